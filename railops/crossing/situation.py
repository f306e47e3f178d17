"""The situation space: eight measured parameters of a level crossing, their ranges, their scaling.

A situation is one point of the space U of the thesis's chapter 4: what the train, the car and the
air around them are doing. Immune detectors live in the same space, scaled to the unit cube, so that
a metre of distance and a kilometre per hour of speed can be compared at all.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, check_range

Array = npt.NDArray[np.float64]

KMH_PER_MPS = 3.6


class Parameter(NamedTuple):
    """One axis of the space: its name (with the unit in it), and its range in that unit."""

    name: str
    low: float
    high: float
    unit: str
    label: str


SPACE: tuple[Parameter, ...] = (
    Parameter("train_speed_kmh", 0.0, 100.0, "km/h", "train speed"),
    Parameter("car_speed_kmh", 0.0, 150.0, "km/h", "car speed"),
    Parameter("rail_slope_percent", -20.0, 20.0, "%", "railway slope"),
    Parameter("road_slope_percent", -20.0, 20.0, "%", "road slope"),
    Parameter("train_distance_m", -100.0, 1000.0, "m", "train to the rendezvous"),
    Parameter("car_distance_m", -10.0, 1000.0, "m", "car to the rendezvous"),
    Parameter("air_temperature_c", -50.0, 60.0, "°C", "air temperature"),
    Parameter("humidity_percent", 0.0, 100.0, "%", "relative humidity"),
)
"""The thesis's problem space (its Fig. 4.2), in the published order and units."""

DIMENSIONS = len(SPACE)
LOW: Array = np.array([axis.low for axis in SPACE])
HIGH: Array = np.array([axis.high for axis in SPACE])
SPAN: Array = HIGH - LOW
for _constant in (LOW, HIGH, SPAN):
    _constant.setflags(write=False)


@dataclass(frozen=True)
class Situation:
    """One measured situation; distances are to the rendezvous, the crossing, along rail and road.

    Attributes:
        train_speed_kmh: Speed of the train, km/h, 0 … 100.
        car_speed_kmh: Speed of the car, km/h, 0 … 150.
        rail_slope_percent: Railway slope, %, −20 … 20; positive climbs in the train's direction.
        road_slope_percent: Road slope, %, −20 … 20; positive climbs in the car's direction.
        train_distance_m: From the train's front to the crossing, m, −100 … 1000; negative: passed.
        car_distance_m: From the car's front to the crossing, m, −10 … 1000; negative: passed.
        air_temperature_c: Air temperature, °C, −50 … 60.
        humidity_percent: Relative humidity, %, 0 … 100.

    Raises:
        DomainError: if a value is not a finite number in its range.

    Example:
        >>> Situation(80.0, 40.0, 0.0, 0.0, 1000.0, 500.0, 20.0, 50.0).train_speed_mps
        22.22222222222222
    """

    train_speed_kmh: float
    car_speed_kmh: float
    rail_slope_percent: float
    road_slope_percent: float
    train_distance_m: float
    car_distance_m: float
    air_temperature_c: float
    humidity_percent: float

    def __post_init__(self) -> None:
        for axis, value in zip(SPACE, astuple(self), strict=True):
            check_range(axis.name, value, axis.low, axis.high, axis.unit)

    @property
    def train_speed_mps(self) -> float:
        """Speed of the train, m/s."""
        return self.train_speed_kmh / KMH_PER_MPS

    @property
    def car_speed_mps(self) -> float:
        """Speed of the car, m/s."""
        return self.car_speed_kmh / KMH_PER_MPS

    def array(self) -> Array:
        """The eight values in the order of :data:`SPACE`, shape (8,)."""
        return np.array(astuple(self), dtype=np.float64)

    @staticmethod
    def of(values: Sequence[float]) -> Situation:
        """A situation from eight numbers in the order of :data:`SPACE`.

        Raises:
            DomainError: if there are not exactly eight, or one lies outside its range.
        """
        if len(values) != DIMENSIONS:
            names = ", ".join(axis.name for axis in SPACE)
            raise DomainError("situation", f"{len(values)} values", f"eight: {names}")
        return Situation(*map(float, values))


def as_points(situations: Iterable[Situation] | npt.ArrayLike) -> Array:
    """Situations as an array in their own units, shape (N, 8), every value checked.

    Raises:
        DomainError: if the shape is not (N, 8), or a value is not a number in its range.
    """
    if not isinstance(situations, np.ndarray):
        rows = [
            item.array() if isinstance(item, Situation) else _row(number, item)
            for number, item in enumerate(situations)  # type: ignore[arg-type]  # an ArrayLike list
        ]
        situations = np.array(rows) if rows else np.empty((0, DIMENSIONS))
    points = np.asarray(situations, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != DIMENSIONS:
        raise DomainError("situations", f"an array of shape {points.shape}", "shape (N, 8)")
    outside = ~((points >= LOW) & (points <= HIGH))  # NaN is outside as well
    if outside.any():
        row, column = np.argwhere(outside)[0]
        axis = SPACE[column]
        check_range(f"{axis.name} of situation {row}", points[row, column], axis.low, axis.high)
    return points


def _row(number: int, values: object) -> Array:
    """One row of a list as it may come from a file: eight numbers, and nothing else."""
    try:
        row = np.asarray(values)
    except ValueError:  # lists of unequal lengths
        row = np.empty(0)
    if row.shape != (DIMENSIONS,) or row.dtype.kind not in "iuf":
        raise DomainError(f"situation {number}", reprlib.repr(values), "eight numbers")
    return row.astype(np.float64)


def scaled(points: Array) -> Array:
    """Map the ranges of :data:`SPACE` onto the unit cube, shape (N, 8) to (N, 8)."""
    return (points - LOW) / SPAN


def unscaled(cube: Array) -> Array:
    """The inverse of :func:`scaled`."""
    return LOW + cube * SPAN


def random_situations(count: int, rng: np.random.Generator) -> Array:
    """Situations spread evenly over the whole space, shape (count, 8), in their own units."""
    return unscaled(rng.random((count, DIMENSIONS)))
