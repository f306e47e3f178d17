"""When vehicles reach the crossing, whether it is clear in time, and whether the train can stop.

Times come from straight-line prediction (distance over present speed): they say what happens if
nobody does anything, which is the question an alarm has to answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from railops.braking import Train, stopping_distance
from railops.crossing.situation import Situation
from railops.errors import CannotStopError, check_range
from railops.traction import Adhesion, Line

VALVE_S = 7.0
"""The electro-pneumatic valve sounds for seven seconds before the brakes act (chapter 3)."""

TRACK_SPACING_M = 4.1
"""Usual distance between the centres of neighbouring main tracks, m."""

CLEAR_BEFORE_S = 35.0
"""The crossing has to be clear this long before the train arrives (chapter 1)."""


@dataclass(frozen=True)
class Crossing:
    """Geometry of one crossing and its rule; the defaults are a single track and a passenger car.

    Attributes:
        tracks: Number of tracks, >= 1.
        zone_m: Length of road inside one track's clearance profile, m; as long along the rail.
        car_length_m: Length of a road vehicle, m.
        lead_m: Length of train that counts as striking a road user, m. Whoever reaches the
            crossing after that sees the train standing across the road; 11 m is calibrated to
            the published probabilities (see :mod:`railops.crossing.probability`).
        clear_before_s: The crossing must be clear this long before the train, s.
    """

    tracks: int = 1
    zone_m: float = 5.0
    car_length_m: float = 4.5
    lead_m: float = 11.0
    clear_before_s: float = CLEAR_BEFORE_S

    def __post_init__(self) -> None:
        hint = "a crossing without a track is a road"
        check_range("tracks", self.tracks, 1, 20, hint=hint)
        check_range("zone_m", self.zone_m, 1.0, 100.0, "m")
        check_range("car_length_m", self.car_length_m, 1.0, 40.0, "m")
        check_range("lead_m", self.lead_m, 0.0, 2000.0, "m")
        check_range("clear_before_s", self.clear_before_s, 0.0, 300.0, "s")

    @property
    def car_occupies_m(self) -> float:
        """What a car runs from reaching the first track until its rear has left the last, m."""
        return self.zone_m + (self.tracks - 1) * TRACK_SPACING_M + self.car_length_m

    @property
    def train_occupies_m(self) -> float:
        """What the train runs from reaching the road until it counts as blocking it, m."""
        return self.zone_m + self.lead_m


def time_to_rendezvous_s(distance_m: float, speed_mps: float) -> float:
    """Time until a vehicle's front reaches the crossing, s; 0 once there, inf if it stands before.

    Example:
        >>> time_to_rendezvous_s(1000.0, 20.0)
        50.0
    """
    if distance_m <= 0.0:
        return 0.0
    return distance_m / speed_mps if speed_mps > 0.0 else math.inf


def time_to_clear_s(distance_m: float, length_m: float, speed_mps: float) -> float:
    """Time until the rear has left, s, with ``length_m`` of vehicle and zone behind the front."""
    return time_to_rendezvous_s(distance_m + length_m, speed_mps)


@dataclass(frozen=True)
class Clearance:
    """How a situation stands against the rule.

    Attributes:
        train_arrives_s: Until the train's front reaches the crossing, s (inf: it does not).
        car_arrives_s: Until the car's front reaches it, s.
        car_clears_s: Until the car's rear has left it, s.
        margin_s: From the car leaving to the train arriving, s; negative: they overlap or the car
            comes later; inf where the train does not come.
        kept: Whether the rule is kept.
        reason: Why, in words.
    """

    train_arrives_s: float
    car_arrives_s: float
    car_clears_s: float
    margin_s: float
    kept: bool
    reason: str


def clearance(
    situation: Situation, crossing: Crossing | None = None, train_length_m: float = 200.0
) -> Clearance:
    """Judge one situation by the rule "the crossing is clear 35 s before the train".

    Args:
        situation: What was measured.
        crossing: Geometry and rule.
        train_length_m: Length of the train, m; a car may follow once its rear has passed.

    Example:
        The thesis's first example: the last car is still on the crossing 25 s before the train.

        >>> late = clearance(Situation(72.0, 18.0, 0, 0, 500.0, -9.0, 20.0, 50.0))
        >>> late.kept, late.reason
        (False, 'the crossing is clear only 24.9 s before the train, 35 s are required')
    """
    place = crossing or Crossing()
    check_range("train_length_m", train_length_m, 0.0, 2000.0, "m")
    train_v, car_v = situation.train_speed_mps, situation.car_speed_mps
    train_d, car_d = situation.train_distance_m, situation.car_distance_m
    train_at = time_to_rendezvous_s(train_d, train_v)
    train_gone = time_to_clear_s(train_d, place.zone_m + train_length_m, train_v)
    car_at = time_to_rendezvous_s(car_d, car_v)
    car_gone = time_to_clear_s(car_d, place.car_occupies_m, car_v)
    margin = train_at - car_gone if math.isfinite(train_at) else math.inf
    kept, reason = False, ""
    if train_gone == 0.0:
        kept, reason = True, "the train has passed"
    elif car_gone == 0.0:
        kept, reason = True, "the car has passed"
    elif math.isinf(train_at):
        kept, reason = True, "the train stands before the crossing"
    elif car_at >= train_gone:
        kept, reason = True, "the car reaches the crossing after the train has left it"
    elif margin >= place.clear_before_s:
        kept, reason = True, f"the crossing is clear {margin:.1f} s before the train"
    elif math.isinf(car_gone):
        reason = "a car stands on the crossing and the train is coming"
    elif margin >= 0.0:
        reason = (
            f"the crossing is clear only {margin:.1f} s before the train, "
            f"{place.clear_before_s:g} s are required"
        )
    else:
        reason = "train and car are on the crossing at the same time"
    return Clearance(train_at, car_at, car_gone, margin, kept, reason)


def adhesion_of(situation: Situation) -> Adhesion:
    """Rail condition assumed from the air: damp (from 90 %) or freezing rails count as wet.

    A cautious assumption, not a measurement: factor 0.6 instead of 1.
    """
    damp = situation.humidity_percent >= 90.0 or situation.air_temperature_c <= 0.0
    return Adhesion(factor=0.6 if damp else 1.0)


def with_valve(train: Train) -> Train:
    """The train whose emergency brake is released through the valve: seven more seconds' delay."""
    brake = train.emergency
    return replace(train, emergency=replace(brake, delay_s=brake.delay_s + VALVE_S))


