"""The smooth track both rails are judged against.

A track's curvature changes slowly: straight, transition, arc. The model is a centre line whose
second derivative is piecewise linear with a prior on its rate of change (a clothoid piece by
piece), plus half the spacing, constant but for a slow trend, which takes up gradients and
errors of the horizon. Both rails are fitted at once by robust weighted least squares; what is left
over is the rails' own shape: ripple, bulge, kink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_HALF_SPREAD = 0.1
"""Standard deviation of the half spacing about the expected one, relative."""

_TURNS = 5
"""Turns of the iterated weights."""

CORRELATED_ROWS = 8.0
"""Neighbouring rows see the same blobs: so many count as one against the priors."""


@dataclass(frozen=True)
class SmoothTrack:
    """A fitted smooth track over ground distance x.

    Attributes:
        knots_m: Knots of the second derivative, metres ahead, shape (K,).
        centre: y (m) and slope at the first knot, then y'' at each knot (1/m), shape (K + 2,).
        half_knots_m: Knots of the half spacing, shape (J,).
        half: Half spacing at its knots, metres, shape (J,).
    """

    knots_m: Array
    centre: Array
    half_knots_m: Array
    half: Array

    def y(self, x_m: Array) -> Array:
        """Centre line's lateral position, metres, shape of ``x_m``."""
        return self.along(x_m)[0]

    def along(self, x_m: Array) -> tuple[Array, Array, Array]:
        """Centre line y (m), its slope dy/dx, and half the rails' spacing across it (m)."""
        return _along(x_m, self.knots_m, self.centre, self.half_knots_m, self.half)


@numba.njit(cache=True)
def _along(
    x_m: Array, knots_m: Array, centre: Array, half_knots_m: Array, half: Array
) -> tuple[Array, Array, Array]:
    """Integrate the piecewise linear y'' from knot to knot: y, y' and the half spacing at x."""
    k, bend = len(knots_m), centre[2:]
    y, slope = np.empty(k), np.empty(k)  # at the knots
    y[0], slope[0] = centre[0], centre[1]
    for j in range(k - 1):
        w = knots_m[j + 1] - knots_m[j]
        y[j + 1] = y[j] + w * (slope[j] + w * (bend[j] / 3.0 + bend[j + 1] / 6.0))
        slope[j + 1] = slope[j] + 0.5 * w * (bend[j] + bend[j + 1])
    at, lean = np.empty(len(x_m)), np.empty(len(x_m))
    for i in range(len(x_m)):
        j = min(max(np.searchsorted(knots_m, x_m[i]) - 1, 0), k - 1)
        t, change = x_m[i] - knots_m[j], 0.0  # outside the knots y'' stays what it is there
        if t > 0.0 and j + 1 < k:
            change = (bend[j + 1] - bend[j]) / (knots_m[j + 1] - knots_m[j])
        at[i] = y[j] + t * (slope[j] + t * (0.5 * bend[j] + t * change / 6.0))
        lean[i] = slope[j] + t * (bend[j] + 0.5 * t * change)
    return at, lean, np.interp(x_m, half_knots_m, half)


@numba.njit(cache=True)
def hat_basis(x_m: Array, knots_m: Array) -> Array:
    """Piecewise-linear hats, constant outside the knots, shape (N, K)."""
    n, k = x_m.shape[0], knots_m.shape[0]
    basis = np.zeros((n, k))
    for i in range(n):
        j = 0
        while j + 2 < k and x_m[i] >= knots_m[j + 1]:
            j += 1
        if k == 1:
            basis[i, 0] = 1.0
            continue
        share = (x_m[i] - knots_m[j]) / (knots_m[j + 1] - knots_m[j])
        share = min(1.0, max(0.0, share))
        basis[i, j], basis[i, j + 1] = 1.0 - share, share
    return basis


