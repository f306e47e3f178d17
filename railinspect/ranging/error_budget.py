"""What a camera can range before anything is measured: errors by cause, and the reliable range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.ranging.along_track import COARSE_PX, RangingSettings
from railinspect.ranging.ground_level import BED_M

OWN_M = 0.085
"""What pictures finer than the masks leave open of a foot's place, metres of height: median of what
they said of 350 things on rendered rides (600–619)."""


@dataclass(frozen=True)
class Budget:
    """Expected relative errors of a range by the gauge on straight, level track.

    Attributes:
        range_m: Range, metres.
        noise: Relative standard deviation by cause that differs from frame to frame.
        bias: The same by cause that stays.
    """

    range_m: float
    noise: dict[str, float]
    bias: dict[str, float]

    @property
    def noise_rel(self) -> float:
        """All noise together."""
        return math.hypot(*self.noise.values())

    @property
    def bias_rel(self) -> float:
        """All biases together."""
        return math.hypot(*self.bias.values())

    @property
    def std_m(self) -> float:
        """Noise and bias together, metres."""
        return self.range_m * math.hypot(self.noise_rel, self.bias_rel)


def budget(camera: Camera, range_m: float, settings: RangingSettings | None = None) -> Budget:
    """Errors to expect at a range.

    The fitted scale rests on the rows around the foot: from a good half of the range to a little
    beyond it, as the vertical curvature allows.

    Args:
        camera: The camera with its standard deviations.
        range_m: Range, metres, > 0.
        settings: Errors that no calibration states.

    Example:
        >>> camera = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5)
        >>> round(budget(camera, 100.0).std_m, 1)
        3.5
    """
    if not (math.isfinite(range_m) and range_m > 0):
        raise BadInputError(f"range_m is {range_m}; give a positive number")
    settings = settings or RangingSettings()
    px = camera.size_wh[0] / 640.0
    height = camera.height_m - BED_M
    row_px = camera.focal_px * height / range_m  # of the foot, below the horizon
    spacing_px = camera.focal_px * camera.rail_spacing_m / range_m
    rows = max(1.0, row_px * (1.0 / 0.6 - 1.0) / settings.scale.correlated_rows)
    return Budget(
        range_m,
        {
            "row": _foot_px(camera, row_px / height, settings) / row_px,
            "along": settings.foot_along_m / range_m,
            "spacing": settings.scale.spacing_std_px * px / spacing_px / math.sqrt(rows),
        },
        {
            "focal": camera.std.focal_px / camera.focal_px,
            "gauge": camera.std.gauge_m / camera.rail_spacing_m,
            "level": settings.bed_std_m / height,
        },
    )


def _foot_px(camera: Camera, metre_px: float, settings: RangingSettings) -> float:
    """Standard deviation to expect of a foot's row, pixels, where a metre is ``metre_px``."""
    if camera.size_wh[0] < COARSE_PX or settings.foot_mask_m == 0.0:
        return settings.foot_std_px * camera.size_wh[0] / 640.0
    return math.hypot(1.0, math.hypot(settings.foot_picture_m, OWN_M) * metre_px)


def reliable_range(camera: Camera, settings: RangingSettings | None = None) -> float:
    """Range beyond which a set-up returns no number, metres; 0 where it never does.

    The same limits as in :class:`railinspect.ranging.FrameRanging`: the rails' spacing, the noise
    and the whole error.

    Example:
        >>> camera = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5)
        >>> 250 < reliable_range(camera) < 450
        True
    """
    settings = settings or RangingSettings()
    px = camera.size_wh[0] / 640.0
    most = camera.focal_px * camera.rail_spacing_m / (settings.least_spacing_px * px)
    last = 0.0
    for range_m in np.geomspace(3.0, most, 200):
        errors = budget(camera, float(range_m), settings)
        if range_m > 10.0 and errors.noise_rel > settings.worst_noise_rel:
            break
        if math.hypot(errors.noise_rel, errors.bias_rel) > settings.worst_rel:
            break
        last = float(range_m)
    return last
