"""Headway: published tables, linearity, safety over random lines, independent simulation, speed."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np

from benchmarks.common import Measure, alternating_medians, median_seconds, parser, publish
from benchmarks.headway_fine import interval_s as fine_interval_s
from railops.errors import RailOpsError
from railops.headway import (
    Characteristic,
    FixedBlock,
    MovingBlock,
    Section,
    Stock,
    Succession,
    TrackCircuits,
    bracketed_interval,
    characteristic,
    choose_run_time,
    find_section,
    simulate,
)
from railops.headway.published import MOSCOW, ZHENGZHOU
from railops.traction import Davis, Effort, Line

STEPS_KMH = (0.0, 40.0, 60.0, 70.0, 80.0)


def random_section(rng: np.random.Generator) -> Section:
    """Any metro-like section: profile, limits, circuits or blocks, train, all drawn."""
    length = float(rng.uniform(900.0, 2600.0))
    train = float(rng.uniform(60.0, 160.0))

    def cuts(low: float, high: float, start: float) -> tuple[tuple[float, float], ...]:
        edges = [start]
        while edges[-1] < length + 700.0:
            edges.append(edges[-1] + float(rng.uniform(low, high)))
        return tuple(pairwise(edges))

    start = -float(rng.uniform(0.0, 200.0))
    kind = rng.integers(4)
    if kind == 0:
        protection = TrackCircuits(
            cuts(60.0, 200.0, start),
            steps_kmh=STEPS_KMH,
            design_decel_mps2=float(rng.uniform(0.6, 1.1)),
            overlap_m=float(rng.uniform(0.0, 60.0)),
            delay_s=float(rng.uniform(0.5, 4.0)),
        )
    elif kind == 1:
        protection = TrackCircuits(
            cuts(90.0, 180.0, start),
            codes=((0, 0.0), (1, 40.0), (2, 60.0), (3, 70.0), (4, 80.0)),
            delay_s=float(rng.uniform(0.5, 4.0)),
        )
    elif kind == 2:
        protection = FixedBlock(cuts(150.0, 500.0, start), overlap_m=float(rng.uniform(0.0, 100.0)))
    else:
        protection = MovingBlock(
            margin_m=float(rng.uniform(5.0, 60.0)), report_m=float(rng.uniform(1.0, 10.0))
        )
    places = np.sort(rng.uniform(50.0, length, 4)).tolist()
    grades = rng.uniform(-0.03, 0.03, 4).tolist()
    low_at, low_end = np.sort(rng.uniform(200.0, length, 2)).tolist()
    limits = ((0.0, 80.0), (low_at, float(rng.uniform(45.0, 75.0))), (low_end + 1.0, 80.0))
    return Section(
        length,
        protection,
        Stock(
            train,
            Effort(float(rng.uniform(0.8, 1.3)), float(rng.uniform(8.0, 18.0))),
            Davis(
                *(np.array([Davis().c0, Davis().c1, Davis().c2]) * rng.uniform(0.7, 1.6)).tolist()
            ),
            brake_mps2=float(rng.uniform(0.6, 1.1)),
        ),
        Line(((0.0, 0.0), *zip(places, grades, strict=True)), ((0.0, 400.0), (500.0, np.inf))),
        limits if rng.random() < 0.5 else ((0.0, 80.0),),
    )


def random_pair(rng: np.random.Generator) -> tuple[Succession, float, float, float]:
    """A random section with two run times it allows and a dwell."""
    while True:
        try:
            pair = Succession(random_section(rng))
        except RailOpsError:  # too steep for its train, or circuits that end too early
            continue
        shortest = pair.regulator.shortest_s
        longest = min(1.4 * shortest, pair.regulator.longest().run_time_s)
        second, first = rng.uniform(shortest, longest, 2).tolist()
        return pair, second, first, float(rng.uniform(15.0, 60.0))


def residual_s(published: Characteristic, name: str) -> float:
    """RMS difference of a built-in calibrated section from a published table, s."""
    table = characteristic(
        find_section(name), published.second_s.tolist(), published.first_s.tolist()
    )
    difference = table.interval_s(published.dwell_s) - published.interval_s()
    return float(np.sqrt(np.nanmean(difference**2)))


def worked_example() -> float:
    """Figures and decisions of the worked example that differ from the paper's."""
    order = choose_run_time(ZHENGZHOU, 120, 120, 105, late_s=5, front_delay_s=3)
    mine = [(trial.run_s, trial.required_s, trial.feasible) for trial in order.trials]
    paper = [(115.0, 106.0, False), (120.0, 104.0, True)]
    return float(sum(a != b for a, b in zip(mine, paper, strict=True)) + (order.run_s != 120.0))


