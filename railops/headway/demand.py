"""When the second train first needs each level of the first one's tail.

The second train, running its undisturbed curve, needs at every moment some level of the train in
front (see :mod:`railops.headway.protection`): the lowest at which it is allowed the speed it has
where it is. The first moment at which level k or more is needed is its demand time d_k.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.headway.motion import Nodes, between, reach, speed_reached
from railops.headway.protection import SPEED_TOLERANCE_MPS, Plan

Array = npt.NDArray[np.float64]


@compiled
def permitted(position_m: float, level: int, circuit: int, plan: Plan) -> float:
    """Speed the protection allows at a place, given the level of the tail, m/s.

    Args:
        position_m: Front of the second train, m.
        level: Boundaries that the tail has passed, −1 for none.
        circuit: The circuit under the front; not read by block systems.
        plan: The protection system.
    """
    if plan.code_mps.size > 0:
        return float(plan.code_mps[circuit, level]) if level >= 0 else 0.0
    end = plan.boundary_m[level] if level >= 0 else -np.inf
    if end >= plan.stop_m:
        return np.inf
    room = end - position_m
    if room <= 0.0:
        return 0.0
    # v·τ + v²/(2b) = room
    brake = plan.decel_mps2
    delay = brake * plan.reaction_s
    return float(np.sqrt(delay * delay + 2.0 * brake * room) - delay)


@compiled
def authority(position_m: float, speed_mps: float, plan: Plan) -> float:
    """How far ahead the line must be free for a block system, m; never beyond the stop."""
    braking = speed_mps * (plan.reaction_s + 0.5 * speed_mps / plan.decel_mps2)
    return min(position_m + braking, plan.stop_m)


@compiled
def level_for(circuit: int, speed_mps: float, plan: Plan) -> int:
    """The lowest level at which a circuit's code allows a speed; past the last if none does."""
    levels = plan.code_mps.shape[1]
    level = circuit + 1
    while level < levels and plan.code_mps[circuit, level] + SPEED_TOLERANCE_MPS < speed_mps:
        level += 1
    return level


@compiled
def code_demands(nodes: Nodes, plan: Plan, demand_s: Array) -> None:
    """Demand times under speed codes: events are circuit entries and code speeds reached.

    ``demand_s`` has one entry more than there are boundaries: in the last, when the train is faster
    than the best code of its circuit, which a run under its ceiling never is.
    """
    demand_s[:] = np.inf
    edges, count = plan.boundary_m, nodes.time_s.size
    levels = edges.size
    circuit = 0
    while circuit + 1 < levels - 1 and edges[circuit + 1] <= nodes.position_m[0]:
        circuit += 1
    need = level_for(circuit, 2.0 * SPEED_TOLERANCE_MPS, plan)
    demand_s[: need + 1] = nodes.time_s[0]
    for node in range(1, count):
        s0, s1 = nodes.position_m[node - 1], nodes.position_m[node]
        v0, v1 = nodes.speed_mps[node - 1], nodes.speed_mps[node]
        start, step = nodes.time_s[node - 1], nodes.time_s[node] - nodes.time_s[node - 1]
        while True:
            last = not (circuit + 1 < levels - 1 and edges[circuit + 1] <= s1)
            end_part = step if last else reach(edges[circuit + 1], step, s0, v0, s1, v1)
            end_speed = v1 if last else between(end_part, step, s0, v0, s1, v1)[1]
            # Code speeds reached inside this circuit, one after the other.
            while need < levels and (
                plan.code_mps[circuit, need] + SPEED_TOLERANCE_MPS < end_speed
            ):
                limit = plan.code_mps[circuit, need] + SPEED_TOLERANCE_MPS
                part = speed_reached(limit, step, s0, v0, s1, v1) if v0 < limit else 0.0
                now = level_for(circuit, limit + SPEED_TOLERANCE_MPS, plan)
                demand_s[need + 1 : now + 1] = start + min(part, end_part)
                need = now
            if last:
                break
            circuit += 1
            now = level_for(circuit, max(end_speed, 2.0 * SPEED_TOLERANCE_MPS), plan)
            if s1 >= nodes.position_m[count - 1] and edges[circuit] >= nodes.position_m[count - 1]:
                break  # it stops at the boundary and never enters
            if now > need:
                demand_s[need + 1 : now + 1] = start + end_part
                need = now


@compiled
def block_demands(nodes: Nodes, plan: Plan, demand_s: Array) -> None:
    """Demand times under block systems: when the authority needed reaches beyond a boundary."""
    demand_s[:] = np.inf
    edges, count = plan.boundary_m, nodes.time_s.size
    need = 0
    while need < edges.size - 1 and edges[need] < nodes.position_m[0] + 1e-9:
        need += 1
    demand_s[: need + 1] = nodes.time_s[0]
    for node in range(1, count):
        s0, s1 = nodes.position_m[node - 1], nodes.position_m[node]
        v0, v1 = nodes.speed_mps[node - 1], nodes.speed_mps[node]
        ahead = authority(s1, v1, plan)
        while need < edges.size - 1 and edges[need] < ahead:
            step = nodes.time_s[node] - nodes.time_s[node - 1]
            low, high = 0.0, step
            for _ in range(50):
                part = 0.5 * (low + high)
                position, speed = between(part, step, s0, v0, s1, v1)
                if authority(position, speed, plan) > edges[need]:
                    high = part
                else:
                    low = part
            need += 1
            demand_s[need] = nodes.time_s[node - 1] + high


def demand_times(nodes: Nodes, plan: Plan) -> Array:
    """Demand time of each level, s from the second train's departure; inf if never needed."""
    times = np.empty(plan.boundary_m.size + 1)
    (code_demands if plan.code_mps.size else block_demands)(nodes, plan, times)
    return times
