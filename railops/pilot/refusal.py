"""Why a leg cannot be planned: which limit is short, and by how much."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from railops.errors import UnreachableError
from railops.pilot._transcription import RawSolution
from railops.pilot.leg import Leg

Attempt = Callable[[Leg, bool], RawSolution | None]

_SLOWEST_MOTHER_MPS = 1.0


def refuse_early(leg: Leg) -> None:
    """Refuse what can be seen without solving anything.

    Raises:
        UnreachableError: if the mother train stands or is beyond the speed limit on the leg's
            stretch, or the force cannot hold the gap at the fixed end.
    """
    low, high = leg.reach_m
    if high - low < 1.0:
        raise UnreachableError(
            f"the leg starts or ends at {leg.anchor_m:.0f} m, where the trip leaves it "
            f"{max(0.0, high - low):.0f} m",
            "section",
            1.0 - (high - low),
            "m",
        )
    at = np.linspace(low, high, 400)
    mother = leg.route.mother.speed_at(at)
    anchor = float(leg.route.mother.speed_at(leg.anchor_m))
    if anchor < _SLOWEST_MOTHER_MPS:
        raise UnreachableError(
            f"the mother train runs at {anchor:.2f} m/s at {leg.anchor_m:.0f} m; a gap that "
            f"changes with its position needs it to move, at {_SLOWEST_MOTHER_MPS:g} m/s or more",
            "mother speed",
            _SLOWEST_MOTHER_MPS - anchor,
            "m/s",
        )
    over = anchor - leg.speed_limit_mps
    if over > 0.0:
        raise UnreachableError(
            f"the speed limit of {leg.speed_limit_mps:.2f} m/s is below the mother train's "
            f"{anchor:.2f} m/s at {leg.anchor_m:.0f} m, by {over:.2f} m/s",
            "speed limit",
            over,
            "m/s",
        )
    gap = leg.from_gap_m if leg.anchored == "start" else leg.to_gap_m
    if leg.objective.continuous:
        refuse_hold(leg, leg.anchor_m, gap)
    if leg.opens and leg.objective.continuous and mother.min() > leg.speed_limit_mps:
        raise UnreachableError(
            f"the gap cannot open: the speed limit of {leg.speed_limit_mps:.2f} m/s is below the "
            f"mother train's speed on the whole stretch",
            "speed limit",
            float(mother.min()) - leg.speed_limit_mps,
            "m/s",
        )


def refuse_hold(leg: Leg, mother_m: float, gap_m: float) -> None:
    """Refuse a place where the force cannot hold the gap (eq. 20 against eq. 29).

    Raises:
        UnreachableError: with the missing force over mass, m/s².
    """
    vehicle = leg.vehicle
    held = float(leg.route.hold_mps2(vehicle, mother_m, gap_m))
    short = max(held - vehicle.traction_mps2, -vehicle.braking_mps2 - held)
    if short > 1e-9:
        kind, limit = ("traction", vehicle.traction_mps2)
        if held < 0:
            kind, limit = "braking", vehicle.braking_mps2
        raise UnreachableError(
            f"U is too small: holding a gap of {gap_m:.0f} m with the mother train at "
            f"{mother_m:.0f} m takes {abs(held):.3f} m/s² of {kind}, the limit is {limit:.3f} "
            f"m/s², {short:.3f} m/s² short",
            f"{kind} force",
            short,
            "m/s²",
        )


def refuse_unsolved(leg: Leg, attempt: Attempt) -> None:
    """Find the limit that kept the solver from an answer, and refuse with it.

    Args:
        leg: The leg that was not solved.
        attempt: Solves a changed leg, with elastic force limits or not; None if that fails too.

    Raises:
        UnreachableError: always.
    """
    quick = replace(
        leg.objective, energy_weight=0.0, jerk_weight=min(1.0, leg.objective.jerk_weight)
    )
    if leg.objective.jerk == "bounded":
        quick = replace(quick, jerk_weight=leg.objective.jerk_weight)
    asked = leg.length_m if leg.length_m is not None else leg.room_m
    longer = replace(leg, objective=quick, longest_m=4.0 * leg.longest_m, length_m=None)
    freed = attempt(longer, False)
    if freed is not None and freed.guess.length_m > asked * (1.0 + 1e-6):
        need = freed.guess.length_m
        raise UnreachableError(
            f"a gap of {leg.to_gap_m:.0f} m is out of reach within the section: from "
            f"{leg.from_gap_m:.0f} m it takes the mother train at least {need:.0f} m, there are "
            f"{asked:.0f} m, {need - asked:.0f} m short",
            "section",
            need - asked,
            "m",
        )
    pushed = attempt(leg, True)
    if pushed is not None and pushed.excess > 1e-4:
        vehicle = leg.vehicle
        up = pushed.excess * vehicle.traction_mps2
        raise UnreachableError(
            f"U is too small: the leg needs {1.0 + pushed.excess:.2f} times the force limits "
            f"({vehicle.traction_mps2:g} m/s² of traction, {vehicle.braking_mps2:g} m/s² of "
            f"braking), up to {up:.3f} m/s² short",
            "force",
            up,
            "m/s²",
        )
    raise UnreachableError(
        f"no plan was found that changes the gap from {leg.from_gap_m:.0f} m to "
        f"{leg.to_gap_m:.0f} m at {leg.anchor_m:.0f} m within all limits, and neither a longer "
        f"section nor a stronger drive alone makes one appear",
        "all",
        math.nan,
    )
