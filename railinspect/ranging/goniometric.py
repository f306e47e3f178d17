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

    @property
    def noise_m(self) -> float:
        """The part that averages out over frames, metres."""
        return self.range_m * self.extent_rel

    @property
    def bias_m(self) -> float:
        """The part that stays, metres."""
        return self.range_m * math.hypot(self.size_rel, self.focal_rel)


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
        _positive(name, value)
    return SizeRange(
        size_m * focal_px / extent_px,
        extent_std_px / extent_px,
        size_std_m / size_m,
        focal_std_px / focal_px,
    )


def angle_of(size_m: float, range_m: float) -> float:
    """φ = arctan(l / D), (6), radians: what a size subtends from one end of it.

    Example:
        >>> round(angle_of(2.7, 20.0), 5)  # a car's width at 20 m
        0.13419
    """
    _positive("size_m", size_m)
    _positive("range_m", range_m)
    return math.atan(size_m / range_m)


def range_from_angle(size_m: float, angle_rad: float) -> float:
    """D = l / tan φ, (5), metres.

    Args:
        size_m: Size l, metres, > 0.
        angle_rad: Angle φ it subtends, radians, between 0 and π/2.

    Raises:
        BadInputError: at φ = 0, where the object is infinitely far, and outside (0, π/2).

    Example:
        >>> round(range_from_angle(2.7, angle_of(2.7, 20.0)), 9)
        20.0
    """
    _positive("size_m", size_m)
    if not 0.0 < angle_rad < math.pi / 2:
        raise BadInputError(
            f"the angle an object subtends is {angle_rad} rad; a range needs one between 0 and π/2"
        )
    return size_m / math.tan(angle_rad)


@dataclass(frozen=True)
class AngleError:
    """Error of a range by (5) from two independent causes.

    Attributes:
        from_angle_m: What the angle's error Δω does to the range, metres.
        from_size_m: What the size's error Δl does, metres.
        worst_m: Both at once and in the direction that adds up, metres.
    """

    from_angle_m: float
    from_size_m: float
    worst_m: float

    @property
    def std_m(self) -> float:
        """Root of the sum of squares: the two do not know of each other."""
        return math.hypot(self.from_angle_m, self.from_size_m)


def angle_error(range_m: float, size_m: float, size_error_m: float, step_rad: float) -> AngleError:
    """Error of a range by (5), instead of (7), in which the two causes partly cancel.

    The angle's part is that of (8): l·(tan(φ + Δω) − tan φ) / (tan φ·tan(φ + Δω)).

    Args:
        range_m: Range D, metres, > 0.
        size_m: Size l, metres, > 0.
        size_error_m: Its error Δl, metres, >= 0.
        step_rad: Error Δω of the angle, radians, >= 0.

    Example:
        >>> error = angle_error(20.0, 2.7, 0.1, 0.47e-3)
        >>> round(error.std_m, 3), round(error.worst_m, 3)
        (0.744, 0.815)
    """
    angle = angle_of(size_m, range_m)
    wider = math.tan(angle + step_rad)
    from_angle = size_m * (wider - math.tan(angle)) / (math.tan(angle) * wider)
    worst = (size_m + size_error_m) / math.tan(angle - step_rad) - range_m
    return AngleError(from_angle, size_error_m / math.tan(angle), worst)


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise BadInputError(f"{name} is {value}; a range needs a positive number")
