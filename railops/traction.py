"""How a train moves: running resistance, gradient and curve, adhesion, effort, brake build-up.

The one longitudinal model that braking, pilot, crossing and headway share, per unit mass:

    dv/dt = e(t, v) − [c0 + c1·v + c2·v² + w(s)] / (1 + γ)

with the effort e (positive: traction; negative: brake), the Davis terms, the line's resistance
w(s) = g·sin θ + g·k/R averaged over the train's length, and the rotating-mass share γ. Efforts are
*accelerations the train would show on level track without running resistance*, so γ is already in
them; it is not in the resistances.

Frames and units: s is the position of the train's front along the track, metres; v in m/s; every
specific force in m/s². A positive gradient climbs. Functions marked ``@compiled`` are the inner
functions: scalars in, scalar out, no checks, callable from other compiled code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled
from railops.errors import DomainError, check_range

Array = npt.NDArray[np.float64]

GRAVITY_MPS2 = 9.80665
# Curve resistance 700/R N/kN (R in metres) is 0.7/R as a share of the weight. The pilot-vehicle
# paper prints g·700/ρ (its eq. 2): that is the per-mille figure without its 1/1000.
CURVE_RESISTANCE_M = 0.7
MAX_SPEED_MPS = 150.0


@dataclass(frozen=True)
class Davis:
    """Running resistance per unit mass: r/m = c0 + c1·v + c2·v²   [pilot-vehicle paper, eq. 1].

    The default is of the form used in traction calculations for a ten-car suburban multiple unit
    (1.1 + 0.012·V + 0.000267·V² N/kN, V in km/h), stated here and not measured on any train.

    Attributes:
        c0: Constant part, m/s², >= 0.
        c1: Linear part, 1/s, >= 0.
        c2: Quadratic part, 1/m, >= 0.
    """

    c0: float = 1.1e-3 * GRAVITY_MPS2
    c1: float = 0.012e-3 * 3.6 * GRAVITY_MPS2
    c2: float = 0.000267e-3 * 3.6**2 * GRAVITY_MPS2

    def __post_init__(self) -> None:
        check_range("c0", self.c0, 0.0, 1.0, "m/s²")
        check_range("c1", self.c1, 0.0, 0.1, "1/s")
        check_range("c2", self.c2, 0.0, 0.01, "1/m")

    @staticmethod
    def per_train(mass_kg: float, a_n: float, b_ns_m: float, c_ns2_m2: float) -> Davis:
        """Coefficients per unit mass from those of a whole train, A + B·v + C·v² newtons.

        Example:
            >>> Davis.per_train(100_000.0, 1000.0, 50.0, 5.0)
            Davis(c0=0.01, c1=0.0005, c2=5e-05)
        """
        mass = check_range("mass_kg", mass_kg, 0.0, unit="kg", above=True)
        return Davis(a_n / mass, b_ns_m / mass, c_ns2_m2 / mass)


@dataclass(frozen=True)
class Adhesion:
    """Wheel–rail adhesion after Curtius and Kniffler, µ = f·(0.161 + 7.5 / (V + 44)), V in km/h.

    Attributes:
        factor: Rail condition f: 1 dry, about 0.6 wet, 0.2–0.4 leaves or ice. In (0, 1.5].
        share: Share of the train's weight on braked (or driven) axles, in (0, 1].
    """

    factor: float = 1.0
    share: float = 1.0

    def __post_init__(self) -> None:
        check_range("adhesion factor", self.factor, 0.0, 1.5, above=True)
        check_range("adhesion share", self.share, 0.0, 1.0, above=True)

    def limit_mps2(self, speed_mps: float) -> float:
        """The largest effort the contact transmits at this speed, m/s²."""
        return adhesion_limit(speed_mps, self.factor * self.share)


@dataclass(frozen=True)
class Effort:
    """Traction: constant up to a corner speed, then constant power, both per unit mass.

    Attributes:
        accel_mps2: Largest effort from standstill, m/s², > 0.
        power_w_per_kg: Power at the rail over mass, W/kg, > 0; the effort is at most power / v.
    """

    accel_mps2: float = 0.8
    power_w_per_kg: float = 9.0

    def __post_init__(self) -> None:
        check_range("accel_mps2", self.accel_mps2, 0.0, 5.0, "m/s²", above=True)
        check_range("power_w_per_kg", self.power_w_per_kg, 0.0, 200.0, "W/kg", above=True)

    def at(self, speed_mps: float) -> float:
        """Largest effort at this speed, m/s²."""
        return tractive_effort(speed_mps, self.accel_mps2, self.power_w_per_kg)


class LineTable(NamedTuple):
    """What inner functions read of a line: w(s) for one train length, linear between knots.

    Attributes:
        position_m: Knots, increasing, shape (K,). Outside them the end values hold.
        resistance_mps2: w at the knots, m/s², shape (K,); negative pulls the train along.
    """

    position_m: Array
    resistance_mps2: Array


Pieces = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Line:
    """Gradient and curve profile, each constant from its position to the next.

    Before the first position the first value holds, after the last the last.

    Attributes:
        gradients: (position_m, gradient) pairs; gradient is rise over run, positive uphill.
        curves: (position_m, radius_m) pairs; ``inf`` is straight; the side does not matter.
    """

    gradients: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    curves: tuple[tuple[float, float], ...] = ((0.0, math.inf),)
    _tables: dict[float, LineTable] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "gradients", _pieces("gradients", self.gradients))
        object.__setattr__(self, "curves", _pieces("curves", self.curves))
        for _, gradient in self.gradients:
            check_range("gradient", gradient, -0.5, 0.5, "m/m", hint="25 ‰ is 0.025")
        for _, radius in self.curves:
            if not radius >= 20.0:
                raise DomainError("curve radius_m", f"{radius} m", "at least 20 m, or inf")

    @staticmethod
    def uniform(gradient: float = 0.0, radius_m: float = math.inf) -> Line:
        """A line of one gradient (rise over run) and one curve radius."""
        return Line(((0.0, gradient),), ((0.0, radius_m),))

    def radius_m(self, position_m: float, ahead_m: float = 0.0) -> float:
        """The tightest radius between ``position_m`` and ``ahead_m`` further on, metres."""
        starts = [start for start, _ in self.curves]
        first = max(0, int(np.searchsorted(starts, position_m, side="right")) - 1)
        return min(
            radius
            for start, radius in self.curves[first:]
            if start <= position_m + ahead_m or start == starts[first]
        )

    def table(self, length_m: float) -> LineTable:
        """w(s) for a train of this length with evenly spread mass (a point counts as 1 m).

        Exact: the average over the length is the difference of the line's potential
        H(s) = ∫ (g·sin θ + g·k/R) ds at front and rear, divided by the length, and H is linear
        between the profile's positions.
        """
        length = max(float(length_m), 1.0)
        if length not in self._tables:
            self._tables[length] = _average(self, length)
        return self._tables[length]


def _pieces(name: str, pieces: Pieces) -> tuple[tuple[float, float], ...]:
    """Check a profile: at least one pair, positions finite and increasing."""
    try:
        pairs = tuple((float(start), float(value)) for start, value in pieces)
    except (TypeError, ValueError, OverflowError):
        raise DomainError(name, pieces, "a list of [position_m, value] pairs") from None
    starts = [start for start, _ in pairs]
    in_order = all(a < b for a, b in pairwise(starts))
    if not (pairs and in_order and all(map(math.isfinite, starts))):
        raise DomainError(name, pieces, "[position_m, value] pairs with increasing positions in m")
    return pairs


def _average(line: Line, length_m: float) -> LineTable:
    """Tabulate the line's resistance averaged over a train length."""
    grade_at, grade = np.array(line.gradients).T
    curve_at, radius = np.array(line.curves).T
    breaks = np.unique(np.concatenate([grade_at, curve_at]))

    def point(position: Array) -> Array:
        slope = grade[np.clip(np.searchsorted(grade_at, position, "right") - 1, 0, None)]
        bend = radius[np.clip(np.searchsorted(curve_at, position, "right") - 1, 0, None)]
        force: Array = GRAVITY_MPS2 * (np.sin(np.arctan(slope)) + CURVE_RESISTANCE_M / bend)
        return force

    # Potential at knots that reach one length beyond either end, where w is constant.
    edges = np.concatenate([[breaks[0] - length_m], breaks, [breaks[-1] + length_m]])
    potential = np.concatenate([[0.0], np.cumsum(point(edges[:-1]) * np.diff(edges))])
    knots = np.unique(np.concatenate([breaks, breaks + length_m]))
    front = np.interp(knots, edges, potential)
    rear = np.interp(knots - length_m, edges, potential)
    return LineTable(knots, (front - rear) / length_m)


