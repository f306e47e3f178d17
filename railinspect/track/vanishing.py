"""Vanishing point of the track: weighted least squares (41) and adaptive smoothing (42)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.begin import Line

Array = npt.NDArray[np.float64]


def vanishing_point(
    lines: Sequence[Line], bottom_px: float, near_px: tuple[float, float], reach_px: float
) -> tuple[tuple[float, float], float]:
    """Point nearest to all lines that pass a first guess.

    min Σ aᵢ·(lᵢ − μ₀·cos θᵢ − ν₀·sin θᵢ)²,  aᵢ = zᵢ/Σz         [source 002, (41)]

    Lines that miss the guess by more than ``reach_px`` belong to kerbs, walls or other tracks and
    are left out.

    Args:
        lines: Lines with their votes z; at least the two that make the guess.
        bottom_px: Row the lines' ``bottom_px`` refers to.
        near_px: First guess (X, Y), where the two ego rails meet.
        reach_px: Largest distance from the guess at which a line takes part.

    Returns:
        The point (X, Y) and the weighted mean squared distance ε, px².
    """
    table = np.array([(line.slope, line.bottom_px, line.votes) for line in lines])
    x, y, residual = _nearest(table, bottom_px, near_px[0], near_px[1], reach_px)
    return (x, y), residual


@numba.njit(cache=True)
def _nearest(
    lines: Array, bottom_px: float, near_x: float, near_y: float, reach_px: float
) -> tuple[float, float, float]:
    """The point and ε for lines (slope, X at the bottom, votes), shape (N, 3)."""
    votes, g00, g01, g11, h0, h1, square, part = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for i in range(len(lines)):
        # X − slope·Y = X_b − slope·Y_b, divided by the normal's length: cos θ, sin θ and l of (41).
        norm = math.hypot(1.0, lines[i, 0])
        cos, sin = 1.0 / norm, -lines[i, 0] / norm
        distance = (lines[i, 1] - lines[i, 0] * bottom_px) / norm - cos * near_x - sin * near_y
        if abs(distance) > reach_px:
            continue
        weight = lines[i, 2]
        part += 1
        votes += weight
        g00, g01, g11 = g00 + weight * cos**2, g01 + weight * cos * sin, g11 + weight * sin**2
        h0, h1 = h0 + weight * cos * distance, h1 + weight * sin * distance
        square += weight * distance**2
    determinant = g00 * g11 - g01 * g01
    if part < 2 or determinant <= 1e-6 * votes**2:
        return near_x, near_y, 0.0
    x, y = (g11 * h0 - g01 * h1) / determinant, (g00 * h1 - g01 * h0) / determinant
    return near_x + x, near_y + y, max(0.0, square - x * h0 - y * h1) / votes


def smoothed(
    last: tuple[float, float] | None, now: tuple[float, float], residual_px2: float, psi: float
) -> tuple[float, float]:
    """Blend the new vanishing point into the old one.

    p₀ᵗ = (1 − e^(−ψε))·p₀ᵗ⁻¹ + e^(−ψε)·p̂₀ᵗ                     [source 002, (42)]

    ε is the residual of (41) (not the acceleration coefficient of the same letter).

    Args:
        last: Previous point, or None on the first frame.
        now: This frame's point.
        residual_px2: ε, px².
        psi: ψ, 1/px².

    Example:
        >>> smoothed((0.0, 0.0), (10.0, 4.0), 0.0, 0.05)
        (10.0, 4.0)
    """
    if last is None:
        return now
    share = math.exp(-psi * residual_px2)
    return (
        (1 - share) * last[0] + share * now[0],
        (1 - share) * last[1] + share * now[1],
    )
