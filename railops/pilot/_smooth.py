"""Smooth twins of piecewise linear tables, for the optimiser.

f(p) = a + b·p + ½ Σₖ Δₖ·√((p − kₖ)² + δ²), with Δₖ the change of slope at knot kₖ: the exact table
where δ = 0, and within ½·|Δₖ|·δ of it near a knot otherwise. Two derivatives exist everywhere,
which Newton's method needs and a table does not give.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from railops._extras import extra
from railops.pilot.route import Ramp

ROUNDING_M = 4.0


class SmoothRamp:
    """A :class:`Ramp` on [low, high], as CasADi expressions of its value and slope."""

    def __init__(self, ramp: Ramp, low_m: float, high_m: float, rounding_m: float = ROUNDING_M):
        knots, values = ramp
        self._rounding = rounding_m
        self._origin = low_m
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(knots), [0.0]])
        bends = np.diff(slopes)
        near = (knots > low_m - 50 * rounding_m) & (knots < high_m + 50 * rounding_m) & (bends != 0)
        self._knots, self._bends = knots[near] - low_m, bends[near]
        # Left of every knot kept the table is one straight line; ½ Σ Δ is the twin's share of it.
        left = float(slopes[np.searchsorted(knots, low_m - 50 * rounding_m, "right")])
        self._linear = left + 0.5 * float(self._bends.sum())
        start = low_m - 50 * rounding_m
        beyond = 0.5 * float((self._bends * np.abs(start - low_m - self._knots)).sum())
        self._constant = float(ramp.at(start)) - self._linear * (start - low_m) - beyond

    def value(self, position: Any) -> Any:
        """Values f at a CasADi expression of positions, metres."""
        p = position - self._origin
        result = self._constant + self._linear * p
        for knot, bend in zip(self._knots.tolist(), self._bends.tolist(), strict=True):
            result = result + 0.5 * bend * self._soft_abs(p - knot)
        return result

    def integral(self, position: Any) -> Any:
        """∫ f from the interval's low end to a CasADi expression of positions."""
        ca = extra("pilot", "casadi", "planning")
        p, soft = position - self._origin, self._rounding

        def area(x: Any) -> Any:
            return 0.5 * (x * ca.sqrt(x * x + soft**2) + soft**2 * ca.asinh(x / soft))

        result = (self._constant + 0.5 * self._linear * p) * p
        for knot, bend in zip(self._knots.tolist(), self._bends.tolist(), strict=True):
            result = result + 0.5 * bend * (area(p - knot) - area(-knot))
        return result

    def _soft_abs(self, x: Any) -> Any:
        return extra("pilot", "casadi", "planning").sqrt(x * x + self._rounding**2)
