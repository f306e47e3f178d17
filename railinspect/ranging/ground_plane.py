"""Range from the image row, over a plane, below a camera of known height and horizon.

For a camera of height h and pitch θ the plane appears s rows below the horizon at

    x = f·h / (s·cos²θ) − h·tan θ

metres ahead of the point under the camera (:mod:`railinspect.track.level`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from railinspect.errors import BadInputError


@dataclass(frozen=True)
class PlaneRange:
    """A range from a row, with its relative standard deviations by cause.

    Attributes:
        range_m: Distance ahead on the plane, metres.
        row_rel: From the row of the foot (noise).
        horizon_rel: From the horizon's row, that is the pitch (noise and bias).
        height_rel: From the camera's height (bias).
        focal_rel: From the focal length (bias).
        plane_rel: From the ground not being a plane: a change of gradient on the way.
    """

    range_m: float
    row_rel: float
    horizon_rel: float
    height_rel: float
    focal_rel: float
    plane_rel: float

    @property
    def std_m(self) -> float:
        """All causes together, independent of each other, metres."""
        return self.range_m * math.hypot(
            self.row_rel, self.horizon_rel, self.height_rel, self.focal_rel, self.plane_rel
        )


GRADIENT_STD = 0.001
"""Standard deviation of the gradient at the camera against the plane the horizon stands for."""

VERTICAL_CURVATURE_STD = 1.0e-4
"""Standard deviation of a track's vertical curvature, 1/m: curves of 10 km radius are common,
of 2 km rare. The mean gradient up to x differs from that at the camera by half of it times x."""


def range_from_row(
    below_px: float,
    height_m: float,
    focal_px: float,
    pitch_rad: float = 0.0,
    row_std_px: float = 0.0,
    horizon_std_px: float = 0.0,
    height_std_m: float = 0.0,
    focal_std_px: float = 0.0,
    gradient_std: float = 0.003,
) -> PlaneRange:
    """Range of a point of the ground.

    A mean gradient g against the plane lifts a point at x by g·x, which moves its row as a change
    of height would: δx/x = g·x/h.

    Args:
        below_px: Rows s of the point below the horizon (levelled view), pixels, > 0.
        height_m: Camera height h above the plane, metres, > 0.
        focal_px: Focal length, pixels, > 0.
        pitch_rad: Pitch θ, radians.
        row_std_px: Standard deviation of the point's row.
        horizon_std_px: Standard deviation of the horizon's row.
        height_std_m: Standard deviation of h.
        focal_std_px: Standard deviation of f.
        gradient_std: Standard deviation of g, the mean gradient up to the point against the plane.

    Raises:
        BadInputError: if s, h or f is not positive and finite; a point at or above the horizon
            has no range.

    Example:
        >>> round(range_from_row(30.0, 3.0, 1000.0).range_m, 6)
        100.0
    """
    for name, value in (("below_px", below_px), ("height_m", height_m), ("focal_px", focal_px)):
        if not (math.isfinite(value) and value > 0):
            raise BadInputError(f"{name} is {value}; a range needs a positive number")
    range_m = focal_px * height_m / (below_px * math.cos(pitch_rad) ** 2)
    range_m -= height_m * math.tan(pitch_rad)
    return PlaneRange(
        range_m,
        row_std_px / below_px,
        horizon_std_px / below_px,
        height_std_m / height_m,
        focal_std_px / focal_px,
        gradient_std * range_m / height_m,
    )
