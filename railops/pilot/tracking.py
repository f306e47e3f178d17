"""The closed loop of Appendix C: the pilot vehicle follows its reference gap.

Simulated in time with the classical Runge–Kutta method on the route's exact tables, and with what
a vehicle really has: an actuator with dead time, lag and limits; noisy ranging that loses sight in
curves; dead reckoning over the radio meanwhile (Section II-B); a radio with delay and loss;
an odometer with a scale error; wind; and a model whose coefficients are not the vehicle's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.errors import check_range
from railops.pilot.controllers import Mpc, MpcTables, Pid, box_qp, pid_force
from railops.pilot.reference import Reference
from railops.pilot.reintegration import Course, course_of, mother_motion, pilot_acceleration
from railops.pilot.sight import in_sight
from railops.pilot.trip import TripPlan
from railops.pilot.vehicle import PilotVehicle
from railops.traction import Davis, line_resistance

Array = npt.NDArray[np.float64]

_HORIZON_S = 60_000.0


@dataclass(frozen=True)
class Reality:
    """What differs from the ideal; the defaults are the paper's Section III-E: nothing does.

    Attributes:
        limited: Whether the power system has limits (:attr:`PilotVehicle.available_mps2`); the
            paper's Fig. 12 (d) lets the force pass them.
        dead_time_s: From the command until the force starts to change, s.
        lag_s: Time constant of the force, s.
        range_std_m: Standard deviation of one range measurement, metres.
        clear_m: Half-width of the strip free of obstacles to sight; None: always in sight.
        radio_delay_s: Age of the mother train's speed when it arrives, s.
        radio_loss: Probability that one message is lost; the last one heard is used.
        odometer_std: Standard deviation of the scale error of the pilot vehicle's odometer.
        gust_std_mps2: Standard deviation of the wind's force over mass, m/s².
        gust_time_s: Its correlation time, s.
        resistance_error: Relative error of the Davis coefficients: the real vehicle has 1 + this
            times what the controller believes.
        effort_error: Relative error of the force: the real one is 1 + this times the command.
    """

    limited: bool = True
    dead_time_s: float = 0.0
    lag_s: float = 0.0
    range_std_m: float = 0.0
    clear_m: float | None = None
    radio_delay_s: float = 0.0
    radio_loss: float = 0.0
    odometer_std: float = 0.0
    gust_std_mps2: float = 0.0
    gust_time_s: float = 5.0
    resistance_error: float = 0.0
    effort_error: float = 0.0

    def __post_init__(self) -> None:
        check_range("dead_time_s", self.dead_time_s, 0.0, 10.0, "s")
        check_range("lag_s", self.lag_s, 0.0, 30.0, "s")
        check_range("range_std_m", self.range_std_m, 0.0, 1000.0, "m")
        check_range("radio_delay_s", self.radio_delay_s, 0.0, 30.0, "s")
        check_range("radio_loss", self.radio_loss, 0.0, 1.0)
        check_range("odometer_std", self.odometer_std, 0.0, 0.2)
        check_range("gust_std_mps2", self.gust_std_mps2, 0.0, 5.0, "m/s²")
        check_range("gust_time_s", self.gust_time_s, 0.0, 1e4, "s", above=True)
        check_range("resistance_error", self.resistance_error, -0.9, 5.0)
        check_range("effort_error", self.effort_error, -0.9, 1.0)
        if self.clear_m is not None:
            check_range("clear_m", self.clear_m, 0.0, 1e4, "m", above=True)

    @staticmethod
    def rough() -> Reality:
        """A bad day: everything the class knows, at plausible sizes."""
        return Reality(
            dead_time_s=0.3,
            lag_s=0.5,
            range_std_m=1.0,
            clear_m=8.0,
            radio_delay_s=0.5,
            radio_loss=0.1,
            odometer_std=0.002,
            gust_std_mps2=0.03,
            resistance_error=0.2,
            effort_error=-0.05,
        )


@dataclass(frozen=True)
class Track:
    """One tracked trip, sampled at every decision.

    Attributes:
        time_s: Time, s, shape (N,).
        mother_m: Mother train's position, metres.
        gap_m: True gap, metres.
        reference_m: Reference gap, metres.
        speed_mps: Pilot vehicle's speed, m/s.
        force_mps2: Force over mass that acted, m/s².
        estimate_m: Gap as the controller saw it, metres.
        seen: Whether the ranging saw the pilot vehicle's partner.
        limits_mps2: The plan's limits (lowest, highest) of the force, m/s².
    """

    time_s: Array
    mother_m: Array
    gap_m: Array
    reference_m: Array
    speed_mps: Array
    force_mps2: Array
    estimate_m: Array
    seen: npt.NDArray[np.bool_]
    limits_mps2: tuple[float, float]
    saturated: npt.NDArray[np.bool_] = field(repr=False)

    @property
    def error_m(self) -> Array:
        """Tracking error e = x_ref − x, metres."""
        return self.reference_m - self.gap_m

    @property
    def largest_error_m(self) -> float:
        """Largest tracking error anywhere on the trip, metres."""
        return float(np.abs(self.error_m).max())

    @property
    def rms_error_m(self) -> float:
        """Root mean square of the tracking error, metres."""
        return float(np.sqrt(np.mean(self.error_m**2)))

    @property
    def saturated_share(self) -> float:
        """Share of the time the command was beyond the power system's limits."""
        return float(np.mean(self.saturated))

    @property
    def beyond_plan_mps2(self) -> float:
        """How far the force went beyond the plan's limits (Fig. 12 d), m/s²."""
        low, high = self.limits_mps2
        return float(max(0.0, self.force_mps2.max() - high, low - self.force_mps2.min()))

    @property
    def unseen_share(self) -> float:
        """Share of the time without line of sight."""
        return 1.0 - float(np.mean(self.seen))

    @property
    def smallest_gap_m(self) -> float:
        """Smallest true gap, metres; zero or less is a collision with the mother train."""
        return float(self.gap_m.min())