@dataclass(frozen=True)
class StopCheck:
    """Whether the train can still be stopped before the crossing.

    Attributes:
        distance_m: From the front to the crossing, m.
        stopping_m: Distance the stop takes, valve included, m; inf if brake and adhesion do not
            hold the train.
        spare_m: What is left before the crossing, m; negative: it does not stop in time.
        possible: Whether the train stands before the crossing.
    """

    distance_m: float
    stopping_m: float
    spare_m: float = field(init=False)
    possible: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "spare_m", self.distance_m - self.stopping_m)
        object.__setattr__(self, "possible", self.spare_m >= 0.0)


def can_stop(situation: Situation, train: Train | None = None, age_s: float = 0.0) -> StopCheck:
    """Whether the train, braked through the valve now, stands before the crossing.

    Slope and air come from the situation, the rest from ``train`` (default: a suburban multiple
    unit); the motion is the shared traction model's. The stop is reckoned from the largest speed
    the measurement allows, and from where the train is by now if its report is ``age_s`` old.

    Example:
        >>> check = can_stop(Situation(80.0, 40.0, 0.0, 0.0, 1000.0, 500.0, 20.0, 50.0))
        >>> check.possible, round(check.stopping_m)
        (True, 478)
    """
    base = train or Train(0.0)
    here = replace(
        base,
        speed_mps=situation.train_speed_mps,
        position_m=0.0,
        line=Line.uniform(situation.rail_slope_percent / 100.0),
        adhesion=adhesion_of(situation),
    )
    try:
        needed = stopping_distance(with_valve(here), speed_mps=here.fastest_mps).distance_m
    except CannotStopError:
        needed = math.inf
    check_range("age_s", age_s, 0.0, 600.0, "s")
    return StopCheck(situation.train_distance_m - age_s * here.fastest_mps, needed)