def searched(
    pair: Succession, second: float, first: float, dwell: float, low: float, high: float
) -> float:
    """The shortest interval by bisection on the forward simulation's verdict, to 1e-11 s."""
    return bracketed_interval(
        lambda interval: simulate(pair, second, first, interval, dwell).restricted, low, high, 1e-11
    )


def safety(count: int, seed: int) -> tuple[float, float, float]:
    """Over random lines and pairs: unsafe at the interval, safe 1 s below, worst nonlinearity.

    The last is measured on every tenth line, by search: it does not know that eq. 2 holds.
    """
    rng = np.random.default_rng(seed)
    unsafe = idle = 0
    bent = 0.0
    for index in range(count):
        pair, second, first, dwell = random_pair(rng)
        found = pair.interval(second, first)
        shortest = found.at(dwell)
        unsafe += simulate(pair, second, first, shortest, dwell).restricted
        idle += not simulate(pair, second, first, shortest - 1.0, dwell).restricted
        if index % 10:
            continue
        start = max(dwell, found.linear_from_s)
        near = found.at(start)
        one = searched(pair, second, first, start, near - 1.0, near + 1e-3)
        two = searched(pair, second, first, start + 17.0, near + 16.0, near + 17.001)
        bent = max(bent, abs(two - one - 17.0))
    return float(unsafe), float(idle), bent


def against_fine(count: int, seed: int) -> float:
    """Largest difference from the independent fine-step simulation, s."""
    rng = np.random.default_rng(seed)
    worst = 0.0
    for _ in range(count):
        pair, second, first, dwell = random_pair(rng)
        mine = pair.interval(second, first).at(dwell)
        worst = max(worst, abs(mine - fine_interval_s(pair.section, second, first, dwell)))
    return worst


def exceptions(count: int, seed: int) -> float:
    """Pairs of neighbouring run times at which a slower second train needs longer."""
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(count):
        pair, *_ = random_pair(rng)
        shortest = pair.regulator.shortest_s
        longest = min(1.3 * shortest, pair.regulator.longest().run_time_s)
        times = np.linspace(shortest, longest, 8).tolist()
        table = characteristic(pair.section, times, name_critical=False)
        found += int(np.sum(np.diff(table.interval_s(), axis=0) > 1e-6))
    return float(found)


def speed_cases() -> tuple[Section, list[float]]:
    """The section and the 21 run times that are timed."""
    edges = [-150.0, 30.0] + [30.0 + 120.0 * index for index in range(1, 21)]
    section = Section(1700.0, TrackCircuits(tuple(pairwise(edges)), steps_kmh=STEPS_KMH))
    return section, np.linspace(112.0, 132.0, 21).tolist()


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--lines", type=int, default=10_000, help="random lines (default 10000)")
    arguments.add_argument("--fine", type=int, default=40, help="fine simulations (default 40)")
    arguments.add_argument("--seed", type=int, default=1, help="seed (default 1)")
    options = arguments.parse_args()
    section, times = speed_cases()
    pair = Succession(section)
    pair.interval(120.0, 125.0)

    def one_simulation() -> None:
        """Both runs integrated anew at 0.1 s, then the succession followed."""
        pair.regulator.at_cut(180.0)
        pair.regulator.at_cut(170.0)
        simulate(pair, 120.0, 125.0, 90.0, 20.0)

    simulation_s, full_s = alternating_medians(
        [one_simulation, lambda: characteristic(section, times, times)], 31
    )
    runs_s = median_seconds(lambda: [Succession(section).run(time) for time in times[:5]], 5) / 5
    start = time.perf_counter()
    unsafe, idle, bent = safety(options.lines, options.seed)
    elapsed = time.perf_counter() - start
    lines = f"{options.lines} random lines"
    publish(
        "headway",
        [
            Measure("worked example: figures unlike the paper's", worked_example(), "", 0),
            Measure("Moscow table, RMS residual", residual_s(MOSCOW, "moscow"), "s", 1.0),
            Measure("Zhengzhou table, RMS residual", residual_s(ZHENGZHOU, "zhengzhou"), "s", 3.0),
            Measure(f"largest departure from eq. 2, {options.lines // 10} lines", bent, "s", 1e-9),
            Measure("two-train simulation, 0.1 s steps", 1e3 * simulation_s, "ms", 0.3),
            Measure("characteristic 21 x 21, one core", full_s, "s", 0.15),
            Measure("one run found for a wanted time, alone", 1e3 * runs_s, "ms"),
            Measure(
                f"largest difference from {options.fine} fine simulations",
                against_fine(options.fine, options.seed + 1),
                "s",
                0.2,
            ),
            Measure("slower second train, longer interval", exceptions(300, 5), "pairs", 0),
            Measure(f"restricted at the found interval, {lines}", unsafe, "pairs", 0),
            Measure(f"unrestricted 1 s below it, {lines}", idle, "pairs", 0),
            Measure("time per random line", 1e3 * elapsed / options.lines, "ms"),
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
