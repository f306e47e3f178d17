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
Bools = npt.NDArray[np.bool_]

KNOTS_M = np.array([0.0, 50.0, 100.0, 160.0, 230.0, 320.0, 450.0])
"""Where z'' has its knots: vertical curves are tens of metres long."""

_GRID_M = np.concatenate([np.arange(2.0, 60.0, 1.0), np.geomspace(60.0, 600.0, 90)])
_KNOT_BASIS, _KNOT_SLOPE = (
    np.ascontiguousarray(basis[:, 2:]) for basis in centre_bases(_GRID_M, KNOTS_M)
)


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

    def chainage_at(self, x_m: float) -> float:
        """Chainage of the track at the distance ``x_m`` straight ahead, metres."""
        return float(np.interp(x_m, _GRID_M, self.chainage_m))

    def at(self, foot_uv: Array, foot_m: float = 0.0) -> FootRange | None:
        """Range of a point of the ground ``foot_m`` above the rail tops; None beyond the scale."""
        camera = self.level.camera
        row = float(self.level.from_pixels(foot_uv[None, :])[0, 1])
        angle = math.atan(row / camera.focal_px) + self.pitch_rad
        t = math.tan(angle)
        x, chainage, per_t, noise, incidence = _foot(
            t, foot_m, self.slope_t, self.chainage_m, self.parameters, self.covariance, self.far_m
        )
        if math.isnan(x):
            return None
        return FootRange(
            chainage,
            per_t * noise,
            1.0 / incidence,
            per_t / (camera.focal_px * math.cos(angle - self.pitch_rad) ** -2),
        )


@numba.njit(cache=True)
def _foot(
    t: float,
    foot_m: float,
    slope_t: Array,
    chainage_m: Array,
    parameters: Array,
    covariance: Array,
    far_m: float,
) -> tuple[float, float, float, float, float]:
    """Where the line of sight of slope t meets the ground ``foot_m`` above the fitted rails.

    Distance x and chainage, |d ln x / d t|, the standard deviation of t by the fit, and the height
    above the tangent at x; x is NaN beyond the scale.
    """
    nothing = (np.nan, np.nan, np.nan, np.nan, np.nan)
    # The nearest crossing: behind a crest the same row shows farther ground again.
    index = 0
    while index < len(_GRID_M) and slope_t[index] - foot_m / _GRID_M[index] > t:
        index += 1
    if index in (0, len(_GRID_M)):
        return nothing
    first, second = 1.0 / _GRID_M[index - 1], 1.0 / _GRID_M[index]
    a, b = slope_t[index - 1] - foot_m * first, slope_t[index] - foot_m * second
    x = 1.0 / (first + (a - t) / (a - b) * (second - first))
    if x > far_m:
        return nothing
    basis, lean = centre_bases(np.full(1, x), KNOTS_M)
    bend = parameters[2:]
    z, rise = (basis[0, 2:] * bend).sum(), (lean[0, 2:] * bend).sum()
    incidence = parameters[1] - foot_m - z + rise * x  # height above the tangent at x
    if incidence <= 0.1 * parameters[1]:
        return nothing
    gradient = np.empty(len(parameters))
    gradient[0], gradient[1] = 1.0, 1.0 / x
    gradient[2:] = -basis[0, 2:] / x
    variance = 0.0
    for i in range(len(gradient)):
        for j in range(len(gradient)):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    chainage = np.interp(x, _GRID_M, chainage_m)
    return x, chainage, x / incidence, math.sqrt(variance), incidence


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
    level = Level.of(camera)
    rows = _rows(
        level.from_pixels(profile.uv.reshape(-1, 2)).reshape(-1, 2, 2),
        profile.residual_m,
        profile.doubtful | profile.at_switch[:, None],
        np.interp(profile.chainage_m, path.chainage_m, path.heading_rad) - camera.yaw_rad,
        (camera.focal_px, camera.pitch_rad, camera.rail_spacing_m),
        px,
        settings.spacing_std_px * px,
    )
    x, t, apart, sigma_px = rows
    if len(x) < settings.least_rows:
        return None
    solution, covariance, scatter = _solve(x, t, apart, sigma_px, camera.height_m, settings)
    slope_t, far = _ground(solution, x, settings.beyond)
    seen = level.from_pixels(path.uv)
    chainage = _chainages(seen, path.seen, slope_t, camera.focal_px, camera.pitch_rad)
    return TrackScale(
        level, camera.pitch_rad, solution, covariance, slope_t, chainage, far, scatter, len(x)
    )


@numba.njit(cache=True)
def _rows(
    rails: Array,
    residual_m: Array,
    doubtful: Bools,
    heading_rad: Array,
    view: tuple[float, float, float],
    px: float,
    sigma_px: float,
) -> tuple[Array, Array, Array, Array]:
    """Distance x, slope t, spacing and its deviation, pixels, of each row that shows both rails."""
    focal, pitch, spacing_m = view
    out = np.empty((4, len(rails)))
    used = 0
    for i in range(len(rails)):
        if not (np.isfinite(residual_m[i, 0]) and np.isfinite(residual_m[i, 1])):
            continue
        across = 0.5 * (rails[i, 0, 0] + rails[i, 1, 0])
        apart = abs(rails[i, 1, 0] - rails[i, 0, 0])
        # Rails opposite each other on a slanting track: the nearer one looks farther out.
        turned = math.cos(heading_rad[i]) - across / focal * math.sin(heading_rad[i])
        angle = math.atan(0.5 * (rails[i, 0, 1] + rails[i, 1, 1]) / focal) + pitch
        if not (apart > 2.0 * px and turned > 0.2 and angle > 0):
            continue
        t = math.tan(angle)
        depth = focal * spacing_m * turned / apart
        out[0, used] = depth / (math.cos(pitch) + t * math.sin(pitch))
        out[1, used], out[2, used] = t, apart
        out[3, used] = sigma_px * (4.0 if doubtful[i, 0] or doubtful[i, 1] else 1.0)
        used += 1
    return out[0, :used], out[1, :used], out[2, :used], out[3, :used]


