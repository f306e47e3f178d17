"""Inspecting one or more inputs into one run folder."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, replace
from datetime import UTC, datetime
from logging import WARNING
from pathlib import Path
from typing import Any, Final, Protocol

import cv2

from railinspect.errors import BadInputError, OutputError
from railinspect.events import Event
from railinspect.fovea import for_stills
from railinspect.input_results import InputResults, InputSummary
from railinspect.inspect_settings import InspectSettings
from railinspect.logs import note
from railinspect.pipeline import Inspector, SegmentFunction, Steps, segmented_frames
from railinspect.progress import Progress, Report
from railinspect.records import FrameRecord
from railinspect.report import write_report
from railinspect.right_pictures import RightPictures
from railinspect.run_summary import RunSummary
from railinspect.runfolder import RunFolder, unique_names
from railinspect.runinfo import run_info, write_json
from railinspect.sinks import JsonLines, OverlayVideo, draw_overlay, write_events_parquet
from railinspect.speed_log import SpeedLog
from railinspect.video import Frame, Source, open_source
from railinspect.warmup import warm_up

MAX_LOGGED_BREAKS: Final = 100
"""Breaks of one input that are logged; all that are kept stand in ``run.json``."""

LOGGED_OF_EVENT: Final = (
    "id",
    "input",
    "type",
    "confidence",
    "first_time_s",
    "last_time_s",
    "first_range_m",
    "closest_range_m",
    "advice",
)
"""What the log says about an event; the rest is in ``events.jsonl``."""


class Viewer(Protocol):
    """Something beside the run folder that is shown every frame."""

    def write(self, name: str, frame: Frame, record: FrameRecord) -> None:
        """Take in one frame of an input and its record."""


def inspect_inputs(
    inputs: Sequence[str | Path],
    out: str | Path,
    segmenter: SegmentFunction,
    settings: InspectSettings | None = None,
    *,
    progress: Report | None = None,
    steps: Steps | None = None,
    viewer: Viewer | None = None,
) -> RunSummary:
    """Inspect inputs one after another and write a run folder.

    Every input is opened before the run folder is touched, so a misspelt name costs nothing. If
    the run is interrupted or fails, what was finished is published, ``run.json`` says
    ``"complete": false``, and the exception goes on to the caller.

    Args:
        inputs: Video files, image folders or images.
        out: The run folder to create.
        segmenter: Callable from an RGB image to a ``Segmentation``.
        settings: How to inspect.
        progress: Called after every frame and every input.
        steps: Replaces single steps of the frame loop.
        viewer: Also given every frame with its record.

    Returns:
        The summary, also stored as ``run.json``.

    Raises:
        BadInputError: if an input cannot be read.
        OutputError: if the folder cannot be written to or already holds a run.
    """
    settings = settings or InspectSettings()
    paths = [Path(one) for one in inputs]
    if settings.right is not None:
        if len(paths) > 1:
            raise BadInputError(
                f"the right-hand recording {settings.right} fits one input, not {len(paths)}; "
                "inspect them one by one"
            )
        if settings.stereo is None:
            raise BadInputError("a right-hand recording needs the stereo pair's calibration")
        open_source(settings.right, settings.folder_rate_hz).close()
    for path in paths[1:]:
        open_source(path, settings.folder_rate_hz, topic=settings.topic).close()
    first = open_source(paths[0], settings.folder_rate_hz, topic=settings.topic)
    try:
        _check_speed_log(settings.speed_log, paths, first)
        run = _Run(RunFolder.claim(out), paths, segmenter, settings, steps, viewer)
    except BaseException:
        first.close()
        raise
    return run.inspect(first, progress)


def inspect_live(
    source: Source,
    out: str | Path,
    segmenter: SegmentFunction,
    settings: InspectSettings | None = None,
    *,
    progress: Report | None = None,
    steps: Steps | None = None,
    viewer: Viewer | None = None,
) -> RunSummary:
    """Inspect one source that is already open, such as a ``LiveSource``, into a run folder.

    Its files can be read while the run goes on, under their names plus ``.part``.

    Args:
        source: The source; it is closed at the end.
        out: The run folder to create.
        segmenter: Callable from an RGB image to a ``Segmentation``.
        settings: How to inspect.
        progress: Called after every frame, and at the end.
        steps: Replaces single steps of the frame loop.
        viewer: Also given every frame with its record.

    Returns:
        The summary, also stored as ``run.json``.

    Raises:
        OutputError: if the folder cannot be written to or already holds a run.
    """
    settings = settings or InspectSettings()
    try:
        run = _Run(RunFolder.claim(out), [source.path], segmenter, settings, steps, viewer)
    except BaseException:
        source.close()
        raise
    return run.inspect(source, progress)


def _check_speed_log(log: SpeedLog | None, paths: Sequence[Path], source: Source) -> None:
    """Refuse a log that cannot belong to the input.

    Raises:
        BadInputError: if there are several inputs, or the log and the recording do not overlap.
    """
    if log is None:
        return
    if len(paths) > 1:
        raise BadInputError(
            f"speed log {log.source} fits one recording, not {len(paths)}; inspect them one by one"
        )
    first, last = log.span_s
    if last < 0 or (source.duration_s is not None and first > source.duration_s):
        raise BadInputError(
            f"speed log {log.source} runs from {first:.1f} s to {last:.1f} s of media time, the "
            f"recording from 0 s to {source.duration_s or 0:.1f} s; check the times and --started"
        )


class _Run:
    """The state of one run: its open files and its counts."""

    def __init__(
        self,
        folder: RunFolder,
        paths: list[Path],
        segmenter: SegmentFunction,
        settings: InspectSettings,
        steps: Steps | None,
        viewer: Viewer | None,
    ) -> None:
        self._viewer = viewer
        self._folder, self._paths, self._settings = folder, paths, settings
        self._segmenter, self._steps = segmenter, steps
        self._started = datetime.now(UTC)
        self._summaries: list[InputSummary] = []
        self._events: list[dict[str, Any]] = []
        self._next_id = 1
        self._frames = 0
        self._seconds = 0.0

    def inspect(self, first: Source, progress: Report | None) -> RunSummary:
        """Inspect every input; publish whatever was finished, whatever happens."""
        complete = False
        self._frames_file = JsonLines(self._folder.part("frames.jsonl"))
        self._events_file = JsonLines(self._folder.part("events.jsonl"))
        self._write_run_json(complete=False)
        try:
            warm_up()
            names = unique_names(self._paths)
            for path, name in zip(self._paths, names, strict=True):
                source = first if not self._summaries else self._open(path)
                self._one(source, name, progress)
            complete = True
        except OSError as error:
            raise OutputError(
                f"cannot go on writing to {self._folder.path}: {error.strerror or error}; what "
                "was finished is kept"
            ) from error
        finally:
            self._frames_file.close()
            self._events_file.close()
            summary = self._publish(complete)
        return summary

    def _open(self, path: Path) -> Source:
        return open_source(path, self._settings.folder_rate_hz, topic=self._settings.topic)

    def _one(self, source: Source, name: str, progress: Report | None) -> None:
        summary = InputSummary.of(source, name)
        self._summaries.append(summary)
        note("input begun", input=name, path=summary.path, kind=source.kind, size_wh=source.size_wh)
        still = source.kind == "image"
        segmenter = self._segmenter
        if still:
            segmenter = for_stills(segmenter, self._settings.camera)
        inspector = self._settings.inspector(
            segmenter, source.kind, first_event_id=self._next_id, steps=self._steps
        )
        results = InputResults(summary, self._frames_file, self._events_file, self._folder.part)
        began_s, before_s = time.perf_counter(), self._seconds
        with ExitStack() as stack:
            overlay: OverlayVideo | None = None
            if self._settings.overlay and not still:
                summary.overlay = f"overlay/{name}.mp4"
                overlay = OverlayVideo(self._folder.part(summary.overlay), source.size_wh)
                stack.callback(overlay.close)
            stack.callback(self._end_input, inspector, results, source)
            frames = stack.enter_context(closing(segmented_frames(source, segmenter)))
            right = self._right(stack)
            for frame, segmentation in frames:
                beside = right.at(frame.time_s) if right is not None else None
                record = inspector.feed(frame, segmentation, beside)
                results.add_frame(record)
                self._add_events(results, inspector.take_ended())
                if overlay is not None:
                    overlay.write(frame.rgb, record)
                elif self._settings.overlay:
                    self._overlay_still(frame, record, summary)
                if self._viewer is not None:
                    self._viewer.write(name, frame, record)
                source.done(frame)
                summary.live = source.live
                self._frames += 1
                self._seconds = before_s + time.perf_counter() - began_s
                if progress is not None:
                    progress(self._progress(source, summary))
        self._seconds = before_s + time.perf_counter() - began_s
        note("input ended", **asdict(replace(summary, breaks=[])))
        if progress is not None:
            progress(replace(self._progress(source, summary), inputs_done=len(self._summaries)))

    def _progress(self, source: Source, summary: InputSummary) -> Progress:
        return Progress(
            summary.name,
            self._frames,
            self._share(source, summary),
            unknown_frames=sum(one.unknown_frames for one in self._summaries),
            events=sum(one.events for one in self._summaries),
            dropped_frames=summary.live.dropped if summary.live else 0,
            latency_s=summary.live.latency_s if summary.live else None,
            inputs=len(self._paths),
            inputs_done=len(self._summaries) - 1,
        )

    def _right(self, stack: ExitStack) -> RightPictures | None:
        if self._settings.right is None:
            return None
        return stack.enter_context(closing(RightPictures(self._open(self._settings.right))))

    def _share(self, source: Source, summary: InputSummary) -> float | None:
        """Share done: by media time where a duration is announced, else by frames."""
        if source.duration_s:
            own = ((summary.last_time_s or 0.0) - (summary.first_time_s or 0.0)) / source.duration_s
        elif source.frames_expected:
            own = summary.frames / source.frames_expected
        else:
            return None
        return (len(self._summaries) - 1 + min(own, 1.0)) / len(self._paths)

    def _end_input(self, inspector: Inspector, results: InputResults, source: Source) -> None:
        self._add_events(results, inspector.finish())
        self._next_id = inspector.next_event_id
        results.summary.live = source.live
        results.summary.break_count = source.break_count
        results.summary.breaks = source.breaks
        for broken in source.breaks[:MAX_LOGGED_BREAKS]:
            note("reading failed", level=WARNING, input=results.summary.name, **asdict(broken))

    def _add_events(self, results: InputResults, events: Iterable[Event]) -> None:
        for row in results.add_events(events):
            self._events.append(row)
            note("event ended", **{key: row[key] for key in LOGGED_OF_EVENT})

    def _overlay_still(self, frame: Frame, record: FrameRecord, summary: InputSummary) -> None:
        summary.overlay = f"overlay/{summary.name}.png"
        drawn = cv2.cvtColor(draw_overlay(frame.rgb, record), cv2.COLOR_RGB2BGR)
        data = cv2.imencode(".png", drawn)[1].tobytes()
        self._folder.part(summary.overlay).write_bytes(data)

    def _publish(self, complete: bool) -> RunSummary:
        inputs = tuple(self._summaries)
        summary = RunSummary(self._folder.path, inputs, self._seconds, complete)
        write_events_parquet(self._folder.part("events.parquet"), self._events)
        self._write_run_json(complete)
        write_report(self._folder)
        self._folder.publish()
        return summary

    def _write_run_json(self, complete: bool) -> None:
        summary = RunSummary(self._folder.path, tuple(self._summaries), self._seconds, complete)
        counts = summary.as_json()
        del counts["paths"]
        info = run_info(self._started, self._segmenter, self._settings)
        info |= {"counts": counts, "inputs": [asdict(one) for one in self._summaries]}
        write_json(self._folder.part("run.json"), info)
