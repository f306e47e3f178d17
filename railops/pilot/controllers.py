"""The controllers that make the pilot vehicle follow its reference gap.

Both get the estimated gap, their own speed and the mother train's speed as received, and return a
force over mass. Compiled: scalars and flat arrays in, scalars out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.errors import check_range

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Pid:
    """Eq. 39: u/m = P·e + I·∫e dt + D·de/dt with e = x_ref − x.

    The derivative is taken from the speeds, de/dt = v_m·dx_ref/dp_m − (v − v_m), as in Appendix C.

    Attributes:
        proportional: P/m, 1/s².
        integral: I/m, 1/s³.
        derivative: D/m, 1/s.
        anti_windup: Whether the integral waits while the force is at its limit.
    """

    proportional: float = 0.8
    integral: float = 0.1
    derivative: float = 6.0
    anti_windup: bool = True

    def __post_init__(self) -> None:
        for name in ("proportional", "integral", "derivative"):
            check_range(name, getattr(self, name), 0.0, 1e4)


@dataclass(frozen=True)
class Mpc:
    """Model-predictive control with preview of the reference and the mother train's profile.

    The plan's own force (flatness, :mod:`railops.pilot.plan`) is fed forward; a box-constrained
    quadratic programme over the horizon corrects the error within what the limits leave, with an
    estimate of the disturbance taken out. The error obeys e″ = δu, exactly for the reference's
    own motion.

    Attributes:
        horizon: Steps ahead, 2 … 60.
        step_s: Length of one step, s.
        gap_weight: Weight of the gap's error, 1/m².
        speed_weight: Weight of the speed's error, (m/s)⁻².
        force_weight: Weight of the correction, (m/s²)⁻².
        sweeps: Projected Gauss–Seidel sweeps per decision, from the last decision's answer.
    """

    horizon: int = 20
    step_s: float = 1.0
    gap_weight: float = 1.0
    speed_weight: float = 2.0
    force_weight: float = 60.0
    sweeps: int = 12

    def __post_init__(self) -> None:
        check_range("horizon", self.horizon, 2, 60)
        check_range("step_s", self.step_s, 0.05, 10.0, "s")
        for name in ("gap_weight", "speed_weight"):
            check_range(name, getattr(self, name), 0.0, 1e6)
        check_range("force_weight", self.force_weight, 0.0, 1e6, above=True)
        check_range("sweeps", self.sweeps, 1, 1000)

    @property
    def tables(self) -> MpcTables:
        """The matrices of the quadratic programme ½δᵀHδ + (K·[e, r])ᵀδ."""
        n, h = int(self.horizon), self.step_s
        to_gap, to_speed = np.zeros((n, n)), np.zeros((n, n))
        for k in range(n):
            for j in range(k + 1):
                to_speed[k, j] = h
                to_gap[k, j] = h * h * (k - j + 0.5)
        times = h * np.arange(1, n + 1)
        free_gap = np.stack([np.ones(n), times], axis=1)
        free_speed = np.stack([np.zeros(n), np.ones(n)], axis=1)
        q, s = self.gap_weight, self.speed_weight
        hessian = q * to_gap.T @ to_gap + s * to_speed.T @ to_speed
        hessian += self.force_weight * np.eye(n)
        linear = q * to_gap.T @ free_gap + s * to_speed.T @ free_speed
        return MpcTables(h, int(self.sweeps), hessian, np.ascontiguousarray(linear))


class MpcTables(NamedTuple):
    """What the inner function reads of an :class:`Mpc`."""

    step_s: float
    sweeps: int
    hessian: Array
    linear: Array


@compiled
def pid_force(
    error: float,
    error_rate: float,
    total: float,
    gains: Array,
    low: float,
    high: float,
    step_s: float,
) -> tuple[float, float]:
    """One PID decision: force over mass (not yet limited) and the new integral of the error.

    ``gains`` is (P, I, D, anti-windup); the limits serve the anti-windup only.
    """
    grown = total + error * step_s
    force = gains[0] * error + gains[1] * grown + gains[2] * error_rate
    outward = (force > high and error > 0.0) or (force < low and error < 0.0)
    if gains[3] > 0.0 and outward:
        grown = total
        force = gains[0] * error + gains[1] * grown + gains[2] * error_rate
    return force, grown


@compiled
def box_qp(
    hessian: Array, gradient: Array, low: Array, high: Array, answer: Array, sweeps: int
) -> None:
    """Minimise ½xᵀHx + gᵀx within low <= x <= high by projected Gauss–Seidel, in place."""
    n = gradient.size
    for _ in range(sweeps):
        for i in range(n):
            slope = gradient[i]
            for j in range(n):
                slope += hessian[i, j] * answer[j]
            moved = answer[i] - slope / hessian[i, i]
            answer[i] = min(max(moved, low[i]), high[i])
