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

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.geometry import TrackGeometry
from railinspect.track.level import Level
from railinspect.track.smooth import centre_bases

Array = npt.NDArray[np.float64]

KNOTS_M = np.array([0.0, 50.0, 100.0, 160.0, 230.0, 320.0, 450.0])
"""Where z'' has its knots: vertical curves are tens of metres long."""

_GRID_M = np.concatenate([np.arange(2.0, 60.0, 1.0), np.geomspace(60.0, 600.0, 90)])
_KNOT_BASIS, _KNOT_SLOPE = (b[:, 2:] for b in centre_bases(_GRID_M, KNOTS_M))


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
        level: The levelled view it refers to.
        pitch_rad: Pitch θ₀ assumed, about which ``parameters[0]`` is the correction δ.
        parameters: δ (rad), h (m), z'' at the knots (1/m), shape (2 + K,).
        covariance: Of the parameters, shape (2 + K, 2 + K).
        slope_t: Slope below the horizontal at ``_GRID_M``, decreasing up to ``far_m``.
        chainage_m: Chainage at ``_GRID_M``.
        far_m: Farthest ground distance at which a range is given.
        scatter_px: Scatter of the rails' spacing about the fit in one row, pixels.
        rows: Rows used.
    """

    level: Level
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

    def at(self, foot_uv: Array, foot_m: float = 0.0) -> FootRange | None:
        """Range of a point of the ground ``foot_m`` above the rail tops; None beyond the scale."""
        camera = self.level.camera
        row = float(self.level.from_pixels(foot_uv[None, :])[0, 1])
        angle = math.atan(row / camera.focal_px) + self.pitch_rad
        t = math.tan(angle)
        slopes = self.slope_t - foot_m / _GRID_M
        # The nearest crossing: behind a crest the same row shows farther ground again.
        below = slopes <= t
        index = int(np.argmax(below))
        if not below[index] or index == 0 or _GRID_M[index - 1] > self.far_m:
            return None
        a, b = slopes[index - 1], slopes[index]
        inverse = 1.0 / _GRID_M
        share = (a - t) / (a - b)
        x = 1.0 / (inverse[index - 1] + share * (inverse[index] - inverse[index - 1]))
        if x > self.far_m:
            return None
        basis, lean = (part[0, 2:] for part in centre_bases(np.array([x]), KNOTS_M))
        bend = self.parameters[2:]
        z, rise = float(basis @ bend), float(lean @ bend)
        incidence = self.height_m - foot_m - z + rise * x  # height above the tangent at x
        if incidence <= 0.1 * self.height_m:
            return None
        per_t = x / incidence  # |d ln x / d t|
        gradient = np.concatenate([[1.0, 1.0 / x], -basis / x])
        noise = math.sqrt(float(gradient @ self.covariance @ gradient))
        chainage = float(np.interp(x, _GRID_M, self.chainage_m))
        return FootRange(
            chainage,
            per_t * noise,
            1.0 / incidence,
            per_t / (camera.focal_px * math.cos(angle - self.pitch_rad) ** -2),
        )


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
    usable = np.isfinite(profile.residual_m).all(axis=1)
    if np.count_nonzero(usable) < settings.least_rows:
        return None
    level = Level.of(camera)
    rails = level.from_pixels(profile.uv[usable])  # (M, 2 rails, 2)
    heading = np.interp(profile.chainage_m[usable], path.chainage_m, path.heading_rad)
    heading = heading - camera.yaw_rad
    middle = rails.mean(axis=1)
    apart = np.abs(rails[:, 1, 0] - rails[:, 0, 0])
    # Rails opposite each other on a slanting track: the nearer one looks farther out.
    turned = np.cos(heading) - middle[:, 0] / camera.focal_px * np.sin(heading)
    focal, pitch = camera.focal_px, camera.pitch_rad
    angle = np.arctan(middle[:, 1] / focal) + pitch
    t = np.tan(angle)
    kept = (apart > 2.0 * px) & (turned > 0.2) & (angle > 0)
    if np.count_nonzero(kept) < settings.least_rows:
        return None
    t, apart, turned, angle = t[kept], apart[kept], turned[kept], angle[kept]
    depth = focal * camera.rail_spacing_m * turned / apart
    x = depth / (math.cos(pitch) + t * math.sin(pitch))
    calm = ~profile.doubtful[usable][kept].any(axis=1)
    sigma_px = settings.spacing_std_px * px * np.where(calm, 1.0, 4.0)
    solution, covariance, scatter = _solve(x, t, apart, sigma_px, camera.height_m, settings)
    z, rise = _KNOT_BASIS @ solution[2:], _KNOT_SLOPE @ solution[2:]
    slope_t = (solution[1] - z) / _GRID_M + solution[0]
    far = float(np.percentile(x, 98)) * settings.beyond
    # Ground that falls away from the line of sight is hidden: no range from there on.
    hidden = solution[1] - z + rise * _GRID_M <= 0.1 * solution[1]
    if hidden.any():
        far = min(far, float(_GRID_M[np.argmax(hidden)]))
    chainage = _chainages(level, track, slope_t, pitch)
    return TrackScale(level, pitch, solution, covariance, slope_t, chainage, far, scatter, len(x))


def _solve(
    x: Array, t: Array, apart: Array, sigma_px: Array, height_m: float, settings: ScaleSettings
) -> tuple[Array, Array, float]:
    """Weighted least squares with priors; parameters, covariance and scatter in pixels."""
    basis = centre_bases(x, KNOTS_M)[0][:, 2:]
    design = np.column_stack([np.ones_like(x), 1.0 / x, -basis / x[:, None]])
    expected = np.zeros(design.shape[1])
    expected[1] = height_m
    prior_std = np.concatenate(
        [
            [settings.pitch_std_rad, settings.height_rel * height_m],
            np.full(len(KNOTS_M), settings.curvature_std),
        ]
    )
    # σ_t = h_inc·σ_q and σ_q = q·σ_p/p; h_inc = h to first order.
    sigma_t = height_m * sigma_px / (x * apart)
    solution, covariance, scale = _robust(
        design, t, sigma_t, expected, prior_std**-2.0, settings.correlated_rows
    )
    return solution, covariance, scale * float(np.median(sigma_px))


@numba.njit(cache=True)
def _robust(
    design: Array, t: Array, sigma: Array, expected: Array, prior: Array, least: float
) -> tuple[Array, Array, float]:
    """Least squares with Cauchy weights and priors; solution, covariance and scatter over σ."""
    rows, size = design.shape
    solution = expected.copy()
    gram = np.zeros((size, size))
    robust = np.ones(rows)
    normal = np.zeros(rows)
    scale, correlated = 1.0, least
    for _ in range(4):
        gram[:] = 0.0
        right = prior * expected
        for i in range(rows):
            weight = robust[i] / ((scale * sigma[i]) ** 2 * correlated)
            for a in range(size):
                part = weight * design[i, a]
                right[a] += part * t[i]
                for b in range(a + 1):
                    gram[a, b] += part * design[i, b]
        for a in range(size):
            for b in range(a):
                gram[b, a] = gram[a, b]
            gram[a, a] += prior[a]
        solution = np.linalg.solve(gram, right).astype(np.float64)
        for i in range(rows):
            model = 0.0
            for a in range(size):
                model += design[i, a] * solution[a]
            normal[i] = (t[i] - model) / sigma[i]
        scale = max(1.0, 1.4826 * np.median(np.abs(normal)))
        for i in range(rows):
            robust[i] = 1.0 / (1.0 + (normal[i] / (2.5 * scale)) ** 2)
        correlated = max(least, _correlation(normal))
    return solution, np.linalg.inv(gram).astype(np.float64), scale


@numba.njit(cache=True)
def _correlation(normal: Array, most: int = 40) -> float:
    """Rows that count as one: 1 + 2·Σ of the residuals' autocorrelation up to its first zero."""
    rows = normal.shape[0]
    middle = np.median(normal)
    r = np.empty(rows)
    power = 0.0
    for i in range(rows):
        r[i] = min(4.0, max(-4.0, normal[i] - middle))
        power += r[i] * r[i]
    if power <= 0.0 or rows < 3 * most:
        return 1.0
    total = 1.0
    for lag in range(1, most):
        rho = 0.0
        for i in range(lag, rows):
            rho += r[i] * r[i - lag]
        rho /= power
        if rho <= 0.05:
            break
        total += 2.0 * rho
    return total


