"""What may the second train do, given where the tail of the first one is.

Three systems answer that question, and all reduce to the same table. The line is cut by
*boundaries*; the tail of the train in front has passed so many of them (its *level*), and the level
says what the train behind may do:

- :class:`TrackCircuits` (of the ALS-ARS kind): the circuit under the train's front receives a speed
  code that depends on the level;
- :class:`FixedBlock` with overlap: the train may run as far as it could brake before the end of the
  last released block;
- :class:`MovingBlock` (CBTC): the same with position reports every metre instead of blocks.

Everything happens at boundaries, so nothing is lost by looking only there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, check_range

Array = npt.NDArray[np.float64]
Spans = Sequence[Sequence[float]]

KMH = 1.0 / 3.6
SPEED_TOLERANCE_MPS = 1e-6  # running exactly at a code is running under it


class Plan(NamedTuple):
    """A protection system as the inner functions read it.

    With n circuits or blocks there are n + 1 boundaries. The tail is at level k when it has passed
    ``release_m[k]`` but not ``release_m[k + 1]``.

    Attributes:
        boundary_m: Where circuits or blocks begin, and where the last ends, m, shape (n + 1,).
        release_m: What the tail must have passed for level k to hold, m, shape (n + 1,).
        code_mps: Speed code in circuit i at level k, m/s, shape (n, n + 1); (0, 0) for blocks.
        decel_mps2: Deceleration that the authority of a block system is computed with, m/s².
        reaction_s: Reaction time in that computation, s.
        stop_m: Where every train stops anyway: no authority beyond it is needed, m.
    """

    boundary_m: Array
    release_m: Array
    code_mps: Array
    decel_mps2: float
    reaction_s: float
    stop_m: float


def _edges(name: str, spans: Spans) -> Array:
    """Check that spans join end to start, and return their boundaries."""
    try:
        pairs = [(float(start), float(end)) for start, end in spans]
    except (TypeError, ValueError):
        raise DomainError(name, spans, "a list of [start_m, end_m] pairs") from None
    if not pairs:
        raise DomainError(name, "empty", "at least one [start_m, end_m] pair")
    for index, (start, end) in enumerate(pairs):
        place = f"{name}[{index}]"
        if not (math.isfinite(start) and math.isfinite(end) and end > start):
            raise DomainError(
                place, f"[{start:g}, {end:g}] m", "an end beyond its start", "lengths are positive"
            )
        if index and start != pairs[index - 1][1]:
            before = pairs[index - 1][1]
            kind = "leaves a gap of" if start > before else "overlaps the one before by"
            raise DomainError(
                place,
                f"[{start:g}, {end:g}] m",
                f"a start at {before:g} m, where the one before ends",
                f"it {kind} {abs(start - before):g} m",
            )
    return np.array([pairs[0][0], *(end for _, end in pairs)])


@dataclass(frozen=True)
class TrackCircuits:
    """Track circuits with speed codes, given by a table or derived from braking.

    With ``codes`` the code of a circuit depends on how many circuits ahead of it are free. With
    ``steps_kmh`` it is derived: the highest step from which a train that leaves the circuit at that
    speed, reacts for ``design_delay_s`` and brakes at ``design_decel_mps2`` stops ``overlap_m``
    before the circuit that the tail of the train in front occupies.

    Attributes:
        circuits: [start_m, end_m] of each circuit along the line, joined end to start.
        codes: (free circuits ahead, code in km/h) pairs, rising; 0 free circuits must give 0.
        steps_kmh: The codes the system knows, km/h; 0 must be among them.
        design_decel_mps2: Deceleration of the design, m/s², > 0.
        design_delay_s: Reaction time of the design, s, >= 0.
        overlap_m: Distance kept free behind the tail's circuit in the design, m, >= 0.
        delay_s: From the tail leaving a circuit until the better code is shown, s, >= 0.
    """

    circuits: tuple[tuple[float, float], ...]
    codes: tuple[tuple[int, float], ...] = ()
    steps_kmh: tuple[float, ...] = ()
    design_decel_mps2: float = 0.8
    design_delay_s: float = 2.0
    overlap_m: float = 0.0
    delay_s: float = 1.5

    def __post_init__(self) -> None:
        edges = _edges("circuits", self.circuits)
        spans = tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
        object.__setattr__(self, "circuits", spans)
        check_range("design_decel_mps2", self.design_decel_mps2, 0.0, 3.0, "m/s²", above=True)
        check_range("design_delay_s", self.design_delay_s, 0.0, 30.0, "s")
        check_range("overlap_m", self.overlap_m, 0.0, 2_000.0, "m")
        check_range("delay_s", self.delay_s, 0.0, 60.0, "s")
        if bool(self.codes) == bool(self.steps_kmh):
            raise DomainError(
                "codes", self.codes, "either codes or steps_kmh, not both", "one of them is needed"
            )
        if self.codes:
            object.__setattr__(self, "codes", _codes(self.codes))
        else:
            object.__setattr__(self, "steps_kmh", _steps(self.steps_kmh))

    def plan(self, stop_m: float) -> Plan:
        """The table that the inner functions read; every train stops at ``stop_m``."""
        edges = _edges("circuits", self.circuits)
        count = edges.size - 1
        level = np.arange(count + 1)
        if self.codes:
            free_circuits, speed_kmh = np.array(self.codes, dtype=np.float64).T
            free = level[None, :] - np.arange(count)[:, None] - 1
            index = np.searchsorted(free_circuits, free, side="right") - 1
            code = np.where(index >= 0, speed_kmh[index], 0.0) * KMH
        else:
            steps = np.array(self.steps_kmh) * KMH
            braking = steps * (self.design_delay_s + 0.5 * steps / self.design_decel_mps2)
            room = edges[None, :] - edges[1:, None] - self.overlap_m
            index = np.searchsorted(braking, room + 1e-9, side="right") - 1
            code = np.where(room >= -1e-9, steps[np.maximum(index, 0)], 0.0)
        code = np.where(level[None, :] > np.arange(count)[:, None], code, 0.0)
        return Plan(edges, edges.copy(), np.ascontiguousarray(code), 1.0, 0.0, float(stop_m))

    @property
    def front_limits(self) -> tuple[tuple[float, float], ...]:
        """(position_m, speed_mps): the best code of each circuit, which binds the front."""
        plan = self.plan(0.0)
        starts, best = plan.boundary_m[:-1].tolist(), plan.code_mps[:, -1].tolist()
        return tuple(zip(starts, best, strict=True))


def _codes(codes: Sequence[Sequence[float]]) -> tuple[tuple[int, float], ...]:
    try:
        pairs = tuple((int(free), float(speed)) for free, speed in codes)
    except (TypeError, ValueError):
        raise DomainError("codes", codes, "a list of [free circuits, km/h] pairs") from None
    for index, (free, speed) in enumerate(pairs):
        check_range(f"codes[{index}] speed", speed, 0.0, 500.0, "km/h")
        if index and not (free > pairs[index - 1][0] and speed >= pairs[index - 1][1]):
            raise DomainError(
                f"codes[{index}]",
                list(pairs[index]),
                "more free circuits and no lower speed than the entry before",
            )
    if pairs[0] != (0, 0.0):
        raise DomainError(
            "codes[0]", list(pairs[0]), "[0, 0]: no free circuit means stop", "a table without stop"
        )
    if pairs[-1][1] == 0.0:
        raise DomainError("codes", list(pairs), "a code above 0 km/h as its last entry")
    return pairs


def _steps(steps: Sequence[float]) -> tuple[float, ...]:
    try:
        speeds = tuple(sorted(float(speed) for speed in steps))
    except (TypeError, ValueError):
        raise DomainError("steps_kmh", steps, "a list of speeds in km/h") from None
    if speeds[0] != 0.0:
        raise DomainError("steps_kmh", list(speeds), "0 km/h among the codes", "no stop")
    if len(speeds) < 2 or speeds[-1] > 500.0 or len(set(speeds)) < len(speeds):
        raise DomainError("steps_kmh", list(speeds), "0 and one or more different speeds in km/h")
    return speeds


@dataclass(frozen=True)
class FixedBlock:
    """Fixed blocks with overlap: a rival that knows only whole blocks.

    Attributes:
        blocks: [start_m, end_m] of each block along the line, joined end to start.
        overlap_m: How far the tail must be beyond a block before it is released, m, >= 0.
        decel_mps2: Deceleration of the authority's braking curve, m/s², > 0.
        reaction_s: Reaction time in it, s, >= 0.
        delay_s: From the release until the second train knows, s, >= 0.
    """

    blocks: tuple[tuple[float, float], ...]
    overlap_m: float = 50.0
    decel_mps2: float = 0.8
    reaction_s: float = 2.0
    delay_s: float = 1.5

    def __post_init__(self) -> None:
        edges = _edges("blocks", self.blocks)
        spans = tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
        object.__setattr__(self, "blocks", spans)
        _check_authority(self.overlap_m, "overlap_m", self.decel_mps2, self.reaction_s)
        check_range("delay_s", self.delay_s, 0.0, 60.0, "s")

    @property
    def front_limits(self) -> tuple[tuple[float, float], ...]:
        """None: blocks do not limit the speed of a train that has its authority."""
        return ()

    def plan(self, stop_m: float) -> Plan:
        """The table that the inner functions read; every train stops at ``stop_m``."""
        edges = _edges("blocks", self.blocks)
        return _authority(edges, self.overlap_m, self.decel_mps2, self.reaction_s, stop_m)


@dataclass(frozen=True)
class MovingBlock:
    """Moving block: the authority ends a margin behind the last reported tail.

    Attributes:
        margin_m: Kept between the end of authority and the tail, m, >= 0.
        report_m: Step in which the tail's position is known, m, > 0; rounded backwards.
        decel_mps2: Deceleration of the authority's braking curve, m/s², > 0.
        reaction_s: Reaction time in it, s, >= 0.
        delay_s: From the tail passing a position until the second train knows, s, >= 0.
    """

    margin_m: float = 20.0
    report_m: float = 1.0
    decel_mps2: float = 0.8
    reaction_s: float = 1.0
    delay_s: float = 0.8

    def __post_init__(self) -> None:
        check_range("report_m", self.report_m, 0.05, 100.0, "m")
        _check_authority(self.margin_m, "margin_m", self.decel_mps2, self.reaction_s)
        check_range("delay_s", self.delay_s, 0.0, 60.0, "s")

    @property
    def front_limits(self) -> tuple[tuple[float, float], ...]:
        """None: the authority is the only limit."""
        return ()

    def plan(self, stop_m: float) -> Plan:
        """The table that the inner functions read; every train stops at ``stop_m``."""
        count = max(1, math.ceil(stop_m / self.report_m))
        edges = np.append(np.arange(count) * self.report_m, stop_m)
        return _authority(edges, self.margin_m, self.decel_mps2, self.reaction_s, stop_m)


Protection = TrackCircuits | FixedBlock | MovingBlock


def _check_authority(
    margin_m: float, margin_name: str, decel_mps2: float, reaction_s: float
) -> None:
    check_range(margin_name, margin_m, 0.0, 2_000.0, "m")
    check_range("decel_mps2", decel_mps2, 0.0, 3.0, "m/s²", above=True)
    check_range("reaction_s", reaction_s, 0.0, 30.0, "s")


def _authority(
    edges: Array, margin_m: float, decel_mps2: float, reaction_s: float, stop_m: float
) -> Plan:
    release = edges + margin_m
    return Plan(edges, release, np.zeros((0, 0)), decel_mps2, reaction_s, float(stop_m))
