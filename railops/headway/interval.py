"""The shortest departure interval at which the second train never meets a code below its curve.

Let d_k be the moment the second train first needs level k (:mod:`railops.headway.demand`), counted
from its departure, and r_k the moment the tail of the train in front gives it, counted from the
departure of that train. With δ the delay until the better code is shown, the condition for every
level is  I + d_k >= r_k + δ, so the interval is  I = max_k (r_k + δ − d_k)   [the paper's eq. 1].

Levels that the tail gives while the train in front still runs to the next station do not know its
dwell; those it gives drawing away come later by exactly the dwell D. Hence, with A and B the
maxima over the two kinds,

    I(D) = max(A, B + D),

which is the paper's eq. 2 wherever D >= A − B. And since drawing away is the same movement every
time, B = T(n−1) + f(T(n)): the run time of the train in front, plus a function of that of the
second train alone. Both published tables show this to within their rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from railops.errors import RailOpsError
from railops.headway.demand import demand_times
from railops.headway.motion import STEP_S
from railops.headway.regulator import Regulator, Run, departure
from railops.headway.section import Section

Array = npt.NDArray[np.float64]

_STANDING_M = 1e-6  # a tail that stands this close behind a boundary has not passed it


@dataclass(frozen=True)
class Interval:
    """The shortest interval of one pair of run times, as a function of the dwell.

    Attributes:
        before_s: A: what the train in front requires while it runs to the next station, s.
        after_s: B: what it requires drawing away, for a dwell of zero, s.
        before_level: The level that decides A, −1 where there is none.
        after_level: The level that decides B, −1 where there is none.
    """

    before_s: float
    after_s: float
    before_level: int
    after_level: int

    def at(self, dwell_s: float) -> float:
        """The interval for a dwell of the train in front, s."""
        return max(self.before_s, self.after_s + dwell_s)

    @property
    def linear_from_s(self) -> float:
        """The dwell from which on the interval grows second for second, s."""
        return max(0.0, self.before_s - self.after_s)

    def critical_level(self, dwell_s: float) -> int:
        """The level that decides the interval for this dwell."""
        after = self.after_s + dwell_s >= self.before_s
        return self.after_level if after else self.before_level


class Succession:
    """Two trains in succession over one section, with everything that pairs share."""

    def __init__(self, section: Section, step_s: float = STEP_S) -> None:
        self.section = section
        self.regulator = Regulator(section, step_s)
        self.plan, self.delay_s = section.plan, section.protection.delay_s
        # Where the front of the train in front is when its tail gives each level.
        self.front_m = self.plan.release_m + section.stock.length_m
        self.before = self.front_m < section.length_m - _STANDING_M
        self._runs: dict[float, tuple[Run, Array, Array]] = {}

    @cached_property
    def away(self) -> Run:
        """The train in front drawing away from the next station at 0 s."""
        reach_m = max(float(self.front_m[-1]), self.section.length_m) + 1.0
        return departure(self.section, reach_m, self.regulator.step_s)

    @cached_property
    def away_s(self) -> Array:
        """Times from that departure at which the levels given afterwards come, s; −inf before."""
        times = np.full(self.front_m.size, -np.inf)
        times[~self.before] = self.away.passage_s(
            np.maximum(self.front_m[~self.before], self.section.length_m)
        )
        return times

    def run(self, run_time_s: float) -> Run:
        """The run of either train in a given time."""
        return self._of(run_time_s)[0]

    def demand_s(self, run_time_s: float) -> Array:
        """When a second train of this run time first needs each level, s; inf if never."""
        return self._of(run_time_s)[1]

    def given_s(self, run_time_s: float) -> Array:
        """When a first train of this run time gives each level before its stop, s; −inf after."""
        return self._of(run_time_s)[2]

    def _of(self, run_time_s: float) -> tuple[Run, Array, Array]:
        key = float(run_time_s)
        if key not in self._runs:
            run = self.regulator.run(key)
            demand = demand_times(run.nodes, self.plan)
            if np.isfinite(demand[-1]):
                raise RailOpsError(
                    "internal: the run exceeds the best code of a circuit, its ceiling"
                )
            given = np.full(self.front_m.size, -np.inf)
            given[self.before] = run.passage_s(self.front_m[self.before])
            self._runs[key] = (run, demand[:-1], given)
        return self._runs[key]

    def interval(self, second_s: float, first_s: float) -> Interval:
        """The shortest interval of a pair.

        Args:
            second_s: Run time of the second train, T(n), s.
            first_s: Run time of the train in front, T(n−1), s.

        Raises:
            RunTimeError: if the section cannot be run in one of the times.
        """
        demand = self.demand_s(second_s)
        before = self.given_s(first_s) - demand
        after = self.away_s - demand
        early, late = int(np.argmax(before)), int(np.argmax(after))
        return Interval(
            float(before[early]) + self.delay_s,
            float(after[late]) + self.delay_s + first_s,
            early if np.isfinite(before[early]) else -1,
            late if np.isfinite(after[late]) else -1,
        )

    def given_all_s(self, first_s: float, dwell_s: float) -> Array:
        """When each level is shown to the second train, s from the first one's departure."""
        after = self.away_s + first_s + dwell_s
        shown: Array = np.where(self.before, self.given_s(first_s), after) + self.delay_s
        return shown


