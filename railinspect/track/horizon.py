"""Horizon and camera height from how the rails' spacing grows with the row.

In the levelled view the spacing of the rails is ``w = k·(Y − Y_h)``: a straight line whose zero is
the horizon and whose slope k = spacing_m·cos θ / h gives the camera's height without knowing its
focal length. A two-state Kalman filter keeps both. They belong to the vehicle and hardly change,
but the suspension makes the horizon swing about its mean: a frame's horizon is the mean with that
swing added, and another track's rails, which need another k and another horizon, are no match.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera

Array = npt.NDArray[np.float64]

Measured = tuple[float, float, Array]
"""Horizon row, spacing growth and their covariance, as one frame's rails show them."""


@dataclass(frozen=True)
class Horizon:
    """Estimate of the horizon row and the spacing growth.

    Attributes:
        row_px: Y_h, levelled pixels below the principal point.
        growth: k, pixels of spacing per row below the horizon.
        covariance: Of (Y_h, k), shape (2, 2).
    """

    row_px: float
    growth: float
    covariance: Array

    @property
    def row_std_px(self) -> float:
        """Standard deviation of the horizon row, pixels."""
        return math.sqrt(max(0.0, float(self.covariance[0, 0])))

    @property
    def growth_std(self) -> float:
        """Standard deviation of ln k."""
        return math.sqrt(max(0.0, float(self.covariance[1, 1]))) / self.growth

    def later(self, row_walk_px: float, growth_walk: float) -> Horizon:
        """The estimate one frame later: less certain by a random walk of each state."""
        walk = np.array([[row_walk_px**2, 0.0], [0.0, (growth_walk * self.growth) ** 2]])
        return Horizon(self.row_px, self.growth, self.covariance + walk)

    def swung(self, swing_px: float) -> Horizon:
        """What is known of one frame's horizon, about which the vehicle swings."""
        swing = np.array([[swing_px**2, 0.0], [0.0, 0.0]])
        return Horizon(self.row_px, self.growth, self.covariance + swing)

    def updated(self, row_px: float, growth: float, covariance: Array) -> Horizon:
        """The estimate after a measurement of both states with its covariance."""
        # Gain P·(P + R)⁻¹ written out: two by two, NumPy's solver costs more than the sums.
        (p00, p01), (_, p11) = self.covariance.tolist()
        (r00, r01), (_, r11) = covariance.tolist()
        s00, s01, s11 = p00 + r00, p01 + r01, p11 + r11
        determinant = s00 * s11 - s01 * s01
        g00, g01 = (p00 * s11 - p01 * s01) / determinant, (p01 * s00 - p00 * s01) / determinant
        g10, g11 = (p01 * s11 - p11 * s01) / determinant, (p11 * s00 - p01 * s01) / determinant
        off_row, off_growth = row_px - self.row_px, growth - self.growth
        mixed = p01 - 0.5 * (g00 * p01 + g01 * p11 + g10 * p00 + g11 * p01)
        rest = [[p00 - g00 * p00 - g01 * p01, mixed], [mixed, p11 - g10 * p01 - g11 * p11]]
        return Horizon(
            self.row_px + g00 * off_row + g01 * off_growth,
            self.growth + g10 * off_row + g11 * off_growth,
            np.array(rest),
        )


def prior_horizon(camera: Camera, calibrated: bool) -> Horizon:
    """What is known before the first frame.

    A calibrated camera's pitch is trusted to its own standard deviation and 0.7° of vehicle
    motion. For an uncalibrated one the horizon lies near the middle of the image and the height
    between 1.4 m and 4.1 m (two standard deviations).
    """
    cos_pitch = math.cos(camera.pitch_rad)
    growth = camera.rail_spacing_m * cos_pitch / camera.height_m
    if calibrated:
        spread = math.hypot(camera.std.height_m / camera.height_m, camera.std.gauge_m / 1.5)
        row_std = camera.focal_px * math.hypot(camera.std.pitch_rad, math.radians(0.7))
        growth_std = math.hypot(spread, 0.02) * growth
        row = -camera.focal_px * math.tan(camera.pitch_rad)
    else:
        row_std, growth_std = 0.16 * camera.size_wh[1], 0.27 * growth
        row = -0.05 * camera.size_wh[1]
    return Horizon(row, growth, np.diag([row_std**2, growth_std**2]))


@numba.njit(cache=True)
def _line(rows: Array, spacing: Array, noise: float) -> tuple[float, float, float, float, Array]:
    """Robust line ``level + slope·(row − centre)``: centre, level, slope, scatter, cofactors."""
    centre = rows.mean()
    below = rows - centre
    weight = np.ones(rows.shape[0])
    level, slope, scale = 0.0, 0.0, noise
    cofactors = np.zeros((2, 2))
    for _ in range(3):
        g00, g01, g11 = weight.sum(), (weight * below).sum(), (weight * below * below).sum()
        h0, h1 = (weight * spacing).sum(), (weight * below * spacing).sum()
        determinant = g00 * g11 - g01 * g01
        level = (g11 * h0 - g01 * h1) / determinant
        slope = (g00 * h1 - g01 * h0) / determinant
        cofactors[0, 0], cofactors[1, 1] = g11 / determinant, g00 / determinant
        cofactors[0, 1] = cofactors[1, 0] = -g01 / determinant
        residual = spacing - level - slope * below
        scale = max(noise, 1.4826 * np.median(np.abs(residual)))
        weight = 1.0 / (1.0 + (residual / (2.0 * scale)) ** 2)
    return centre, level, slope, scale, cofactors


def fit_growth(
    rows_px: Array, spacing_px: Array, noise_px: float, correlated: float = 8.0
) -> tuple[float, float, Array] | None:
    """Straight line of spacing over row, robust to outliers.

    Args:
        rows_px: Levelled rows Y, shape (N,).
        spacing_px: Spacing of the rails at these rows, shape (N,).
        noise_px: Standard deviation of one spacing, pixels.
        correlated: Neighbouring rows see the same blobs: so many count as one.

    Returns:
        Horizon row, growth and their covariance, or None where the rows do not span enough.
    """
    if len(rows_px) < 12 or np.ptp(rows_px) < 12 * noise_px:
        return None
    centre, level, slope, scale, line = _line(rows_px, spacing_px, noise_px)
    if slope <= 0.02:
        return None
    line = line * (scale**2 * correlated)
    # Y_h = centre − level/slope, k = slope
    jacobian = np.array([[-1.0 / slope, level / slope**2], [0.0, 1.0]])
    return float(centre - level / slope), float(slope), jacobian @ line @ jacobian.T
