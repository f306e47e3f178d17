"""Tables 4.1 to 4.7 from runs, and today's statistics beside them.

The published z-test asks, per scenario, whether the probability before the reaction lies outside
the interval of the six attempts' mean. With six attempts of a method that finds the same answer
every time the standard deviation is zero and the interval a point, so the test says little; the
paired bootstrap and the Wilcoxon signed-rank test over scenarios (the independent unit) say more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from railops.crossing.experiment import Run
from railops.errors import EvidenceError
from railops.seeds import generator

Array = npt.NDArray[np.float64]

CRITERIA: dict[str, Callable[[Run], float]] = {
    "target function": lambda run: run.reaction.objective,
    "collision probability": lambda run: run.reaction.probability,
    "train speed change, km/h": lambda run: run.reaction.train_change_kmh,
    "machine time, s": lambda run: run.machine_s,
}

PUBLISHED_MEANS: dict[str, tuple[float, float, float]] = {
    "target function": (0.00119, 0.00962, 0.00263),
    "collision probability": (0.00086, 0.00327, 0.00088),
    "train speed change, km/h": (0.04167, 0.7, 0.15028),
    "machine time, s": (0.35433, 0.34762, 0.15961),
}
"""Tables 4.4 and 4.5: means of immune, genetic and neural methods."""

PUBLISHED_DEVIATIONS: dict[str, tuple[float, float, float]] = {
    "target function": (0.00011, 0.00088, 0.00024),
    "collision probability": (8e-5, 3e-4, 8e-5),
    "train speed change, km/h": (0.00382, 0.06417, 0.01378),
    "machine time, s": (0.01604, 0.01495, 0.00634),
}
"""Tables 4.6 and 4.7: standard deviations, in the same order."""


@dataclass(frozen=True)
class ZTest:
    """One row of Tables 4.1 to 4.3.

    Attributes:
        experiment: Its number, from 1: the first action range, then the second.
        low: Lower end of the 99.9 % interval of the mean probability after the reaction.
        high: Upper end.
        tested: The probability before the reaction.
        improved: The tested value lies above the interval.
    """

    experiment: int
    low: float
    high: float
    tested: float
    improved: bool


def values(runs: Sequence[Run], method: str, criterion: str) -> Array:
    """A criterion of a method, shape (experiments, attempts).

    Raises:
        EvidenceError: if the method has no runs.
    """
    groups: dict[tuple[float, int], list[float]] = {}
    for run in runs:
        if run.method == method:
            key = (run.actions.low_kmh, run.scenario)
            groups.setdefault(key, []).append(CRITERIA[criterion](run))
    if not groups:
        raise EvidenceError(f"there are no runs of {method}")
    return np.array(list(groups.values()))


def z_tests(runs: Sequence[Run], method: str, confidence: float = 0.999) -> list[ZTest]:
    """Tables 4.1 to 4.3: mean ± z·s/√n of the probability left, against the one before."""
    left = values(runs, method, "collision probability")
    before: dict[tuple[float, int], float] = {}
    for run in runs:
        if run.method == method:
            before.setdefault((run.actions.low_kmh, run.scenario), run.before)
    z = float(stats.norm.ppf(0.5 + 0.5 * confidence))
    rows = []
    for number, (attempts, tested) in enumerate(zip(left, before.values(), strict=True), start=1):
        spread = float(attempts.std(ddof=1)) if len(attempts) > 1 else math.nan
        half = z * spread / math.sqrt(len(attempts))
        low, high = float(attempts.mean()) - half, float(attempts.mean()) + half
        rows.append(ZTest(number, low, high, tested, tested > high))
    return rows


@dataclass(frozen=True)
class Comparison:
    """One row of Tables 4.4 to 4.7, with an interval.

    Attributes:
        criterion: What is compared.
        rival: The other method.
        mean: Mean of clonal selection.
        rival_mean: Mean of the rival.
        printed_percent: (rival − ours) / ours, %, the thesis's column; NaN where ours is 0.
        deviation: Mean of the experiments' standard deviations over attempts, clonal selection.
        rival_deviation: The rival's.
        difference_low: 95 % bootstrap interval of (rival − ours), experiments resampled.
        difference_high: Its upper end; an interval around 0 leaves the ranking open.
        p_value: Wilcoxon signed-rank test over experiments; 1 where all agree.
    """

    criterion: str
    rival: str
    mean: float
    rival_mean: float
    printed_percent: float
    deviation: float
    rival_deviation: float
    difference_low: float
    difference_high: float
    p_value: float


def compare(
    runs: Sequence[Run], rival: str, seed: int, ours: str = "clonal selection"
) -> list[Comparison]:
    """Tables 4.4 to 4.7 for one rival.

    Raises:
        EvidenceError: if either method has no runs.
    """
    rng = generator(seed)
    rows = []
    for criterion in CRITERIA:
        mine, other = values(runs, ours, criterion), values(runs, rival, criterion)
        apart = other.mean(axis=1) - mine.mean(axis=1)
        draws = apart[rng.integers(len(apart), size=(10_000, len(apart)))].mean(axis=1)
        low, high = np.quantile(draws, [0.025, 0.975])
        same = bool(np.all(np.abs(apart) < 1e-12))
        p = 1.0 if same else float(stats.wilcoxon(apart, method="approx").pvalue)
        mean, rival_mean = float(mine.mean()), float(other.mean())
        deviations = [
            float(item.std(axis=1, ddof=1).mean()) if item.shape[1] > 1 else math.nan
            for item in (mine, other)
        ]
        rows.append(
            Comparison(
                criterion,
                rival,
                mean,
                rival_mean,
                _percent(mean, rival_mean),
                deviations[0],
                deviations[1],
                float(low),
                float(high),
                p,
            )
        )
    return rows


def numbered(runs: Sequence[Run], seed: int) -> dict[str, list[dict[str, Any]]]:
    """Tables 4.1 to 4.7 by their numbers, each row of 4.4 to 4.7 with what the thesis printed.

    The methods are numbered as they first appear in ``runs``, clonal selection first: its rivals'
    tables are 4.2, 4.4 and 4.6, then 4.3, 4.5 and 4.7.
    """
    methods = list(dict.fromkeys(run.method for run in runs))
    result = {
        f"4.{number}": [asdict(row) for row in z_tests(runs, method)]
        for number, method in enumerate(methods, start=1)
    }
    for place, rival in enumerate(methods[1:], start=1):
        means: list[dict[str, Any]] = []
        deviations: list[dict[str, Any]] = []
        result[f"4.{3 + place}"], result[f"4.{5 + place}"] = means, deviations
        for row in compare(runs, rival, seed, methods[0]):
            for table, mine, other, printed in (
                (means, row.mean, row.rival_mean, PUBLISHED_MEANS),
                (deviations, row.deviation, row.rival_deviation, PUBLISHED_DEVIATIONS),
            ):
                known = printed[row.criterion]
                table.append(
                    {
                        "criterion": row.criterion,
                        "rival": rival,
                        "immune": mine,
                        "other": other,
                        "difference_percent": _percent(mine, other),
                        "published_immune": known[0],
                        "published_other": known[place],
                        "published_percent": _percent(known[0], known[place]),
                    }
                )
    return dict(sorted(result.items()))


def _percent(ours: float, rival: float) -> float:
    """(rival − ours) / ours, %, the thesis's last column; NaN where ours is 0."""
    return 100.0 * (rival - ours) / ours if ours > 0.0 else math.nan


