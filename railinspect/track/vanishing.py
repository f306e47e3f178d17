"""Vanishing point of the track: weighted least squares (41) and adaptive smoothing (42)."""

from __future__ import annotations

import math
from collections.abc import Sequence

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
    # X − slope·Y = X_b − slope·Y_b, divided by the normal's length: cos θ, sin θ and l of (41).
    slope = np.array([line.slope for line in lines])
    at_bottom = np.array([line.bottom_px for line in lines])
    votes = np.array([line.votes for line in lines])
    norm = np.hypot(1.0, slope)
    normal = np.stack([1.0 / norm, -slope / norm], axis=1)
    distance = (at_bottom - slope * bottom_px) / norm
    guess = np.array(near_px)
    part = np.abs(distance - normal @ guess) <= reach_px
    if np.count_nonzero(part) < 2:
        return near_px, 0.0
    normal, distance, weight = normal[part], distance[part], votes[part] / votes[part].sum()
    gram = normal.T @ (weight[:, None] * normal)
    if np.linalg.det(gram) < 1e-6:
        return near_px, 0.0
    x, y = np.linalg.solve(gram, normal.T @ (weight * distance))
    residual = float(weight @ (distance - normal @ np.array([x, y])) ** 2)
    return (float(x), float(y)), residual


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
