"""Run a train: traction to a cut-off, then coasting, under a ceiling that it brakes for.

The equation of motion is that of :mod:`railops.traction`; free motion is integrated by the
classical Runge–Kutta method of order four, following the ceiling is solved in closed form. Steps
end exactly where something changes: at the cut-off of traction, where the ceiling is met, at the
knots of ceiling and profile, at the corner speed, where the ceiling can no longer be followed, and
at standstill. Between nodes the position is the cubic through both ends' positions and
speeds, so an event is located to far below a microsecond.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.headway.ceiling import Ceiling, square_at
from railops.headway.stock import Stock
from railops.traction import LineTable, acceleration, line_resistance, tractive_effort

Array = npt.NDArray[np.float64]

STEP_S = 0.1
STALL_MPS = 1.0  # a train coasting slower than this will not reach the station by itself
HORIZON_S = 1800.0  # nor is it worth following a run for longer than half an hour

ARRIVED, STALLED, FULL = 0, 1, 2


class Drive(NamedTuple):
    """Everything the inner function reads about a run; fields as in Stock, Line and Ceiling."""

    accel_mps2: float
    power_w_per_kg: float
    c0: float
    c1: float
    c2: float
    rotating: float
    line: LineTable
    ceiling: Ceiling


class Nodes(NamedTuple):
    """A run as arrays of equal length: time, front position, speed and traction work per mass."""

    time_s: Array
    position_m: Array
    speed_mps: Array
    work_jpkg: Array

    def first(self, count: int) -> Nodes:
        """A copy of the first nodes."""
        return Nodes(*(column[:count].copy() for column in self))


def drive_of(stock: Stock, line: LineTable, table: Ceiling) -> Drive:
    """The inner function's view of a train on a line under a ceiling."""
    effort, davis = stock.effort, stock.davis
    return Drive(
        effort.accel_mps2,
        effort.power_w_per_kg,
        davis.c0,
        davis.c1,
        davis.c2,
        stock.rotating,
        line,
        table,
    )


def empty_nodes(step_s: float) -> Nodes:
    """Room for the longest run at this step."""
    size = int(HORIZON_S / step_s) + 256
    return Nodes(np.empty(size), np.empty(size), np.empty(size), np.empty(size))


@compiled
def natural(pulling: bool, position_m: float, speed_mps: float, drive: Drive) -> float:
    """dv/dt with full traction or coasting, m/s²."""
    effort = 0.0
    if pulling:
        effort = tractive_effort(speed_mps, drive.accel_mps2, drive.power_w_per_kg)
    line = line_resistance(position_m, drive.line.position_m, drive.line.resistance_mps2)
    return acceleration(effort, speed_mps, line, drive.c0, drive.c1, drive.c2, drive.rotating)


@compiled
def free_step(
    pulling: bool, position_m: float, speed_mps: float, step_s: float, drive: Drive
) -> tuple[float, float]:
    """Position and speed after one Runge–Kutta step."""
    half = 0.5 * step_s
    a1 = natural(pulling, position_m, speed_mps, drive)
    v2 = speed_mps + half * a1
    a2 = natural(pulling, position_m + half * speed_mps, v2, drive)
    v3 = speed_mps + half * a2
    a3 = natural(pulling, position_m + half * v2, v3, drive)
    v4 = speed_mps + step_s * a3
    a4 = natural(pulling, position_m + step_s * v3, v4, drive)
    position = position_m + step_s / 6.0 * (speed_mps + 2.0 * (v2 + v3) + v4)
    return position, speed_mps + step_s / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@compiled
def between(
    part_s: float, step_s: float, s0: float, v0: float, s1: float, v1: float
) -> tuple[float, float]:
    """Position and speed ``part_s`` into a step, on the cubic through both ends."""
    u = part_s / step_s
    mean = (s1 - s0) / step_s
    b = 3.0 * mean - 2.0 * v0 - v1
    c = v0 + v1 - 2.0 * mean
    position = s0 + part_s * (v0 + u * (b + u * c))
    return position, v0 + u * (2.0 * b + 3.0 * u * c)


@compiled
def reach(target_m: float, step_s: float, s0: float, v0: float, s1: float, v1: float) -> float:
    """Time into a step at which the position on the cubic is ``target_m``, s."""
    low, high = 0.0, step_s
    part = step_s * (target_m - s0) / (s1 - s0) if s1 > s0 else step_s
    for _ in range(60):
        position, speed = between(part, step_s, s0, v0, s1, v1)
        if position < target_m:
            low = part
        else:
            high = part
        off = position - target_m
        if abs(off) < 1e-11 * (1.0 + abs(target_m)) or high - low < 1e-13:
            break
        part = part - off / speed if speed > 0.0 else low
        if not low < part < high:
            part = 0.5 * (low + high)
    return part


@compiled
def meet(
    step_s: float, s0: float, v0: float, s1: float, v1: float, piece: int, table: Ceiling
) -> float:
    """Time into a step at which the cubic meets the ceiling's piece from below, s."""
    low, high = 0.0, step_s
    while high - low > 1e-13 * step_s + 1e-14:
        part = 0.5 * (low + high)
        position, speed = between(part, step_s, s0, v0, s1, v1)
        if speed * speed > square_at(position, piece, table):
            high = part
        else:
            low = part
        if part in (low, high) and high - low < 1e-12:
            break
    return low


@compiled
def speed_reached(
    limit_mps: float, step: float, s0: float, v0: float, s1: float, v1: float
) -> float:
    """Time into a step at which the speed rises through a limit, s."""
    low, high = 0.0, step
    for _ in range(50):
        part = 0.5 * (low + high)
        if between(part, step, s0, v0, s1, v1)[1] > limit_mps:
            high = part
        else:
            low = part
    return high


