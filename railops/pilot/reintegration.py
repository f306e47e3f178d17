"""The dynamics of eqs. 2, 17 and 18 as a compiled inner function, and a plan integrated with it.

Independent of the collocation: it takes only the planned force as a function of position, starts
from the leg's first state and integrates with the classical Runge–Kutta method on the exact
tables of the route (not their smooth twins).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.pilot.route import Route
from railops.pilot.vehicle import PilotVehicle
from railops.traction import acceleration, line_resistance

Array = npt.NDArray[np.float64]

STEP_M = 2.0


class Course(NamedTuple):
    """What the inner functions read: the vehicle's coefficients and the route's tables."""

    epsilon: float
    c0: float
    c1: float
    c2: float
    line_at: Array
    line_mps2: Array
    tunnel_at: Array
    tunnel_factor: Array
    mother_at: Array
    mother_accel: Array
    mother_energy: Array


def course_of(route: Route, vehicle: PilotVehicle) -> Course:
    """The inner functions' view of a vehicle on a route."""
    davis = vehicle.davis
    return Course(
        vehicle.epsilon,
        davis.c0,
        davis.c1,
        davis.c2,
        route.resistance.position_m,
        route.resistance.value,
        route.tunnel.position_m,
        route.tunnel.value,
        route.mother.accel.position_m,
        route.mother.accel.value,
        route.mother.energy,
    )


@compiled
def pilot_acceleration(
    force_mps2: float, speed_mps: float, position_m: float, course: Course
) -> float:
    """dv/dt of eq. 2: ε·u/m − c₀ − c₁v − c₂v² − w(p), m/s²."""
    line = line_resistance(position_m, course.line_at, course.line_mps2)
    factor = line_resistance(position_m, course.tunnel_at, course.tunnel_factor)
    return acceleration(
        course.epsilon * force_mps2,
        speed_mps,
        line,
        course.c0,
        course.c1,
        factor * course.c2,
        0.0,
    )


@compiled
def mother_motion(position_m: float, course: Course) -> tuple[float, float]:
    """v_m and a_m = v_m·dv_m/dp at a mother-train position, m/s and m/s²."""
    at, accel = course.mother_at, course.mother_accel
    last = at.size - 1
    p = min(max(position_m, at[0]), at[last])
    k = min(max(np.searchsorted(at, p, "right") - 1, 0), last - 1)
    past = p - at[k]
    slope = (accel[k + 1] - accel[k]) / (at[k + 1] - at[k])
    energy = course.mother_energy[k] + (accel[k] + 0.5 * slope * past) * past
    return np.sqrt(2.0 * max(energy, 0.0)), accel[k] + slope * past


@compiled
def _march(position: Array, force: Array, gap: Array, speed: Array, course: Course) -> None:
    """Runge–Kutta over pairs of intervals of ``position``; fills every second gap and speed.

    ``force`` is given at every position, so also at the middle of each step.
    """
    for i in range(0, position.size - 2, 2):
        h = position[i + 2] - position[i]
        x, v = gap[i], speed[i]
        kx, kv = 0.0, 0.0
        sum_x, sum_v = 0.0, 0.0
        for stage in range(4):
            at = i if stage == 0 else (i + 2 if stage == 3 else i + 1)
            part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            xs, vs = x + part * kx, v + part * kv
            mother, _ = mother_motion(position[at], course)
            kx = vs / mother - 1.0
            kv = pilot_acceleration(force[at], vs, position[at] + xs, course) / mother
            weight = 1.0 if stage == 0 or stage == 3 else 2.0
            sum_x += weight * kx
            sum_v += weight * kv
        gap[i + 2] = x + h / 6.0 * sum_x
        speed[i + 2] = v + h / 6.0 * sum_v


@dataclass(frozen=True)
class Trajectory:
    """A leg as it is really driven.

    Attributes:
        position_m: Mother-train positions p_m, metres, increasing, shape (N,).
        gap_m: Gap x there, metres.
        speed_mps: Pilot vehicle's speed v, m/s.
        force_mps2: Force over mass u/m, m/s².
    """

    position_m: Array
    gap_m: Array
    speed_mps: Array
    force_mps2: Array


def drive(
    course: Course, position_m: Array, force_mps2: Array, gap_m: float, speed_mps: float
) -> Trajectory:
    """Integrate eqs. 17 and 18 under a given force.

    Args:
        course: Vehicle and route.
        position_m: Mother-train positions, an odd number, each second one the middle of a step.
        force_mps2: Force over mass at all of them.
        gap_m: Gap at the first.
        speed_mps: Pilot vehicle's speed at the first.

    Returns:
        The states at every second position.
    """
    gap, speed = np.empty(position_m.size), np.empty(position_m.size)
    gap[0], speed[0] = gap_m, speed_mps
    _march(position_m, force_mps2, gap, speed, course)
    return Trajectory(position_m[::2], gap[::2], speed[::2], force_mps2[::2])
