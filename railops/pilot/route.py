"""What lies along the trip: the mother train's speed, the line and its tunnels.

Everything is piecewise linear in position, so that the exact tables (used by simulation and
re-integration) and their smooth twins (used by the optimiser, :mod:`railops.pilot._smooth`) come
from the same knots:

* the mother train's acceleration a_m(p) = v_m·dv_m/dp, whose integral is v_m²/2;
* the line's resistance w(p), from :class:`railops.traction.Line`; gradients and curves change
  over a transition (a vertical curve, a transition curve) and not from one metre to the next;
* the tunnel factor on the aerodynamic term c₂ (the paper's Section III-B: "adjust c0, c1 and c2
  along the track").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, check_range
from railops.pilot.vehicle import PilotVehicle
from railops.traction import LEVEL, MAX_SPEED_MPS, Line

Array = npt.NDArray[np.float64]

# The decay constant of eq. 40, 1/m. The paper prints -0.008, with which the mother train would
# accelerate at up to |β|·v²/4 = 2.2 m/s², nearly four times what the pilot vehicle can follow;
# the authors' published program has -0.0025/3 (0.23 m/s²).
BETA_PER_M = -0.0025 / 3.0
BETA_AS_PRINTED_PER_M = -0.008
_MOST_ACCEL_MPS2 = 20.0  # no train; beyond it a unit is wrong


class Ramp(NamedTuple):
    """A piecewise linear function of position; outside its knots the end values hold."""

    position_m: Array
    value: Array

    def at(self, position_m: Array | float) -> Array:
        """Values at these positions."""
        return np.asarray(np.interp(position_m, self.position_m, self.value), float)


@dataclass(frozen=True)
class SpeedProfile:
    """The mother train's speed over position, from an acceleration that is piecewise linear.

    Its kinetic energy per unit mass is E(p) = v_m²/2 = E(p₀) + ∫ a dp, so speed and acceleration
    are consistent and continuous.

    Attributes:
        position_m: Knots p_m, metres, increasing, at least two.
        accel_mps2: Acceleration v_m·dv_m/dp at the knots, m/s²; none before and after them.
        speed_mps: Speed at the first knot, m/s, >= 0.
    """

    position_m: tuple[float, ...]
    accel_mps2: tuple[float, ...]
    speed_mps: float
    accel: Ramp = field(init=False, repr=False, compare=False)
    energy: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        at, accel = np.array(self.position_m, float), np.array(self.accel_mps2, float)
        if at.ndim != 1 or at.size < 2 or at.shape != accel.shape or not (np.diff(at) > 0).all():
            raise DomainError(
                "position_m", f"{at.size} knots", "two or more, increasing, one per acceleration"
            )
        check_range("speed_mps", self.speed_mps, 0.0, MAX_SPEED_MPS, "m/s")
        if not (np.isfinite(at).all() and (np.abs(accel) <= _MOST_ACCEL_MPS2).all()):
            worst = float(accel[np.argmax(~(np.abs(accel) <= _MOST_ACCEL_MPS2))])
            raise DomainError(
                "mother train's acceleration",
                f"{worst:g} m/s²",
                f"within ±{_MOST_ACCEL_MPS2:g} m/s²",
                "speeds are in m/s, positions in metres",
            )
        rise = np.diff(at) * (accel[:-1] + accel[1:]) / 2.0
        energy = 0.5 * self.speed_mps**2 + np.concatenate([[0.0], np.cumsum(rise)])
        energy[np.abs(energy) < 1e-6] = 0.0
        if not (energy[1:-1] > 0.0).all() or energy[-1] < 0.0:
            where = float(at[1:][energy[1:] <= 0.0][0])
            raise DomainError(
                "speed profile",
                f"standing at {where:.0f} m",
                "a train that moves between its ends",
                "plan each run between two stops on its own",
            )
        check_range("speed_mps", float(np.sqrt(2.0 * energy.max())), 0.0, MAX_SPEED_MPS, "m/s")
        object.__setattr__(self, "accel", Ramp(at, accel))
        object.__setattr__(self, "energy", energy)

    @staticmethod
    def constant(speed_mps: float, length_m: float = 1e6) -> SpeedProfile:
        """One speed from position 0 to ``length_m``."""
        return SpeedProfile((0.0, length_m), (0.0, 0.0), speed_mps)

    @staticmethod
    def through(
        position_m: Sequence[float], speed_mps: Sequence[float], transition_m: float = 100.0
    ) -> SpeedProfile:
        """Pieces of constant acceleration between given speeds, with transitions between them.

        Args:
            position_m: Positions, metres, increasing, at least a transition apart.
            speed_mps: Speeds there, m/s.
            transition_m: Length over which the acceleration changes, metres.

        Example:
            >>> profile = SpeedProfile.through([0.0, 1000.0, 2000.0], [20.0, 20.0, 30.0])
            >>> round(float(profile.speed_at(2000.0)), 6)
            30.0
        """
        at, speed = np.array(position_m, float), np.array(speed_mps, float)
        if at.size < 2 or at.size != speed.size or not (np.diff(at) >= transition_m).all():
            raise DomainError(
                "position_m", f"{at.size} positions", "two or more, a transition apart"
            )
        if not (speed[1:-1] > 0.0).all():
            raise DomainError(
                "speed_mps",
                f"{speed[1:-1].min():g} m/s between the ends",
                "a train that moves between its ends",
                "plan each run between two stops on its own",
            )
        half = 0.5 * transition_m
        accel = np.diff(speed**2) / 2.0 / np.diff(at)
        # At the two ends the piece keeps its acceleration right up to the station.
        knots = [at[0], *np.stack([at[1:-1] - half, at[1:-1] + half], 1).ravel(), at[-1]]
        return SpeedProfile(tuple(knots), tuple(np.repeat(accel, 2)), float(speed[0]))

    @staticmethod
    def paper(
        trip_m: float = 300e3,
        ramp_m: float = 15e3,
        top_mps: float = 120.0 / 3.6,
        beta_per_m: float = BETA_PER_M,
        knots: int = 300,
    ) -> SpeedProfile:
        """Eq. 40: v = top·(1 − e^(β·p)) away from either station, ``top`` in between.

        Along eq. 40 itself a train that stands never starts, since its acceleration is zero
        there; here the acceleration of the tenth metre holds from the first.
        """
        check_range("beta_per_m", beta_per_m, -1.0, -1e-6, "1/m")
        check_range("ramp_m", ramp_m, 100.0, 0.499 * trip_m, "m")
        near = np.geomspace(10.0, ramp_m, knots)
        accel = top_mps**2 * -beta_per_m * np.exp(beta_per_m * near) * -np.expm1(beta_per_m * near)
        at = np.concatenate([[0.0], near, trip_m - near[::-1], [trip_m]])
        accel = np.concatenate([accel[:1], accel])
        accel[-1] = 0.0
        # The trapezium rule and the first metres are off by some 10⁻⁴: end at ``top`` exactly.
        reached = np.trapezoid(accel, at[: knots + 1])
        accel = accel * (0.5 * top_mps**2 / reached)
        both = np.concatenate([accel, -accel[::-1]])
        return SpeedProfile(tuple(at.tolist()), tuple(both.tolist()), 0.0)

    @property
    def length_m(self) -> float:
        """From the first to the last knot, metres."""
        return self.position_m[-1] - self.position_m[0]

    def speed_at(self, position_m: Array | float) -> Array:
        """v_m, m/s; before and after the profile its end speeds hold."""
        at, accel = self.accel
        p = np.clip(position_m, at[0], at[-1])
        piece = np.clip(np.searchsorted(at, p, "right") - 1, 0, at.size - 2)
        past = p - at[piece]
        slope = (accel[piece + 1] - accel[piece]) / (at[piece + 1] - at[piece])
        energy = self.energy[piece] + (accel[piece] + 0.5 * slope * past) * past
        return np.sqrt(2.0 * np.maximum(energy, 0.0))

    def accel_at(self, position_m: Array | float) -> Array:
        """v_m·dv_m/dp, m/s²."""
        return self.accel.at(position_m)


@dataclass(frozen=True)
class Route:
    """A trip: the mother train's speed profile over a line with tunnels.

    Attributes:
        mother: The mother train's speed profile over its own position p_m.
        line: Gradients and curves over the position of whoever is there.
        tunnels: (from_m, to_m, factor) triples, in order and apart; the factor multiplies c₂.
        transition_m: Length over which gradient, curvature and tunnel factor change, metres,
            centred on the profile's positions.
    """

    mother: SpeedProfile
    line: Line = LEVEL
    tunnels: tuple[tuple[float, float, float], ...] = ()
    transition_m: float = 100.0
    resistance: Ramp = field(init=False, repr=False, compare=False)
    tunnel: Ramp = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_range("transition_m", self.transition_m, 1.0, 5000.0, "m")
        half = 0.5 * self.transition_m
        knots, values = self.line.table(self.transition_m)
        object.__setattr__(self, "resistance", Ramp(knots - half, values))
        object.__setattr__(self, "tunnel", _tunnel_ramp(self.tunnels, half))

    @staticmethod
    def paper(trip_m: float = 300e3, ramp_m: float = 15e3) -> Route:
        """The paper's trip: 300 km, flat and straight, speed after eq. 40."""
        return Route(SpeedProfile.paper(trip_m, ramp_m))

    def hold_mps2(self, vehicle: PilotVehicle, mother_m: Array | float, gap_m: float) -> Array:
        """The force over mass that holds the gap there, eqs. 19 and 20, m/s².

        The printed equations omit the mother train's own acceleration v_m·dv_m/dp, which the
        pilot vehicle has to share; it is added here.
        """
        here = np.asarray(mother_m) + gap_m
        speed, davis = self.mother.speed_at(mother_m), vehicle.davis
        running = davis.c0 + (davis.c1 + davis.c2 * self.tunnel.at(here) * speed) * speed
        accel = self.mother.accel_at(mother_m)
        return np.asarray((accel + running + self.resistance.at(here)) / vehicle.epsilon)


def _tunnel_ramp(tunnels: Sequence[Sequence[float]], half_m: float) -> Ramp:
    """The factor on c₂: 1 outside, the tunnel's factor inside, linear across the portals."""
    at, value = [0.0], [1.0]
    end = -math.inf
    for tunnel in tunnels:
        if len(tunnel) != 3 or not end + 2 * half_m <= tunnel[0] < tunnel[1]:
            raise DomainError(
                "tunnels", tunnel, "(from_m, to_m, factor) in order, a transition apart"
            )
        start, end, factor = tunnel
        check_range("tunnel factor", factor, 0.1, 20.0)
        if end - start < 2 * half_m:
            raise DomainError("tunnels", tunnel, f"a tunnel at least {2 * half_m:g} m long")
        at += [start - half_m, start + half_m, end - half_m, end + half_m]
        value += [1.0, factor, factor, 1.0]
    if tunnels:
        at, value = at[1:], value[1:]
    return Ramp(np.array(at, float), np.array(value, float))