def track(
    plan: TripPlan,
    controller: Pid | Mpc | None = None,
    reality: Reality | None = None,
    *,
    seed: int = 0,
    step_s: float = 0.1,
) -> Track:
    """Simulate a whole trip under a controller.

    Args:
        plan: The planned trip.
        controller: Default: the paper's PID.
        reality: What differs from the ideal; default: nothing but the power system's limits.
        seed: Seed of noise, loss, wind and the odometer's error.
        step_s: Time between two decisions, s.
    """
    controller = controller or Pid()
    reality = reality or Reality()
    check_range("step_s", step_s, 0.01, 1.0, "s")
    check_range("seed", seed, 0, 2**63)
    rng = np.random.default_rng(seed)
    trip, reference = plan.trip, plan.reference
    if reality.clear_m is None:
        sight_at, sight = np.array([0.0, 1.0]), np.ones(2)
    else:
        sight_at, sight = in_sight(trip.route, reference, reality.clear_m)

    times = _mother_times(course_of(trip.route, trip.vehicle), step_s)
    count = times.size
    clock = np.arange(count, dtype=np.float64) * step_s
    noise = rng.standard_normal((count, 2))
    lost = rng.random(count) < reality.radio_loss
    low, high = trip.vehicle.available_mps2 if reality.limited else (-np.inf, np.inf)
    is_mpc = isinstance(controller, Mpc)
    tables = controller.tables if isinstance(controller, Mpc) else Mpc(2).tables
    pid = controller if isinstance(controller, Pid) else Pid()
    gains = np.array([pid.proportional, pid.integral, pid.derivative, float(pid.anti_windup)])
    settings = np.array(
        [
            step_s,
            low,
            high,
            reality.lag_s,
            reality.range_std_m,
            1.0 + reality.odometer_std * float(rng.standard_normal()),
            reality.gust_std_mps2,
            float(np.exp(-step_s / reality.gust_time_s)),
            1.0 + reality.effort_error,
        ]
    )
    delays = np.array(
        [round(reality.dead_time_s / step_s), round(reality.radio_delay_s / step_s)], np.int64
    )
    real = _real_vehicle(trip.vehicle, reality)
    out = np.empty((count, 8))
    _loop(
        course_of(trip.route, trip.vehicle),
        course_of(trip.route, real),
        reference,
        sight_at,
        sight,
        times,
        noise,
        lost,
        is_mpc,
        gains,
        tables,
        settings,
        delays,
        out,
    )
    gap, ref, speed, force, estimate, seen, beyond, _ = out.T
    return Track(
        clock,
        times,
        gap,
        ref,
        speed,
        force,
        estimate,
        seen > 0.5,
        (-trip.vehicle.braking_mps2, trip.vehicle.traction_mps2),
        beyond > 0.5,
    )


