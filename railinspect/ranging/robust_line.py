"""The straight line through most points of a plane."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@numba.njit(cache=True)
def robust_line(x: Array, y: Array, turns: int) -> tuple[float, float]:
    """Line y = slope·x + at by least squares whose weights fall with the residuals (Cauchy).

    Args:
        x: Abscissae, at least two different ones, shape (N,).
        y: Ordinates, shape (N,).
        turns: How often the weights are taken anew, >= 1.

    Returns:
        Slope and value at x = 0.

    Example:
        >>> x = np.arange(9.0)
        >>> slope, at = robust_line(x, 2 * x + 1 + 50 * (x == 4), 6)
        >>> abs(slope - 2) < 1e-3 and abs(at - 1) < 1e-2
        True
    """
    weight = np.ones(len(x))
    slope, at = 0.0, 0.0
    for _ in range(turns):
        total = weight.sum()
        mean_x, mean_y = (weight * x).sum() / total, (weight * y).sum() / total
        off = x - mean_x
        slope = (weight * off * (y - mean_y)).sum() / (weight * off * off).sum()
        at = mean_y - slope * mean_x
        residual = np.abs(y - slope * x - at)
        weight = 1.0 / (1.0 + (residual / (2.0 * np.median(residual) + 1e-6)) ** 2)
    return slope, at
