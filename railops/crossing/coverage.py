"""How much of the dangerous space a detector set covers, with a confidence interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy.typing as npt

from railops.braking.bounds import largest_probability
from railops.crossing.detectors import DetectorSet, coordinates, distances
from railops.crossing.situation import Situation, as_points, random_situations
from railops.errors import DomainError, check_range
from railops.seeds import generator


def interval(hits: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided Clopper–Pearson interval of a share, exact for any number of hits.

    Example:
        >>> [round(end, 4) for end in interval(95, 100)]
        [0.8872, 0.9836]
    """
    check_range("trials", trials, 1, 1e15)
    check_range("hits", hits, 0, trials)
    one_sided = 0.5 + 0.5 * confidence
    high = largest_probability(trials, one_sided, hits) if hits < trials else 1.0
    low = 1.0 - largest_probability(trials, one_sided, trials - hits) if hits else 0.0
    return low, high


def trials_in_a_row(coverage: float, confidence: float) -> int:
    """Covered samples in a row that support this coverage: ⌈ln(1 − β) / ln(coverage)⌉.

    Example:
        >>> trials_in_a_row(0.99, 0.95)
        299
    """
    return math.ceil(math.log1p(-confidence) / math.log(coverage))


@dataclass(frozen=True)
class Coverage:
    """Estimated share of the space outside the safe balls that raises an alarm.

    Attributes:
        share: The estimate.
        low: Lower end of the two-sided interval.
        high: Upper end.
        confidence: Confidence of the interval.
        samples: Situations drawn outside the safe balls.
        seed: Seed of the draws.
    """

    share: float
    low: float
    high: float
    confidence: float
    samples: int
    seed: int


def estimate(
    detectors: DetectorSet,
    safe: npt.ArrayLike | list[Situation],
    seed: int,
    samples: int = 20_000,
    confidence: float = 0.95,
) -> Coverage:
    """Estimate coverage by situations drawn evenly over the space, safe balls left out.

    Raises:
        DomainError: if not one drawn situation lies outside the safe balls.
    """
    check_range("samples", samples, 1, 1e8)
    kept = coordinates(as_points(safe), detectors.units)
    drawn = random_situations(int(samples), generator(seed))
    points = coordinates(drawn, detectors.units)
    outside = distances(points, kept).min(axis=1) > detectors.self_radius
    trials = int(outside.sum())
    if trials == 0:
        raise DomainError("samples", "all within the safe balls", "room outside them")
    hits = int(detectors.alarms(points[outside]).sum())
    low, high = interval(hits, trials, confidence)
    return Coverage(hits / trials, low, high, confidence, trials, seed)
