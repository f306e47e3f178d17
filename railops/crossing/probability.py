"""Probability that a train strikes a car, from two uncertain arrival times.

The thesis prints three values and no formula. The model stated here:

- A vehicle of speed v at distance d reaches the crossing at T = d/v and occupies it until its rear
  has left, (zone + length)/v later. Of the train only the leading part counts (`Crossing.lead_m`).
  A report τ seconds old is no present position: d is the reported distance less what the vehicle
  has run since at its reported speed.
- Each arrival time is uncertain with the scale
  σ² = (ε/v)² + (ρ·T)² + (a·τ·T/v)² + (a·τ²/(2v))²: position error ε; relative speed error ρ, so
  that σ grows with the horizon; and a message τ seconds old, in which the vehicle may have
  changed its speed by a·τ.
- The standardised difference of the arrival times follows Student's t with three degrees of
  freedom: the variance itself is only estimated, from a handful of reports. Its tail is why the
  printed probability falls by 8 over the first 2.7 s of separation and by only 400 over the next
  12 s, which no normal law does.
- The collision probability is that of the two occupancies overlapping.

ρ and the lead were fitted to the three printed values (:func:`calibrate`) and rounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from railops._compile import compiled
from railops.crossing.published import COLLISION_PROBABILITIES
from railops.crossing.rules import Crossing
from railops.crossing.situation import KMH_PER_MPS
from railops.errors import MeasurementError, check_range

Array = npt.NDArray[np.float64]

STANDING_MPS = 1e-3
"""Below this a vehicle stands: it does not arrive, or does not leave."""


@dataclass(frozen=True)
class Uncertainty:
    """What is not known about the arrival of a vehicle.

    Attributes:
        position_m: ε, error of a reported position, m (one scale unit).
        speed_rel: ρ, relative error of the speed over the horizon.
        accel_mps2: a, by how much a driver may change the speed unreported, m/s².
    """

    position_m: float = 5.0
    speed_rel: float = 0.012
    accel_mps2: float = 0.5

    def __post_init__(self) -> None:
        check_range("position_m", self.position_m, 0.0, 1000.0, "m", above=True)
        check_range("speed_rel", self.speed_rel, 0.0, 1.0)
        check_range("accel_mps2", self.accel_mps2, 0.0, 10.0, "m/s²")


@dataclass(frozen=True)
class Approach:
    """One vehicle coming towards the crossing, as last reported ``age_s`` ago.

    Attributes:
        distance_m: Front to the crossing, m; negative: on it or past it.
        speed_mps: Speed, m/s, 0 … 100.
        age_s: How old the report is, s, 0 … 600.

    Raises:
        DomainError: if distance or speed leaves its range.
        MeasurementError: if the report is from the future, or older than ten minutes.
    """

    distance_m: float
    speed_mps: float
    age_s: float = 0.0

    def __post_init__(self) -> None:
        check_range("distance_m", self.distance_m, -10_000.0, 100_000.0, "m")
        check_range("speed_mps", self.speed_mps, 0.0, 100.0, "m/s")
        if not 0.0 <= self.age_s <= 600.0:
            raise MeasurementError(
                "age_s", f"{self.age_s} s", "0 to 600 s", "a report from the future or a dead link"
            )

    @property
    def run_m(self) -> float:
        """What it has run since the report if it kept its speed, m."""
        return self.speed_mps * self.age_s


@compiled
def student3(x: float) -> float:
    """Distribution function of Student's t with three degrees of freedom, closed form."""
    y = x / math.sqrt(3.0)
    return 0.5 + (y / (1.0 + y * y) + math.atan(y)) / math.pi


@compiled
def arrival_variance(
    distance_m: float,
    speed_mps: float,
    age_s: float,
    position_m: float,
    speed_rel: float,
    accel_mps2: float,
) -> float:
    """σ² of the arrival time, s²; the module's formula."""
    time = max(distance_m, 0.0) / speed_mps
    drift = accel_mps2 * age_s
    return (
        (position_m / speed_mps) ** 2
        + (speed_rel * time) ** 2
        + (drift * time / speed_mps) ** 2
        + (0.5 * drift * age_s / speed_mps) ** 2
    )


