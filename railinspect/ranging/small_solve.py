"""Positive definite systems of a few unknowns, for the compiled loops.

LAPACK takes longer to reach than these take to solve.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@numba.njit(cache=True)
def factorise(matrix: Array) -> None:
    """Put L with L·Lᵀ = matrix in place of its lower triangle; the rest is neither read nor set.

    Args:
        matrix: Symmetric and positive definite, shape (N, N).

    Example:
        >>> matrix, out = np.array([[4.0, 2.0], [2.0, 3.0]]), np.empty(2)
        >>> factorise(matrix)
        >>> substitute(matrix, np.array([8.0, 8.0]), out)
        >>> [float(value) for value in out.round(12)]
        [1.0, 2.0]
    """
    for a in range(len(matrix)):
        for b in range(a + 1):
            total = matrix[a, b]
            for k in range(b):
                total -= matrix[a, k] * matrix[b, k]
            matrix[a, b] = math.sqrt(total) if a == b else total / matrix[b, b]


@numba.njit(cache=True)
def substitute(lower: Array, right: Array, out: Array) -> None:
    """Solve L·Lᵀ·out = right.

    Args:
        lower: L in its lower triangle, shape (N, N).
        right: Shape (N,).
        out: Where the solution goes, shape (N,).
    """
    count = len(right)
    for a in range(count):
        total = right[a]
        for k in range(a):
            total -= lower[a, k] * out[k]
        out[a] = total / lower[a, a]
    for a in range(count - 1, -1, -1):
        total = out[a]
        for k in range(a + 1, count):
            total -= lower[k, a] * out[k]
        out[a] = total / lower[a, a]