@numba.njit(cache=True)
def _ground(solution: Array, x: Array, beyond: float) -> tuple[Array, float]:
    """Slope of the fitted ground at ``_GRID_M``, and how far ranges are given, metres."""
    far = np.percentile(x, 98) * beyond
    slope_t = np.empty(len(_GRID_M))
    hidden = False
    for i in range(len(_GRID_M)):
        z, rise = 0.0, 0.0
        for k in range(len(solution) - 2):
            z += _KNOT_BASIS[i, k] * solution[2 + k]
            rise += _KNOT_SLOPE[i, k] * solution[2 + k]
        slope_t[i] = (solution[1] - z) / _GRID_M[i] + solution[0]
        # Ground that falls away from the line of sight is hidden: no range from there on.
        if not hidden and solution[1] - z + rise * _GRID_M[i] <= 0.1 * solution[1]:
            hidden = True
            far = min(far, _GRID_M[i])
    return slope_t, far


def _solve(
    x: Array, t: Array, apart: Array, sigma_px: Array, height_m: float, settings: ScaleSettings
) -> tuple[Array, Array, float]:
    """Weighted least squares with priors; parameters, covariance and scatter in pixels."""
    prior_std = np.full(len(KNOTS_M) + 2, settings.curvature_std)
    prior_std[:2] = settings.pitch_std_rad, settings.height_rel * height_m
    return _fitted(x, t, apart, sigma_px, height_m, prior_std**-2.0, settings.correlated_rows)


@numba.njit(cache=True)
def _fitted(
    x: Array, t: Array, apart: Array, sigma_px: Array, height_m: float, prior: Array, least: float
) -> tuple[Array, Array, float]:
    design = -centre_bases(x, KNOTS_M)[0] / x.reshape(-1, 1)
    design[:, 0], design[:, 1] = 1.0, 1.0 / x
    expected = np.zeros(design.shape[1])
    expected[1] = height_m
    # σ_t = h_inc·σ_q and σ_q = q·σ_p/p; h_inc = h to first order.
    sigma_t = height_m * sigma_px / (x * apart)
    solution, covariance, scale = _robust(design, t, sigma_t, expected, prior, least)
    return solution, covariance, scale * np.median(sigma_px)


@numba.njit(cache=True)
def _robust(
    design: Array, t: Array, sigma: Array, expected: Array, prior: Array, least: float
) -> tuple[Array, Array, float]:
    """Least squares with Cauchy weights and priors; solution, covariance and scatter over σ."""
    solution = expected.copy()
    gram = np.diag(prior)
    robust = np.ones(len(t))
    normal = np.zeros(len(t))
    scale, correlated = 1.0, least
    for _ in range(4):
        weight = robust / ((scale * sigma) ** 2 * correlated)
        weighted = design * weight.reshape(-1, 1)
        gram = weighted.T @ design + np.diag(prior)
        right = weighted.T @ t + prior * expected
        solution = np.linalg.solve(gram, right).astype(np.float64)
        normal = (t - design @ solution) / sigma
        scale = max(1.0, 1.4826 * np.median(np.abs(normal)))
        robust = 1.0 / (1.0 + (normal / (2.5 * scale)) ** 2)
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


@numba.njit(cache=True)
def _chainages(seen_xy: Array, seen: Bools, slope_t: Array, focal: float, pitch: float) -> Array:
    """Chainage at each grid distance: the fitted ground seen along the path's levelled pixels."""
    rising = np.empty(len(slope_t))
    low = np.inf
    for i in range(len(slope_t)):
        low = min(low, slope_t[i])
        rising[i] = -low
    tangent = np.tan(np.arctan(seen_xy[:, 1] / focal) + pitch)
    x = np.interp(-tangent, rising, _GRID_M)
    y = -seen_xy[:, 0] * x * (math.cos(pitch) + tangent * math.sin(pitch)) / focal
    used = seen.copy()
    for i in range(1, len(x)):
        used[i] = seen[i] and x[i] - x[i - 1] > 1e-6
    along, across = x[used], y[used]
    if len(along) < 4:
        return _GRID_M.copy()
    # Slopes over spans, not samples: far rows lie metres apart and their noise must not add up.
    count = max(3, min(24, len(along) // 4))
    spans = np.linspace(along[0], along[-1], count)
    ends = np.interp(spans, along, across)
    bends = np.empty(count)
    bends[1:-1] = (ends[2:] - ends[:-2]) / (spans[2:] - spans[:-2])
    bends[0] = (ends[1] - ends[0]) / (spans[1] - spans[0])
    bends[-1] = (ends[-1] - ends[-2]) / (spans[-1] - spans[-2])
    stretch = np.sqrt(1.0 + np.interp(_GRID_M, spans, bends) ** 2) - 1.0
    chainage = np.empty(len(_GRID_M))
    longer = 0.0
    for i in range(len(_GRID_M)):
        if i > 0:
            step = _GRID_M[i] - _GRID_M[i - 1]
            longer += 0.5 * step * (stretch[i] + stretch[i - 1])
        chainage[i] = _GRID_M[i] + _GRID_M[0] * stretch[0] + longer
    return chainage