def _real_vehicle(vehicle: PilotVehicle, reality: Reality) -> PilotVehicle:
    """The vehicle as it is, where the controller knows only ``vehicle``."""
    more, davis = 1.0 + reality.resistance_error, vehicle.davis
    return replace(vehicle, davis=Davis(more * davis.c0, more * davis.c1, more * davis.c2))


def _mother_times(course: Course, step_s: float) -> Array:
    """The mother train's position at every decision, from its first knot until it stands."""
    positions = _mother_run(course, step_s, int(_HORIZON_S / step_s))
    return np.asarray(positions)


@compiled
def _mother_run(course: Course, step_s: float, most: int) -> Array:
    """Position over time: exact for constant acceleration within a step."""
    out = np.empty(most)
    last = course.mother_at[course.mother_at.size - 1]
    position, count = course.mother_at[0], 0
    while count < most and position < last:
        out[count] = position
        count += 1
        speed, accel = mother_motion(position, course)
        middle = position + 0.5 * step_s * speed + 0.125 * step_s * step_s * accel
        half_speed, half_accel = mother_motion(middle, course)
        ahead = step_s * half_speed
        start = 0.5 * accel * step_s * step_s
        position += max(ahead, start)
        if max(ahead, start) < 1e-4 * step_s and position > 0.5 * last:
            break
        if half_accel < 0.0 and half_speed < 0.02:
            break
    return out[:count].copy()


@compiled
def _step(
    gap: float,
    speed: float,
    mother_m: float,
    next_m: float,
    force: float,
    gust: float,
    step_s: float,
    real: Course,
) -> tuple[float, float]:
    """Eq. 2 over one decision with constant force: Runge–Kutta in time."""
    middle_m = 0.5 * (mother_m + next_m)
    sum_x, sum_v, kx, kv = 0.0, 0.0, 0.0, 0.0
    for stage in range(4):
        part = 0.0 if stage == 0 else (step_s if stage == 3 else 0.5 * step_s)
        at = mother_m if stage == 0 else (next_m if stage == 3 else middle_m)
        v = max(speed + part * kv, 0.0)
        kx = v - mother_motion(at, real)[0]
        kv = pilot_acceleration(force, v, at + gap + part * kx, real) + gust
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        sum_x += weight * kx
        sum_v += weight * kv
    return gap + step_s / 6.0 * sum_x, max(speed + step_s / 6.0 * sum_v, 0.0)


@compiled
def _feed_forward(
    mother_m: float, reference: Reference, model: Course
) -> tuple[float, float, float]:
    """x_ref, v_ref and the force over mass that would follow the reference exactly."""
    speed, accel = mother_motion(mother_m, model)
    gap = line_resistance(mother_m, reference.position_m, reference.gap_m)
    slope = line_resistance(mother_m, reference.position_m, reference.slope)
    bend = line_resistance(mother_m, reference.position_m, reference.bend_per_m)
    own = speed * (1.0 + slope)
    needed = bend * speed * speed + (1.0 + slope) * accel
    drag = pilot_acceleration(0.0, own, mother_m + gap, model)
    return gap, own, (needed - drag) / model.epsilon


@compiled
def _mpc_force(
    mother_m: float,
    error: float,
    error_rate: float,
    push: float,
    reference: Reference,
    model: Course,
    tables: MpcTables,
    low: float,
    high: float,
    correction: Array,
) -> float:
    """One MPC decision: feed-forward less disturbance plus the first correction.

    ``error`` and ``error_rate`` are those of the gap, x − x_ref; ``push`` is the disturbance.
    """
    n = correction.size
    floor, ceiling = np.empty(n), np.empty(n)
    ahead, first = mother_m, 0.0
    for k in range(n):
        _, _, force = _feed_forward(ahead, reference, model)
        force -= push / model.epsilon
        first = force if k == 0 else first
        floor[k], ceiling[k] = low - force, high - force
        ahead += tables.step_s * mother_motion(ahead, model)[0]
    gradient = np.empty(n)
    for k in range(n):
        gradient[k] = tables.linear[k, 0] * error + tables.linear[k, 1] * error_rate
        correction[k] = min(max(correction[k], floor[k]), ceiling[k])
    box_qp(tables.hessian, gradient, floor, ceiling, correction, tables.sweeps)
    return first + float(correction[0]) / model.epsilon


