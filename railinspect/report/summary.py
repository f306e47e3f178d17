"""Condensing ``frames.jsonl`` to what a report shows, in memory that does not grow with it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

BINS: Final = 1000
"""Columns of a timeline."""

MAX_STRETCHES: Final = 200
"""Stretches without a verdict that are listed for one input; the longest are kept."""

_SEVERITY: Final = {"clear": 0, "finding": 1, "unknown": 2}


@dataclass
class Stretch:
    """Successive frames in which nothing could be said.

    Attributes:
        first_s: Media time of the first such frame, seconds.
        last_s: Media time of the last.
        first_frame: Index of the first.
        frames: How many.
        reasons: How often each reason was given, numbers replaced by "…".
    """

    first_s: float
    last_s: float
    first_frame: int
    frames: int = 0
    reasons: Counter[str] = field(default_factory=Counter)


@dataclass
class InputTimeline:
    """One input over time.

    Attributes:
        first_s: Media time of the first frame, seconds.
        last_s: Media time of the last frame, seconds.
        status: Worst status in each of the columns, None where no frame falls.
        points: (column, range in metres, event id) of confirmed findings, one per column and
            event.
        stretches: Where nothing could be said, in order, at most ``MAX_STRETCHES``.
        dropped_stretches: How many more there were.
        reasons: How many frames each reason accounts for.
    """

    first_s: float
    last_s: float
    status: list[str | None] = field(default_factory=lambda: [None] * BINS)
    points: dict[tuple[int, int], float] = field(default_factory=dict)
    stretches: list[Stretch] = field(default_factory=list)
    dropped_stretches: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    _open: Stretch | None = None

    def column(self, time_s: float) -> int:
        """Column of a time, 0 to ``BINS - 1``."""
        share = (time_s - self.first_s) / max(self.last_s - self.first_s, 1e-9)
        return min(max(int(share * BINS), 0), BINS - 1)

    def add(self, frame: Mapping[str, Any]) -> None:
        """Take in one line of ``frames.jsonl``."""
        status, time_s = frame["status"], frame["time_s"]
        column = self.column(time_s)
        worst = self.status[column]
        if worst is None or _SEVERITY[status] > _SEVERITY[worst]:
            self.status[column] = status
        for found in frame["findings"]:
            if found["event_id"] is not None and found["range_m"] is not None:
                self.points.setdefault((column, found["event_id"]), found["range_m"])
        if status == "unknown":
            self._add_unknown(frame)
        else:
            self._close_stretch()

    def finish(self) -> None:
        """After the last frame."""
        self._close_stretch()
        self._fill_gaps()

    def _add_unknown(self, frame: Mapping[str, Any]) -> None:
        reason = general(frame["reason"] or "no reason given")
        if len(self.reasons) < 100 or reason in self.reasons:
            self.reasons[reason] += 1
        if self._open is None:
            self._open = Stretch(frame["time_s"], frame["time_s"], frame["index"])
        self._open.last_s = frame["time_s"]
        self._open.frames += 1
        if len(self._open.reasons) < 20 or reason in self._open.reasons:
            self._open.reasons[reason] += 1

    def _close_stretch(self) -> None:
        if self._open is None:
            return
        self.stretches.append(self._open)
        self._open = None
        if len(self.stretches) > MAX_STRETCHES:
            shortest = min(range(len(self.stretches)), key=lambda i: self.stretches[i].frames)
            del self.stretches[shortest]
            self.dropped_stretches += 1

    def _fill_gaps(self) -> None:
        """Columns narrower than a frame take the status of the frame before them."""
        filled = [index for index, status in enumerate(self.status) if status is not None]
        # Twice the usual spacing of frames is still drawn as continuous; longer holes stay holes.
        widest = max(2 * BINS // max(len(filled), 1), 1)
        for before, after in pairwise([*filled, BINS]):
            for index in range(before + 1, min(after, before + 1 + widest)):
                self.status[index] = self.status[before]


def general(reason: str) -> str:
    """A reason with its numbers replaced, so that equal causes count together.

    Example:
        >>> general("growing stopped at row 231: rails merge at 41.5 m")
        'growing stopped at row …: rails merge at … m'
    """
    return re.sub(r"-?[0-9]+(?:[.,][0-9]+)*", "…", reason)


def summarise(
    frames: Iterable[Mapping[str, Any]], inputs: Iterable[Mapping[str, Any]]
) -> dict[str, InputTimeline]:
    """One timeline per input that has frames, by the input's name."""
    timelines = {
        one["name"]: InputTimeline(one["first_time_s"], one["last_time_s"])
        for one in inputs
        if one["frames"]
    }
    for frame in frames:
        if frame["input"] in timelines:
            timelines[frame["input"]].add(frame)
    for timeline in timelines.values():
        timeline.finish()
    return timelines
