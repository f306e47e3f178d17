"""Level crossings: detection, probabilities, reaction and its rivals, exchange over bad radio."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable

import numpy as np

from benchmarks.common import Measure, parser, publish
from railops.crossing import negative, tables, vdetector
from railops.crossing.audit import audit
from railops.crossing.bus import FIELD, WORST
from railops.crossing.detectors import DetectorSet
from railops.crossing.experiment import ACTIONS, ATTEMPTS, METHODS, SCENARIOS, crowd, run, scenario
from railops.crossing.front import nsga2
from railops.crossing.probability import published_values
from railops.crossing.published import ALARMED, ANTIGENS, SELF
from railops.crossing.situation import Array, random_situations, scaled
from railops.crossing.units import AS_PUBLISHED, CAUTIOUS


def around_self(count: int, rng: np.random.Generator) -> Array:
    """Clear situations in the unit cube: evenly in the balls of radius 0.2 around the safe nine."""
    points = np.empty((0, 8))
    safe = scaled(SELF)
    while len(points) < count:
        way = rng.normal(size=(count, 8))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        drawn = safe[rng.integers(len(safe), size=count)]
        drawn = drawn + way * 0.2 * rng.random((count, 1)) ** (1 / 8)
        points = np.concatenate([points, drawn[((drawn >= 0) & (drawn <= 1)).all(axis=1)]])
    return points[:count]


def detection(seeds: int) -> list[Measure]:
    """Alarm rates over seeds: the least of the eleven antigens', and of clear situations."""
    clear = around_self(2000, np.random.default_rng(0))
    wide = scaled(SELF)[np.arange(2000) % 9] + 0.05 * np.random.default_rng(1).normal(
        size=(2000, 8)
    )
    trainers: dict[str, Callable[[int], DetectorSet]] = {
        "V-detectors": lambda seed: vdetector.train(SELF, seed),
        "moving detectors, unit cube": lambda seed: negative.train(SELF, seed, negative.SCALED),
        "moving detectors, as printed": lambda seed: negative.train(SELF, seed),
    }
    measures = []
    for name, train in trainers.items():
        count = seeds if name != "moving detectors, unit cube" else max(1, seeds // 10)
        sets = [train(seed) for seed in range(count)]
        caught = np.mean([item.judge(ANTIGENS) >= 0 for item in sets], axis=0)
        bar = 0.95 if name == "V-detectors" else None
        label = f"{name}: antigens alarmed, {count} seeds"
        measures += [
            Measure(f"{label}, least of 11", caught[:ALARMED].min(), "", bar, "higher"),
            Measure(f"{label}, mean of 11", caught[:ALARMED].mean(), "", None, "higher"),
            Measure(f"{label}, the 12th (not alarmed in print)", caught[ALARMED], "", None),
        ]
        if sets[0].units == "scaled":
            false = np.mean([item.alarms(clear).mean() for item in sets])
            noisy = np.mean([item.alarms(wide).mean() for item in sets])
            bar = 0.01 if name == "V-detectors" else None
            measures += [
                Measure(f"{name}: clear situations alarmed", false, "", bar),
                Measure(f"{name}: normal noise of 5 % per axis alarmed", noisy, "", bar),
            ]
    return measures


def thousand() -> DetectorSet:
    """A thousand V-detectors, grown from as many seeds as it takes."""
    sets, seed = [], 1000
    while sum(map(len, sets)) < 1000:
        sets.append(vdetector.train(SELF, seed))
        seed += 1
    centres = np.concatenate([item.centres for item in sets])[:1000]
    radii = np.concatenate([item.radii for item in sets])[:1000]
    return DetectorSet(centres, radii, 0.2, "V-detectors", 1000)


def rates(work: Callable[[], object], count: int, repeats: int = 7) -> tuple[float, float]:
    """Situations per second by the wall clock and by processor time, medians."""
    work()
    wall, used = [], []
    for _ in range(repeats):
        start, own = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - start)
        used.append(time.process_time() - own)
    return count / statistics.median(wall), count / statistics.median(used)


def speed() -> list[Measure]:
    """Situations per second with 1000 detectors, the rival's beside it where it is installed."""
    detectors = thousand()
    rng = np.random.default_rng(2)
    measures = []
    for name, points in (
        ("anywhere", scaled(random_situations(200_000, rng))),
        ("clear, every detector has to be ruled out", around_self(50_000, rng)),
    ):
        wall, used = rates(lambda points=points: detectors.match(points), len(points))
        label = f"matching 1000 detectors, {name}"
        measures += [
            Measure(label, wall, "1/s", 500_000, "higher"),
            Measure(f"{label}, per processor second", used, "1/s", None, "higher"),
        ]
    if importlib.util.find_spec("aisp") is not None:
        from aisp.nsa import RNSA

        rival = RNSA(N=1000, r=0.2, seed=1)
        rival.fit(scaled(SELF), np.array(["safe"] * len(SELF)), verbose=False)
        points = scaled(random_situations(300, rng))
        wall, used = rates(lambda: rival.predict(points), len(points), 3)
        measures.append(
            Measure("aisp's real-valued negative selection", wall, "1/s", None, "higher")
        )
        measures.append(Measure("aisp, per processor second", used, "1/s", None, "higher"))
    return measures


