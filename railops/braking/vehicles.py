"""Longitudinal dynamics of a train of several vehicles with couplers between them.

Each vehicle i has its own place on the line, brake and running resistance; neighbours are coupled
by a spring and a damper with slack:

    m_i·(1 + γ)·dv_i/dt = −m_i·(1 + γ)·e_i − m_i·(r(v_i) + w(s_i)) + F_{i−1} − F_i

with the coupler force F_i = k·x + d·dx/dt for an elongation x beyond half the slack either way.
The brake command runs along the train (an air brake at some 250 m/s), so the front brakes first
and the couplers feel it. Semi-implicit Euler steps of 1 ms resolve the couplers' oscillation
(some 2–5 Hz); with rigid settings the train moves like the point mass of
:mod:`railops.braking.stopping`, which a test holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.braking.stopping import BrakeName, cannot_stop
from railops.braking.train import Brake, Train
from railops.errors import CannotStopError, DomainError, check_range
from railops.traction import (
    acceleration,
    adhesion_limit,
    build_up,
    line_resistance,
)

Array = npt.NDArray[np.float64]

_STEP_S = 1e-3
_HORIZON_S = 1800.0


@dataclass(frozen=True)
class Consist:
    """How a train is made up; masses are equal shares of the train's.

    Attributes:
        vehicles: Number of vehicles, 1 … 400.
        stiffness_n_per_m: Coupler stiffness k, N/m.
        damping_ns_per_m: Coupler damping d, N·s/m.
        slack_m: Free travel of each coupler, metres, >= 0.
        wave_mps: Speed of the brake command along the train, m/s; inf for an electric command.
        isolated: Indices of vehicles whose brake does not work.
    """

    vehicles: int = 10
    stiffness_n_per_m: float = 1e7
    damping_ns_per_m: float = 5e5
    slack_m: float = 0.0
    wave_mps: float = math.inf
    isolated: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_range("vehicles", self.vehicles, 1, 400)
        check_range("stiffness_n_per_m", self.stiffness_n_per_m, 0.0, 1e9, "N/m", above=True)
        check_range("damping_ns_per_m", self.damping_ns_per_m, 0.0, 1e8, "N·s/m")
        check_range("slack_m", self.slack_m, 0.0, 1.0, "m")
        if not math.isinf(self.wave_mps):
            check_range("wave_mps", self.wave_mps, 1.0, 1e9, "m/s")
        for index in self.isolated:
            check_range("isolated", index, 0, self.vehicles - 1)


@dataclass(frozen=True)
class ConsistStop:
    """A stop of several vehicles.

    Attributes:
        distance_m: Run of the first vehicle until the whole train stands, metres.
        time_s: Until then, s.
        largest_push_n: Largest compression of each coupler, N. Shape (vehicles − 1,).
        largest_pull_n: Largest tension of each coupler, N. Shape (vehicles − 1,).
    """

    distance_m: float
    time_s: float
    largest_push_n: Array
    largest_pull_n: Array


@compiled
def _simulate(
    v: Array,
    s: Array,
    brakes: Array,
    start: Array,
    settings: Array,
    train: Array,
    brake_at: Array,
    brake_value: Array,
    line_at: Array,
    line_force: Array,
    push: Array,
    pull: Array,
) -> float:
    """Advance until every vehicle stands; returns the time, or inf. Works in place."""
    n = v.size
    stiffness, damping, slack, mass, spacing, delay, ramp = settings
    c0, c1, c2, rotating, adhesion = train
    inertia = mass * (1.0 + rotating)
    force = np.zeros(n + 1)  # force[i] acts between vehicle i − 1 and vehicle i; tension positive
    for step in range(int(_HORIZON_S / _STEP_S)):
        time = (step + 1) * _STEP_S
        moving = False
        for i in range(1, n):
            stretch = s[i - 1] - s[i] - spacing
            beyond = max(abs(stretch) - 0.5 * slack, 0.0) * np.sign(stretch)
            f = stiffness * beyond + (damping * (v[i - 1] - v[i]) if beyond != 0.0 else 0.0)
            force[i] = f
            push[i - 1], pull[i - 1] = max(push[i - 1], -f), max(pull[i - 1], f)
        for i in range(n):
            share = brakes[i] * build_up(time - start[i], delay, ramp)
            effort = share * line_resistance(v[i], brake_at, brake_value)
            effort = min(effort, adhesion_limit(v[i], adhesion))
            line = line_resistance(s[i], line_at, line_force)
            free = acceleration(0.0, v[i], line, c0, c1, c2, rotating)
            free += (force[i] - force[i + 1]) / inertia
            new = v[i] + _STEP_S * (free - effort)
            # A braked vehicle that comes to rest stays there unless pushed harder than it brakes.
            if new <= 0.0:
                new = 0.0
            v[i] = new
            moving = moving or new > 1e-4
        for i in range(n):
            s[i] += _STEP_S * v[i]
        if not moving and time > start[n - 1] + delay:
            return time
    return np.inf


def stop_consist(
    train: Train, consist: Consist, brake: BrakeName | Brake = "emergency"
) -> ConsistStop:
    """Stop a train of several coupled vehicles.

    Args:
        train: The train; ``mass_kg`` and ``length_m`` are shared out evenly.
        consist: Its vehicles and couplers.
        brake: Which brake.

    Raises:
        CannotStopError: if it never stands.
    """
    used = brake if isinstance(brake, Brake) else getattr(train, brake)
    n = consist.vehicles
    spacing = train.length_m / n
    v = np.full(n, float(train.speed_mps))
    places: Array = spacing * np.arange(n, dtype=float)
    s: Array = train.position_m - places
    front = s[0]
    brakes = np.ones(n)
    brakes[list(consist.isolated)] = 0.0
    start: Array = places / consist.wave_mps  # all zero for an electric command
    # One vehicle's line resistance is averaged over its own length only.
    line = train.line.table(spacing)
    mass = train.mass_kg / n
    quickest = (
        2.0 * math.sqrt(consist.stiffness_n_per_m / mass) + 4.0 * consist.damping_ns_per_m / mass
    )
    if quickest * _STEP_S > 1.0:
        raise DomainError(
            "stiffness_n_per_m, damping_ns_per_m",
            (consist.stiffness_n_per_m, consist.damping_ns_per_m),
            f"couplers whose motion steps of {_STEP_S:g} s resolve for vehicles of {mass:g} kg",
        )
    settings = np.array(
        [
            consist.stiffness_n_per_m,
            consist.damping_ns_per_m,
            consist.slack_m,
            mass,
            spacing,
            used.delay_s,
            used.build_up_s,
        ]
    )
    davis = train.davis
    adhesion = train.adhesion.factor * train.adhesion.share
    vehicle = np.array([davis.c0, davis.c1, davis.c2, train.rotating, adhesion])
    push, pull = np.zeros(n - 1), np.zeros(n - 1)
    if train.speed_mps == 0.0:
        return ConsistStop(0.0, 0.0, push, pull)
    brake_at, brake_value = used.table
    time = _simulate(
        v,
        s,
        brakes,
        start,
        settings,
        vehicle,
        brake_at,
        brake_value,
        line.position_m,
        line.resistance_mps2,
        push,
        pull,
    )
    if not math.isfinite(time):
        raise CannotStopError(cannot_stop(train, used))
    return ConsistStop(float(s[0] - front), float(time), push, pull)