@compiled
def _loop(
    model: Course,
    real: Course,
    reference: Reference,
    sight_at: Array,
    sight: Array,
    mother: Array,
    noise: Array,
    lost: npt.NDArray[np.bool_],
    is_mpc: bool,
    gains: Array,
    tables: MpcTables,
    settings: Array,
    delays: npt.NDArray[np.int64],
    out: Array,
) -> None:
    """The closed loop, one row of ``out`` per decision.

    Rows: gap, reference, speed, force, estimate, seen, beyond limits, disturbance estimate.
    """
    step, low, high, lag = settings[0], settings[1], settings[2], settings[3]
    range_std, odometer, gust_std, gust_keep = settings[4], settings[5], settings[6], settings[7]
    effort = settings[8]
    keep = np.exp(-step / lag) if lag > 0.0 else 0.0
    count = mother.size
    gap = line_resistance(mother[0], reference.position_m, reference.gap_m)
    speed, force, total, gust = mother_motion(mother[0], real)[0], 0.0, 0.0, 0.0
    estimate, scale, push = gap, 0.0, 0.0
    predicted_speed = speed
    commands = np.zeros(delays[0] + 1)
    heard = speed
    correction = np.zeros(tables.hessian.shape[0])
    for i in range(count):
        at = mother[i]
        gap_ref, own_ref, _ = _feed_forward(at, reference, model)
        mother_now = mother_motion(at, real)[0]

        # What is known: own odometer, the mother train's speed over the radio, the range if seen.
        if not lost[i]:
            heard = mother_motion(mother[max(0, i - delays[1])], real)[0]
        own = odometer * speed
        seen = line_resistance(at, sight_at, sight) > 0.99
        estimate += (own * (1.0 - scale) - heard) * step if i > 0 else 0.0
        if seen:
            innovation = gap + range_std * noise[i, 0] - estimate
            if range_std > 0.0:  # a slow filter that also learns the odometer's scale
                estimate += min(1.0, 0.6 * step) * innovation
                scale -= 0.004 * step * innovation / max(own, 5.0)
            else:
                estimate += innovation
        # Disturbance: what the own speed did beyond what the model expected of the last force.
        push += min(1.0, 0.5 * step) * ((own - predicted_speed) / step if i > 0 else 0.0)
        error, error_rate = gap_ref - estimate, own_ref - own * (1.0 - scale)
        if is_mpc:
            # The commands still on their way act before this one does: look past them.
            ahead_s = delays[0] * step + lag
            wanted = _mpc_force(
                at + mother_now * ahead_s,
                -error - error_rate * ahead_s,
                -error_rate,
                push,
                reference,
                model,
                tables,
                low,
                high,
                correction,
            )
        else:
            wanted, total = pid_force(error, error_rate, total, gains, low, high, step)
        beyond = wanted > high or wanted < low
        commands[i % commands.size] = min(max(wanted, low), high)
        acting = commands[(i + 1) % commands.size] if i + 1 >= commands.size else 0.0
        force = keep * force + (1.0 - keep) * acting

        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = gap, gap_ref, speed, force * effort
        out[i, 4], out[i, 5], out[i, 6], out[i, 7] = (
            estimate,
            1.0 if seen else 0.0,
            1.0 if beyond else 0.0,
            push,
        )
        accel = pilot_acceleration(force, own, at + estimate, model)
        predicted_speed = own + step * (accel + push)
        gust = gust_keep * gust + gust_std * np.sqrt(1.0 - gust_keep**2) * noise[i, 1]
        ahead = mother[i + 1] if i + 1 < count else at
        gap, speed = _step(gap, speed, at, ahead, force * effort, gust, step, real)
