"""Legendre–Gauss–Lobatto nodes and weights; matrices that differentiate, evaluate, integrate.

On [0, 1]; exact for polynomials of degree 2n − 3 (weights) and n − 1 (matrices) with n nodes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from railops.errors import check_range

Array = npt.NDArray[np.float64]


class Lobatto(NamedTuple):
    """The rule with n nodes.

    Attributes:
        nodes: Shape (n,), from 0 to 1.
        weights: ∫₀¹ f ≈ Σ wᵢ·f(nodeᵢ), shape (n,).
        derivative: f′ at the nodes from f at the nodes, shape (n, n).
        basis: Legendre coefficients of each node's Lagrange polynomial, shape (degree, n).
    """

    nodes: Array
    weights: Array
    derivative: Array
    basis: Array


@lru_cache(maxsize=32)
def lobatto(count: int) -> Lobatto:
    """The rule with ``count`` nodes, 2 … 200.

    Example:
        >>> lobatto(3).weights * 6
        array([1., 4., 1.])
    """
    check_range("count", count, 2, 200)
    n = int(count)
    top = np.zeros(n)
    top[-1] = 1.0  # the Legendre polynomial of degree n − 1
    inner = np.sort(legendre.legroots(legendre.legder(top)).real) if n > 2 else np.empty(0)
    slope, bend = legendre.legder(top), legendre.legder(top, 2)
    for _ in range(3 if n > 2 else 0):  # Newton polishes the eigenvalue solver's last digits
        inner = inner - legendre.legval(inner, slope) / legendre.legval(inner, bend)
    t = np.concatenate([[-1.0], inner, [1.0]])
    at_nodes = legendre.legval(t, top)
    weights = 2.0 / (n * (n - 1) * at_nodes**2)

    gaps = t[:, None] - t[None, :] + np.eye(n)
    derivative = at_nodes[:, None] / at_nodes[None, :] / gaps
    np.fill_diagonal(derivative, 0.0)
    derivative[0, 0], derivative[-1, -1] = -n * (n - 1) / 4.0, n * (n - 1) / 4.0

    # Lagrange basis through its Legendre coefficients: cᵏ = γₖ⁻¹ Σ w·P_k·f.
    vander = legendre.legvander(t, n - 1)  # (node, degree)
    norm = (vander**2 * weights[:, None]).sum(0)
    basis = (vander * weights[:, None]).T / norm[:, None]  # (degree, node)
    return Lobatto((t + 1.0) / 2.0, weights / 2.0, 2.0 * derivative, basis)


def evaluate(rule: Lobatto, at: Array, integrals: int = 0) -> Array:
    """The matrix from values at the nodes to their polynomial, or its repeated integral from 0.

    Args:
        rule: The rule.
        at: Points in [0, 1], shape (m,).
        integrals: How many times to integrate.

    Returns:
        Shape (m, n).

    Example:
        >>> rule = lobatto(3)
        >>> evaluate(rule, np.array([1.0]), integrals=2) @ np.ones(3)
        array([0.5])
    """
    t = 2.0 * at - 1.0
    series = legendre.legint(rule.basis, m=integrals, lbnd=-1) if integrals else rule.basis
    return np.asarray(legendre.legval(t, series).T * 0.5**integrals, float)
