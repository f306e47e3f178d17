"""Figures of merit from answers and truth: Table IV of the pilot-vehicle paper, and more.

The table's task is binary, anomalous or not: its *accuracy* is the share of all pictures told
right, its *sensitivity* per type the share of that type's pictures called anomalous. An answer
"unknown" is right for no picture: neither did it see the anomaly nor call a clear track clear.
Beside these stand the stricter figures: type and place right too.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from scipy.special import ndtri

from railinspect.boxes import area, boxes_touch
from railinspect.evaluation.answers import TYPES, Answer
from railinspect.evaluation.samples import Sample

RANGES_M: Final = (0.0, 20.0, 40.0, 60.0, 80.0, 120.0, math.inf)
SIZES_PX: Final = (0.0, 8.0, 16.0, 32.0, 64.0, math.inf)
"""Edges of the bands recall is told by: range along the track and root of the box's area."""


@dataclass(frozen=True)
class Rate:
    """A share of counted cases.

    Attributes:
        hits: Cases counted.
        of: All cases.
    """

    hits: int
    of: int

    @property
    def share(self) -> float:
        """``hits / of``; NaN without any case."""
        return self.hits / self.of if self.of else math.nan

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Wilson's score interval of the share; (0, 1) without any case.

        Example:
            >>> [round(bound, 3) for bound in Rate(141, 150).interval()]
            [0.89, 0.968]
        """
        if not self.of:
            return 0.0, 1.0
        z = float(ndtri(0.5 + confidence / 2))
        n, p = self.of, self.share
        centre = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(0.0, centre - half), min(1.0, centre + half)


@dataclass(frozen=True)
class Band:
    """Recall within a band of range or size; ``low <= value < high``."""

    low: float
    high: float
    rate: Rate


@dataclass(frozen=True)
class Scores:
    """Scores of one judge over one data set.

    Attributes:
        accuracy: Pictures told right, anomalous or not.
        sensitivity: By type: its pictures called anomalous.
        specificity: Clear pictures called clear.
        named: By type: its pictures called by their type,
        placed: and with a finding of that type at the anomaly's place.
        unknown: Pictures left unknown.
        confusion: Counts by (truth, said); truth "clear" for pictures without an anomaly.
        by_range: Recall (called anomalous) by range along the track, all types together.
        by_size: Recall by the root of the anomaly's box area, pixels.
        median_ms: Median processor time per picture after the segmentation.
        slowest_ms: The time 95 % of the pictures stay below.
    """

    accuracy: Rate
    sensitivity: dict[str, Rate]
    specificity: Rate
    named: dict[str, Rate]
    placed: dict[str, Rate]
    unknown: Rate
    confusion: dict[tuple[str, str], int]
    by_range: tuple[Band, ...]
    by_size: tuple[Band, ...]
    median_ms: float
    slowest_ms: float


def right(sample: Sample, answer: Answer) -> bool:
    """Whether the answer tells the picture right in the table's binary sense."""
    return answer.alarmed if sample.anomaly else answer.said == "clear"


def at_place(sample: Sample, answer: Answer) -> bool:
    """Whether a finding of the anomaly's type touches its box."""
    anomaly = sample.anomaly
    return anomaly is not None and any(
        type_ == anomaly.type and boxes_touch(box, anomaly.box_xyxy) for type_, box in answer.boxes
    )


def score(samples: Sequence[Sample], answers: Sequence[Answer]) -> Scores:
    """Score the answers against the truth.

    Args:
        samples: The data set.
        answers: One answer per sample, in the same order.
    """
    pairs = list(zip(samples, answers, strict=True))
    of_type = {
        name: [(s, a) for s, a in pairs if s.anomaly and s.anomaly.type == name] for name in TYPES
    }
    clear = [(s, a) for s, a in pairs if s.anomaly is None]
    ranged = [
        (s.anomaly.range_m, a.alarmed)
        for s, a in pairs
        if s.anomaly is not None and s.anomaly.range_m is not None
    ]
    sized = [(math.sqrt(area(s.anomaly.box_xyxy)), a.alarmed) for s, a in pairs if s.anomaly]
    times = sorted(a.time_ms for a in answers)
    return Scores(
        accuracy=Rate(sum(right(s, a) for s, a in pairs), len(pairs)),
        sensitivity={
            name: Rate(sum(a.alarmed for _, a in ones), len(ones)) for name, ones in of_type.items()
        },
        specificity=Rate(sum(a.said == "clear" for _, a in clear), len(clear)),
        named={
            name: Rate(sum(a.said == name for _, a in ones), len(ones))
            for name, ones in of_type.items()
        },
        placed={
            name: Rate(sum(at_place(s, a) for s, a in ones), len(ones))
            for name, ones in of_type.items()
        },
        unknown=Rate(sum(a.said == "unknown" for _, a in pairs), len(pairs)),
        confusion=dict(
            Counter((s.anomaly.type if s.anomaly else "clear", a.said) for s, a in pairs)
        ),
        by_range=_bands(ranged, RANGES_M),
        by_size=_bands(sized, SIZES_PX),
        median_ms=times[len(times) // 2] if times else math.nan,
        slowest_ms=times[int(0.95 * (len(times) - 1))] if times else math.nan,
    )


def _bands(values: Sequence[tuple[float, bool]], edges: Sequence[float]) -> tuple[Band, ...]:
    bands = []
    for low, high in pairwise(edges):
        inside = [hit for value, hit in values if low <= value < high]
        bands.append(Band(low, high, Rate(sum(inside), len(inside))))
    return tuple(bands)
