"""A section between two stations: everything its regulating characteristic depends on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from railops.errors import DomainError, check_range
from railops.headway.ceiling import Ceiling, ceiling
from railops.headway.motion import Drive, drive_of
from railops.headway.protection import KMH, MovingBlock, Plan, Protection
from railops.headway.stock import Stock
from railops.traction import LEVEL, Line


@dataclass(frozen=True)
class Dwell:
    """Dwell of the train in front at the next station.

    The interval is linear in the dwell, so a dwell with spread needs no further simulation: the
    interval that suffices with a probability is the one for that quantile of the dwell.

    Attributes:
        mean_s: Mean, s, >= 0.
        std_s: Standard deviation of its (normal) spread, s, >= 0.
    """

    mean_s: float = 20.0
    std_s: float = 0.0

    def __post_init__(self) -> None:
        check_range("mean_s", self.mean_s, 0.0, 3600.0, "s")
        check_range("std_s", self.std_s, 0.0, 600.0, "s")

    def quantile_s(self, probability: float = 0.5) -> float:
        """The dwell not exceeded with this probability, s, never negative.

        Example:
            >>> Dwell(20.0, 4.0).quantile_s(0.5), round(Dwell(20.0, 4.0).quantile_s(0.95), 2)
            (20.0, 26.58)
        """
        check_range("probability", probability, 0.0, 1.0 - 1e-12, above=True)
        if self.std_s == 0.0:
            return self.mean_s
        return max(0.0, self.mean_s + self.std_s * float(ndtri(probability)))


@dataclass(frozen=True)
class Section:
    """A section: from the stopping point of one station (0 m) to that of the next.

    Positions are those of a train's front. Profile, limits and circuits go on beyond the next
    stopping point, as far as the train in front has to draw away.

    Attributes:
        length_m: Distance between the stopping points, m, > 0.
        protection: The train-protection system.
        stock: Both trains' rolling stock.
        line: Gradients and curves.
        limits_kmh: (position_m, km/h): the limit from each position to the next.
        run_times_s: Run times the upper level may order, s, rising; empty for none stated.
        dwell: Dwell of the train in front at the next station.
        name: For people.
    """

    length_m: float
    protection: Protection = field(default_factory=MovingBlock)
    stock: Stock = field(default_factory=Stock)
    line: Line = LEVEL
    limits_kmh: tuple[tuple[float, float], ...] = ((0.0, 80.0),)
    run_times_s: tuple[float, ...] = ()
    dwell: Dwell = field(default_factory=Dwell)
    name: str = "section"

    def __post_init__(self) -> None:
        check_range("length_m", self.length_m, 0.0, 50_000.0, "m", above=True)
        if self.stock.length_m >= self.length_m:
            raise DomainError(
                "stock.length_m",
                f"{self.stock.length_m:g} m",
                f"a train shorter than the section, which is {self.length_m:g} m long",
            )
        object.__setattr__(self, "limits_kmh", _limits(self.limits_kmh))
        object.__setattr__(self, "run_times_s", _run_times(self.run_times_s))
        _check_reach(self.protection, self.length_m)

    @cached_property
    def plan(self) -> Plan:
        """The protection system as the inner functions read it."""
        return self.protection.plan(self.length_m)

    @cached_property
    def limits_mps(self) -> tuple[tuple[float, float], ...]:
        """The line's limits in m/s."""
        return tuple((start, speed * KMH) for start, speed in self.limits_kmh)

    def ceiling(self, *, stopping: bool = True) -> Ceiling:
        """The ceiling up to the next stop, or (for the train drawing away) without it.

        The train drawing away has a free line before it: the highest code is its only code limit.
        """
        codes = self.protection.front_limits
        if codes and not stopping:
            codes = ((0.0, max(speed for _, speed in codes)),)
        return ceiling(
            self.limits_mps,
            self.stock.length_m,
            self.stock.brake_mps2,
            self.length_m if stopping else math.inf,
            codes,
        )

    def drive(self, *, stopping: bool = True) -> Drive:
        """Train, line and ceiling as the inner functions read them."""
        table = self.line.table(self.stock.length_m)
        return drive_of(self.stock, table, self.ceiling(stopping=stopping))

    def with_protection(self, protection: Protection) -> Section:
        """The same section under another protection system."""
        return replace(self, protection=protection)


def _limits(limits: Sequence[Sequence[float]]) -> tuple[tuple[float, float], ...]:
    try:
        pairs = tuple((float(start), float(speed)) for start, speed in limits)
    except (TypeError, ValueError):
        raise DomainError("limits_kmh", limits, "a list of [position_m, km/h] pairs") from None
    if not pairs:
        raise DomainError("limits_kmh", "empty", "at least one [position_m, km/h] pair")
    for index, (start, speed) in enumerate(pairs):
        check_range(f"limits_kmh[{index}] position", start, unit="m")
        check_range(f"limits_kmh[{index}] speed", speed, 5.0, 500.0, "km/h")
        if index and start <= pairs[index - 1][0]:
            raise DomainError(
                f"limits_kmh[{index}] position",
                f"{start:g} m",
                f"a position beyond the one before, {pairs[index - 1][0]:g} m",
            )
    return pairs


def _run_times(times: Sequence[float]) -> tuple[float, ...]:
    try:
        values = tuple(float(time) for time in times)
    except (TypeError, ValueError):
        raise DomainError("run_times_s", times, "a list of times in s") from None
    for index, time in enumerate(values):
        check_range(f"run_times_s[{index}]", time, 0.0, 3600.0, "s", above=True)
        if index and time <= values[index - 1]:
            raise DomainError(f"run_times_s[{index}]", f"{time:g} s", "rising run times")
    return values


def _check_reach(protection: Protection, length_m: float) -> None:
    """Circuits or blocks must cover the section and let a train into the next station."""
    if isinstance(protection, MovingBlock):
        return
    plan = protection.plan(length_m)
    name = "circuits" if plan.code_mps.size else "blocks"
    first, last = plan.boundary_m[0], plan.boundary_m[-1]
    if first > 0.0:
        raise DomainError(f"protection.{name}[0]", f"from {first:g} m", "a start at or before 0 m")
    place = f"protection.{name}[{plan.boundary_m.size - 2}]"
    if last < length_m:
        raise DomainError(
            place, f"to {last:g} m", f"an end at or beyond the stopping point, {length_m:g} m"
        )
    if plan.code_mps.size:
        under = np.searchsorted(plan.boundary_m, length_m - 1e-9, side="right") - 1
        dead = np.flatnonzero(plan.code_mps[: under + 1, -1] <= 0.0)
        if dead.size:
            raise DomainError(
                place,
                f"to {last:g} m",
                "more circuits beyond it",
                f"no code ever lets a train into circuits[{dead[0]}], on its way to the stopping "
                f"point at {length_m:g} m",
            )