def text(runs: Sequence[Run], seed: int) -> str:
    """All tables for people, and what the thesis printed beside the means."""
    methods = list(dict.fromkeys(run.method for run in runs))
    lines = []
    for method in methods:
        tests = z_tests(runs, method)
        count = sum(row.improved for row in tests)
        lines.append(f"Tables 4.1-4.3, {method}: {count} of {len(tests)} improved (99.9 % z-test)")
        lines += [
            f"  {row.experiment:>3}  ({row.low:.6f}; {row.high:.6f})  before {row.tested:.4f}"
            for row in tests
        ]
    for place, rival in enumerate(methods):
        if rival == "clonal selection":
            continue
        lines.append(f"Tables 4.4-4.7, clonal selection against {rival}: mean ± deviation of each,")
        lines.append(
            "  95 % interval of the difference, Wilcoxon's p; in brackets the thesis's means"
        )
        for row in compare(runs, rival, seed):
            printed = PUBLISHED_MEANS[row.criterion]
            lines.append(
                f"  {row.criterion:<24} {row.mean:.3g} ± {row.deviation:.2g} ({printed[0]:g})"
                f"   {row.rival_mean:.3g} ± {row.rival_deviation:.2g} ({printed[place]:g})"
                f"   [{row.difference_low:.2g}, {row.difference_high:.2g}]   p {row.p_value:.2g}"
            )
    return "\n".join(lines)
