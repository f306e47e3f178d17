"""Many stops at once: the integrator of :mod:`railops.braking.stopping`, sixteen lanes abreast.

One stop is a chain of dependent operations, so a core waits more than it works. Here sixteen
stops advance together through the same three phases (dead time, build-up, full effort), each with
its own step length, and the arithmetic of a Runge–Kutta step is one loop over the lanes that the
compiler turns into vector instructions. What would break that loop is taken out of it: table
look-ups happen once per step, as the chord of the table between the step's two (predicted) ends,
and lanes that stand continue with a step of zero.

A test holds the lanes against the scalar integrator and against an independent one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.braking.stopping import INSTANT_S
from railops.traction import adhesion_limit, running_resistance

Array = npt.NDArray[np.float64]

LANES = 16
LANE_STEP_S = 1.0
RAMP_STEP_S = 0.5
_PACED_STEP = 0.2  # a step may be at most this share of the running resistance's time constant
_HORIZON_S = 1800.0
# Rows of the workspace. One flat array with constant offsets: the compiler can then prove that
# rows do not overlap, which it must before it vectorises.
_V, _S, _H, _SHARE, _GROWTH = 0, 16, 32, 48, 64
_B0, _DB, _W0, _DW, _ADHESION = 80, 96, 112, 128, 144
_DAVIS, _NEW_V, _NEW_S, _BRAKE, _EXTRA = 160, 176, 192, 208, 224
WORKSPACE = 240


class Table(NamedTuple):
    """A piecewise linear function: knots with one far beyond either end, and the slopes between."""

    knot: Array
    value: Array
    slope: Array
    integral: Array


def table_of(knots: Array, values: Array) -> Table:
    """Extend a table by constants to both sides; precompute slopes and the running integral."""
    # Far enough for any run, near enough for the integral to keep a millimetre's worth of digits.
    knot = np.concatenate([[knots[0] - 1e6], knots, [knots[-1] + 1e6]])
    value = np.concatenate([values[:1], values, values[-1:]])
    pieces = np.diff(knot) * (value[:-1] + value[1:]) / 2.0
    integral = np.concatenate([[0.0], np.cumsum(pieces)])
    return Table(knot, value, np.append(np.diff(value) / np.diff(knot), 0.0), integral)


class Course(NamedTuple):
    """What all lanes share: running resistance, rotating mass, brake and line tables."""

    position_m: float
    c0: float
    c1: float
    c2: float
    rotating: float
    brake: Table
    line: Table


@compiled
def _look_up(table: Table, x: float, near: int) -> tuple[float, float, int]:
    """The table's value and integral at x, searching from piece ``near``; and the piece found."""
    last = table.knot.size - 2
    while near > 0 and table.knot[near] > x:
        near -= 1
    while near < last and table.knot[near + 1] <= x:
        near += 1
    past = x - table.knot[near]
    rise = table.slope[near] * past
    return (
        table.value[near] + rise,
        table.integral[near] + (table.value[near] + 0.5 * rise) * past,
        near,
    )


@compiled
def _slope(
    share: float,
    speed: float,
    brake: float,
    line: float,
    adhesion: float,
    davis: float,
    course: Course,
) -> float:
    """dv/dt with the step's brake and line values at hand, m/s²."""
    effort = min(share * brake, adhesion_limit(speed, adhesion))
    running = davis * running_resistance(speed, course.c0, course.c1, course.c2)
    return -effort - (running + line) / (1.0 + course.rotating)


@compiled
def _advance(w: Array, course: Course) -> None:
    """One Runge–Kutta step of every lane, into the rows _NEW_V and _NEW_S."""
    for i in range(LANES):
        v, h, share, growth = w[_V + i], w[_H + i], w[_SHARE + i], w[_GROWTH + i]
        b0, db, w0, dw = w[_B0 + i], w[_DB + i], w[_W0 + i], w[_DW + i]
        mu, davis = w[_ADHESION + i], w[_DAVIS + i]
        half = 0.5 * h
        middle, end = share + half * growth, share + h * growth
        a1 = _slope(share, v, b0, w0, mu, davis, course)
        v2 = v + half * a1
        a2 = _slope(middle, v2, b0 + db * (v2 - v), w0 + dw * half * v, mu, davis, course)
        v3 = v + half * a2
        a3 = _slope(middle, v3, b0 + db * (v3 - v), w0 + dw * half * v2, mu, davis, course)
        v4 = v + h * a3
        a4 = _slope(end, v4, b0 + db * (v4 - v), w0 + dw * h * v3, mu, davis, course)
        w[_NEW_V + i] = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        w[_NEW_S + i] = w[_S + i] + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)


@compiled
def _chords(w: Array, near: npt.NDArray[np.int64], course: Course) -> None:
    """Set every lane's brake and line chord for its next step."""
    varies = course.line.knot.size > 3
    brake_varies = course.brake.knot.size > 3
    for i in range(LANES):
        v, h = w[_V + i], w[_H + i]
        lost = h * w[_SHARE + i] * w[_B0 + i] + 1e-3  # speed, as far as it can be foreseen
        if varies:
            # The chord's slope with the exact mean over the step, so that a kink inside it counts.
            ahead = max(h * (v - 0.5 * lost), 1e-3)
            s = course.position_m + w[_S + i]
            w0, i0, near[i] = _look_up(course.line, s, near[i])
            w1, i1, _ = _look_up(course.line, s + ahead, near[i])
            w[_W0 + i] = (i1 - i0) / ahead - 0.5 * (w1 - w0) + w[_EXTRA + i]
            w[_DW + i] = (w1 - w0) / ahead
        if brake_varies:
            b0, i0, near[LANES + i] = _look_up(course.brake, v, near[LANES + i])
            b1, i1, _ = _look_up(course.brake, v - lost, near[LANES + i])
            w[_B0 + i] = w[_BRAKE + i] * ((i0 - i1) / lost + 0.5 * (b0 - b1))
            w[_DB + i] = w[_BRAKE + i] * (b0 - b1) / lost


