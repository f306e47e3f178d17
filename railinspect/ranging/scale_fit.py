"""The compiled fit of one frame's row-to-range scale; :mod:`.track_scale` says what it solves.

A frame is ranged with caches that the network has emptied, where each call costs as much as what it
computes: one compiled function does it all.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from railinspect.ranging.small_solve import factorise, substitute
from railinspect.track.smooth import centre_bases

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

KNOTS_M = np.array([0.0, 50.0, 100.0, 160.0, 230.0, 320.0, 450.0])
"""Where z'' has its knots: vertical curves are tens of metres long."""

GRID_M = np.concatenate([np.arange(2.0, 60.0, 1.0), np.geomspace(60.0, 600.0, 90)])
"""Distances ahead at which a fitted scale is kept."""

_KNOTS = len(KNOTS_M)
_UNKNOWNS = _KNOTS + 2
_GRID_BASIS, _GRID_LEAN = (
    np.ascontiguousarray(basis[:, 2:]) for basis in centre_bases(GRID_M, KNOTS_M)
)
_AT_KNOT, _LEAN_AT_KNOT = (
    np.ascontiguousarray(basis[:, 2:]) for basis in centre_bases(KNOTS_M, KNOTS_M)
)
_TURNS = 4
_MOST_LAGS = 40

# Sums may be taken in any order, so that several are taken at once; nothing else is allowed.
_SUMS = {"reassoc", "contract"}


@numba.njit(cache=True)
def bend_basis(x: float, basis: Array, lean: Array) -> None:
    """Height and slope at x > 0 of the ground by each knot's z'', into two arrays of shape (K,)."""
    at = 0
    while at + 1 < _KNOTS and x > KNOTS_M[at + 1]:
        at += 1
    s = x - KNOTS_M[at]
    for m in range(_KNOTS):
        lean[m] = _LEAN_AT_KNOT[at, m]
        basis[m] = _AT_KNOT[at, m] + _LEAN_AT_KNOT[at, m] * s
    lean[at] += s
    basis[at] += 0.5 * s * s
    if at + 1 < _KNOTS:  # z'' goes over to the next knot's
        over = s * s / (KNOTS_M[at + 1] - KNOTS_M[at])
        lean[at] -= 0.5 * over
        lean[at + 1] += 0.5 * over
        basis[at] -= over * s / 6.0
        basis[at + 1] += over * s / 6.0


@numba.njit(cache=True)
def fit(
    rails_uv: Array,
    residual_m: Array,
    doubtful: Bools,
    at_switch: Bools,
    profile_m: Array,
    path_uv: Array,
    path_m: Array,
    heading_rad: Array,
    seen: Bools,
    view: tuple[float, float, float, float, float, float, float, float],
    sigma_px: float,
    least_apart_px: float,
    spread: tuple[float, float, float],
    correlated: float,
    least_rows: int,
    beyond: float,
) -> tuple[int, Array, Array, float, Array, Array, float]:
    """Fit the scale to one frame's rails.

    Args:
        rails_uv: Both rails, undistorted pixels, shape (N, 2, 2).
        residual_m: Of both, NaN where one was not seen, shape (N, 2).
        doubtful: Likewise, shape (N, 2).
        at_switch: Shape (N,).
        profile_m: Their chainage, metres, shape (N,).
        path_uv: The centre line, undistorted pixels, shape (M, 2).
        path_m: Its chainage, metres, shape (M,).
        heading_rad: Its direction, shape (M,).
        seen: Whether it was seen, shape (M,).
        view: Focal length (px), principal point (px, px), roll, pitch, yaw (rad), rail spacing
            and camera height (m).
        sigma_px: Standard deviation of the rails' spacing in one row, pixels.
        least_apart_px: Where the rails are closer they say nothing, pixels.
        spread: Standard deviations beforehand of pitch (rad), relative camera height and z'' (1/m).
        correlated: At least so many rows count as one.
        least_rows: With fewer there is no fit.
        beyond: How far beyond the rows ranges are given, as a factor.

    Returns:
        Rows used (0: no fit), parameters, covariance, scatter (px), slopes and chainages at
        ``GRID_M``, and how far ranges are given, metres.
    """
    focal, centre_u, centre_v, roll, pitch, yaw, spacing_m, height_m = view
    turn = (centre_u, centre_v, math.cos(roll), math.sin(roll), focal, math.tan(pitch))
    cos_p, sin_p = math.cos(pitch), math.sin(pitch)
    rows = np.empty((4, len(rails_uv)))
    used = 0
    for i in range(len(rails_uv)):
        if not (np.isfinite(residual_m[i, 0]) and np.isfinite(residual_m[i, 1])):
            continue
        left, left_y = levelled(rails_uv[i, 0, 0], rails_uv[i, 0, 1], turn)
        right, right_y = levelled(rails_uv[i, 1, 0], rails_uv[i, 1, 1], turn)
        apart = abs(right - left)
        t = slope(0.5 * (left_y + right_y), turn)
        # Rails opposite each other on a slanting track: the nearer one looks farther out.
        heading = _between(profile_m[i], path_m, heading_rad) - yaw
        turned = math.cos(heading) - 0.5 * (left + right) / focal * math.sin(heading)
        if not (apart > least_apart_px and turned > 0.2 and t > 0):
            continue
        rows[0, used] = focal * spacing_m * turned / (apart * (cos_p + t * sin_p))
        rows[1, used], rows[2, used] = t, apart
        doubt = doubtful[i, 0] or doubtful[i, 1] or at_switch[i]
        rows[3, used] = sigma_px * (4.0 if doubt else 1.0)
        used += 1
    if used < least_rows:
        none = np.empty(0)
        return 0, none, np.empty((0, 0)), 0.0, none, none, 0.0
    away, tangent, spacing, sigma = (rows[0, :used], rows[1, :used], rows[2, :used], rows[3, :used])
    solution, covariance, scatter = solve(
        away, tangent, spacing, sigma, height_m, spread, correlated
    )
    slope_t, far = _ground(solution, away, beyond)
    chainage = _chainages(path_uv, seen, slope_t, turn, cos_p, sin_p)
    return used, solution, covariance, scatter, slope_t, chainage, far