@numba.njit(cache=True)
def _integrated_hats(x_m: Array, knots_m: Array) -> tuple[Array, Array]:
    """Hats integrated once and twice from the first knot, each of shape (N, K).

    Before the first knot and after the last the hats' values there are continued.
    """
    n, k = x_m.shape[0], knots_m.shape[0]
    once, twice = np.zeros((n, k)), np.zeros((n, k))
    for i in range(n):
        if x_m[i] <= knots_m[0]:
            t = x_m[i] - knots_m[0]
            once[i, 0], twice[i, 0] = t, 0.5 * t * t
            continue
        # Add each interval's share: within it the two hats are 1 − t/w and t/w.
        for j in range(k):
            width = knots_m[j + 1] - knots_m[j] if j + 1 < k else np.inf
            t = min(x_m[i] - knots_m[j], width)
            if t <= 0.0:
                break
            for m in range(k):  # what was gathered so far goes on linearly
                twice[i, m] += once[i, m] * t
            if j + 1 < k:
                once[i, j] += t - 0.5 * t * t / width
                twice[i, j] += 0.5 * t * t - t * t * t / (6.0 * width)
                once[i, j + 1] += 0.5 * t * t / width
                twice[i, j + 1] += t * t * t / (6.0 * width)
            else:
                once[i, j] += t
                twice[i, j] += 0.5 * t * t
    return once, twice


@numba.njit(cache=True)
def centre_bases(x_m: Array, knots_m: Array) -> tuple[Array, Array]:
    """Bases of y(x) = y₀ + y₀'·(x − x₀) + ∬ y'' and of its slope, each of shape (N, K + 2)."""
    n, k = len(x_m), len(knots_m)
    centre, slope = np.zeros((n, k + 2)), np.zeros((n, k + 2))
    centre[:, 0], centre[:, 1], slope[:, 1] = 1.0, x_m - knots_m[0], 1.0
    slope[:, 2:], centre[:, 2:] = _integrated_hats(x_m, knots_m)
    return centre, slope


@numba.njit(cache=True)
def _knots(near_m: float, far_m: float, first_m: float, growth: float) -> Array:
    """Knots from near to far whose spacing starts at ``first_m`` and grows with distance."""
    knots = [near_m]
    while knots[-1] < far_m:
        knots.append(knots[-1] + max(first_m, growth * knots[-1]))
    if len(knots) == 1:
        knots.append(near_m + first_m)
    else:
        knots[-1] = max(far_m, knots[-2] + 1.0)
    return np.array(knots)


@numba.njit(cache=True)
def _add_differences(gram: Array, first: int, weight: Array) -> None:
    """Add Σ wⱼ·(pⱼ₊₁ − pⱼ)² over the parameters from ``first`` on to a gram matrix."""
    for j in range(len(weight)):
        a, b = first + j, first + j + 1
        gram[a, a] += weight[j]
        gram[b, b] += weight[j]
        gram[a, b] -= weight[j]
        gram[b, a] -= weight[j]


@numba.njit(cache=True)
def centre_prior(knots_m: Array, curvature: float, rate: float) -> Array:
    """Gram matrix of what is known of a centre line beforehand, shape (K + 2, K + 2).

    Args:
        knots_m: Knots of the second derivative, metres, shape (K,).
        curvature: Standard deviation of y'', 1/m.
        rate: Standard deviation of the change of y'' per metre over 10 m, 1/m².
    """
    prior = np.zeros((len(knots_m) + 2, len(knots_m) + 2))
    for j in range(2, len(prior)):
        prior[j, j] = 1.0 / curvature**2
    _add_differences(prior, 2, 1.0 / (rate**2 * np.diff(knots_m) * 10.0))
    return prior


