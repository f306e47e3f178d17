"""Detectors, and the index that matches situations against them.

A detector is a hypersphere d = (c, r_d); a sample p = (c_p, r_p) activates it if D < r_p + r_d.

The index is exact. Detectors are sorted into blocks of near neighbours by recursive median splits
(the leaves of a k-d tree); every block has a bounding ball, and a sample outside it skips the
block. Blocks that catch most of the space come first, and the search ends at the first hit. Inside
a block |x − c|² − r² = |x|² − 2·x·c + (|c|² − r²) is evaluated for all its detectors at once, so
that the machine's vector units do the work.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.crossing.situation import (
    DIMENSIONS,
    LOW,
    SPAN,
    Array,
    Situation,
    as_points,
    scaled,
)
from railops.errors import DomainError, check_range

Indices = npt.NDArray[np.int64]

Units = Literal["scaled", "raw"]

BLOCK = 32


class Index(NamedTuple):
    """What the inner function reads; K blocks of up to 32 detectors, padded by empty ones.

    Attributes:
        centre: Bounding balls' centres, shape (K, 8).
        radius: Their radii, shape (K,).
        double_centre: 2·c of the detectors, shape (K, 8, 32).
        offset: |c|² − r² (inf where padded), shape (K, 32).
        number: Each slot's detector, −1 where padded, shape (K, 32).
    """

    centre: Array
    radius: Array
    double_centre: Array
    offset: Array
    number: Indices


@dataclass(frozen=True)
class DetectorSet:
    """Mature detectors.

    Attributes:
        centres: Centres in the coordinates of ``units``, shape (K, 8); they may lie outside the
            situation space.
        radii: Radii r_d, shape (K,), > 0.
        self_radius: Distance from any safe sample within which none of them may reach.
        method: How they were made.
        seed: The seed they were made from.
        units: The coordinates, see :func:`coordinates`.
    """

    centres: Array
    radii: Array
    self_radius: float
    method: str
    seed: int
    units: Units = "scaled"
    _index: Index = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        centres = np.ascontiguousarray(self.centres, dtype=np.float64)
        radii = np.ascontiguousarray(self.radii, dtype=np.float64)
        if centres.ndim != 2 or centres.shape[1] != DIMENSIONS or radii.shape != centres.shape[:1]:
            shapes = f"shapes {centres.shape} and {radii.shape}"
            raise DomainError("centres and radii", shapes, f"(K, {DIMENSIONS}) and (K,)")
        if not (np.isfinite(centres).all() and (radii > 0.0).all() and np.isfinite(radii).all()):
            raise DomainError("detectors", "not all finite", "finite centres and radii above 0")
        if self.units not in ("scaled", "raw"):
            raise DomainError("units", self.units, "scaled or raw")
        check_range("self_radius", self.self_radius, 0.0, 1e4)
        object.__setattr__(self, "centres", centres)
        object.__setattr__(self, "radii", radii)
        object.__setattr__(self, "_index", _build(centres, radii, self.units))

    def __len__(self) -> int:
        return len(self.radii)

    def match(self, points: Array, sample_radius: float = 0.0) -> Indices:
        """The detector each sample activates (any one of them), −1 where none.

        Args:
            points: Samples in the set's own coordinates, shape (N, 8).
            sample_radius: r_p, how far the sample itself may be off, >= 0.

        Returns:
            Detector numbers, shape (N,).
        """
        samples = np.ascontiguousarray(points, dtype=np.float64)
        if samples.ndim != 2 or samples.shape[1] != DIMENSIONS:
            raise DomainError("samples", f"an array of shape {samples.shape}", "shape (N, 8)")
        if not np.isfinite(samples).all():
            raise DomainError("samples", "not all finite", "finite numbers")
        check_range("sample_radius", sample_radius, 0.0, 1e4)
        index = self._index
        if sample_radius > 0.0:  # D < r_p + r_d: every detector grows by r_p
            index = _build(self.centres, self.radii + sample_radius, self.units)
        return search(samples, *index)

    def alarms(self, points: Array, sample_radius: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether each sample activates any detector, shape (N,); arguments as in :meth:`match`."""
        return self.match(points, sample_radius) >= 0

    def judge(
        self, situations: Iterable[Situation] | npt.ArrayLike, sample_radius: float = 0.0
    ) -> Indices:
        """:meth:`match` for situations in their own units; they are checked against their ranges.

        Raises:
            DomainError: if a situation lies outside the space.
        """
        return self.match(coordinates(as_points(situations), self.units), sample_radius)