@compiled
def _finish(w: Array, i: int, course: Course) -> float:
    """Distance to standstill of a lane whose step ended below zero speed."""
    v, share = w[_V + i], w[_SHARE + i]
    decel = (v - w[_NEW_V + i]) / w[_H + i]
    rest = v / decel
    brake = w[_B0 + i] - 0.5 * v * w[_DB + i]
    line = w[_W0 + i] + w[_DW + i] * 0.375 * v * rest
    middle = -_slope(
        share + 0.5 * rest * w[_GROWTH + i],
        0.5 * v,
        brake,
        line,
        w[_ADHESION + i],
        w[_DAVIS + i],
        course,
    )
    decel = middle if middle > 0.5 * decel else decel
    distance: float = w[_S + i] + 0.5 * v * v / decel
    return distance


@compiled
def set_lane(
    w: Array,
    lane: int,
    speed_mps: float,
    brake_share: float,
    adhesion: float,
    davis_share: float,
    line_extra_mps2: float,
) -> None:
    """Fill in what makes this lane's stop its own; fields as in ``stopping.Motion``."""
    w[_V + lane] = speed_mps
    w[_BRAKE + lane] = brake_share
    w[_ADHESION + lane] = adhesion
    w[_DAVIS + lane] = davis_share
    w[_EXTRA + lane] = line_extra_mps2


@compiled
def run_lanes(
    w: Array,
    near: npt.NDArray[np.int64],
    delay_s: Array,
    build_up_s: Array,
    course: Course,
    out: Array,
) -> None:
    """Stop the sixteen lanes set up in the workspace.

    Args:
        w: Workspace in which every lane was set; the rest is scratch. Shape (WORKSPACE,).
        near: Scratch for table positions, shape (2·LANES,), zeros.
        delay_s: Dead times, s, shape (LANES,).
        build_up_s: Build-up times, s, shape (LANES,).
        course: What the lanes share.
        out: Stopping distances, metres, inf where a lane never stands. Shape (LANES,).
    """
    moving, pace = 0, 0.0
    length = np.empty(LANES)
    for i in range(LANES):
        w[_S + i] = 0.0
        w[_DB + i], w[_DW + i] = 0.0, 0.0
        w[_B0 + i] = w[_BRAKE + i] * course.brake.value[1]
        w[_W0 + i] = course.line.value[1] + w[_EXTRA + i]
        out[i] = np.inf if w[_V + i] > 0.0 else 0.0
        moving += w[_V + i] > 0.0
        # d(c1·v + c2·v²)/dv, 1/s: steps of a second are fine for any real train's resistance.
        pace = max(pace, w[_DAVIS + i] * (course.c1 + 2.0 * course.c2 * w[_V + i]))
    longest_step = min(LANE_STEP_S, _PACED_STEP / pace) if pace > 0.0 else LANE_STEP_S
    for phase in range(3):
        longest = 0.0
        for i in range(LANES):
            if phase == 0:
                length[i] = delay_s[i]
            elif phase == 1:
                # The rise ends where adhesion takes over: no step straddles that kink either.
                full, _, _ = _look_up(course.brake, w[_V + i], 0)
                cap = adhesion_limit(w[_V + i], w[_ADHESION + i])
                short = cap < w[_BRAKE + i] * full
                length[i] = build_up_s[i] * (cap / (w[_BRAKE + i] * full) if short else 1.0)
            longest = max(longest, length[i])
        if phase == 2:
            longest = _HORIZON_S
        step = min(RAMP_STEP_S, longest_step) if phase == 1 else longest_step
        steps = int(np.ceil(longest / step))
        for i in range(LANES):
            stands = w[_V + i] <= 0.0
            # A rise too short to matter is none: the rate of a denormal one is infinite.
            rises = phase == 1 and build_up_s[i] > INSTANT_S
            w[_H + i] = 0.0 if stands else (length[i] / steps if phase < 2 else step)
            w[_SHARE + i] = 1.0 if phase == 2 else 0.0
            w[_GROWTH + i] = 1.0 / build_up_s[i] if rises else 0.0
        for _ in range(steps):
            if moving == 0:
                return
            _chords(w, near, course)
            _advance(w, course)
            for i in range(LANES):
                if w[_NEW_V + i] <= 0.0 and w[_V + i] > 0.0:
                    out[i] = _finish(w, i, course)
                    w[_NEW_V + i], w[_NEW_S + i], w[_H + i] = 0.0, 0.0, 0.0
                    moving -= 1
                w[_V + i] = w[_NEW_V + i]
                w[_S + i] = w[_NEW_S + i]
                w[_SHARE + i] += w[_H + i] * w[_GROWTH + i]
