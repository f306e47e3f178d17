"""V-detectors: negative selection with variable radii, the modern rival of the moving detectors.

After Ji and Dasgupta (Real-valued negative selection algorithm with variable-sized detectors, GECCO
2004): a candidate centre is drawn evenly over the space; if it is covered already it only counts as
evidence of coverage, otherwise it becomes a detector as large as the safe samples allow,
r_d = D(nearest safe) − r_s. Training ends when enough candidates in a row were covered, or at a
given number of detectors. By construction no detector reaches a safe sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from railops._compile import compiled
from railops.crossing.coverage import trials_in_a_row
from railops.crossing.detectors import DetectorSet, Units, coordinates, extent
from railops.crossing.situation import DIMENSIONS, Array, Situation, as_points
from railops.errors import DomainError, check_range
from railops.seeds import generator

_BATCH = 256
_MOST_BATCHES = 4_000
_HOPELESS = 10_000
"""After so many draws without one outside the safe balls there is no room."""


@dataclass(frozen=True)
class Settings:
    """When to stop, and how close detectors may come to safe samples.

    Attributes:
        self_radius: r_s in the coordinates of ``units``; the thesis's 0.2, taken in the unit cube.
        detectors: Largest number of detectors.
        coverage: Share of the space outside the safe balls that has to be covered, in (0, 1).
        confidence: Confidence of the coverage test.
        units: The unit cube, or raw.
    """

    self_radius: float = 0.2
    detectors: int = 1000
    coverage: float = 0.997
    confidence: float = 0.95
    units: Units = "scaled"

    def __post_init__(self) -> None:
        check_range("self_radius", self.self_radius, 0.0, 1e4)
        check_range("detectors", self.detectors, 1, 100_000)
        check_range("coverage", self.coverage, 0.0, 1.0 - 1e-9, above=True)
        check_range("confidence", self.confidence, 0.0, 1.0 - 1e-9, above=True)


def train(
    safe: npt.ArrayLike | list[Situation], seed: int, settings: Settings | None = None
) -> DetectorSet:
    """Grow V-detectors around safe situations.

    Args:
        safe: The safe situations ("self"), in their own units, shape (N, 8), N >= 1.
        seed: Seed of the random numbers, kept in the result.
        settings: When to stop; by default at 99.7 % coverage or 1000 detectors.

    Raises:
        DomainError: if there is no safe situation, one leaves the space, or the safe balls leave
            no room for a detector.

    Example:
        >>> from railops.crossing.published import ALARMED, ANTIGENS, SELF
        >>> detectors = train(SELF, seed=1)
        >>> int((detectors.judge(ANTIGENS[:ALARMED]) >= 0).sum())
        11
    """
    chosen = settings or Settings()
    points = as_points(safe)
    if len(points) == 0:
        raise DomainError("safe", "no situations", "at least one safe situation to learn from")
    kept = coordinates(points, chosen.units)
    tree = KDTree(kept)
    rng = generator(seed)
    far = extent(chosen.units)
    enough = trials_in_a_row(chosen.coverage, chosen.confidence)
    centres, radii = np.empty((chosen.detectors, DIMENSIONS)), np.empty(chosen.detectors)
    count, in_a_row, outside = 0, 0, 0
    for batch in range(_MOST_BATCHES):
        if batch * _BATCH >= _HOPELESS and not outside:
            break
        candidates = rng.random((_BATCH, DIMENSIONS)) * far
        rooms = np.asarray(tree.query(candidates)[0]) - chosen.self_radius
        candidates, rooms = candidates[rooms > 0.0], rooms[rooms > 0.0]
        outside += len(rooms)
        count, in_a_row = grow(candidates, rooms, centres, radii, count, in_a_row, enough)
        if in_a_row >= enough or count >= chosen.detectors:
            break
    if count == 0:
        raise DomainError(
            "self_radius", chosen.self_radius, "small enough to leave room for a detector"
        )
    centres, radii = centres[:count], radii[:count]
    return DetectorSet(centres, radii, chosen.self_radius, "V-detectors", seed, chosen.units)


@compiled
def grow(
    candidates: Array,
    rooms: Array,
    centres: Array,
    radii: Array,
    count: int,
    in_a_row: int,
    enough: int,
) -> tuple[int, int]:
    """Try candidates in turn: an uncovered one becomes a detector, a covered one is evidence.

    Args:
        candidates: Shape (N, 8).
        rooms: How large each may become, shape (N,), > 0.
        centres: Filled from ``count`` on, shape (K, 8).
        radii: Likewise, shape (K,).
        count: Detectors so far.
        in_a_row: Covered candidates in a row so far.
        enough: How many of those end the training.

    Returns:
        ``count`` and ``in_a_row`` after the last candidate tried.
    """
    for i in range(candidates.shape[0]):
        if in_a_row >= enough or count >= radii.shape[0]:
            break
        covered = False
        for d in range(count):
            apart = 0.0
            for k in range(DIMENSIONS):
                step = candidates[i, k] - centres[d, k]
                apart += step * step
            if apart < radii[d] * radii[d]:
                covered = True
                break
        if covered:
            in_a_row += 1
            continue
        in_a_row = 0
        centres[count], radii[count] = candidates[i], rooms[i]
        count += 1
    return count, in_a_row
