"""The right-hand recording of a stereo pair, read beside the left one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from railinspect.video import Frame, Source

TOGETHER_S = 0.010
"""Pictures farther apart in time than this are no pair: at 40 m/s the train moves 0.4 m."""


class RightPictures:
    """Gives the right picture of each left one, by media time: a lost frame shifts nothing.

    Args:
        source: The right-hand recording; it is closed with this object.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._frames = iter(source)
        self._next: Frame | None = next(self._frames, None)

    def at(self, time_s: float) -> npt.NDArray[np.uint8] | None:
        """The picture taken at a time, or None where there is none or it is damaged.

        Args:
            time_s: Media time, s, not before that of the last call.
        """
        while self._next is not None and self._next.time_s < time_s - TOGETHER_S:
            self._next = next(self._frames, None)
        frame = self._next
        apart = math.inf if frame is None else abs(frame.time_s - time_s)
        if frame is None or apart > TOGETHER_S or frame.damaged:
            return None
        return frame.rgb

    def close(self) -> None:
        """Release the recording."""
        self._source.close()
