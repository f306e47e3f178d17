"""Range from a known size and the angle it subtends.

D = l / tan φ                                                     [source 001, (5)]

With an undistorted pinhole image and a size l at right angles to the line of sight,
tan φ = p/f for an extent of p pixels, so D = l·f/p. The track gauge at an obstacle's foot is the
best size of all: it is known, on the ground, and exactly where the obstacle stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from railinspect.errors import BadInputError


@dataclass(frozen=True)
class SizeRange:
    """A range from a known size, with its relative standard deviations by cause.

    Attributes:
        range_m: Distance along the viewing axis, metres.
        extent_rel: From the measured extent (noise).
        size_rel: From the assumed size (bias: it does not average out).
        focal_rel: From the focal length (bias).
    """

    range_m: float
    extent_rel: float
    size_rel: float
    focal_rel: float

    @property
    def std_m(self) -> float:
        """All causes together, independent of each other, metres."""
        return self.range_m * math.hypot(self.extent_rel, self.size_rel, self.focal_rel)


def range_from_size(
    size_m: float,
    extent_px: float,
    focal_px: float,
    size_std_m: float = 0.0,
    extent_std_px: float = 0.0,
    focal_std_px: float = 0.0,
) -> SizeRange:
    """Range of something of known size.

    The relative errors follow from (5) to first order: each of l, p and f enters once.

    Args:
        size_m: Size l at right angles to the viewing axis, metres, > 0.
        extent_px: Its image p, pixels, > 0.
        focal_px: Focal length, pixels, > 0.
        size_std_m: Standard deviation of l.
        extent_std_px: Standard deviation of p.
        focal_std_px: Standard deviation of f.

    Raises:
        BadInputError: if the size, the extent or the focal length is not positive and finite.

    Example:
        >>> range_from_size(1.507, 15.07, 1000.0).range_m
        100.0
    """
    for name, value in (("size_m", size_m), ("extent_px", extent_px), ("focal_px", focal_px)):
        if not (math.isfinite(value) and value > 0):
            raise BadInputError(f"{name} is {value}; a range needs a positive number")
    return SizeRange(
        size_m * focal_px / extent_px,
        extent_std_px / extent_px,
        size_std_m / size_m,
        focal_std_px / focal_px,
    )
