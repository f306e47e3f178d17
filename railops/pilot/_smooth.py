"""Smooth twins of piecewise linear tables, for the optimiser.

f(p) = a + b·p + ½ Σₖ Δₖ·√((p − kₖ)² + δₖ²), with Δₖ the change of slope at knot kₖ: the exact
table where δₖ = 0, and within ½·|Δₖ|·δₖ of it near a knot otherwise. Two derivatives exist
everywhere, which Newton's method needs and a table does not give.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from railops._extras import extra
from railops.pilot.route import Ramp

Array = npt.NDArray[np.float64]

# A knot this many roundings away bends nothing any more: left out it costs ½·|Δₖ|·δ/24, and each
# one kept is differentiated twice at every node.
_NEAR = 12


class SmoothRamp:
    """A :class:`Ramp` on [low, high], as CasADi expressions of its value and its integral."""

    def __init__(self, ramp: Ramp, low_m: float, high_m: float, rounding_m: Array | float):
        """Choose what bends on the interval.

        Args:
            ramp: The table.
            low_m: Start of the interval, metres.
            high_m: Its end.
            rounding_m: δ, one or one per knot, metres, > 0.
        """
        knots, values = ramp
        rounding = np.broadcast_to(rounding_m, knots.shape)
        self._origin = low_m
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(knots), [0.0]])
        bends = np.diff(slopes)
        away = np.maximum(low_m - knots, knots - high_m)
        near = (away < _NEAR * rounding) & (bends != 0)
        self._knots, self._bends = knots[near] - low_m, bends[near]
        self._rounding = rounding[near]
        # The straight line that makes the sum, were it sharp, agree with the table at low_m.
        slope = float(slopes[np.searchsorted(knots, low_m, "right")])
        self._linear = slope - 0.5 * float(self._bends @ np.where(self._knots <= 0.0, 1.0, -1.0))
        self._constant = float(ramp.at(low_m)) - 0.5 * float(self._bends @ np.abs(self._knots))

    def value(self, position: Any) -> Any:
        """Values f at a CasADi expression of positions, metres."""
        return self.value_and_integral(position)[0]

    def value_and_integral(self, position: Any) -> tuple[Any, Any]:
        """f, and ∫ f from the interval's low end, at a CasADi expression of positions, metres."""
        ca = extra("pilot", "casadi", "planning")
        p = position - self._origin
        value = self._constant + self._linear * p
        integral = (self._constant + 0.5 * self._linear * p) * p
        columns = (column.tolist() for column in (self._knots, self._bends, self._rounding))
        for knot, bend, soft in zip(*columns, strict=True):
            away = p - knot
            root = ca.sqrt(away * away + soft**2)
            area = away * root + soft**2 * ca.asinh(away / soft)
            before = -knot * math.hypot(knot, soft) + soft**2 * math.asinh(-knot / soft)
            value = value + 0.5 * bend * root
            integral = integral + 0.25 * bend * (area - before)
        return value, integral
