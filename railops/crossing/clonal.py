"""Clonal selection: breed the antibodies that bind best, mutate the poor ones most (chapter 2).

Per generation: rank the population; clone the best, the better the more; mutate the clones, the
better the less; let improved clones replace their parents; suppress antibodies too like a better
one; fill up with fresh blood. Affinity is the rank, scaled to [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops.crossing.problem import Problem, Reaction, reaction_of
from railops.crossing.situation import Array
from railops.errors import check_range
from railops.seeds import generator


@dataclass(frozen=True)
class Settings:
    """Size of the search; about 3000 evaluations by default, the same as its rivals'.

    Attributes:
        population: Antibodies.
        selected: How many of the best are cloned.
        clones: Clones of the very best; the k-th best gets clones/k, at least one.
        generations: Generations.
        decay: Mutation falls as exp(−decay·affinity), relative to the action range.
        suppression: Antibodies nearer than this share of the range to a better one are removed.
        fresh: Least number of newcomers per generation.
    """

    population: int = 20
    selected: int = 8
    clones: int = 20
    generations: int = 50
    decay: float = 3.0
    suppression: float = 0.01
    fresh: int = 3

    def __post_init__(self) -> None:
        check_range("population", self.population, 2, 100_000)
        check_range("selected", self.selected, 1, self.population)
        check_range("clones", self.clones, 1, 100_000)
        check_range("generations", self.generations, 1, 100_000)
        check_range("decay", self.decay, 0.0, 50.0)
        check_range("suppression", self.suppression, 0.0, 1.0)
        check_range("fresh", self.fresh, 0, self.population - 1)


def hypermutate(
    parents: Array, affinity: Array, decay: float, problem: Problem, rng: np.random.Generator
) -> Array:
    """Mutated copies, shape (K, size); amplitude falls with affinity in [0, 1].

    The amplitude falls as exp(−decay·affinity), and within two decades by chance, so that a
    generation searches near and far. At least one gene of every clone changes; one change in five
    takes a gene from the library (least, none, most), which is how "leave this vehicle alone" is
    found exactly.
    """
    low, high = problem.actions.low_kmh, problem.actions.high_kmh
    amplitude = 0.5 * (high - low) * np.exp(-decay * affinity)[:, None]
    amplitude = amplitude * 10.0 ** rng.uniform(-2.0, 0.0, (len(parents), 1))
    mutated = parents + amplitude * rng.normal(size=parents.shape)
    library = np.array([low, 0.0, high])[rng.integers(3, size=parents.shape)]
    mutated = np.where(rng.random(parents.shape) < 0.2, library, mutated)
    chosen = rng.random(parents.shape) < 0.5
    chosen[np.arange(len(parents)), rng.integers(problem.size, size=len(parents))] = True
    return problem.clip(np.where(chosen, mutated, parents))


def suppress(population: Array, value: Array, distance_kmh: float) -> npt.NDArray[np.int64]:
    """Indices of the antibodies that stay: none is within ``distance_kmh`` of a better one."""
    apart = np.abs(population[:, None, :] - population[None, :, :]).max(axis=2)
    rank = np.argsort(np.argsort(value, kind="stable"))
    beaten = (apart < distance_kmh) & (rank[None, :] < rank[:, None])
    return np.flatnonzero(~beaten.any(axis=1)).astype(np.int64)


def solve(problem: Problem, seed: int, settings: Settings | None = None) -> Reaction:
    """Minimise (3.1) by clonal selection.

    Example:
        >>> from railops.crossing.probability import Approach
        >>> both_in_45_s = Problem((Approach(1000.0, 80 / 3.6),), (Approach(500.0, 40 / 3.6),))
        >>> found = solve(both_in_45_s, seed=1)
        >>> found.train_changes_kmh, found.car_changes_kmh, round(found.probability, 6)
        ((0.0,), (-10.0,), 0.000152)
    """
    chosen = settings or Settings()
    rng = generator(seed)
    span = problem.actions.high_kmh - problem.actions.low_kmh
    copies = np.maximum(chosen.clones // np.arange(1, chosen.selected + 1), 1)
    population = problem.newcomers(chosen.population, rng)
    value = problem.objective(population)
    evaluations = len(population)
    for _ in range(chosen.generations):
        order = np.argsort(value, kind="stable")
        population, value = population[order], value[order]
        parents = min(chosen.selected, len(population))
        origin = np.repeat(np.arange(parents), copies[:parents])
        affinity = 1.0 - origin / max(parents - 1, 1)
        clones = hypermutate(population[origin], affinity, chosen.decay, problem, rng)
        clone_value = problem.objective(clones)
        for parent in range(parents):
            own = np.flatnonzero(origin == parent)
            best = own[np.argmin(clone_value[own])]
            if clone_value[best] < value[parent]:
                population[parent], value[parent] = clones[best], clone_value[best]
        stay = suppress(population, value, chosen.suppression * span)
        stay = stay[np.argsort(value[stay], kind="stable")][: chosen.population - chosen.fresh]
        newcomers = problem.newcomers(chosen.population - len(stay), rng)
        newcomer_value = problem.objective(newcomers)
        evaluations += len(clones) + len(newcomers)
        population = np.concatenate([population[stay], newcomers])
        value = np.concatenate([value[stay], newcomer_value])
    return reaction_of(problem, population[np.argmin(value)], "clonal selection", evaluations)