def coordinates(points: Array, units: Units) -> Array:
    """Situations in the coordinates of a detector set, shape (N, 8) to (N, 8).

    ``scaled`` is the unit cube, where all eight ranges weigh alike; ``raw`` measures from the
    ranges' lower ends in the published units, where the two distances outweigh everything else.
    """
    result: Array = scaled(points) if units == "scaled" else points - LOW
    return result


def extent(units: Units) -> Array:
    """The far corner of the situation space in these coordinates, shape (8,)."""
    return np.ones(DIMENSIONS) if units == "scaled" else SPAN.copy()


def distances(a: Array, b: Array) -> Array:
    """Euclidean distances between two sets of points, (N, 8) and (M, 8) to (N, M)."""
    apart: Array = np.sqrt(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2))
    return apart


def _leaves(centres: Array, numbers: Indices) -> list[Indices]:
    """Split at the median of the widest axis until a leaf fits a block."""
    if len(numbers) <= BLOCK:
        return [numbers]
    axis = int(np.argmax(np.ptp(centres[numbers], axis=0)))
    order = numbers[np.argsort(centres[numbers, axis], kind="stable")]
    half = len(order) // 2
    return _leaves(centres, order[:half]) + _leaves(centres, order[half:])


def _build(centres: Array, radii: Array, units: Units) -> Index:
    """Lay the detectors out in blocks, those that catch most of the space first."""
    count = len(radii)
    leaves = _leaves(centres, np.arange(count, dtype=np.int64)) if count else []
    index = Index(
        np.zeros((len(leaves), DIMENSIONS)),
        np.zeros(len(leaves)),
        np.zeros((len(leaves), DIMENSIONS, BLOCK)),
        np.full((len(leaves), BLOCK), np.inf),
        np.full((len(leaves), BLOCK), -1, dtype=np.int64),
    )
    probe = np.random.default_rng(0).random((512, DIMENSIONS)) * extent(units)
    caught = [(distances(probe, centres[leaf]) < radii[leaf]).any(axis=1).sum() for leaf in leaves]
    for block, place in enumerate(np.argsort(caught, kind="stable")[::-1]):
        leaf = leaves[place]
        middle = centres[leaf].mean(axis=0)
        reach = np.linalg.norm(centres[leaf] - middle, axis=1) + radii[leaf]
        index.centre[block], index.radius[block] = middle, reach.max()
        index.double_centre[block, :, : len(leaf)] = 2.0 * centres[leaf].T
        index.offset[block, : len(leaf)] = (centres[leaf] ** 2).sum(axis=1) - radii[leaf] ** 2
        index.number[block, : len(leaf)] = leaf
    return index


@compiled
def search(
    points: Array,
    centre: Array,
    radius: Array,
    double_centre: Array,
    offset: Array,
    number: Indices,
) -> Indices:
    """The activated detector of each point, −1 where none; arguments as in :class:`Index`.

    The eight coordinates are written out: only then does the compiler keep them in registers and
    run the loop over a block on the vector unit, six times faster than a loop over coordinates.
    """
    found = np.full(points.shape[0], -1, dtype=np.int64)
    c = double_centre
    for i in range(points.shape[0]):
        x0, x1, x2, x3 = points[i, 0], points[i, 1], points[i, 2], points[i, 3]
        x4, x5, x6, x7 = points[i, 4], points[i, 5], points[i, 6], points[i, 7]
        norm = x0 * x0 + x1 * x1 + x2 * x2 + x3 * x3 + x4 * x4 + x5 * x5 + x6 * x6 + x7 * x7
        for b in range(centre.shape[0]):
            apart = 0.0
            for k in range(DIMENSIONS):
                step = points[i, k] - centre[b, k]
                apart += step * step
            if apart >= radius[b] * radius[b]:
                continue
            hits, least, hit = 0, 0.0, -1
            for j in range(BLOCK):
                near = x0 * c[b, 0, j] + x1 * c[b, 1, j] + x2 * c[b, 2, j] + x3 * c[b, 3, j]
                far = x4 * c[b, 4, j] + x5 * c[b, 5, j] + x6 * c[b, 6, j] + x7 * c[b, 7, j]
                hits += offset[b, j] + norm < near + far
            if hits == 0:
                continue
            for j in range(BLOCK):
                near = x0 * c[b, 0, j] + x1 * c[b, 1, j] + x2 * c[b, 2, j] + x3 * c[b, 3, j]
                far = x4 * c[b, 4, j] + x5 * c[b, 5, j] + x6 * c[b, 6, j] + x7 * c[b, 7, j]
                power = (offset[b, j] + norm) - (near + far)
                if power < least:
                    least, hit = power, j
            if hit >= 0:
                found[i] = number[b, hit]
                break
    return found