@compiled
def pair_probability(
    train_d: float,
    train_run: float,
    train_v: float,
    train_age: float,
    train_length: float,
    car_d: float,
    car_run: float,
    car_v: float,
    car_age: float,
    car_length: float,
    position_m: float,
    speed_rel: float,
    accel_mps2: float,
) -> float:
    """P of one train and one car; lengths include the zone; distances m, speeds m/s, ages s.

    A vehicle that was *reported* past the crossing strikes nobody; one only predicted to be past
    it may. One that stands before the crossing does not come; one that stands on it is there for
    ever.
    """
    if train_d + train_length <= 0.0 or car_d + car_length <= 0.0:
        return 0.0
    train_d -= train_run
    car_d -= car_run
    train_stands, car_stands = train_v < STANDING_MPS, car_v < STANDING_MPS
    if (train_stands and train_d > 0.0) or (car_stands and car_d > 0.0):
        return 0.0
    if train_stands or car_stands:
        return 1.0
    variance = arrival_variance(
        train_d, train_v, train_age, position_m, speed_rel, accel_mps2
    ) + arrival_variance(car_d, car_v, car_age, position_m, speed_rel, accel_mps2)
    scale = math.sqrt(variance)
    apart = train_d / train_v - car_d / car_v  # the train comes this much later
    high = (car_length / car_v - apart) / scale
    low = (-train_length / train_v - apart) / scale
    if low > 0.0:  # in the upper tail the difference of complements keeps its digits
        return student3(-low) - student3(-high)
    return student3(high) - student3(low)


def collision_probability(
    train: Approach,
    car: Approach,
    crossing: Crossing | None = None,
    uncertainty: Uncertainty | None = None,
) -> float:
    """Probability that the train strikes the car if both keep their speeds.

    Example:
        The published situation, printed as 0.4658:

        >>> p = collision_probability(Approach(1000.0, 80 / 3.6), Approach(500.0, 40 / 3.6))
        >>> round(p, 3)
        0.546
    """
    place, doubt = crossing or Crossing(), uncertainty or Uncertainty()
    return float(
        pair_probability(
            train.distance_m,
            train.run_m,
            train.speed_mps,
            train.age_s,
            place.train_occupies_m,
            car.distance_m,
            car.run_m,
            car.speed_mps,
            car.age_s,
            place.car_occupies_m,
            doubt.position_m,
            doubt.speed_rel,
            doubt.accel_mps2,
        )
    )


def published_values(
    crossing: Crossing | None = None, uncertainty: Uncertainty | None = None
) -> list[tuple[float, float, float]]:
    """(car's speed change in km/h, printed probability, this model's) for the three values."""
    return [
        (
            change,
            printed,
            collision_probability(
                Approach(1000.0, 80.0 / KMH_PER_MPS),
                Approach(500.0, (40.0 + change) / KMH_PER_MPS),
                crossing,
                uncertainty,
            ),
        )
        for change, printed in COLLISION_PROBABILITIES
    ]


def calibrate(position_m: float = 5.0) -> tuple[float, float]:
    """Fit (ρ, lead_m) to the three printed values, least squares of the logarithms.

    Example:
        >>> speed_rel, lead_m = calibrate()
        >>> round(speed_rel, 3), round(lead_m)
        (0.012, 11)
    """

    def residuals(theta: Array) -> Array:
        doubt = Uncertainty(position_m=position_m, speed_rel=float(theta[0]))
        place = replace(Crossing(), lead_m=float(theta[1]))
        return np.array([math.log(ours / p) for _, p, ours in published_values(place, doubt)])

    found = least_squares(residuals, [0.015, 8.0], bounds=([1e-4, 0.0], [0.5, 100.0]))
    return float(found.x[0]), float(found.x[1])
