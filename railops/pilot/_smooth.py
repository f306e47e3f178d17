"""Smooth twins of piecewise linear tables, for the optimiser.

f(p) = a + b·p + ½ Σₖ Δₖ·√((p − kₖ)² + δ²), with Δₖ the change of slope at knot kₖ: the exact table
where δ = 0, and within ½·|Δₖ|·δ of it near a knot otherwise. Two derivatives exist everywhere,
which Newton's method needs and a table does not give.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from railops._extras import extra
from railops.pilot.route import Ramp

ROUNDING_M = 4.0
# A knot this many roundings away bends nothing any more: left out it costs ½·|Δₖ|·δ/24, and each
# one kept is differentiated twice at every node.
_NEAR = 12


class SmoothRamp:
    """A :class:`Ramp` on [low, high], as CasADi expressions of its value and its integral."""

    def __init__(self, ramp: Ramp, low_m: float, high_m: float, rounding_m: float = ROUNDING_M):
        knots, values = ramp
        self._rounding = rounding_m
        self._origin = low_m
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(knots), [0.0]])
        bends = np.diff(slopes)
        start, end = low_m - _NEAR * rounding_m, high_m + _NEAR * rounding_m
        near = (knots > start) & (knots < end) & (bends != 0)
        self._knots, self._bends = knots[near] - low_m, bends[near]
        # Left of every knot kept the table is one straight line; ½ Σ Δ is the twin's share of it.
        left = float(slopes[np.searchsorted(knots, start, "right")])
        self._linear = left + 0.5 * float(self._bends.sum())
        beyond = 0.5 * float((self._bends * np.abs(start - low_m - self._knots)).sum())
        self._constant = float(ramp.at(start)) - self._linear * (start - low_m) - beyond

    def value(self, position: Any) -> Any:
        """Values f at a CasADi expression of positions, metres."""
        return self.value_and_integral(position)[0]

    def value_and_integral(self, position: Any) -> tuple[Any, Any]:
        """f, and ∫ f from the interval's low end, at a CasADi expression of positions, metres."""
        ca = extra("pilot", "casadi", "planning")
        p, soft = position - self._origin, self._rounding
        value = self._constant + self._linear * p
        integral = (self._constant + 0.5 * self._linear * p) * p
        for knot, bend in zip(self._knots.tolist(), self._bends.tolist(), strict=True):
            away = p - knot
            root = ca.sqrt(away * away + soft**2)
            area = away * root + soft**2 * ca.asinh(away / soft)
            before = -knot * math.hypot(knot, soft) + soft**2 * math.asinh(-knot / soft)
            value = value + 0.5 * bend * root
            integral = integral + 0.25 * bend * (area - before)
        return value, integral
