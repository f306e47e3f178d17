"""The reaction to one situation, and the train stopped when no reaction is good enough."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from railops.braking import Train
from railops.crossing import clonal
from railops.crossing.probability import Approach
from railops.crossing.problem import SLOW_DOWN, ActionRange, Problem, Reaction
from railops.crossing.rules import Crossing, StopCheck, can_stop
from railops.crossing.situation import Situation
from railops.errors import check_range

ACCEPTED_PROBABILITY = 0.005
"""A reaction has to leave less than this; the least improvement the thesis asks of its network."""


class Order(StrEnum):
    """What is to be done."""

    NOTHING = "nothing"
    CHANGE_SPEEDS = "change speeds"
    STOP_TRAIN = "stop train"


@dataclass(frozen=True)
class Decision:
    """What is to be done, and what it rests on.

    Attributes:
        order: The order.
        probability: Collision probability if nobody does anything.
        reaction: The best speed changes found.
        stop: Whether the train can stop before the crossing if braked through the valve now.
        too_late: The train has to stop and cannot: braking only softens the blow.
        reason: Why, in words.
    """

    order: Order
    probability: float
    reaction: Reaction
    stop: StopCheck
    too_late: bool
    reason: str


def react(
    situation: Situation,
    seed: int,
    *,
    actions: ActionRange = SLOW_DOWN,
    crossing: Crossing | None = None,
    train: Train | None = None,
    accepted: float = ACCEPTED_PROBABILITY,
    train_age_s: float = 0.0,
    car_age_s: float = 0.0,
) -> Decision:
    """Find the least speed changes that make the crossing safe; failing that, stop the train.

    The valve sounds for seven seconds before the brakes act; the stop check counts them.

    Args:
        situation: What was measured.
        seed: Seed of the clonal selection.
        actions: Range of the speed changes.
        crossing: Geometry.
        train: The train's brakes and resistance; speed, slope and air come from the situation.
        accepted: Largest collision probability a reaction may leave, in (0, 1].
        train_age_s: Age of the train's report, s.
        car_age_s: Age of the car's report, s.

    Example:
        A car standing on the crossing cannot be helped by speed changes:

        >>> decision = react(Situation(80.0, 0.0, 0, 0, 900.0, -3.0, 20.0, 50.0), seed=1)
        >>> decision.order.value, decision.stop.possible
        ('stop train', True)
    """
    check_range("accepted", accepted, 0.0, 1.0, above=True)
    problem = Problem(
        (Approach(situation.train_distance_m, situation.train_speed_mps, train_age_s),),
        (Approach(situation.car_distance_m, situation.car_speed_mps, car_age_s),),
        actions,
        crossing or Crossing(),
    )
    before = problem.probability_unchanged()
    found = clonal.solve(problem, seed)
    stop = can_stop(situation, train, train_age_s)
    if before < accepted:
        reason = f"collision probability {before:.2g} is below {accepted:g}"
        return Decision(Order.NOTHING, before, found, stop, False, reason)
    if found.probability < accepted:
        reason = f"speed changes lower the collision probability to {found.probability:.2g}"
        return Decision(Order.CHANGE_SPEEDS, before, found, stop, False, reason)
    reason = (
        f"no speed change brings the collision probability below {accepted:g} "
        f"(best {found.probability:.2g})"
    )
    if not stop.possible:
        reason += f"; the stop comes {-stop.spare_m:.0f} m too late"
    return Decision(Order.STOP_TRAIN, before, found, stop, not stop.possible, reason)
