"""What every input of the frame loop is: frames in order, each with its place in time.

Nothing here holds more than a few frames, however long the recording.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

MAX_BREAKS: Final = 1000
"""Breaks of one input that are listed; more are only counted."""


@dataclass(frozen=True)
class Frame:
    """One picture with its place in time.

    Attributes:
        index: Position in the input, 0 for the first frame delivered.
        time_s: Presentation time, seconds, strictly increasing within an input.
        rgb: Image, uint8, shape (H, W, 3).
        damaged: The decoder had to invent part of the picture.
        stamp_ns: Unix time, nanoseconds, by the source's ``stamped_by``; None where it has none.
        arrived_s: ``time.monotonic()`` when a live frame came in, seconds; None elsewhere.
    """

    index: int
    time_s: float
    rgb: npt.NDArray[np.uint8]
    damaged: bool = False
    stamp_ns: int | None = None
    arrived_s: float | None = None


@dataclass(frozen=True)
class Break:
    """Where an input stopped being readable although more of it was announced.

    Attributes:
        time_s: Presentation time of the last frame before the break, seconds.
        frame_index: Index of that frame.
        reason: What went wrong, one sentence without a full stop.
    """

    time_s: float
    frame_index: int
    reason: str


@dataclass(frozen=True)
class LiveCount:
    """What became of a live source's frames; latencies run from a frame's arrival to its record.

    Attributes:
        received: Frames that came in since the live edge was reached.
        dropped: Those of them that were not inspected because newer ones had come.
        skipped: Frames already in the file when following began.
        reconnects: How often the connection was lost and made again.
        latency_s: Of the last frame, seconds; None before the first.
        latency_median_s: Median over all frames, seconds, to 10 ms.
        latency_p95_s: 95 % of the frames stayed below this, seconds, to 10 ms.
        latency_worst_s: Worst of all frames, seconds.
    """

    received: int = 0
    dropped: int = 0
    skipped: int = 0
    reconnects: int = 0
    latency_s: float | None = None
    latency_median_s: float | None = None
    latency_p95_s: float | None = None
    latency_worst_s: float | None = None


Kind = Literal["video", "folder", "image", "bag", "live"]


class Source(ABC):
    """An input that can be iterated once, in order.

    Attributes:
        path: The file or folder; for an address, a path that only names it.
        kind: "video", "folder", "image", "bag" (messages with pictures) or "live".
        size_wh: Size of the first picture, pixels.
        frames_expected: Announced number of frames, or None; only good for a progress bar.
        duration_s: Announced duration, seconds, or None.
        stamped_by: Whose clock the frames' ``stamp_ns`` are by, in words; None where there are
            none.
        breaks: Where reading failed, the first 1000; complete once the iteration has ended.
        break_count: How often reading failed.
    """

    kind: Kind

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size_wh = (0, 0)
        self.frames_expected: int | None = None
        self.duration_s: float | None = None
        self.stamped_by: str | None = None
        self.breaks: list[Break] = []
        self.break_count = 0

    def note_break(self, time_s: float, frame_index: int, reason: str) -> None:
        """Record that reading failed after a frame."""
        self.break_count += 1
        if len(self.breaks) < MAX_BREAKS:
            self.breaks.append(Break(time_s, frame_index, reason))

    @property
    def live(self) -> LiveCount | None:
        """What became of a live source's frames so far; None for a recording."""
        return None

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""

    def clock(self) -> tuple[float, float] | None:
        """Times of the first and the last frame, seconds, by which the input may be cut.

        None where the times cannot be told without decoding, or do not rise as they should.
        Before the iteration only.
        """
        return None

    def seek(self, time_s: float, remember: int = 0) -> list[float]:
        """Leave out frames before a media time, as far as that saves work.

        The next frame is the one at ``time_s`` or any before it; indices count from it. Frames
        and times are those that reading from the beginning gives. Before the iteration only.

        Args:
            time_s: Media time, seconds.
            remember: Of how many of the frames left out, at most, the times are wanted.

        Returns:
            The times of the last frames left out, seconds, rising.
        """
        return []

    def done(self, frame: Frame) -> None:  # noqa: B027  # only live sources keep count
        """The frame's record has been written."""

    @abstractmethod
    def close(self) -> None:
        """Release the file."""