@compiled
def leave(pulling: bool, s: float, v: float, slope_mps2: float, step: float, drive: Drive) -> float:
    """Time into a step along the ceiling at which the train can no longer follow it, s."""
    low, high = 0.0, step
    for _ in range(40):
        part = 0.5 * (low + high)
        place, speed = s + part * (v + 0.5 * slope_mps2 * part), v + slope_mps2 * part
        if natural(pulling, place, speed, drive) < slope_mps2:
            high = part
        else:
            low = part
    return high


@compiled
def run(
    count: int, cut_m: float, end_m: float, step_s: float, drive: Drive, nodes: Nodes
) -> tuple[int, int]:
    """Continue a run from its last node until it stops, stalls, or its front passes ``end_m``.

    Args:
        count: Nodes already there, >= 1; the last is the state to continue from.
        cut_m: Where traction is cut off, m; ``inf`` to keep pulling.
        end_m: Where to end, m: the ceiling's stop, or any place for a run without one.
        step_s: Longest step, s.
        drive: Train, line and ceiling.
        nodes: Filled from ``count`` on.

    Returns:
        (number of nodes, ARRIVED or STALLED or FULL).
    """
    table = drive.ceiling
    t, s, v = nodes.time_s[count - 1], nodes.position_m[count - 1], nodes.speed_mps[count - 1]
    work, size, pieces, piece = nodes.work_jpkg[count - 1], nodes.time_s.size, table.start_m.size, 0
    corner = drive.power_w_per_kg / drive.accel_mps2
    knots, knot = drive.line.position_m, 0
    while s < end_m - 1e-9:
        if count == size:
            return count, FULL
        while knot < knots.size and knots[knot] <= s + 1e-9:
            knot += 1
        while piece + 1 < pieces and table.start_m[piece + 1] <= s + 1e-9:
            piece += 1
        pulling = s < cut_m - 1e-9
        square = square_at(s, piece, table)
        slope = 0.5 * table.slope_mps2[piece]
        own = natural(pulling, s, v, drive)
        goal = end_m  # the next place where something changes
        if piece + 1 < pieces:
            goal = min(goal, table.start_m[piece + 1])
        if knot < knots.size:
            goal = min(goal, knots[knot])
        if pulling:
            goal = min(goal, cut_m)
        step, new_s, new_v, force = step_s, s, v, 0.0
        if v * v >= square - 1e-9 * (1.0 + square) and own >= slope:
            # Follow the ceiling: constant acceleration, closed form.
            end_square = square + 2.0 * slope * (goal - s)
            if end_square < 1e-9:  # the stop: what is left is rounding, and its root is not small
                end_square = 0.0
            left = 2.0 * (goal - s) / (v + np.sqrt(end_square))
            if left <= 1.01 * step:  # rather a longer step than a sliver before the goal
                step, new_s, new_v = left, goal, np.sqrt(end_square)
            else:
                new_s, new_v = s + step * (v + 0.5 * slope * step), v + slope * step
            if new_v > 0.0 and natural(pulling, new_s, new_v, drive) < slope:
                step = leave(pulling, s, v, slope, step, drive)
                new_s, new_v = s + step * (v + 0.5 * slope * step), v + slope * step
            if pulling:
                pull = tractive_effort(v, drive.accel_mps2, drive.power_w_per_kg)
                force = max(pull - (own - slope), 0.0)
            work += force * (1.0 + drive.rotating) * (new_s - s)
        else:
            new_s, new_v = free_step(pulling, s, v, step, drive)
            if new_s > goal:
                step = reach(goal, step, s, v, new_s, new_v)
                new_s, new_v = free_step(pulling, s, v, step, drive)
                new_s = goal
            if pulling and v < corner < new_v:
                step = speed_reached(corner, step, s, v, new_s, new_v)
                new_s, new_v = free_step(pulling, s, v, step, drive)
            if new_v * new_v > square_at(new_s, piece, table):
                part = meet(step, s, v, new_s, new_v, piece, table)
                new_s, new_v = free_step(pulling, s, v, part, drive)
                step, new_v = part, np.sqrt(max(square_at(new_s, piece, table), 0.0))
            if pulling:
                first = tractive_effort(v, drive.accel_mps2, drive.power_w_per_kg)
                last = tractive_effort(new_v, drive.accel_mps2, drive.power_w_per_kg)
                work += 0.5 * (first * v + last * new_v) * (1.0 + drive.rotating) * step
            if new_v < STALL_MPS and new_v <= v:
                return count, STALLED
        t, s, v = t + step, new_s, new_v
        nodes.time_s[count], nodes.position_m[count] = t, s
        nodes.speed_mps[count], nodes.work_jpkg[count] = v, work
        count += 1
    return count, ARRIVED


@compiled
def passages(count: int, nodes: Nodes, target_m: Array, times_s: Array) -> None:
    """Times at which the front passes increasing positions, s; inf where it never does."""
    node = 1
    for index in range(target_m.size):
        target = target_m[index]
        while node < count and nodes.position_m[node] < target:
            node += 1
        if node == count:
            times_s[index] = np.inf
            continue
        s0, s1 = nodes.position_m[node - 1], nodes.position_m[node]
        if target <= s0:
            times_s[index] = nodes.time_s[node - 1]
            continue
        step = nodes.time_s[node] - nodes.time_s[node - 1]
        v0, v1 = nodes.speed_mps[node - 1], nodes.speed_mps[node]
        times_s[index] = nodes.time_s[node - 1] + reach(target, step, s0, v0, s1, v1)
