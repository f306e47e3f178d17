"""Is a camera up to a speed? Source 002, Appendix D, for any cab camera, as one report.

Depth of field, braking distance and lateral shift are :mod:`railops.pilot.camera`'s; motion blur
and the ranging errors are added here.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.ranging.along_track import RangingSettings
from railinspect.ranging.error_budget import budget, reliable_range
from railops.pilot.camera import Optics, braking_distance, lateral_shift

RANGES_M = (10.0, 25.0, 50.0, 100.0, 150.0, 200.0, 250.0)
"""Ranges the report shows."""


@dataclass(frozen=True)
class Operation:
    """How a camera is used.

    Attributes:
        speed_mps: Speed, m/s, >= 0.
        decel_mps2: Emergency deceleration, m/s², > 0.
        recognition_s: Time from light to decision, s, >= 0.
        exposure_s: Exposure time, s, > 0.
        radius_m: Tightest curve to look into, metres.
    """

    speed_mps: float
    decel_mps2: float = 1.2
    recognition_s: float = 0.5
    exposure_s: float = 1e-3
    radius_m: float = 600.0

    def __post_init__(self) -> None:
        for name, least in (
            ("speed_mps", 0.0),
            ("decel_mps2", 1e-3),
            ("recognition_s", 0.0),
            ("exposure_s", 1e-9),
            ("radius_m", 10.0),
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= least):
                raise BadInputError(f"{name} is {value}; give at least {least:g}")


def motion_blur(
    focal_px: float, speed_mps: float, exposure_s: float, range_m: float, aside_m: float
) -> float:
    """Pixels a resting point smears over while the train moves on during the exposure.

    A point ``aside_m`` off the axis at x appears at f·a/x; after v·t it is at f·a/(x − v·t).

    Args:
        focal_px: Focal length, pixels, > 0.
        speed_mps: Speed v, m/s, >= 0.
        exposure_s: Exposure t, s, >= 0.
        range_m: Range x, metres, > 0.
        aside_m: Distance a from the axis, sideways or downwards, metres.

    Returns:
        Pixels; infinite where the train passes the point during the exposure.

    Example:
        >>> round(motion_blur(3000.0, 40.0, 1e-3, 25.0, 2.5), 2)
        0.48
    """
    gone = speed_mps * exposure_s
    if gone >= range_m:
        return math.inf
    return focal_px * abs(aside_m) * gone / (range_m * (range_m - gone))


def report(
    camera: Camera,
    operation: Operation,
    optics: Optics | None = None,
    settings: RangingSettings | None = None,
) -> dict[str, Any]:
    """Everything that limits how far ahead a camera is of use, as a JSON-ready mapping.

    Args:
        camera: The camera with its standard deviations.
        operation: Speed, brakes, exposure, curve.
        optics: The lens, where known: then the sharp interval is part of the report.
        settings: Errors that no calibration states.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        stop_m = braking_distance(
            operation.speed_mps, operation.recognition_s, operation.decel_mps2
        )
    reliable_m = reliable_range(camera, settings)
    sharp = None if optics is None else optics.sharp_m
    rows = []
    for range_m in RANGES_M:
        errors = budget(camera, range_m, settings)
        rows.append(
            {
                "range_m": range_m,
                "gauge_px": camera.focal_px * camera.gauge_m / range_m,
                "row_m_per_px": range_m**2 / (camera.focal_px * camera.height_m),
                "blur_px": motion_blur(
                    camera.focal_px,
                    operation.speed_mps,
                    operation.exposure_s,
                    range_m,
                    camera.height_m,
                ),
                "lateral_shift_m": lateral_shift(operation.radius_m, range_m)
                if range_m <= operation.radius_m
                else None,
                "noise_m": range_m * errors.noise_rel,
                "bias_m": range_m * errors.bias_rel,
                "std_m": errors.std_m,
                "reliable": range_m <= reliable_m,
            }
        )
    problems = [str(warning.message) for warning in caught]
    if reliable_m < stop_m:
        problems.append(
            f"the reliable range of {reliable_m:.0f} m is shorter than the braking distance of "
            f"{stop_m:.0f} m"
        )
    if sharp is not None and sharp[1] < stop_m:
        problems.append(
            f"the picture is sharp up to {sharp[1]:.0f} m, short of the braking distance of "
            f"{stop_m:.0f} m"
        )
    return {
        "braking_distance_m": stop_m,
        "reliable_range_m": reliable_m,
        "sharp_m": None if sharp is None else [s if math.isfinite(s) else None for s in sharp],
        "working_distance_m": None if optics is None else optics.working_m,
        "ranges": rows,
        "problems": problems,
    }
