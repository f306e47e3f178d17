"""One leg: the mother train's section over which the gap opens or closes, eqs. 21–38."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from railops.errors import DomainError, check_range
from railops.pilot.route import Route
from railops.pilot.vehicle import PilotVehicle

Energy = Literal["signed", "absolute", "squared", "traction"]
Jerk = Literal["total", "worst", "bounded"]


@dataclass(frozen=True)
class Objective:
    """What a leg minimises: p′ + λ₁·energy + λ₂·jerk, in the paper's units (m, N, kg).

    Energy, ∫ over the leg of the power u·v over the mother train's speed v_m:

    * ``signed``: u·v/v_m, so braking gives energy back. This is what reproduces Table II.
    * ``absolute``: the size of u·v/v_m, eq. 5.
    * ``squared``: (u·v/v_m)², eqs. 21 and 30 as printed.
    * ``traction``: max(0, u·v/v_m), braking by friction.

    Jerk:

    * ``total``: (1/m)·∫ (du/dp_m)² dp_m, eqs. 21 and 30.
    * ``worst``: the largest (1/m)·(du/dp_m)², Appendix A eqs. 11–20 (there over time; over
      position, as eq. 21, is what the authors' published solution shows).
    * ``bounded``: no cost, but du/dt over m within ±``jerk_limit_mps3``, Appendix A eqs. 21–23.

    Attributes:
        energy: Which energy.
        energy_weight: λ₁.
        jerk: Which jerk.
        jerk_weight: λ₂; not used with ``bounded``.
        jerk_limit_mps3: θ, m/s³; used with ``bounded`` only.
        continuous: Whether u joins the force before and after the leg, eqs. 27, 28, 36, 37.
        alpha_near: α of the constraint at the smaller gap x₀ (α₁), m/s⁴.
        alpha_far: α of the constraint at the larger gap x_max (α₂), m/s⁴.
    """

    energy: Energy = "signed"
    energy_weight: float = 1.0
    jerk: Jerk = "total"
    jerk_weight: float = 1e4
    jerk_limit_mps3: float = 0.5
    continuous: bool = True
    alpha_near: float = 1.0
    alpha_far: float = 1.0

    def __post_init__(self) -> None:
        for name, known in (
            ("energy", ("signed", "absolute", "squared", "traction")),
            ("jerk", ("total", "worst", "bounded")),
        ):
            if getattr(self, name) not in known:
                raise DomainError(name, repr(getattr(self, name)), f"one of {list(known)}")
        check_range("energy_weight", self.energy_weight, 0.0, 1e6)
        check_range("jerk_weight", self.jerk_weight, 0.0, 1e12)
        check_range("jerk_limit_mps3", self.jerk_limit_mps3, 0.0, 100.0, "m/s³", above=True)
        check_range("alpha_near", self.alpha_near, 0.0, 1e6, above=True)
        check_range("alpha_far", self.alpha_far, 0.0, 1e6, above=True)


@dataclass(frozen=True)
class Leg:
    """One change of the gap between the mother train and the pilot vehicle.

    Attributes:
        route: The trip it belongs to.
        vehicle: The pilot vehicle.
        from_gap_m: Gap x at the start, metres, >= 0.
        to_gap_m: Gap at the end, metres, >= 0.
        anchor_m: Mother-train position at which the leg starts (p_m^s), or ends (p_m^e).
        anchored: Which end is fixed there; the other one is free.
        longest_m: Length the leg may have at most, metres (Table I: 6 km).
        length_m: Length the leg must have, metres; default: as short as the objective likes.
        relative_speed_mps: How much faster than the mother train at most, v_max^Δ, m/s.
        speed_limit_mps: Speed the pilot vehicle may have at most, m/s.
        objective: What to minimise.
    """

    route: Route
    vehicle: PilotVehicle = field(default_factory=PilotVehicle)
    from_gap_m: float = 100.0
    to_gap_m: float = 1500.0
    anchor_m: float = 15e3
    anchored: Literal["start", "end"] = "start"
    longest_m: float = 6000.0
    length_m: float | None = None
    relative_speed_mps: float = 10.0
    speed_limit_mps: float = math.inf
    objective: Objective = field(default_factory=Objective)

    def __post_init__(self) -> None:
        check_range("from_gap_m", self.from_gap_m, 0.0, 1e5, "m")
        check_range("to_gap_m", self.to_gap_m, 0.0, 1e5, "m")
        if abs(self.to_gap_m - self.from_gap_m) < 1.0:
            raise DomainError(
                "to_gap_m", f"{self.to_gap_m:g} m", "a gap at least 1 m from from_gap_m"
            )
        check_range("anchor_m", self.anchor_m, unit="m")
        check_range("longest_m", self.longest_m, 0.0, 1e6, "m", above=True)
        if self.length_m is not None:
            check_range("length_m", self.length_m, 0.0, self.longest_m, "m", above=True)
        check_range("relative_speed_mps", self.relative_speed_mps, 0.0, 100.0, "m/s", above=True)
        if not self.speed_limit_mps > 0.0:
            raise DomainError("speed_limit_mps", f"{self.speed_limit_mps} m/s", "above 0 m/s")
        if self.anchored not in ("start", "end"):
            raise DomainError("anchored", repr(self.anchored), "'start' or 'end'")

    @staticmethod
    def paper_acceleration() -> Leg:
        """Eqs. 21–29 with Table I."""
        return Leg(Route.paper())

    @staticmethod
    def paper_deceleration() -> Leg:
        """Eqs. 30–38 with Table I."""
        return Leg(Route.paper(), from_gap_m=1500.0, to_gap_m=100.0, anchor_m=285e3, anchored="end")

    @property
    def opens(self) -> bool:
        """Whether the gap grows."""
        return self.to_gap_m > self.from_gap_m

    @property
    def room_m(self) -> float:
        """The longest the leg can be: ``longest_m``, or what the trip leaves of it, metres."""
        first, *_, last = self.route.mother.position_m
        left = last - self.anchor_m if self.anchored == "start" else self.anchor_m - first
        return min(self.longest_m, left)

    @property
    def reach_m(self) -> tuple[float, float]:
        """The stretch the mother train may be on during the leg, metres."""
        if self.anchored == "start":
            return self.anchor_m, self.anchor_m + self.room_m
        return self.anchor_m - self.room_m, self.anchor_m

    def position_m(self, share: Any, length_m: Any) -> Any:
        """Mother-train positions at shares of the leg's length, arrays or CasADi expressions."""
        if self.anchored == "start":
            return self.anchor_m + length_m * share
        return self.anchor_m - length_m * (1.0 - share)
