"""Satellite fixes: places at clock times, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError

Array = npt.NDArray[np.float64]

EARTH_RADIUS_M: Final = 6_371_008.8
"""Mean radius of the Earth, metres."""

MAX_FIXES: Final = 5_000_000
"""More fixes than this are refused: ten per second for almost six days."""


@dataclass(frozen=True)
class Fixes:
    """Fixes in the order of their file.

    Attributes:
        what: What they were read from, for messages, such as ``positions ride.gpx``.
        unix_s: Clock times, seconds since 1970, shape (N,).
        latitude_deg: Degrees north, −90 … 90, shape (N,).
        longitude_deg: Degrees east, −180 … 180, shape (N,).
        speed_mps: Speeds the receiver stated, m/s, shape (N,); NaN where it stated none.
    """

    what: str
    unix_s: Array
    latitude_deg: Array
    longitude_deg: Array
    speed_mps: Array

    def __post_init__(self) -> None:
        for name, limit in (("latitude", 90.0), ("longitude", 180.0)):
            values = getattr(self, f"{name}_deg")
            if (wrong := ~(np.abs(values) <= limit)).any():
                at = int(np.flatnonzero(wrong)[0])
                raise BadInputError(
                    f"{self.what}, fix {at + 1}: {name} is {values[at]:g}°; expected "
                    f"−{limit:g} to {limit:g}"
                )


class FixList:
    """Gathers fixes while a file is read.

    Args:
        what: What they are read from, for messages.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._rows: list[tuple[float, float, float, float]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, unix_s: float, place_deg: tuple[float, float], speed_mps: float) -> None:
        """Append a fix; one that repeats the last is left out (receivers do that).

        Raises:
            BadInputError: if there are more than ``MAX_FIXES``.
        """
        if self._rows and self._rows[-1][:3] == (unix_s, *place_deg):
            return
        if len(self._rows) >= MAX_FIXES:
            raise BadInputError(
                f"{self._what} has more than {MAX_FIXES // 1_000_000} million fixes; cut it to the "
                "recording"
            )
        self._rows.append((unix_s, *place_deg, speed_mps))

    def fixes(self) -> Fixes:
        """Everything added."""
        return Fixes(self._what, *np.array(self._rows, float).reshape(-1, 4).T)


def steps_m(latitude_deg: Array, longitude_deg: Array) -> Array:
    """Distance from each place to the next, metres, on a sphere; for places close together.

    Args:
        latitude_deg: Degrees north, shape (N,).
        longitude_deg: Degrees east, shape (N,).

    Returns:
        Shape (N − 1,). The antimeridian is no obstacle.

    Example:
        >>> steps_m(np.array([0.0, 0.0]), np.array([179.9995, -179.9995])).round(1)
        array([111.2])
    """
    north = np.radians(np.diff(latitude_deg))
    east = np.radians(wrapped_deg(np.diff(longitude_deg)))
    middle = np.radians((latitude_deg[1:] + latitude_deg[:-1]) / 2)
    return np.asarray(EARTH_RADIUS_M * np.hypot(north, east * np.cos(middle)), float)


def wrapped_deg(angle_deg: Array) -> Array:
    """Angles, degrees, brought to −180 … 180."""
    return np.asarray((angle_deg + 180.0) % 360.0 - 180.0, float)
