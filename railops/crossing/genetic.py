"""A genetic algorithm on the same objective: tournament, blend crossover, mutation, one elite."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from railops.crossing.problem import Problem, Reaction, reaction_of
from railops.errors import check_range
from railops.seeds import generator


@dataclass(frozen=True)
class Settings:
    """Size of the search; about 3000 evaluations by default, the same as its rivals'.

    Attributes:
        population: Individuals.
        generations: Generations.
        crossover: Probability that two parents mix.
        mutation: Probability that a gene mutates.
        amplitude: Standard deviation of a mutation, as a share of the action range.
    """

    population: int = 60
    generations: int = 50
    crossover: float = 0.9
    mutation: float = 0.2
    amplitude: float = 0.1

    def __post_init__(self) -> None:
        check_range("population", self.population, 2, 100_000)
        check_range("generations", self.generations, 1, 100_000)
        check_range("crossover", self.crossover, 0.0, 1.0)
        check_range("mutation", self.mutation, 0.0, 1.0)
        check_range("amplitude", self.amplitude, 0.0, 1.0)


def solve(problem: Problem, seed: int, settings: Settings | None = None) -> Reaction:
    """Minimise (3.1) by a genetic algorithm; it starts from the same kind of population.

    Example:
        >>> from railops.crossing.probability import Approach
        >>> both_in_45_s = Problem((Approach(1000.0, 80 / 3.6),), (Approach(500.0, 40 / 3.6),))
        >>> solve(both_in_45_s, seed=1).probability < 0.001
        True
    """
    chosen = settings or Settings()
    rng = generator(seed)
    span = problem.actions.high_kmh - problem.actions.low_kmh
    count = chosen.population
    population = problem.newcomers(count, rng)
    value = problem.objective(population)
    evaluations = count
    for _ in range(chosen.generations):
        duels = rng.integers(count, size=(2, count, 2))
        winners = np.where(
            value[duels[..., 0]] < value[duels[..., 1]], duels[..., 0], duels[..., 1]
        )
        mother, father = population[winners[0]], population[winners[1]]
        blend = rng.uniform(-0.25, 1.25, mother.shape)
        mixed = np.where(rng.random((count, 1)) < chosen.crossover, blend, 0.0)
        children = mother + mixed * (father - mother)
        noise = chosen.amplitude * span * rng.normal(size=children.shape)
        children += np.where(rng.random(children.shape) < chosen.mutation, noise, 0.0)
        children = problem.clip(children)
        children[0] = population[np.argmin(value)]
        population, value = children, problem.objective(children)
        evaluations += count
    return reaction_of(problem, population[np.argmin(value)], "genetic algorithm", evaluations)