@numba.njit(cache=True, inline="always")
def levelled(
    u: float, v: float, turn: tuple[float, float, float, float, float, float]
) -> tuple[float, float]:
    """:meth:`railinspect.track.level.Level.from_pixels` of one undistorted pixel."""
    du, dv = u - turn[0], v - turn[1]
    return turn[2] * du - turn[3] * dv, turn[3] * du + turn[2] * dv


@numba.njit(cache=True, inline="always")
def slope(y: float, turn: tuple[float, float, float, float, float, float]) -> float:
    """tan(arctan(y/f) + pitch): the slope below the horizontal of a levelled row."""
    a = y / turn[4]
    t: float = (a + turn[5]) / (1.0 - a * turn[5])
    return t


@numba.njit(cache=True, inline="always")
def _between(x: float, xp: Array, fp: Array) -> float:
    """np.interp of one value."""
    last = len(xp) - 1
    if x <= xp[0]:
        return float(fp[0])
    if x >= xp[last]:
        return float(fp[last])
    i = np.searchsorted(xp, x, side="right") - 1
    return float(fp[i] + (x - xp[i]) * (fp[i + 1] - fp[i]) / (xp[i + 1] - xp[i]))


@numba.njit(cache=True, fastmath=_SUMS)
def solve(
    x: Array,
    t: Array,
    apart: Array,
    sigma_px: Array,
    height_m: float,
    spread: tuple[float, float, float],
    least: float,
) -> tuple[Array, Array, float]:
    """Least squares with Cauchy weights and priors.

    Args:
        x: Distances of the rows by the rails' spacing, metres, > 0, shape (N,).
        t: Their slopes below the horizontal, shape (N,).
        apart: The rails' spacing, pixels, shape (N,).
        sigma_px: Its standard deviation, shape (N,).
        height_m: Expected height of the camera.
        spread: Standard deviations beforehand of pitch (rad), relative camera height and z'' (1/m).
        least: At least so many neighbouring rows count as one.

    Returns:
        Parameters, their covariance, and the scatter of the rows in pixels.
    """
    count = len(x)
    prior = np.full(_UNKNOWNS, spread[2] ** -2.0)
    prior[0], prior[1] = spread[0] ** -2.0, (spread[1] * height_m) ** -2.0
    design = np.empty((_UNKNOWNS + 1, count))  # the last row is what is to be explained
    sigma = np.empty(count)
    basis, lean = np.empty(_KNOTS), np.empty(_KNOTS)
    for i in range(count):
        near = 1.0 / x[i]
        bend_basis(x[i], basis, lean)
        design[0, i], design[1, i], design[_UNKNOWNS, i] = 1.0, near, t[i]
        for m in range(_KNOTS):
            design[2 + m, i] = -basis[m] * near
        # σ_t = h_inc·σ_q and σ_q = q·σ_p/p; h_inc = h to first order.
        sigma[i] = height_m * sigma_px[i] * near / apart[i]
    robust, normal, size = np.ones(count), np.empty(count), np.empty(count)
    weighted = np.empty((_UNKNOWNS, count))
    gram, solution = np.empty((_UNKNOWNS, _UNKNOWNS)), np.empty(_UNKNOWNS)
    right = np.empty(_UNKNOWNS)
    scale, correlated = 1.0, least
    for turn in range(_TURNS):
        for i in range(count):
            size[i] = robust[i] / ((scale * sigma[i]) ** 2 * correlated)
        for a in range(_UNKNOWNS):
            for i in range(count):
                weighted[a, i] = size[i] * design[a, i]
            for b in range(a + 1):
                total = 0.0
                for i in range(count):
                    total += weighted[a, i] * design[b, i]
                gram[a, b] = total
            gram[a, a] += prior[a]
            total = 0.0
            for i in range(count):
                total += weighted[a, i] * t[i]
            right[a] = total + (prior[1] * height_m if a == 1 else 0.0)
        factorise(gram)
        substitute(gram, right, solution)
        for i in range(count):
            normal[i] = t[i]
        for a in range(_UNKNOWNS):
            for i in range(count):
                normal[i] -= solution[a] * design[a, i]
        for i in range(count):
            normal[i] /= sigma[i]
            size[i] = abs(normal[i])
        scale = max(1.0, 1.4826 * np.median(size))
        if turn == _TURNS - 1:
            break
        for i in range(count):
            robust[i] = 1.0 / (1.0 + (normal[i] / (2.5 * scale)) ** 2)
        if turn > 0:  # outliers would pass for correlation before they are known
            correlated = max(least, _correlation(normal))
    covariance = np.empty((_UNKNOWNS, _UNKNOWNS))
    unit = np.zeros(_UNKNOWNS)
    for a in range(_UNKNOWNS):
        unit[a] = 1.0
        substitute(gram, unit, covariance[a])
        unit[a] = 0.0
    return solution, covariance, scale * np.median(sigma_px)


