"""Blocking times: from when the second train needs a piece of line free until the first frees it.

Drawn over time and place, the blocks of one train form a stairway. The interval is the least shift
at which the stairways of two trains do not overlap; the block at which they touch is critical.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from railops.headway.interval import Succession, level_name


@dataclass(frozen=True)
class Blocking:
    """One step of the stairway of a train.

    Attributes:
        name: The circuit or block.
        start_m: Where it begins, m.
        end_m: Where it ends, m.
        needed_s: When the train first needs it free, s from its departure; inf if never.
        freed_s: When it is free for the next train, s from its departure.
        slack_s: By how much it stays clear of the train in front at the shortest interval, s; 0 at
            the critical one.
    """

    name: str
    start_m: float
    end_m: float
    needed_s: float
    freed_s: float
    slack_s: float


def stairway(
    pair: Succession, second_s: float, first_s: float, dwell_s: float
) -> tuple[list[Blocking], Blocking]:
    """Blocking times of the second train, and the critical one.

    Args:
        pair: The section.
        second_s: Run time of the second train, s.
        first_s: Run time of the train in front, s.
        dwell_s: Dwell of both at the next station, s.

    Returns:
        (every block the second train needs, in order; the critical one).

    Example:
        >>> from railops.headway.section import Section
        >>> steps, critical = stairway(Succession(Section(1500.0)), 110.0, 115.0, 20.0)
        >>> critical.slack_s
        0.0
    """
    demand = pair.demand_s(second_s)
    front = pair.given_all_s(first_s, dwell_s)
    own = pair.given_all_s(second_s, dwell_s)
    interval = pair.interval(second_s, first_s).at(dwell_s)
    edges = pair.plan.boundary_m
    blocks = [
        Blocking(
            level_name(pair.section, level),
            float(edges[level - 1]),
            float(edges[level]),
            float(demand[level]),
            float(own[level]),
            float(round(interval + demand[level] - front[level], 9)) + 0.0,  # no −0.0
        )
        for level in range(1, edges.size)
        if np.isfinite(demand[level])
    ]
    return blocks, min(blocks, key=lambda block: block.slack_s)
