"""What inspecting one input gives: a row per frame and event, a picture per event, and counts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from railinspect.events import Event
from railinspect.records import FrameRecord, event_json
from railinspect.sinks import JsonLines
from railinspect.source import Break, LiveCount, Source


@dataclass
class InputSummary:
    """What one input gave; counts are frames, times are media seconds.

    ``camera_drift`` is the last alarm about the camera, ``drift_frames`` how many frames had one.
    """

    name: str
    path: str
    kind: str
    size_wh: tuple[int, int]
    announced_frames: int | None
    announced_duration_s: float | None
    frames: int = 0
    clear_frames: int = 0
    finding_frames: int = 0
    unknown_frames: int = 0
    followed_frames: int = 0
    speed_unknown_frames: int = 0
    drift_frames: int = 0
    camera_drift: str | None = None
    first_time_s: float | None = None
    last_time_s: float | None = None
    events: int = 0
    overlay: str | None = None
    breaks: list[Break] = field(default_factory=list)
    break_count: int = 0
    stamped_by: str | None = None
    live: LiveCount | None = None

    @staticmethod
    def of(source: Source, name: str) -> InputSummary:
        """The summary of an input of which no frame was inspected yet."""
        return InputSummary(
            name=name,
            path=str(source.path),
            kind=source.kind,
            size_wh=source.size_wh,
            announced_frames=source.frames_expected,
            announced_duration_s=source.duration_s,
            stamped_by=source.stamped_by,
        )

    def count(self, record: FrameRecord) -> None:
        """Count one frame."""
        self.frames += 1
        self.clear_frames += record.status == "clear"
        self.finding_frames += record.status == "finding"
        self.unknown_frames += record.status == "unknown"
        self.followed_frames += record.followed
        self.speed_unknown_frames += record.speed_mps is None
        self.drift_frames += record.camera_drift is not None
        self.camera_drift = record.camera_drift or self.camera_drift
        if self.first_time_s is None:
            self.first_time_s = record.time_s
        self.last_time_s = record.time_s


class InputResults:
    """Writes the rows and pictures of one input and counts them.

    Args:
        summary: Where to count.
        frames: File of the frames' rows.
        events: File of the events' rows.
        place: From a picture's path relative to the run, ``thumbnails/…``, to where to write it.
        labels: Further values of every row.
    """

    def __init__(
        self,
        summary: InputSummary,
        frames: JsonLines,
        events: JsonLines,
        place: Callable[[str], Path],
        labels: Mapping[str, Any] | None = None,
    ) -> None:
        self.summary = summary
        self._frames, self._events, self._place = frames, events, place
        self._labels = labels or {}

    def add_frame(self, record: FrameRecord) -> None:
        """Write and count one frame."""
        self.summary.count(record)
        self._frames.write({"input": self.summary.name, **self._labels, **record.as_json()})

    def add_events(self, events: Iterable[Event]) -> list[dict[str, Any]]:
        """Write and count ended events; returns their rows."""
        rows = []
        for event in events:
            thumbnail = None
            if event.thumbnail_jpeg is not None:
                thumbnail = thumbnail_path(event.id)
                self._place(thumbnail).write_bytes(event.thumbnail_jpeg)
            row = {**event_json(event, self.summary.name, thumbnail), **self._labels}
            self._events.write(row)
            self.summary.events += 1
            rows.append(row)
        return rows


def thumbnail_path(event_id: int) -> str:
    """Where an event's picture lies, relative to the folder of its run or input."""
    return f"thumbnails/event-{event_id:05d}.jpg"
