"""Target braking: two controllers of the paper's kind, and how far from the target they stop.

Both see the distance to the target and a measured speed V·(1 + e), the error e uniform in ±10 %
(eq. 9: ΔV = 0.1·V·(rnd(2) − 1)), held over one stop, as a wheel-diameter error would be. The brake
follows its command through a dead time and a first-order lag and is limited.

- acceleration-based: command the deceleration that leads to the target, V² / (2·d), anew in every
  cycle;
- speed-based: follow the speed curve √(2·b·d) with a proportional correction.

Below the holding speed both stop the train with a fixed deceleration; past the target both brake
fully. The stopping error is
nominal minus actual distance, the nominal run being the one without any error (negative:
overrun), as the paper defines it. It prints −3 … 1.5 m for acceleration-based and −2 … 3.5 m for
speed-based control of a suburban train without the train's data; the data here are stated and give
these ranges within a metre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.braking.train import Train
from railops.errors import CannotStopError, DomainError, check_range
from railops.traction import LineTable, acceleration, line_resistance

Array = npt.NDArray[np.float64]
Kind = Literal["acceleration", "speed"]

_STEP_S = 0.01
_LIMIT_S = 600.0


@dataclass(frozen=True)
class Controller:
    """A target-braking controller and the brake behind it.

    Attributes:
        kind: "acceleration" or "speed".
        decel_mps2: Planned deceleration b, m/s².
        hold_mps: Measured speed below which the holding deceleration is applied, m/s.
        hold_mps2: Holding deceleration, m/s².
        gain_per_s: Correction of the speed-based controller, 1/s.
        period_s: Control cycle, s.
        dead_time_s: Time before a command reaches the brake, s.
        lag_s: Time constant of the brake, s.
        largest_mps2: Largest deceleration that can be commanded, m/s².
        speed_error_rel: Half-width of the uniform relative speed error.
        resistance_std: Relative standard deviation of the running resistance.
    """

    kind: Kind
    decel_mps2: float
    hold_mps: float
    hold_mps2: float
    gain_per_s: float = 0.3
    period_s: float = 0.1
    dead_time_s: float = 0.2
    lag_s: float = 0.6
    largest_mps2: float = 1.1
    speed_error_rel: float = 0.1
    resistance_std: float = 0.1

    def __post_init__(self) -> None:
        if self.kind not in ("acceleration", "speed"):
            raise DomainError("kind", self.kind, "'acceleration' or 'speed'")
        for name in ("decel_mps2", "largest_mps2", "hold_mps2"):
            check_range(name, getattr(self, name), 0.0, 5.0, "m/s²", above=True)
        check_range("gain_per_s", self.gain_per_s, 0.0, 100.0, "1/s")
        check_range("period_s", self.period_s, _STEP_S, 10.0, "s")
        check_range("dead_time_s", self.dead_time_s, 0.0, 10.0, "s")
        check_range("lag_s", self.lag_s, 0.0, 30.0, "s", above=True)
        check_range("hold_mps", self.hold_mps, 0.0, 10.0, "m/s")
        check_range("speed_error_rel", self.speed_error_rel, 0.0, 0.5)
        check_range("resistance_std", self.resistance_std, 0.0, 1.0)


def suburban(kind: Kind) -> Controller:
    """The stated controllers that give the paper's error ranges from 20 m/s on level track.

    Both act through the same brake (dead time 0.2 s, lag 0.6 s, at most 1.1 m/s²).
    """
    if kind == "acceleration":
        return Controller("acceleration", decel_mps2=0.7, hold_mps=1.0, hold_mps2=0.5)
    return Controller(kind, decel_mps2=0.5, hold_mps=3.0, hold_mps2=0.4)


@compiled
def _run(
    speed: float,
    distance: float,
    by_speed: bool,
    error: float,
    davis: float,
    settings: Array,
    train: Array,
    line_at: Array,
    line_force: Array,
) -> float:
    """Run of one controlled stop, metres; inf if it does not end. Explicit mid-point steps."""
    decel, gain, period, dead, lag, largest, hold_speed, hold = settings
    position, c0, c1, c2, rotating = train
    queue = np.zeros(max(round(dead / _STEP_S), 1))
    every = max(round(period / _STEP_S), 1)
    run, brake, command = 0.0, 0.0, 0.0
    holding = False
    for step in range(int(_LIMIT_S / _STEP_S)):
        if step % every == 0:
            seen = speed * (1.0 + error)
            left = max(distance - run, 0.01)
            holding = holding or seen <= hold_speed
            if run >= distance:
                command = largest
            elif holding:
                command = hold
            elif by_speed:
                command = decel + gain * (seen - math.sqrt(2.0 * decel * left))
            else:
                command = seen * seen / (2.0 * left)
            command = min(max(command, 0.0), largest)
        slot = step % queue.size
        delayed, queue[slot] = queue[slot], command
        new_brake = delayed + (brake - delayed) * math.exp(-_STEP_S / lag)
        line = line_resistance(position + run, line_at, line_force)
        slope = acceleration(
            -0.5 * (brake + new_brake), speed, line, davis * c0, davis * c1, davis * c2, rotating
        )
        new_speed = speed + _STEP_S * slope
        if new_speed <= 0.0:
            return run + 0.5 * speed * speed / -slope
        run += 0.5 * _STEP_S * (speed + new_speed)
        speed, brake = new_speed, new_brake
    return np.inf


def stopping_errors(
    controller: Controller, train: Train, runs: int, seed: int, distance_m: float | None = None
) -> Array:
    """Stopping errors of a simulated series, metres: nominal minus actual, negative = overrun.

    Args:
        controller: The controller and its brake.
        train: The train at its speed and place; its own brakes are not used.
        runs: Number of stops, >= 1.
        seed: Seed of the errors.
        distance_m: Distance to the target when control begins; default: what the planned
            deceleration, the dead time and the lag need.

    Returns:
        Errors, shape (runs,).

    Raises:
        DomainError: if a number leaves its range.
        CannotStopError: if the nominal run or one of the runs does not come to a stand.
    """
    check_range("runs", runs, 1, 1e8)
    check_range("seed", seed, 0, 2**63)
    c, v, davis = controller, train.speed_mps, train.davis
    if distance_m is None:
        distance_m = v * v / (2.0 * c.decel_mps2) + v * (c.dead_time_s + c.lag_s)
    check_range("distance_m", distance_m, 0.0, 1e5, "m", above=True)
    table: LineTable = train.line.table(train.length_m)
    settings = np.array(
        [
            c.decel_mps2,
            c.gain_per_s,
            c.period_s,
            c.dead_time_s,
            c.lag_s,
            c.largest_mps2,
            c.hold_mps,
            c.hold_mps2,
        ]
    )
    vehicle = np.array([train.position_m, davis.c0, davis.c1, davis.c2, train.rotating])

    def run(error: float, share: float) -> float:
        by_speed = c.kind == "speed"
        return _run(v, distance_m, by_speed, error, share, settings, vehicle, *table)

    rng = np.random.default_rng(seed)
    errors = c.speed_error_rel * (2.0 * rng.random(int(runs)) - 1.0)
    shares = np.maximum(0.0, 1.0 + c.resistance_std * rng.standard_normal(int(runs)))
    nominal = run(0.0, 1.0)
    runs_m = np.array([run(e, f) for e, f in zip(errors, shares, strict=True)])
    if not (math.isfinite(nominal) and np.isfinite(runs_m).all()):
        raise CannotStopError(
            f"the train cannot stop: on this line the {c.kind}-based controller with at most "
            f"{c.largest_mps2:g} m/s² does not bring it to a stand in every run; it runs away"
        )
    return nominal - runs_m