def _chainages(level: Level, track: TrackGeometry, slope_t: Array, pitch: float) -> Array:
    """Chainage at each grid distance: the fitted ground seen along the path's pixels."""
    path = track.path
    assert path is not None
    seen = level.from_pixels(path.uv)
    angle = np.arctan(seen[:, 1] / level.camera.focal_px) + pitch
    falling = np.minimum.accumulate(slope_t)
    x = np.interp(-np.tan(angle), -falling, _GRID_M)
    depth = x * (math.cos(pitch) + np.tan(angle) * math.sin(pitch))
    y = -seen[:, 0] * depth / level.camera.focal_px
    used = np.concatenate([[True], np.diff(x) > 1e-6]) & path.seen
    along, across = x[used], y[used]
    if len(along) < 4:
        return _GRID_M.copy()
    # Slopes over spans, not samples: far rows lie metres apart and their noise must not add up.
    spans = np.linspace(along[0], along[-1], max(3, min(24, len(along) // 4)))
    bends = np.gradient(np.interp(spans, along, across), spans)
    slope = np.interp(_GRID_M, spans, bends)
    stretch = np.sqrt(1.0 + slope**2) - 1.0
    steps = np.diff(_GRID_M) * 0.5 * (stretch[1:] + stretch[:-1])
    start = _GRID_M[0] * (1.0 + stretch[0])
    longer = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(start + (_GRID_M - _GRID_M[0]) + longer, np.float64)