def level_name(section: Section, level: int) -> str:
    """The piece of line that the tail has to leave to give a level, in words."""
    edges, release = section.plan.boundary_m, section.plan.release_m
    if level <= 0:
        return "none"
    if section.plan.code_mps.size:
        return f"circuit {level - 1} ({edges[level - 1]:.0f}–{edges[level]:.0f} m)"
    return (
        f"block {level - 1} ({edges[level - 1]:.0f}–{edges[level]:.0f} m), tail at "
        f"{release[level]:.0f} m"
    )


def minimum_interval(
    section: Section, second_s: float, first_s: float, dwell_s: float | None = None
) -> float:
    """Shortest departure interval of two trains over a section, s.

    Args:
        section: The section with its trains and protection.
        second_s: Run time of the second train, s.
        first_s: Run time of the train in front, s.
        dwell_s: Dwell of the train in front at the next station, s; default: the section's mean.

    Raises:
        RunTimeError: if the section cannot be run in one of the times.

    Example:
        >>> section = Section(1500.0)
        >>> round(minimum_interval(section, 105.0, 110.0, 30.0)
        ...       - minimum_interval(section, 105.0, 110.0, 20.0), 9)
        10.0
    """
    dwell = section.dwell.mean_s if dwell_s is None else dwell_s
    return Succession(section).interval(second_s, first_s).at(dwell)


def bracketed_interval(
    meets: Callable[[float], bool], low_s: float, high_s: float, tolerance_s: float = 1e-6
) -> float:
    """The interval from which on a simulation meets no restrictive code, by bisection.

    The closed form above needs no search; this one needs only the simulation's verdict, and is
    what the closed form is checked against.

    Args:
        meets: Whether the second train meets a restrictive code at an interval; true at ``low_s``,
            false at ``high_s`` and everywhere beyond.
        low_s: Too short an interval, s.
        high_s: Long enough an interval, s.
        tolerance_s: Width at which to stop, s.

    Example:
        >>> round(bracketed_interval(lambda interval: interval < 90.5, 0.0, 600.0), 5)
        90.5
    """
    if not meets(low_s) or meets(high_s):
        raise RailOpsError(
            f"no bracket: a code must be met at {low_s:g} s and none at {high_s:g} s"
        )
    while high_s - low_s > tolerance_s:
        middle = 0.5 * (low_s + high_s)
        if meets(middle):
            low_s = middle
        else:
            high_s = middle
    return high_s
