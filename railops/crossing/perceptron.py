"""The self-training perceptron: one layer, random corrections of one weight at a time (chapter 3).

Inputs are every vehicle's distance and speed, outputs their speed changes,
X_j = Σ x_i·w_ij + b_j   [eq. 3.2], limited to the action range by a saturated line   [eq. 3.3].
There is no teacher: a weight is corrected by a random number of −0.1 … 0.1, and the correction is
taken back if the objective got worse, then the next weight's turn comes. The printed rule takes a
correction back only if *both* parts got worse; that drifts, so F of (3.1) decides here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from railops.crossing.problem import Problem, Reaction, reaction_of
from railops.crossing.situation import Array
from railops.errors import check_range
from railops.seeds import generator


@dataclass(frozen=True)
class Settings:
    """How long the network trains.

    Attributes:
        corrections: Weight corrections, each one evaluation; the same 3000 as its rivals.
        probability: Training ends earlier once P is below this and no train changes its speed by
            3 km/h or more; 0: never.
    """

    corrections: int = 3000
    probability: float = 0.0

    def __post_init__(self) -> None:
        check_range("corrections", self.corrections, 1, 1e7)
        check_range("probability", self.probability, 0.0, 1.0)


def inputs_of(problem: Problem) -> Array:
    """Distances in units of 10 m and speeds in km/h, then the bias's 1, shape (2·size + 1,).

    Both are of the order of 100, so that a correction moves an output by some km/h, as in the
    printed run (Fig. 5.2: a weight of −0.035 gives −2.24 km/h).
    """
    vehicles = problem.trains + problem.cars
    pairs = [value for item in vehicles for value in (item.distance_m / 10.0, item.speed_mps * 3.6)]
    return np.array([*pairs, 1.0])


def solve(problem: Problem, seed: int, settings: Settings | None = None) -> Reaction:
    """Minimise (3.1) by training a perceptron on this one situation.

    Example:
        >>> from railops.crossing.probability import Approach
        >>> both_in_45_s = Problem((Approach(1000.0, 80 / 3.6),), (Approach(500.0, 40 / 3.6),))
        >>> solve(both_in_45_s, seed=1).probability < 0.01
        True
    """
    chosen = settings or Settings()
    rng = generator(seed)
    inputs = inputs_of(problem)
    weights = np.zeros((len(inputs), problem.size))
    changes = problem.clip(inputs @ weights)
    value = float(problem.objective(changes[None, :])[0])
    evaluations = 1
    for turn in range(chosen.corrections):
        row, column = divmod(turn % weights.size, problem.size)
        correction = rng.integers(-1000, 1001) / 10_000.0
        weights[row, column] -= correction
        tried = problem.clip(inputs @ weights)
        probability, effort = problem.evaluate(tried[None, :])
        tried_value = float(problem.objective(tried[None, :])[0])
        evaluations += 1
        if tried_value > value:
            weights[row, column] += correction
            continue
        changes, value = tried, tried_value
        if probability[0] < chosen.probability and effort[0] < 3.0 * len(problem.trains):
            break
    return reaction_of(problem, changes, "self-training perceptron", evaluations)