def reaction() -> list[Measure]:
    """The published plan, and the NSGA-II front's best beside the means."""
    runs = run(seed=0)
    fronts = [
        nsga2(problem, seed=0).best(problem)
        for actions in ACTIONS
        for problem in (scenario(number, actions) for number in range(len(SCENARIOS)))
    ]
    best = float(np.mean([item.objective for item in fronts]))
    measures = [Measure("NSGA-II front: best mean objective", best, "")]
    for name in METHODS:
        bars = name == "clonal selection"
        objective, probability, effort, seconds = (
            tables.values(runs, name, criterion) for criterion in tables.CRITERIA
        )
        ratio = float(objective.mean()) / best
        wall = statistics.median(item.wall_s for item in runs if item.method == name)
        measures += [
            Measure(f"{name}: probability left", probability.mean(), "", 0.00086 if bars else None),
            Measure(f"{name}: train speed change", effort.mean(), "km/h", 0.042 if bars else None),
            Measure(f"{name}: objective / front's best", ratio, "", 1.01 if bars else None),
            Measure(f"{name}: processor time", np.median(seconds), "s", 0.05 if bars else None),
            Measure(f"{name}: wall clock", wall, "s", 0.05 if bars else None),
        ]
    for rival in list(METHODS)[1:]:
        for row in tables.compare(runs, rival, seed=0):
            for end, value in (("low", row.difference_low), ("high", row.difference_high)):
                label = f"{rival} minus clonal, {row.criterion}, 95 % {end}"
                measures.append(Measure(label, value, ""))
    return measures


def crowds() -> list[Measure]:
    """Two trains and three cars: every method beside the NSGA-II front's best, mean of attempts."""
    ratios: dict[str, list[float]] = {name: [] for name in METHODS}
    used: dict[str, list[float]] = {name: [] for name in METHODS}
    for problem in (crowd(number, actions) for actions in ACTIONS for number in range(10)):
        best = nsga2(problem, seed=0).best(problem).objective
        for name, solve in METHODS.items():
            start = time.process_time()
            found = [solve(problem, attempt).objective for attempt in range(ATTEMPTS)]
            used[name].append((time.process_time() - start) / ATTEMPTS)
            ratios[name].append(float(np.mean(found)) / best)
    measures = []
    for name, values in ratios.items():
        within = float(np.mean(np.array(values) <= 1.01))
        label = f"2 trains, 3 cars, {name}"
        measures += [
            Measure(f"{label}: median objective / front's best", np.median(values), ""),
            Measure(f"{label}: problems within 1 % of the front", within, "", None, "higher"),
            Measure(f"{label}: processor time", np.median(used[name]), "s"),
        ]
    rng = np.random.default_rng(0)
    for rival in list(METHODS)[1:]:
        apart = np.log10(ratios[rival]) - np.log10(ratios["clonal selection"])
        draws = apart[rng.integers(len(apart), size=(10_000, len(apart)))].mean(axis=1)
        for end, value in zip(("low", "high"), np.quantile(draws, [0.025, 0.975]), strict=True):
            label = f"2 trains, 3 cars, {rival} over clonal, decades, 95 % {end}"
            measures.append(Measure(label, float(value), ""))
    return measures


def exchange(drives: int) -> list[Measure]:
    """Collisions, their causes, and what caution costs."""
    measures = []
    for radio, link in (("1-15 s", FIELD), ("always 15 s", WORST)):
        for name, policy in (("cautious", CAUTIOUS), ("as published", AS_PUBLISHED)):
            found = audit(drives, 0, link, policy)
            label = f"{drives} drives, 5 % loss, {radio}, {name}"
            measures += [
                Measure(f"{label}: unreported collisions", found.unreported, "", 0.0),
                Measure(f"{label}: collisions", found.collisions, ""),
                Measure(f"{label}: a perfect radio avoids", found.avoidable, ""),
                Measure(f"{label}: needless stops", found.needless_stops / drives, ""),
            ]
    return measures


def probability() -> list[Measure]:
    """The three printed collision probabilities."""
    measures = []
    for change, printed, ours in published_values():
        off = max(ours / printed, printed / ours)
        name = f"collision probability, car {change:g} km/h: {ours:.3g} for {printed:.3g}, factor"
        measures.append(Measure(name, off, "", 1.5))
    return measures


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", type=int, default=200, help="detector sets (default 200)")
    arguments.add_argument("--drives", type=int, default=200, help="drives (default 200)")
    parts: dict[str, Callable[[], list[Measure]]] = {
        "probability": probability,
        "detection": lambda: detection(options.seeds),
        "speed": speed,
        "reaction": reaction,
        "crowds": crowds,
        "exchange": lambda: exchange(options.drives),
    }
    arguments.add_argument(
        "--part", choices=list(parts), action="append", help="only this part (repeatable)"
    )
    options = arguments.parse_args()
    measures = [measure for name in options.part or parts for measure in parts[name]()]
    publish("crossing", measures, options.json)


if __name__ == "__main__":
    main()
