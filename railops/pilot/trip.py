"""The whole trip as in the paper's Fig. 6: hold, open the gap, hold, close it, hold."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from railops.errors import UnreachableError
from railops.pilot.leg import Leg, Objective
from railops.pilot.plan import DEFAULT_MESH, LegPlan, Mesh, Tolerance, plan_leg
from railops.pilot.reference import Reference
from railops.pilot.route import Route
from railops.pilot.vehicle import PilotVehicle

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trip:
    """A trip between two stations; the defaults are the paper's Table I.

    Attributes:
        route: Mother train, line, tunnels.
        vehicle: The pilot vehicle.
        near_gap_m: x₀, the gap near stations, metres.
        far_gap_m: x_max, the gap under way, metres.
        open_from_m: p_m^s, where the gap starts to open.
        close_until_m: p_m^e, where it is closed again.
        longest_m: Length either leg may have at most, metres.
        relative_speed_mps: v_max^Δ, m/s.
        speed_limit_mps: Speed the pilot vehicle may have at most, m/s.
        safe_gap_m: x_s, the emergency stopping distance the far gap must exceed, metres.
        objective: What the legs minimise.
    """

    route: Route = field(default_factory=Route.paper)
    vehicle: PilotVehicle = field(default_factory=PilotVehicle)
    near_gap_m: float = 100.0
    far_gap_m: float = 1500.0
    open_from_m: float = 15e3
    close_until_m: float = 285e3
    longest_m: float = 6000.0
    relative_speed_mps: float = 10.0
    speed_limit_mps: float = math.inf
    safe_gap_m: float = 800.0
    objective: Objective = field(default_factory=Objective)

    @property
    def opening(self) -> Leg:
        """The leg that opens the gap."""
        return Leg(
            self.route,
            self.vehicle,
            self.near_gap_m,
            self.far_gap_m,
            self.open_from_m,
            "start",
            self.longest_m,
            None,
            self.relative_speed_mps,
            self.speed_limit_mps,
            self.objective,
        )

    @property
    def closing(self) -> Leg:
        """The leg that closes it."""
        return replace(
            self.opening,
            from_gap_m=self.far_gap_m,
            to_gap_m=self.near_gap_m,
            anchor_m=self.close_until_m,
            anchored="end",
        )


@dataclass(frozen=True)
class TripPlan:
    """A planned trip: two legs, and the gap held before, between and after them."""

    trip: Trip
    opening: LegPlan
    closing: LegPlan

    @property
    def reference(self) -> Reference:
        """x_ref over the whole trip."""
        return Reference.joined([self.opening.reference, self.closing.reference])

    def force_mps2(self, position_m: Array) -> Array:
        """The planned force over mass u*/m anywhere on the trip (eq. 19 outside the legs)."""
        trip = self.trip
        gap, slope, bend = self.reference.at(position_m)
        mother = trip.route.mother
        speed, accel = mother.speed_at(position_m), mother.accel_at(position_m)
        own, here, davis = speed * (1.0 + slope), position_m + gap, trip.vehicle.davis
        running = davis.c0 + (davis.c1 + davis.c2 * trip.route.tunnel.at(here) * own) * own
        total = bend * speed**2 + (1.0 + slope) * accel + running + trip.route.resistance.at(here)
        return np.asarray(total / trip.vehicle.epsilon)


def plan_trip(
    trip: Trip,
    mesh: Mesh = DEFAULT_MESH,
    *,
    tolerance: Tolerance | None = None,
) -> TripPlan:
    """Plan both legs and check the stretches between them.

    Raises:
        UnreachableError: if a leg cannot be planned, the far gap is not beyond the safe one, the
            legs overlap, or the force cannot hold the gap somewhere.
    """
    if trip.far_gap_m <= trip.safe_gap_m:
        raise UnreachableError(
            f"a gap of {trip.far_gap_m:.0f} m does not exceed the mother train's emergency "
            f"stopping distance of {trip.safe_gap_m:.0f} m, by "
            f"{trip.safe_gap_m - trip.far_gap_m:.0f} m",
            "safe gap",
            trip.safe_gap_m - trip.far_gap_m,
            "m",
        )
    opening = plan_leg(trip.opening, mesh, tolerance=tolerance)
    closing = plan_leg(trip.closing, mesh, tolerance=tolerance)
    overlap = opening.span_m[1] - closing.span_m[0]
    if overlap > 0.0:
        raise UnreachableError(
            f"the trip is too short: the gap is open at {opening.span_m[1]:.0f} m but has to start "
            f"closing at {closing.span_m[0]:.0f} m, {overlap:.0f} m earlier",
            "section",
            overlap,
            "m",
        )
    plan = TripPlan(trip, opening, closing)
    first, *_, last = trip.route.mother.position_m
    at = np.arange(first, last, 25.0)
    held = (at < opening.span_m[0]) | (at > closing.span_m[1])
    held |= (at > opening.span_m[1]) & (at < closing.span_m[0])
    _check_hold(trip, at[held], plan.force_mps2(at[held]))
    return plan


def _check_hold(trip: Trip, at: Array, force: Array) -> None:
    """Refuse a trip on which the gap cannot be held somewhere between the legs."""
    low, high = trip.vehicle.available_mps2
    excess = np.maximum(force - high, low - force)
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        kind = "traction" if force[worst] > 0.0 else "braking"
        limit = high if force[worst] > 0.0 else -low
        raise UnreachableError(
            f"U is too small: following the mother train at {at[worst]:.0f} m takes "
            f"{abs(force[worst]):.3f} m/s² of {kind}, {limit:.3f} m/s² are available, "
            f"{excess[worst]:.3f} m/s² short",
            f"{kind} force",
            float(excess[worst]),
            "m/s²",
        )
