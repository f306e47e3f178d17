"""The reference gap x_ref as a table over the mother train's position."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Reference(NamedTuple):
    """x_ref and its derivatives, linear between the knots; constant gaps outside them.

    Attributes:
        position_m: Mother-train positions p_m, metres, increasing, shape (N,).
        gap_m: x_ref, metres.
        slope: dx_ref/dp_m, so that v_ref = v_m·(1 + slope).
        bend_per_m: d²x_ref/dp_m², 1/m.
    """

    position_m: Array
    gap_m: Array
    slope: Array
    bend_per_m: Array

    def at(self, position_m: Array | float) -> tuple[Array, Array, Array]:
        """Gap, slope and bend at mother-train positions."""
        gap, slope, bend = (
            np.asarray(np.interp(position_m, self.position_m, values), float)
            for values in (self.gap_m, self.slope, self.bend_per_m)
        )
        return gap, slope, bend

    @staticmethod
    def joined(parts: list[Reference]) -> Reference:
        """Several tables one after the other."""
        return Reference(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    @staticmethod
    def constant(gap_m: float) -> Reference:
        """One gap everywhere."""
        return Reference(np.array([0.0, 1.0]), np.full(2, gap_m), np.zeros(2), np.zeros(2))
