"""Inspecting one stretch of a recording: the frame loop of a plain run, with an overlap.

The stretch's own frames are written. Before them the inspection runs through a lead-in, so that
what it carries from frame to frame has become what it is in the whole recording; after them it
runs on while an event is in sight, so that the event is complete. What is seen in lead-in and
run-on is kept apart: by it the events of neighbouring stretches are recognised as the same
(:mod:`railinspect.fleet.merge`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from railinspect.fleet.tasks import Cut
from railinspect.input_results import InputResults, InputSummary
from railinspect.inspect_settings import InspectSettings
from railinspect.journey import REMEMBERED
from railinspect.pipeline import Inspector, SegmentFunction
from railinspect.records import FrameRecord
from railinspect.runinfo import write_json
from railinspect.sinks import JsonLines
from railinspect.video import Frame, Source

PART: Final = "part.json"


@dataclass(frozen=True)
class Stretch:
    """A piece of a recording: own frames from ``span_s[0]`` on, before ``span_s[1]``, seconds.

    ``recording_s`` is the time of the recording's first frame.
    """

    span_s: tuple[float, float]
    recording_s: float
    cut: Cut


def inspect_stretch(
    source: Source,
    stretch: Stretch,
    segmenter: SegmentFunction,
    settings: InspectSettings,
    folder: Path,
) -> int:
    """Inspect a stretch and write its part.

    Args:
        source: The recording, opened, not iterated yet; closed in the end.
        stretch: Which part of it.
        segmenter: Callable from an RGB image to a ``Segmentation``.
        settings: How to inspect.
        folder: Existing empty folder to write to.

    Returns:
        How many own frames were inspected.
    """
    with ExitStack() as stack:
        stack.enter_context(closing(source))
        inspector, frames = _begun(source, stretch, segmenter, settings)

        def lines(name: str) -> JsonLines:
            return stack.enter_context(closing(JsonLines(folder / name)))

        def place(name: str) -> Path:
            (folder / name).parent.mkdir(exist_ok=True)
            return folder / name

        summary = InputSummary.of(source, "")
        results = InputResults(summary, lines("frames.jsonl"), lines("events.jsonl"), place)
        first_index, unended = _run(frames, inspector, stretch, results, lines("overlap.jsonl"))
        results.add_events(inspector.finish())
    start_s, end_s = stretch.span_s
    summary.breaks = [one for one in source.breaks if start_s <= one.time_s < end_s]
    listed = len(source.breaks) == source.break_count
    summary.break_count = len(summary.breaks) if listed else source.break_count
    extra = {"path": "", "first_index": first_index, "unended": sorted(unended)}
    document = {**asdict(summary), **extra}
    write_json(folder / PART, document)
    return summary.frames


def _begun(
    source: Source, stretch: Stretch, segmenter: SegmentFunction, settings: InspectSettings
) -> tuple[Inspector, Iterator[Frame]]:
    """The inspector and the frames from the lead-in on, the train being where it then is."""
    from_s = stretch.span_s[0] - stretch.cut.lead_in_s
    train = settings.train
    passed = source.seek(from_s, REMEMBERED if train is not None else 0)
    frames = iter(source)
    ahead: Frame | None = None
    for frame in frames:
        if frame.time_s >= from_s:
            ahead = frame
            break
        passed.append(frame.time_s)
    if passed and train is not None:
        run_m = train.speed_mps * (passed[0] - stretch.recording_s)
        settings = replace(settings, train=replace(train, position_m=train.position_m + run_m))
    inspector = settings.inspector(segmenter, source.kind)
    inspector.pass_by(passed)

    def rest() -> Iterator[Frame]:
        if ahead is not None:
            yield ahead
            yield from frames

    return inspector, rest()


def _run(
    frames: Iterator[Frame],
    inspector: Inspector,
    stretch: Stretch,
    results: InputResults,
    overlap: JsonLines,
) -> tuple[int | None, set[int]]:
    """Feed the frames.

    Returns:
        The index of the first own frame, None if there is none, and the ids of the events that
        had not ended when the run-on did.
    """
    start_s, end_s = stretch.span_s
    first_index: int | None = None
    open_events: set[int] = set()
    for frame in frames:
        if frame.time_s >= end_s and not (
            open_events and frame.time_s < end_s + stretch.cut.run_on_s
        ):
            break
        record = inspector.feed(frame)
        live = inspector.live_ids
        open_events = set(live) if frame.time_s < end_s else open_events.intersection(live)
        if start_s <= frame.time_s < end_s:
            first_index = frame.index if first_index is None else first_index
            results.add_frame(record)
        elif sightings := _confirmed(record):
            overlap.write({"time_s": round(record.time_s, 6), "findings": sightings})
        results.add_events(inspector.take_ended())
    return first_index, open_events


def _confirmed(record: FrameRecord) -> list[dict[str, Any]]:
    """The findings of a frame that belong to an event, as in ``frames.jsonl``."""
    found = record.as_json()["findings"]
    return [
        {"event_id": one["event_id"], "box_xyxy": one["box_xyxy"]}
        for one in found
        if one["event_id"] is not None
    ]
