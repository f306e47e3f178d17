"""Two trains in succession, simulated forward: what the second one is shown and whether it fits.

The train in front follows its run, dwells and draws away; the second leaves an interval later and
runs its own undisturbed curve. Time goes from event to event: the second train's nodes (at most
0.1 s apart), its circuit entries, and the moments a better level is shown. Between two events the
code is constant and the speed monotone, so looking at both ends misses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.headway.demand import permitted
from railops.headway.interval import Succession
from railops.headway.motion import Nodes, between, reach
from railops.headway.protection import SPEED_TOLERANCE_MPS, Plan

Array = npt.NDArray[np.float64]

TIE_S = 1e-7  # a better level that comes this soon after an event comes with it


@compiled
def follow(
    nodes: Nodes, shown_s: Array, interval_s: float, plan: Plan, log: Array
) -> tuple[int, float, float, float]:
    """Run the second train and compare its speed with what it is shown.

    Args:
        nodes: The second train's run, from its own departure.
        shown_s: When each level is shown, s from the first train's departure, rising.
        interval_s: Departure of the second train after the first, s.
        plan: The protection system.
        log: Filled with (time, position, circuit, level, permitted, speed) at every event, times
            from the second train's departure, shape (N, 6).

    Returns:
        (rows of the log, smallest permitted − actual speed, the place and time of the first
        violation; both inf without one).
    """
    edges, levels, count = plan.boundary_m, shown_s.size, nodes.time_s.size
    level = -1
    while level + 1 < levels and shown_s[level + 1] <= interval_s + nodes.time_s[0] + TIE_S:
        level += 1
    circuit = 0
    while circuit + 2 < edges.size and edges[circuit + 1] <= nodes.position_m[0]:
        circuit += 1
    rows, margin, bad_m, bad_s = 0, np.inf, np.inf, np.inf
    for node in range(1, count):
        t0, s0, v0 = nodes.time_s[node - 1], nodes.position_m[node - 1], nodes.speed_mps[node - 1]
        t1, s1, v1 = nodes.time_s[node], nodes.position_m[node], nodes.speed_mps[node]
        step, at = t1 - t0, 0.0
        while True:
            # The next event within this step: the better level, the next circuit, or its end.
            entry = better = np.inf
            if circuit + 2 < edges.size and edges[circuit + 1] <= s1:
                entry = reach(edges[circuit + 1], step, s0, v0, s1, v1)
            if level + 1 < levels:
                better = max(shown_s[level + 1] - interval_s - t0 - TIE_S, at)
            until = min(step, entry, better)
            for end in range(2):
                part = until if end else at
                position, speed = between(part, step, s0, v0, s1, v1)
                if node == 1 and part == 0.0:
                    speed = 2.0 * SPEED_TOLERANCE_MPS  # it is about to move
                allowed = permitted(position, level, circuit, plan)
                slack = allowed - speed
                standing = node == count - 1 and part == step
                if not standing:
                    margin = min(margin, slack)
                    if slack < -SPEED_TOLERANCE_MPS and bad_s == np.inf:
                        bad_m, bad_s = position, t0 + part
                if rows < log.shape[0] and (end == 0 or until == step):
                    log[rows, 0], log[rows, 1], log[rows, 2] = t0 + part, position, circuit
                    log[rows, 3], log[rows, 4], log[rows, 5] = level, allowed, speed
                    rows += 1
            if until >= step:
                break
            at = until
            if better <= entry:
                level += 1
            else:
                circuit += 1
                if (
                    circuit + 2 < edges.size
                    and s1 >= nodes.position_m[count - 1]
                    and (edges[circuit] >= nodes.position_m[count - 1])
                ):
                    break
    return rows, margin, bad_m, bad_s


@dataclass(frozen=True)
class Simulation:
    """What the second train met.

    Attributes:
        interval_s: Its departure after the train in front, s.
        margin_mps: Smallest difference of permitted and actual speed, m/s; negative: a violation.
        violation_m: Where it first met a code below its speed, m; inf if never.
        violation_s: When, s from its departure; inf if never.
        log: (time_s, position_m, circuit, level, permitted_mps, speed_mps), shape (N, 6).
    """

    interval_s: float
    margin_mps: float
    violation_m: float
    violation_s: float
    log: Array

    @property
    def restricted(self) -> bool:
        """Whether the second train met a code below its curve."""
        return bool(np.isfinite(self.violation_s))

    def code_changes(self) -> Array:
        """The rows of the log at which circuit or level changed, shape (M, 6)."""
        changed = np.any(np.diff(self.log[:, 2:4], axis=0) != 0, axis=1)
        rows: Array = self.log[np.concatenate([[True], changed])]
        return rows


def simulate(
    pair: Succession, second_s: float, first_s: float, interval_s: float, dwell_s: float
) -> Simulation:
    """Simulate two trains of given run times, interval and dwell.

    Example:
        >>> from railops.headway.section import Section
        >>> pair = Succession(Section(1500.0))
        >>> shortest = pair.interval(105.0, 110.0).at(20.0)
        >>> simulate(pair, 105.0, 110.0, shortest, 20.0).restricted
        False
        >>> simulate(pair, 105.0, 110.0, shortest - 1.0, 20.0).restricted
        True
    """
    nodes = pair.run(second_s).nodes
    shown = pair.given_all_s(first_s, dwell_s)
    log = np.empty((2 * nodes.time_s.size + 4 * shown.size + 16, 6))
    rows, margin, bad_m, bad_s = follow(nodes, shown, float(interval_s), pair.plan, log)
    return Simulation(interval_s, margin, bad_m, bad_s, log[:rows])
