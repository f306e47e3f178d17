"""The train on its way through one recording: how fast and where it is at each media time."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Final

from railinspect.speed_log import SpeedLog
from railops.braking import BrakeMoments, Policy, RangeMeasurement, Train, brake_moments

REMEMBERED: Final = 7500
"""So many last frames are remembered: five minutes at 25 per second."""


class Journey:
    """A train whose speed comes from a log, is assigned, or is taken to be constant.

    The place is counted from the speed; ``train.position_m`` is that of the first frame.

    Args:
        train: The train as the recording begins.
        log: Its speed over media time; None for the train's own, constant or assigned.
        speed_is_known: False where the train's own speed is only assumed.
    """

    def __init__(
        self, train: Train, log: SpeedLog | None = None, speed_is_known: bool = True
    ) -> None:
        self.train = train
        self._log = log
        self._own_error_mps = train.speed_error_mps
        self._assumed = not speed_is_known
        self._unknown = False
        self._lost = False
        self._time_s: float | None = None
        self._way: deque[tuple[float, Train | None]] = deque(maxlen=REMEMBERED)

    @property
    def speed_mps(self) -> float | None:
        """The speed, m/s; None where it is unknown or only assumed."""
        return None if self._unknown or self._assumed else self.train.speed_mps

    @property
    def in_doubt(self) -> bool:
        """Whether the speed is unknown now, or was, and with it the place on an uneven line.

        ``train`` then has the log's highest speed. An assumed constant speed is no doubt: it is
        the user's word.
        """
        return self._unknown or self._lost

    def assign(self, speed_mps: float) -> None:
        """The speed from now on, m/s, in place of any log's."""
        self.train = replace(self.train, speed_mps=speed_mps, speed_error_mps=self._own_error_mps)
        self._log, self._assumed, self._unknown = None, False, False

    def advance(self, time_s: float) -> None:
        """Go on to the next frame's media time, seconds, later than the one before."""
        speed, error = self.train.speed_mps, self.train.speed_error_mps
        if self._log is not None:
            read = self._log.at(time_s)
            self._unknown = read is None
            speed = read.speed_mps if read else self._log.highest_mps
            error = self._own_error_mps + (read.error_mps if read else 0.0)
        run_m = 0.0
        if self._time_s is not None:
            run_m = 0.5 * (self.train.speed_mps + speed) * (time_s - self._time_s)
        line = self.train.line
        if self._unknown and len(line.gradients) + len(line.curves) > 2:
            self._lost = True
        self.train = replace(
            self.train,
            speed_mps=speed,
            speed_error_mps=error,
            position_m=self.train.position_m + run_m,
        )
        self._time_s = time_s
        self._way.append((time_s, None if self.in_doubt else self.train))

    def place_m(self, measured: RangeMeasurement, policy: Policy) -> float | None:
        """Position on the line that what was measured just now is at least at, metres.

        None where the train's own place is in doubt.
        """
        if self.in_doubt:
            return None
        return self.train.position_m + policy.range_lower_m(measured)

    def moments(self, until_s: float, place_m: float, policy: Policy) -> BrakeMoments:
        """When braking for a place had to start, looking back from a media time, seconds."""
        way = [passed for passed in self._way if passed[0] <= until_s]
        return brake_moments(way, place_m, policy)
