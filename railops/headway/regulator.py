"""Run a section in a wanted time: traction, coasting, braking.

Of all runs of these three phases that take the wanted time, the one with the earliest cut-off of
traction is the only one; it spends the least traction work, since every later cut-off arrives
earlier and pulls longer. Where traction would exceed a limit, the limit is held instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.errors import DomainError, RailOpsError
from railops.headway.motion import (
    ARRIVED,
    STEP_S,
    Drive,
    Nodes,
    empty_nodes,
    passages,
    run,
)
from railops.headway.section import Section

Array = npt.NDArray[np.float64]

TIME_TOLERANCE_S = 5e-7  # aimed at; the run time moves by up to this as nodes shift
TIME_ACCURACY_S = 2e-5  # demanded of a run


class RunTimeError(DomainError):
    """A run time the section does not allow; the message says the shortest and the longest.

    Attributes:
        shortest_s: Run time with full traction until the brake must be applied, s.
        longest_s: Run time with the earliest cut-off from which the train still arrives, s.
    """

    def __init__(self, wanted_s: float, shortest_s: float, longest_s: float, name: str) -> None:
        self.shortest_s, self.longest_s = shortest_s, longest_s
        super().__init__(
            f"run time over {name}",
            f"{wanted_s:g} s",
            f"{shortest_s:.1f} s (the shortest) to {longest_s:.1f} s (the longest without pulling "
            "again)",
        )


class StuckError(RailOpsError, ValueError):
    """The train does not reach the next station even with full traction."""


@dataclass(frozen=True)
class Run:
    """One run over the section, leaving at 0 s.

    Attributes:
        nodes: Time, position, speed and traction work per unit mass at every node.
        cut_off_m: Where traction is cut off, m; ``inf`` for the shortest run.
    """

    nodes: Nodes
    cut_off_m: float

    @property
    def run_time_s(self) -> float:
        """From departure to standstill, s."""
        return float(self.nodes.time_s[-1])

    @property
    def work_jpkg(self) -> float:
        """Traction work per unit mass, J/kg."""
        return float(self.nodes.work_jpkg[-1])

    def passage_s(self, position_m: Array) -> Array:
        """Times at which the front passes increasing positions, s; inf where it never does."""
        times = np.empty(position_m.size)
        passages(self.nodes.time_s.size, self.nodes, position_m, times)
        return times


class Found(NamedTuple):
    """What the inner search returns: nodes used, cut-off, and the time it takes."""

    nodes: int
    cut_m: float
    time_s: float


@compiled
def cut_at(
    cut_m: float, flat: Nodes, flat_count: int, end_m: float, step: float, drive: Drive, out: Nodes
) -> tuple[int, float]:
    """Fill ``out`` with the run that cuts traction at ``cut_m``; (nodes, run time or inf)."""
    low, high = 0, flat_count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if flat.position_m[middle] <= cut_m:
            low = middle
        else:
            high = middle
    for index in range(low + 1):
        out.time_s[index] = flat.time_s[index]
        out.position_m[index] = flat.position_m[index]
        out.speed_mps[index] = flat.speed_mps[index]
        out.work_jpkg[index] = flat.work_jpkg[index]
    count, state = run(low + 1, cut_m, end_m, step, drive, out)
    if state != ARRIVED:
        return count, np.inf
    return count, out.time_s[count - 1]


@compiled
def search(
    wanted_s: float,
    flat: Nodes,
    flat_count: int,
    end_m: float,
    step: float,
    drive: Drive,
    out: Nodes,
) -> Found:
    """Find the cut-off for a wanted run time; a later cut-off never arrives later.

    For a time longer than possible the search ends at the longest there is.
    """
    low, low_time = 0.0, np.inf  # cutting at once: the train stalls or is slowest
    high, high_time = end_m, flat.time_s[flat_count - 1]
    low_weight = high_weight = 1.0
    side = 0
    for _ in range(100):
        cut = 0.5 * (low + high)
        if low_time < np.inf:  # Illinois: false position that halves an end retained twice
            up, down = low_weight * (low_time - wanted_s), high_weight * (wanted_s - high_time)
            if up + down > 0.0:
                cut = low + (high - low) * up / (up + down)
            if not low < cut < high:
                cut = 0.5 * (low + high)
        count, time = cut_at(cut, flat, flat_count, end_m, step, drive, out)
        if abs(time - wanted_s) <= TIME_TOLERANCE_S:
            return Found(count, cut, time)
        if time > wanted_s:
            low, low_time, low_weight = cut, time, 1.0
            high_weight = 0.5 * high_weight if side < 0 else high_weight
            side = -1
        else:
            high, high_time, high_weight = cut, time, 1.0
            low_weight = 0.5 * low_weight if side > 0 else low_weight
            side = 1
        if high - low < 1e-9:
            break
    count, time = cut_at(high, flat, flat_count, end_m, step, drive, out)
    return Found(count, high, time)


class Regulator:
    """Finds runs over one section; full traction is computed once and shared by all of them."""

    def __init__(self, section: Section, step_s: float = STEP_S) -> None:
        self.section, self.step_s = section, step_s
        self._drive = section.drive()
        self._room = empty_nodes(step_s)
        self._flat = empty_nodes(step_s)
        for column in self._flat:
            column[0] = 0.0
        count, state = run(1, math.inf, section.length_m, step_s, self._drive, self._flat)
        if state != ARRIVED:
            raise StuckError(
                f"the train does not reach the end of {section.name}: at "
                f"{self._flat.position_m[count - 1]:.0f} m of {section.length_m:g} m its traction "
                "no longer overcomes the resistance; check gradients, effort and limits"
            )
        self._flat_count = count
        self.shortest = Run(self._flat.first(count), math.inf)

    @property
    def shortest_s(self) -> float:
        """Run time with full traction, s."""
        return self.shortest.run_time_s

    def at_cut(self, cut_m: float) -> Run:
        """The run that cuts traction off at ``cut_m``; raises where it does not arrive."""
        count, time = cut_at(
            float(cut_m),
            self._flat,
            self._flat_count,
            self.section.length_m,
            self.step_s,
            self._drive,
            self._room,
        )
        if not math.isfinite(time):
            raise StuckError(
                f"a train that cuts traction at {cut_m:g} m does not reach the end of "
                f"{self.section.name}"
            )
        return Run(self._room.first(count), float(cut_m))

    def longest(self) -> Run:
        """The run with the earliest cut-off from which the train still arrives."""
        return self._found(1e9)

    def run(self, wanted_s: float) -> Run:
        """The run that takes ``wanted_s``.

        Raises:
            RunTimeError: if that is shorter than the shortest or longer than the longest run time.
        """
        if abs(wanted_s - self.shortest_s) <= 1e-6:
            return self.shortest
        if not wanted_s > self.shortest_s:
            raise self._impossible(wanted_s)
        found = self._found(wanted_s)
        if abs(found.run_time_s - wanted_s) > TIME_ACCURACY_S:
            raise self._impossible(wanted_s)
        return found

    def _found(self, wanted_s: float) -> Run:
        found = search(
            float(wanted_s),
            self._flat,
            self._flat_count,
            self.section.length_m,
            self.step_s,
            self._drive,
            self._room,
        )
        return Run(self._room.first(found.nodes), found.cut_m)

    def _impossible(self, wanted_s: float) -> RunTimeError:
        longest_s = self.longest().run_time_s
        return RunTimeError(wanted_s, self.shortest_s, longest_s, self.section.name)


def departure(section: Section, reach_m: float, step_s: float = STEP_S) -> Run:
    """The train in front draws away from the next station under full traction.

    It leaves at 0 s from the stopping point and runs until its front passes ``reach_m``.

    Raises:
        StuckError: if it does not get that far.
    """
    room = empty_nodes(step_s)
    for column in room:
        column[0] = 0.0
    room.position_m[0] = section.length_m
    count, state = run(1, math.inf, reach_m, step_s, section.drive(stopping=False), room)
    if state != ARRIVED:
        raise StuckError(
            f"the train in front does not draw away from the end of {section.name}: it gets to "
            f"{room.position_m[count - 1]:.0f} m of {reach_m:.0f} m; check gradients and effort"
        )
    return Run(room.first(count), math.inf)