LEVEL = Line()


@compiled
def running_resistance(speed_mps: float, c0: float, c1: float, c2: float) -> float:
    """Davis resistance per unit mass, c0 + c1·v + c2·v², m/s²."""
    return c0 + (c1 + c2 * speed_mps) * speed_mps


@compiled
def line_resistance(position_m: float, knots_m: Array, resistance_mps2: Array) -> float:
    """w(s) of a :class:`LineTable` at one position, m/s²."""
    last = knots_m.size - 1
    if position_m <= knots_m[0]:
        return float(resistance_mps2[0])
    if position_m >= knots_m[last]:
        return float(resistance_mps2[last])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if knots_m[middle] <= position_m:
            low = middle
        else:
            high = middle
    part = (position_m - knots_m[low]) / (knots_m[high] - knots_m[low])
    return float(resistance_mps2[low] + part * (resistance_mps2[high] - resistance_mps2[low]))


@compiled
def adhesion_limit(speed_mps: float, factor: float) -> float:
    """Curtius–Kniffler limit of the effort, f·g·(0.161 + 7.5 / (3.6·v + 44)), m/s²."""
    return factor * GRAVITY_MPS2 * (0.161 + 7.5 / (3.6 * speed_mps + 44.0))


@compiled
def tractive_effort(speed_mps: float, accel_mps2: float, power_w_per_kg: float) -> float:
    """Largest traction effort at a speed, min(a, P / v), m/s²."""
    if speed_mps * accel_mps2 <= power_w_per_kg:
        return accel_mps2
    return power_w_per_kg / speed_mps


@compiled
def build_up(time_s: float, delay_s: float, build_up_s: float) -> float:
    """Share of the full brake effort ``time_s`` after the command: dead time, then a ramp."""
    if time_s <= delay_s:
        return 0.0
    if time_s >= delay_s + build_up_s:
        return 1.0
    return (time_s - delay_s) / build_up_s


@compiled
def acceleration(
    effort_mps2: float,
    speed_mps: float,
    line_mps2: float,
    c0: float,
    c1: float,
    c2: float,
    rotating: float,
) -> float:
    """dv/dt of the module's equation of motion, m/s²; the effort is negative when braking."""
    return effort_mps2 - (running_resistance(speed_mps, c0, c1, c2) + line_mps2) / (1.0 + rotating)
