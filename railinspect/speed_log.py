"""A train's speed over time, as a log has it, and how wrong it may be between the log's entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railops.traction import MAX_SPEED_MPS

Array = npt.NDArray[np.float64]

CHANGE_MPS2: Final = 1.5
"""No train changes its speed faster than this between two entries of a log, m/s²."""

LONGEST_GAP_S: Final = 10.0
"""Between entries further apart than this the speed is unknown, seconds."""


@dataclass(frozen=True)
class Speed:
    """A speed, m/s, >= 0, and the largest error it may have, m/s."""

    speed_mps: float
    error_mps: float


class SpeedLog:
    """Speeds at rising times.

    Args:
        source: What the log was read from, for reports.
        time_s: Media times, seconds, strictly rising. Shape (N,), N >= 2.
        speed_mps: Speeds, m/s, 0 … 150. Shape (N,).
        error_mps: Their largest errors, m/s, >= 0. Shape (N,) or a single number.

    Raises:
        BadInputError: if a value lies outside its range or the times do not rise.
    """

    def __init__(
        self,
        source: str,
        time_s: Sequence[float] | Array,
        speed_mps: Sequence[float] | Array,
        error_mps: Sequence[float] | Array | float = 0.0,
    ) -> None:
        self.source = source
        self._time_s = np.array(time_s, float)
        self._speed_mps = np.array(speed_mps, float)
        self._error_mps = np.broadcast_to(np.array(error_mps, float), self._time_s.shape)
        if self._time_s.size < 2:
            raise BadInputError(f"speed log {source} has fewer than two entries; give a longer one")
        self._check(np.isfinite(self._time_s), "time {time} s is no finite number")
        rising = np.diff(self._time_s, prepend=-np.inf) > 0
        self._check(rising, "time {time} s does not come after the entry before; sort the log")
        self._check(
            (self._speed_mps >= 0) & (self._speed_mps <= MAX_SPEED_MPS),
            f"speed {{speed}} m/s at {{time}} s; expected 0 to {MAX_SPEED_MPS:g} m/s (a column in "
            "km/h is called speed_kmh)",
        )
        sound = (self._error_mps >= 0) & (self._error_mps <= MAX_SPEED_MPS)
        self._check(sound, "the error of the speed at {time} s is negative or no number")

    def _check(self, good: npt.NDArray[np.bool_], complaint: str) -> None:
        if not good.all():
            at = int(np.flatnonzero(~good)[0])
            said = complaint.format(time=f"{self._time_s[at]:g}", speed=f"{self._speed_mps[at]:g}")
            raise BadInputError(f"speed log {self.source}: {said}")

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last entry, seconds."""
        return float(self._time_s[0]), float(self._time_s[-1])

    @property
    def highest_mps(self) -> float:
        """The highest speed in it, m/s."""
        return float(self._speed_mps.max())

    def at(self, time_s: float) -> Speed | None:
        """The speed at a media time, linear between entries, with its largest error.

        Between two entries T apart a train that changes its speed by at most a = 1.5 m/s² may
        have left the straight line, τ after the first one, by at most the larger of
        min((a − s)·τ, (a + s)·(T − τ)) and min((a + s)·τ, (a − s)·(T − τ)), s being the line's
        slope. The larger of the entries' own errors comes on top.

        Returns:
            None outside the log's span, and between entries more than 10 s apart.

        Example:
            >>> log = SpeedLog("a log", [0.0, 2.0], [20.0, 21.0])
            >>> log.at(0.0), log.at(1.0), log.at(2.5)
            (Speed(speed_mps=20.0, error_mps=0.0), Speed(speed_mps=20.5, error_mps=1.0), None)
        """
        first, last = self.span_s
        if not first <= time_s <= last:
            return None
        after = max(1, int(np.searchsorted(self._time_s, time_s)))
        before = after - 1
        gap_s = float(self._time_s[after] - self._time_s[before])
        gone_s = float(time_s - self._time_s[before])
        left_s = float(self._time_s[after] - time_s)
        own_mps = float(self._error_mps[[before, after]].max())
        if gone_s == 0.0 or left_s == 0.0:
            entry = before if gone_s == 0.0 else after
            return Speed(float(self._speed_mps[entry]), float(self._error_mps[entry]))
        if gap_s > LONGEST_GAP_S:
            return None
        slope = float(self._speed_mps[after] - self._speed_mps[before]) / gap_s
        speed = float(self._speed_mps[before]) + slope * gone_s
        change = max(CHANGE_MPS2, abs(slope))
        above = min((change - slope) * gone_s, (change + slope) * left_s)
        below = min((change + slope) * gone_s, (change - slope) * left_s)
        return Speed(speed, own_mps + float(max(above, below)))
