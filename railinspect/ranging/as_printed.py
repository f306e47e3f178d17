"""What source 001 printed, where it does not follow from consistent units.

Nothing here is used by the package: golden tests and the docs page compare it with the default.
"""

from __future__ import annotations

import math


def stereo_error(range_m: float, baseline_m: float, focal_m: float, step_rad: float) -> float:
    """(4) with Δω = 0.47·10⁻³ read as *metres* of parallax, metres.

    The pixel step is an angle; on the sensor it is f·Δω, ten times less at f = 0.1 m.

    Example:
        >>> round(stereo_error(20.0, 2.5, 0.1, 0.47e-3), 2)
        0.72
    """
    parallax = baseline_m * focal_m / range_m
    return focal_m * baseline_m / parallax * step_rad / (parallax + step_rad)


def goniometer_error(range_m: float, size_m: float, size_error_m: float, step_rad: float) -> float:
    """(7), in which a size too large and an angle too large partly cancel, metres.

    Example:
        >>> round(goniometer_error(20.0, 2.7, 0.1, 0.47e-3), 2)
        0.67
    """
    angle = math.atan(size_m / range_m)
    return (size_m + size_error_m) / math.tan(angle + step_rad) - size_m / math.tan(angle)