def fit_smooth(
    x_m: Array,
    y_m: Array,
    side: Array,
    sigma_m: Array,
    half_m: float,
    curvature: float = 1 / 150,
    rate: float = 1.2e-4,
    trend: float = 0.05,
    correlated: float = CORRELATED_ROWS,
) -> SmoothTrack:
    """Fit both rails jointly.

    Minimises Σ ρ(rᵢ/σᵢ)/correlated + Σ (Δy''/Δx)²·Δx/(10 m·rate²) + Σ (y''/curvature)² and a
    trend of the half spacing, with ρ Cauchy's by iterated weights.

    Args:
        x_m: Ground distance of each rail centre, metres, shape (N,).
        y_m: Lateral position, metres, shape (N,).
        side: +1 left rail, −1 right rail, shape (N,).
        sigma_m: Standard deviation of each lateral position, metres, shape (N,).
        half_m: Expected half spacing, metres.
        curvature: Standard deviation of y'', 1/m.
        rate: Standard deviation of the change of y'' per metre over 10 m, 1/m².
        correlated: How many neighbouring rows count as one against the priors.
        trend: Standard deviation of the half spacing's relative change from knot to knot.
    """
    fitted = _fitted(x_m, y_m, side, sigma_m, half_m, curvature, rate, trend, correlated)
    return SmoothTrack(*fitted)


@numba.njit(cache=True)
def _fitted(
    x_m: Array,
    y_m: Array,
    side: Array,
    sigma_m: Array,
    half_m: float,
    curvature: float,
    rate: float,
    trend: float,
    correlated: float,
) -> tuple[Array, Array, Array, Array]:
    """Knots and parameters of the centre line, then of the half spacing."""
    near, far = x_m.min(), x_m.max()
    knots = _knots(near, far, 12.0, 0.25)
    half_knots = _knots(near, far, 25.0, 0.8)
    n_c = len(knots) + 2
    total = n_c + len(half_knots)
    prior = np.zeros((total, total))  # gram matrix of the priors
    pull = np.zeros(total)
    prior[:n_c, :n_c] = centre_prior(knots, curvature, rate)
    for j in range(n_c, total):
        prior[j, j] = 1.0 / (_HALF_SPREAD * half_m) ** 2
        pull[j] = half_m / (_HALF_SPREAD * half_m) ** 2
    _add_differences(prior, n_c, np.full(len(half_knots) - 1, 1.0 / (trend * half_m) ** 2))
    basis, lean_basis = centre_bases(x_m, knots)
    hats = hat_basis(x_m, half_knots)
    weight = 1.0 / (sigma_m**2 * correlated)
    solution = _solved(basis, lean_basis, hats, side, y_m, sigma_m, weight, prior, pull)
    return knots, solution[:n_c], half_knots, solution[n_c:]


@numba.njit(cache=True)
def _solved(
    basis: Array,
    lean_basis: Array,
    hats: Array,
    side: Array,
    y_m: Array,
    sigma_m: Array,
    weight: Array,
    prior: Array,
    pull: Array,
) -> Array:
    """Parameters of the smooth track by iterated weighted least squares, shape (P,)."""
    n, n_c = basis.shape
    total = len(pull)
    design, weighted = np.empty((n, total)), np.empty((n, total))
    design[:, :n_c] = basis
    lean, robust = np.ones(n), np.ones(n)
    solution: Array = np.zeros(total)
    for turn in range(_TURNS):
        for i in range(n):
            for j in range(n_c, total):
                design[i, j] = side[i] * lean[i] * hats[i, j - n_c]
            for j in range(total):
                weighted[i, j] = design[i, j] * weight[i] * robust[i]
        solved = np.linalg.solve(weighted.T @ design + prior, weighted.T @ y_m + pull)
        solution = solved.astype(np.float64)
        for i in range(n):
            slope, at = 0.0, 0.0
            for j in range(n_c):
                slope += lean_basis[i, j] * solution[j]
            lean[i] = math.sqrt(1.0 + slope * slope)
            if turn:
                for j in range(total):
                    at += design[i, j] * solution[j]
                off = (y_m[i] - at) / sigma_m[i]
                robust[i] = 1.0 / (1.0 + (0.5 * off) ** 2)
    return solution
