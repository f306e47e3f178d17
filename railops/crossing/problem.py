"""What every reaction method minimises: the two-part objective (3.1) over speed changes.

A solution is one speed change per vehicle, trains first. The parts are P = max P_ij over every
train i and car j, and Σ|Δv_i| over the trains. Where one number is needed it is
F = P + 0.01·Σ|Δv_i| (Δv in km/h): the thesis's own mean values imply weights of 0.0079, 0.0091 and
0.0116 per km/h (Tables 4.4 and 4.5).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.crossing.probability import Approach, Array, Uncertainty, pair_probability
from railops.crossing.rules import Crossing
from railops.crossing.situation import KMH_PER_MPS
from railops.errors import DomainError, check_range

TRAIN_CHANGE_WEIGHT = 0.01
"""F's weight of one km/h of train speed change, as a collision probability."""


@dataclass(frozen=True)
class ActionRange:
    """By how much any vehicle's speed may be changed, km/h; zero must be inside."""

    low_kmh: float
    high_kmh: float

    def __post_init__(self) -> None:
        check_range("low_kmh", self.low_kmh, -150.0, 0.0, "km/h")
        check_range("high_kmh", self.high_kmh, 0.0, 150.0, "km/h")
        if self.low_kmh == self.high_kmh:
            raise DomainError("action range", "empty", "room for at least one speed change")


SLOW_DOWN = ActionRange(-10.0, 0.0)
BOTH_WAYS = ActionRange(-15.0, 5.0)
"""The two published action ranges."""


@dataclass(frozen=True)
class Problem:
    """Trains and cars approaching one crossing, and what may be done about it.

    Attributes:
        trains: The trains, at least one.
        cars: The road vehicles, at least one.
        actions: Range of the speed changes.
        crossing: Geometry.
        uncertainty: What is not known about arrivals.
    """

    trains: tuple[Approach, ...]
    cars: tuple[Approach, ...]
    actions: ActionRange = SLOW_DOWN
    crossing: Crossing = field(default_factory=Crossing)
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    _state: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.trains or not self.cars:
            counts = f"{len(self.trains)} and {len(self.cars)}"
            raise DomainError("trains and cars", counts, "at least one of each")
        vehicles = self.trains + self.cars
        rows = [(item.distance_m, item.speed_mps, item.age_s, item.run_m) for item in vehicles]
        object.__setattr__(self, "_state", np.array(rows, dtype=np.float64))

    @property
    def size(self) -> int:
        """Number of speed changes: trains and cars."""
        return len(self.trains) + len(self.cars)

    def evaluate(self, changes_kmh: npt.ArrayLike) -> tuple[Array, Array]:
        """Both parts of the objective for K solutions.

        Args:
            changes_kmh: Speed changes, km/h, trains first, shape (K, size).

        Returns:
            P, shape (K,), and Σ|Δv| of the trains in km/h, shape (K,).
        """
        changes = np.ascontiguousarray(changes_kmh, dtype=np.float64)
        if changes.ndim != 2 or changes.shape[1] != self.size:
            raise DomainError(
                "changes_kmh", f"an array of shape {changes.shape}", f"shape (K, {self.size})"
            )
        place, doubt = self.crossing, self.uncertainty
        return _evaluate(
            changes,
            self._state,
            len(self.trains),
            place.train_occupies_m,
            place.car_occupies_m,
            doubt.position_m,
            doubt.speed_rel,
            doubt.accel_mps2,
        )

    def objective(self, changes_kmh: npt.ArrayLike) -> Array:
        """F of K solutions, shape (K,)."""
        probability, effort = self.evaluate(changes_kmh)
        return probability + TRAIN_CHANGE_WEIGHT * effort

    def probability_unchanged(self) -> float:
        """P if nobody does anything."""
        return float(self.evaluate(np.zeros((1, self.size)))[0][0])

    def clip(self, changes_kmh: Array) -> Array:
        """Speed changes limited to the action range."""
        return np.clip(changes_kmh, self.actions.low_kmh, self.actions.high_kmh)

    def newcomers(self, count: int, rng: np.random.Generator) -> Array:
        """Random solutions; half the genes from the library {least, none, most}, half uniform."""
        low, high = self.actions.low_kmh, self.actions.high_kmh
        shape = (count, self.size)
        library = np.array([low, 0.0, high])[rng.integers(3, size=shape)]
        return np.where(rng.random(shape) < 0.5, library, rng.uniform(low, high, shape))


@compiled
def _evaluate(
    changes: Array,
    state: Array,
    trains: int,
    train_length: float,
    car_length: float,
    position_m: float,
    speed_rel: float,
    accel_mps2: float,
) -> tuple[Array, Array]:
    """Both parts for every row of ``changes``; ``state`` holds distance, speed, age, run."""
    count = changes.shape[0]
    worst, effort = np.zeros(count), np.zeros(count)
    for k in range(count):
        for i in range(trains):
            effort[k] += abs(changes[k, i])
            train_v = max(state[i, 1] + changes[k, i] / KMH_PER_MPS, 0.0)
            for j in range(trains, state.shape[0]):
                car_v = max(state[j, 1] + changes[k, j] / KMH_PER_MPS, 0.0)
                p = pair_probability(
                    state[i, 0],
                    state[i, 3],
                    train_v,
                    state[i, 2],
                    train_length,
                    state[j, 0],
                    state[j, 3],
                    car_v,
                    state[j, 2],
                    car_length,
                    position_m,
                    speed_rel,
                    accel_mps2,
                )
                worst[k] = max(worst[k], p)
    return worst, effort


@dataclass(frozen=True)
class Reaction:
    """A method's answer.

    Attributes:
        method: Its name.
        train_changes_kmh: Speed change of every train, km/h.
        car_changes_kmh: Speed change of every car, km/h.
        probability: P that is left.
        train_change_kmh: Σ|Δv| of the trains, km/h.
        objective: F.
        evaluations: How many solutions were evaluated.
    """

    method: str
    train_changes_kmh: tuple[float, ...]
    car_changes_kmh: tuple[float, ...]
    probability: float
    train_change_kmh: float
    objective: float
    evaluations: int


def reaction_of(problem: Problem, changes: Array, method: str, evaluations: int) -> Reaction:
    """The reaction that one solution is."""
    probability, effort = (float(part[0]) for part in problem.evaluate(changes[None, :]))
    trains = len(problem.trains)
    return Reaction(
        method,
        tuple(map(float, changes[:trains])),
        tuple(map(float, changes[trains:])),
        probability,
        effort,
        probability + TRAIN_CHANGE_WEIGHT * effort,
        evaluations,
    )
