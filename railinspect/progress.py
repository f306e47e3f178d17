"""How far a run is, and a one-line display of it: share done, frames per second, time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TextIO

_REDRAW_S: Final = 0.1
_PLAIN_S: Final = 10.0
_WIDTH: Final = 28


@dataclass(frozen=True)
class Progress:
    """How far a run is; every count is over the whole run so far.

    Attributes:
        name: Name of the present input.
        frames: Frames inspected.
        share: Share of all inputs that is done, 0 to 1; None if an input does not say how long
            it is.
        unknown_frames: Frames in which nothing can be said.
        events: Events that ended.
        dropped_frames: Frames a live source delivered and nothing inspected.
        latency_s: From a live frame's arrival to its record, seconds; None where nothing is live.
        inputs: How many inputs the run has.
        inputs_done: How many of them are finished.
        inputs_bad: How many of them could not be read.
    """

    name: str
    frames: int
    share: float | None
    unknown_frames: int = 0
    events: int = 0
    dropped_frames: int = 0
    latency_s: float | None = None
    inputs: int = 1
    inputs_done: int = 0
    inputs_bad: int = 0


Report = Callable[[Progress], None]
"""What a run calls after every frame and after every input."""


class ProgressLine:
    """Redraws one line on a terminal; elsewhere writes a plain line every ten seconds.

    Args:
        title: What is being done.
        stream: Where to write; default: standard error.
        quiet: Write nothing at all.
    """

    def __init__(self, title: str, stream: TextIO | None = None, quiet: bool = False) -> None:
        self._title, self._stream, self._quiet = title, stream or sys.stderr, quiet
        self._terminal = self._stream.isatty()
        self._start_s = self._drawn_s = time.monotonic()
        self._dirty = False

    def show(self, frames: int, share: float | None) -> None:
        """Report ``frames`` done, which is ``share`` (0 to 1) of the whole if that is known."""
        now_s = time.monotonic()
        wait_s = _REDRAW_S if self._terminal else _PLAIN_S
        if self._quiet or now_s - self._drawn_s < wait_s:
            return
        self._drawn_s = now_s
        text = self._text(frames, share, now_s - self._start_s)
        if self._terminal:
            self._stream.write(f"\r{text}\x1b[K")
            self._dirty = True
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def close(self) -> None:
        """Clear the line, so that what follows starts on a clean one."""
        if self._dirty:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._dirty = False

    def _text(self, frames: int, share: float | None, elapsed_s: float) -> str:
        rate = frames / max(elapsed_s, 1e-6)
        if share is None or share <= 0:
            return f"{self._title}  {frames} frames  {rate:.1f} frames/s"
        share = min(share, 1.0)
        filled = round(share * _WIDTH)
        bar = "━" * filled + "─" * (_WIDTH - filled)
        left = duration(elapsed_s * (1 - share) / share)
        return (
            f"{self._title}  {bar} {share:4.0%}  {frames} frames  {rate:.1f} frames/s  {left} left"
        )


def duration(seconds: float) -> str:
    """A waiting time for people.

    Example:
        >>> duration(7.6), duration(75), duration(3720)
        ('8 s', '1 min 15 s', '1 h 02 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
