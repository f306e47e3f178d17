"""The row-to-range scale of one frame, fitted to the rails over the whole visible track.

Each row in which both rails are seen is a range measurement of its own: rails a spacing w metres
apart and p pixels in the image are Z = f·w/p away (001, eq. 5 with tan φ = p/f), whatever the
ground does. One row is noisy; the track is smooth. In a vertical section with the camera at height
h above the rails under it, a rail at distance x and height z(x) appears at the slope

    t = (h − z(x))/x + δ        z'' piecewise linear

below the horizontal (δ: what the assumed pitch is off). With q = 1/x measured by the spacing this
is linear in δ, h and z'', so all rows are fitted at once; a foot's row then has one range, whose
error follows from the fit's covariance. Neither the camera's height nor its pitch need be known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.ranging.scale_fit import GRID_M, KNOTS_M, bend_basis, fit, levelled, slope
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ScaleSettings:
    """What the fit expects of tracks and of masks.

    Attributes:
        spacing_std_px: Standard deviation of the rails' spacing in one row, pixels of a 640
            pixels wide image; the scatter actually seen replaces it where that is larger.
        correlated_rows: Neighbouring rows see the same blobs: at least so many count as one.
        curvature_std: Standard deviation of the track's vertical curvature z'', 1/m.
        height_rel: Standard deviation of the camera's height against the expected one, relative.
        pitch_std_rad: Standard deviation of the pitch against the expected one.
        least_rows: Fewest rows a fit may rest on.
        beyond: How far beyond the last row that was seen ranges are still given, as a factor.
    """

    spacing_std_px: float = 0.25
    correlated_rows: float = 4.0
    curvature_std: float = 1.0e-4
    height_rel: float = 0.15
    pitch_std_rad: float = 0.03
    least_rows: int = 8
    beyond: float = 1.35

    @property
    def spread(self) -> tuple[float, float, float]:
        """Standard deviations of pitch (rad), relative height and curvature (1/m) beforehand."""
        return self.pitch_std_rad, self.height_rel, self.curvature_std


@dataclass(frozen=True)
class FootRange:
    """Where a foot stands by the fitted scale.

    Attributes:
        range_m: Along the track, metres.
        fit_rel: Relative standard deviation from the fit (noise of the rails).
        slope_per_m: Relative change of the range per metre the foot stands above the rail tops.
        row_rel_per_px: Relative change of the range per pixel of the foot's row.
    """

    range_m: float
    fit_rel: float
    slope_per_m: float
    row_rel_per_px: float


@dataclass(frozen=True)
class TrackScale:
    """The fitted scale of one frame.

    Attributes:
        camera: The camera it refers to.
        pitch_rad: Pitch θ₀ assumed, about which ``parameters[0]`` is the correction δ.
        parameters: δ (rad), h (m), z'' at the knots (1/m), shape (2 + K,).
        covariance: Of the parameters, shape (2 + K, 2 + K).
        slope_t: Slope below the horizontal at ``GRID_M``, decreasing up to ``far_m``.
        chainage_m: Chainage at ``GRID_M``.
        far_m: Farthest ground distance at which a range is given.
        scatter_px: Scatter of the rails' spacing about the fit in one row, pixels.
        rows: Rows used.
    """

    camera: Camera
    pitch_rad: float
    parameters: Array
    covariance: Array
    slope_t: Array
    chainage_m: Array
    far_m: float
    scatter_px: float
    rows: int

    @property
    def height_m(self) -> float:
        """Height of the camera above the rail tops as the rails show it, metres."""
        return float(self.parameters[1])

    @property
    def horizon_pitch_rad(self) -> float:
        """Pitch against the plane of the rails under the camera, radians."""
        return self.pitch_rad - float(self.parameters[0])

    @cached_property
    def _view(self) -> tuple[float, float, float, float, float, float]:
        camera = self.camera
        turn = (math.cos(camera.roll_rad), math.sin(camera.roll_rad))
        return (*camera.principal_uv, *turn, camera.focal_px, math.tan(self.pitch_rad))

    def chainage_at(self, x_m: float) -> float:
        """Chainage of the track at the distance ``x_m`` straight ahead, metres."""
        return float(np.interp(x_m, GRID_M, self.chainage_m))

    def at(self, foot_uv: Array | tuple[float, float], foot_m: float = 0.0) -> FootRange | None:
        """Range of a point of the ground ``foot_m`` above the rail tops; None beyond the scale."""
        camera = self.camera
        u, v = camera.undistort(foot_uv) if any(camera.distortion) else foot_uv
        x, chainage, per_t, noise, incidence, per_px = _foot(
            (float(u), float(v)),
            self._view,
            float(foot_m),
            self.slope_t,
            self.chainage_m,
            self.parameters,
            self.covariance,
            self.far_m,
        )
        if math.isnan(x):
            return None
        return FootRange(
            chainage,
            per_t * noise,
            1.0 / incidence,
            per_px,
        )


@numba.njit(cache=True)
def _foot(
    foot_uv: tuple[float, float],
    view: tuple[float, float, float, float, float, float],
    foot_m: float,
    slope_t: Array,
    chainage_m: Array,
    parameters: Array,
    covariance: Array,
    far_m: float,
) -> tuple[float, float, float, float, float, float]:
    """Where the line of sight of a pixel meets the ground ``foot_m`` above the fitted rails.

    Distance x and chainage, |d ln x / d t| with t the slope below the horizontal, the standard
    deviation of t by the fit, the height above the tangent at x, and |d ln x| per pixel of the
    row; x is NaN beyond the scale.
    """
    nothing = (np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)
    _, row = levelled(foot_uv[0], foot_uv[1], view)
    t = slope(row, view)
    # The nearest crossing: behind a crest the same row shows farther ground again.
    index = 0
    while index < len(GRID_M) and slope_t[index] - foot_m / GRID_M[index] > t:
        index += 1
    if index in (0, len(GRID_M)):
        return nothing
    first, second = 1.0 / GRID_M[index - 1], 1.0 / GRID_M[index]
    a, b = slope_t[index - 1] - foot_m * first, slope_t[index] - foot_m * second
    x = 1.0 / (first + (a - t) / (a - b) * (second - first))
    if x > far_m:
        return nothing
    knots = len(KNOTS_M)
    basis, lean, gradient = np.empty(knots), np.empty(knots), np.empty(knots + 2)
    bend_basis(x, basis, lean)
    incidence = parameters[1] - foot_m  # height above the tangent at x
    gradient[0], gradient[1] = 1.0, 1.0 / x
    for k in range(knots):
        incidence += (lean[k] * x - basis[k]) * parameters[2 + k]
        gradient[2 + k] = -basis[k] / x
    if incidence <= 0.1 * parameters[1]:
        return nothing
    variance = 0.0
    for i in range(len(gradient)):
        for j in range(len(gradient)):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    share = (x - GRID_M[index - 1]) / (GRID_M[index] - GRID_M[index - 1])
    chainage = chainage_m[index - 1] + share * (chainage_m[index] - chainage_m[index - 1])
    per_t = x / incidence
    per_px = per_t / (view[4] * (1.0 + (row / view[4]) ** 2))
    return x, chainage, per_t, math.sqrt(variance), incidence, per_px


def fit_scale(track: TrackGeometry, settings: ScaleSettings | None = None) -> TrackScale | None:
    """Fit the scale to a followed track.

    Args:
        track: The track of one frame.
        settings: What is expected.

    Returns:
        The scale, or None where both rails are seen in too few rows.
    """
    settings = settings or ScaleSettings()
    path, profile = track.path, track.profile
    if path is None or profile is None:
        return None
    camera = track.camera
    px = camera.size_wh[0] / 640.0
    bent = any(camera.distortion)
    rows, parameters, covariance, scatter_px, slope_t, chainage, far = fit(
        camera.undistort(profile.uv) if bent else profile.uv,
        profile.residual_m,
        profile.doubtful,
        profile.at_switch,
        profile.chainage_m,
        camera.undistort(path.uv) if bent else path.uv,
        path.chainage_m,
        path.heading_rad,
        path.seen,
        (
            camera.focal_px,
            *camera.principal_uv,
            camera.roll_rad,
            camera.pitch_rad,
            camera.yaw_rad,
            camera.rail_spacing_m,
            camera.height_m,
        ),
        settings.spacing_std_px * px,
        2.0 * px,
        settings.spread,
        settings.correlated_rows,
        settings.least_rows,
        settings.beyond,
    )
    if rows == 0:
        return None
    return TrackScale(
        camera,
        camera.pitch_rad,
        parameters,
        covariance,
        slope_t,
        chainage,
        far,
        scatter_px,
        rows,
    )