@numba.njit(cache=True, fastmath=_SUMS)
def _correlation(normal: Array) -> float:
    """Rows that count as one: 1 + 2·Σ of the residuals' autocorrelation up to its first zero."""
    rows = len(normal)
    if rows < 3 * _MOST_LAGS:
        return 1.0
    middle = np.median(normal)
    r = np.empty(rows)
    power = 0.0
    for i in range(rows):
        r[i] = min(4.0, max(-4.0, normal[i] - middle))
        power += r[i] * r[i]
    if power <= 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, _MOST_LAGS):
        rho = 0.0
        for i in range(rows - lag):
            rho += r[i + lag] * r[i]
        rho /= power
        if rho <= 0.05:
            break
        total += 2.0 * rho
    return total


@numba.njit(cache=True)
def _ground(solution: Array, x: Array, beyond: float) -> tuple[Array, float]:
    """Slope of the fitted ground at ``GRID_M``, and how far ranges are given, metres."""
    far = np.percentile(x, 98) * beyond
    slope_t = np.empty(len(GRID_M))
    hidden = False
    for i in range(len(GRID_M)):
        z, rise = 0.0, 0.0
        for k in range(_KNOTS):
            z += _GRID_BASIS[i, k] * solution[2 + k]
            rise += _GRID_LEAN[i, k] * solution[2 + k]
        slope_t[i] = (solution[1] - z) / GRID_M[i] + solution[0]
        # Ground that falls away from the line of sight is hidden: no range from there on.
        if not hidden and solution[1] - z + rise * GRID_M[i] <= 0.1 * solution[1]:
            hidden = True
            far = min(far, GRID_M[i])
    return slope_t, far


@numba.njit(cache=True)
def _chainages(
    path_uv: Array,
    seen: Bools,
    slope_t: Array,
    turn: tuple[float, float, float, float, float, float],
    cos_p: float,
    sin_p: float,
) -> Array:
    """Chainage at each grid distance: the fitted ground seen along the path's pixels."""
    rising = np.empty(len(slope_t))
    low = np.inf
    for i in range(len(slope_t)):
        low = min(low, slope_t[i])
        rising[i] = -low
    along, across = np.empty(len(path_uv)), np.empty(len(path_uv))
    used, before = 0, 0.0
    for i in range(len(path_uv)):
        right, down = levelled(path_uv[i, 0], path_uv[i, 1], turn)
        t = slope(down, turn)
        x = _between(-t, rising, GRID_M)
        if seen[i] and (i == 0 or x - before > 1e-6):
            along[used] = x
            across[used] = -right * x * (cos_p + t * sin_p) / turn[4]
            used += 1
        before = x
    if used < 4:
        return GRID_M.copy()
    along, across = along[:used], across[:used]
    # Slopes over spans, not samples: far rows lie metres apart and their noise must not add up.
    count = max(3, min(24, used // 4))
    spans = np.linspace(along[0], along[-1], count)
    ends = np.empty(count)
    for i in range(count):
        ends[i] = _between(spans[i], along, across)
    bends = np.empty(count)
    for i in range(count):
        a, b = max(0, i - 1), min(count - 1, i + 1)
        bends[i] = (ends[b] - ends[a]) / (spans[b] - spans[a])
    chainage = np.empty(len(GRID_M))
    longer, stretch = 0.0, 0.0
    for i in range(len(GRID_M)):
        last = stretch
        stretch = math.sqrt(1.0 + _between(GRID_M[i], spans, bends) ** 2) - 1.0
        if i == 0:
            longer = GRID_M[0] * stretch
        else:
            longer += 0.5 * (GRID_M[i] - GRID_M[i - 1]) * (stretch + last)
        chainage[i] = GRID_M[i] + longer
    return chainage
