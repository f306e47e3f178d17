"""The published experiment: ten scenarios, six attempts, two action ranges, three methods.

The thesis prints only the collision probabilities of its first two scenarios before the reaction,
0.626 and 0.577. The ten here are stated: both vehicles arrive within two seconds of each other,
from different distances at different speeds. With one train and one bus the best answer is to leave
the train alone and slow the bus as far as allowed, so all methods soon agree; :func:`crowd` is the
harder plan beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from railops.crossing import clonal, genetic, perceptron
from railops.crossing.probability import Approach
from railops.crossing.problem import BOTH_WAYS, SLOW_DOWN, ActionRange, Problem, Reaction
from railops.crossing.situation import KMH_PER_MPS
from railops.errors import check_range

Solver = Callable[[Problem, int], Reaction]

METHODS: Mapping[str, Solver] = {
    "clonal selection": clonal.solve,
    "genetic algorithm": genetic.solve,
    "self-training perceptron": perceptron.solve,
}

ACTIONS: tuple[ActionRange, ...] = (SLOW_DOWN, BOTH_WAYS)

SCENARIOS: tuple[tuple[float, float, float, float], ...] = (
    (80.0, 1000.0, 40.0, 500.0),
    (90.0, 1000.0, 50.0, 555.0),
    (70.0, 950.0, 45.0, 605.0),
    (60.0, 900.0, 40.0, 595.0),
    (100.0, 1000.0, 36.0, 365.0),
    (75.0, 800.0, 35.0, 375.0),
    (85.0, 950.0, 45.0, 500.0),
    (65.0, 850.0, 50.0, 650.0),
    (55.0, 700.0, 30.0, 385.0),
    (95.0, 980.0, 42.0, 430.0),
)
"""Train speed km/h, its distance m, car (or bus) speed km/h, its distance m."""

ATTEMPTS = 6


def scenario(number: int, actions: ActionRange) -> Problem:
    """One of the ten scenarios, counted from 0, as a problem.

    Example:
        >>> round(scenario(0, SLOW_DOWN).probability_unchanged(), 3)
        0.546
    """
    check_range("number", number, 0, len(SCENARIOS) - 1)
    train_v, train_d, car_v, car_d = SCENARIOS[number]
    return Problem(
        (Approach(train_d, train_v / KMH_PER_MPS),),
        (Approach(car_d, car_v / KMH_PER_MPS),),
        actions,
    )


def crowd(number: int, actions: ActionRange) -> Problem:
    """Two trains and three cars that all arrive within seconds of a train, drawn from ``number``.

    What helps against one train may hurt against the other, so that the best changes lie inside
    the range.

    Example:
        >>> problem = crowd(0, SLOW_DOWN)
        >>> len(problem.trains), len(problem.cars), round(problem.probability_unchanged(), 2)
        (2, 3, 0.18)
    """
    rng = np.random.default_rng([9, number])
    trains, cars = [], []
    for _ in range(2):
        distance_m, speed_kmh = rng.uniform(600.0, 1000.0), rng.uniform(50.0, 100.0)
        trains.append(Approach(float(distance_m), float(speed_kmh) / KMH_PER_MPS))
    for place in range(3):
        met = trains[place % 2]
        arrives_s = met.distance_m / met.speed_mps + float(rng.uniform(-4.0, 4.0))
        speed_mps = float(rng.uniform(25.0, 60.0)) / KMH_PER_MPS
        cars.append(Approach(speed_mps * arrives_s, speed_mps))
    return Problem(tuple(trains), tuple(cars), actions)


@dataclass(frozen=True)
class Run:
    """One attempt: where, what came out, and how long it took.

    ``machine_s`` is processor time, which other work on the machine does not lengthen; ``wall_s``
    is what a user waits.
    """

    method: str
    scenario: int
    actions: ActionRange
    attempt: int
    before: float
    reaction: Reaction
    machine_s: float
    wall_s: float


def run(
    seed: int,
    attempts: int = ATTEMPTS,
    methods: Mapping[str, Solver] | None = None,
    scenarios: int = len(SCENARIOS),
) -> list[Run]:
    """Run the plan; the methods take turns, so that a loaded machine meets all of them alike.

    Args:
        seed: Seed of the plan; every attempt derives its own.
        attempts: Attempts per scenario and action range.
        methods: Methods by name; default: the thesis's three.
        scenarios: How many of the ten, from the first.
    """
    check_range("attempts", attempts, 1, 10_000)
    check_range("scenarios", scenarios, 1, len(SCENARIOS))
    chosen = METHODS if methods is None else methods
    warm = scenario(0, SLOW_DOWN)
    for solve in chosen.values():
        solve(warm, seed)
    runs = []
    for group, actions in enumerate(ACTIONS):
        for number in range(scenarios):
            problem = scenario(number, actions)
            before = problem.probability_unchanged()
            for attempt in range(attempts):
                for name, solve in chosen.items():
                    own = seed + 1_000_000 * group + 10_000 * number + attempt
                    start, used = time.perf_counter(), time.process_time()
                    found = solve(problem, own)
                    used = time.process_time() - used
                    took = time.perf_counter() - start
                    runs.append(Run(name, number, actions, attempt, before, found, used, took))
    return runs
