"""The reference: the front of both objectives by NSGA-II, from pymoo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from railops._extras import extra
from railops.crossing.problem import TRAIN_CHANGE_WEIGHT, Problem, Reaction, reaction_of
from railops.crossing.situation import Array
from railops.seeds import generator


@dataclass(frozen=True)
class Front:
    """Solutions none of which is better than another in both parts.

    Attributes:
        changes_kmh: Speed changes, trains first, shape (K, size).
        probability: P, shape (K,).
        train_change_kmh: Σ|Δv| of the trains, km/h, shape (K,).
        evaluations: How many solutions were evaluated.
    """

    changes_kmh: Array
    probability: Array
    train_change_kmh: Array
    evaluations: int

    def best(self, problem: Problem) -> Reaction:
        """The front's solution of the smallest F."""
        value = self.probability + TRAIN_CHANGE_WEIGHT * self.train_change_kmh
        return reaction_of(problem, self.changes_kmh[np.argmin(value)], "NSGA-II", self.evaluations)


def nsga2(problem: Problem, seed: int, population: int = 100, generations: int = 150) -> Front:
    """Approximate the front; started from the same kind of population as its rivals.

    Raises:
        MissingExtraError: if pymoo is not installed.
    """
    purpose = "the reference front"
    base = extra("crossing", "pymoo.core.problem", purpose)
    algorithm = extra("crossing", "pymoo.algorithms.moo.nsga2", purpose)
    optimise = extra("crossing", "pymoo.optimize", purpose)

    class Both(base.Problem):  # type: ignore[misc, name-defined]  # pymoo ships no types
        """Both parts, evaluated for a whole population at once."""

        def __init__(self) -> None:
            low, high = problem.actions.low_kmh, problem.actions.high_kmh
            super().__init__(n_var=problem.size, n_obj=2, xl=low, xu=high)

        def _evaluate(self, x: Array, out: dict[str, Array], *_: object, **__: object) -> None:
            out["F"] = np.column_stack(problem.evaluate(x))

    start = problem.newcomers(population, generator(seed))
    method = algorithm.NSGA2(pop_size=population, sampling=start)
    found = optimise.minimize(Both(), method, ("n_gen", generations), seed=seed, verbose=False)
    changes = np.atleast_2d(found.X)
    probability, effort = problem.evaluate(changes)
    return Front(changes, probability, effort, int(found.algorithm.evaluator.n_eval))
