"""Where the train was at each media time, and where the track ahead of it runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.positions.fixes import Fixes, steps_m, wrapped_deg
from railinspect.speed_log import LONGEST_GAP_S

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """A place, degrees north and degrees east (WGS 84)."""

    latitude_deg: float
    longitude_deg: float


class PositionLog:
    """Places at rising media times, linear between them.

    Between fixes further apart than 10 s (a tunnel) the place is unknown.

    Args:
        source: What the places were read from.
        time_s: Media times, seconds. Shape (N,), N >= 1.
        latitude_deg: Degrees north, shape (N,).
        longitude_deg: Degrees east, shape (N,).

    Raises:
        BadInputError: if the times do not rise strictly or there are none.
    """

    def __init__(
        self,
        source: str,
        time_s: npt.ArrayLike,
        latitude_deg: npt.ArrayLike,
        longitude_deg: npt.ArrayLike,
    ) -> None:
        self.source = source
        self.time_s = np.array(time_s, float)
        self.latitude_deg = np.array(latitude_deg, float)
        self.longitude_deg = np.array(longitude_deg, float)
        if not self.time_s.size:
            raise BadInputError(f"{source} has no place in the recording's time; check --started")
        if (np.diff(self.time_s) <= 0).any():
            at = int(np.flatnonzero(np.diff(self.time_s) <= 0)[0]) + 1
            raise BadInputError(
                f"{source}, fix {at + 1}: its time does not come after the one before; sort it"
            )
        steps = steps_m(self.latitude_deg, self.longitude_deg)
        self._way_m = np.concatenate([[0.0], np.cumsum(steps)])
        self._gap = np.diff(self.time_s) > LONGEST_GAP_S

    @staticmethod
    def within(
        fixes: Fixes, started_unix_s: float, first_time_s: float, last_time_s: float
    ) -> PositionLog:
        """The part of a log that belongs to a recording, in its media time.

        Ten seconds before it and two minutes after it are kept: what is seen at the end lies on
        the track that follows.

        Args:
            fixes: The whole log.
            started_unix_s: Clock time of media time zero, seconds since 1970.
            first_time_s: Media time of the first frame, seconds.
            last_time_s: Media time of the last frame, seconds.

        Raises:
            BadInputError: if no fix falls into it, or the times do not rise.
        """
        time_s = fixes.unix_s - started_unix_s
        kept = (time_s >= first_time_s - LONGEST_GAP_S) & (time_s <= last_time_s + 120.0)
        if not kept.any() and time_s.size:
            raise BadInputError(
                f"{fixes.what} runs from {time_s.min():.1f} s to {time_s.max():.1f} s of media "
                f"time, the recording from {first_time_s:.1f} s to {last_time_s:.1f} s; check when "
                "it started"
            )
        columns = (time_s, fixes.latitude_deg, fixes.longitude_deg)
        return PositionLog(fixes.what, *(column[kept] for column in columns))

    def at(self, time_s: float) -> Place | None:
        """The train's place at a media time, seconds; None outside the log and in its gaps.

        Example:
            >>> log = PositionLog("a log", [0, 2], [50.0, 50.002], [8.0, 8.0])
            >>> log.at(1.0), log.at(3.0)
            (Place(latitude_deg=50.001, longitude_deg=8.0), None)
        """
        where = self._between(time_s)
        return None if where is None else self._place(*where)

    def ahead(self, time_s: float, distance_m: float) -> Place | None:
        """The place a distance further along the way the train then took.

        Args:
            time_s: Media time, seconds.
            distance_m: Distance along the track, metres, >= 0.

        Returns:
            None where the place at that time is unknown, or where the train's known way ends, or
            has a gap, before that distance.
        """
        where = self._between(time_s)
        if where is None:
            return None
        before, share = where
        way = self._way_m[before]
        if before + 1 < self._way_m.size:
            way += share * (self._way_m[before + 1] - way)
        target = way + distance_m
        if target > self._way_m[-1]:
            return None
        after = int(np.searchsorted(self._way_m, target))
        if self._gap[before:after].any():
            return None
        if after == 0:
            return self._place(0, 0.0)
        step = self._way_m[after] - self._way_m[after - 1]
        return self._place(after - 1, float((target - self._way_m[after - 1]) / step))

    def way_m(self, first_time_s: float, last_time_s: float) -> tuple[float, float]:
        """How far the train went between two media times, metres, and for how long of it, seconds.

        What lies outside the log and in its gaps counts in neither.
        """
        low = np.maximum(self.time_s[:-1], first_time_s)
        high = np.minimum(self.time_s[1:], last_time_s)
        inside = np.where(self._gap, 0.0, np.maximum(high - low, 0.0))
        share = inside / np.diff(self.time_s)
        return float((share * np.diff(self._way_m)).sum()), float(inside.sum())

    def _between(self, time_s: float) -> tuple[int, float] | None:
        """Index of the fix before and the share of the way to the next."""
        if not self.time_s[0] <= time_s <= self.time_s[-1]:
            return None
        before = int(np.searchsorted(self.time_s, time_s, side="right")) - 1
        if before == self.time_s.size - 1 or self.time_s[before] == time_s:
            return before, 0.0
        if self._gap[before]:
            return None
        gone = time_s - self.time_s[before]
        return before, float(gone / (self.time_s[before + 1] - self.time_s[before]))

    def _place(self, before: int, share: float) -> Place:
        lat, lon = self.latitude_deg, self.longitude_deg
        if share == 0.0:
            return Place(float(lat[before]), float(lon[before]))
        east = wrapped_deg(np.array([lon[before + 1] - lon[before]]))[0]
        return Place(
            round(float(lat[before] + share * (lat[before + 1] - lat[before])), 9),
            round(float(wrapped_deg(np.array([lon[before] + share * east]))[0]), 9),
        )
