"""When braking had to start: closed form, simulated stops, and what is not known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railops.braking import (
    Brake,
    BrakeMoment,
    Policy,
    RangeMeasurement,
    Train,
    brake_moments,
    decide,
    stopping_distance,
)
from railops.traction import Davis, Line

PLAIN = Train(
    20.0,
    davis=Davis(0.0, 0.0, 0.0),
    speed_error_rel=0.0,
    service=Brake(0.5, 1.0, 0.0),
    emergency=Brake(1.0, 0.0, 0.0),
)
BARE = Policy(stop_error_m=0.0, stop_error_rel=0.0, stand_off_m=0.0, reaction_s=0.0)


def steady(speed_mps, until_s, step_s=0.5, train=PLAIN):
    times = np.arange(0.0, until_s + 1e-9, step_s)
    return [(t, replace(train, speed_mps=speed_mps, position_m=speed_mps * t)) for t in times]


def test_worked_by_hand_with_the_whole_protective_section():
    # Service: 1.1·420 + 3 + 5 + 0.5·20 = 480 m before 900 m: at 420 m, 21 s. Emergency: 238 m.
    policy = Policy(stop_error_m=3.0, stop_error_rel=0.1, stand_off_m=5.0, reaction_s=0.5)
    both = brake_moments(steady(20.0, 44.0), 900.0, policy)
    assert both.service == BrakeMoment("due", pytest.approx(21.0))
    assert both.emergency == BrakeMoment("due", pytest.approx((900.0 - 238.0) / 20.0))


@given(st.floats(3.0, 50.0), st.floats(0.0, 0.2), st.floats(0.0, 3.0), st.floats(0.1, 0.5))
def test_braking_at_the_moment_stops_at_the_place(speed, rel, absolute, step):
    train = replace(Train(speed), speed_error_rel=rel, speed_error_mps=absolute)
    needed = stopping_distance(train, "emergency", train.fastest_mps).distance_m
    place = needed + 3.0 * speed
    ride = steady(speed, 3.0 + needed / speed, step, train)
    moment = brake_moments(ride, place, BARE).emergency
    assert moment.time_s == pytest.approx(3.0, abs=1e-6)
    at = replace(train, position_m=speed * moment.time_s)
    assert at.position_m + stopping_distance(at, "emergency", at.fastest_mps).distance_m == (
        pytest.approx(place, abs=1e-6)
    )


def test_the_decision_turns_to_service_at_that_moment():
    ride = steady(20.0, 40.0, 0.1)
    moment = brake_moments(ride, 800.0, BARE).service
    policy = replace(BARE, range_sigmas=0.0, measurements=1)
    actions = {}
    for time_s, train in ride:
        left = 800.0 - train.position_m
        seen = [RangeMeasurement(time_s, left, 0.0, (left, left))]
        actions.setdefault(decide(seen, train, policy).action, time_s)
    assert actions["service"] == pytest.approx(moment.time_s, abs=0.11)


def test_a_train_that_slows_in_time_never_had_to_brake_harder():
    # It halves its speed 300 m before the place: the need falls below what is left again.
    ride = steady(20.0, 25.0)
    ride += [
        (25.5 + 0.5 * i, replace(PLAIN, speed_mps=5.0, position_m=500.0 + 2.5 * i))
        for i in range(60)
    ]
    both = brake_moments(ride, 800.0, BARE)
    assert both.service == BrakeMoment("not due")
    assert both.emergency == BrakeMoment("not due")
    assert brake_moments(ride[:50], 800.0, BARE).service.state == "due"


def test_what_cannot_be_said_is_said():
    ride = steady(20.0, 20.0)
    assert brake_moments(ride, 410.0, BARE).service.state == "before"
    assert brake_moments([], 410.0, BARE).service.state == "unknown"
    gap = [*ride[:30], (15.0, None), *ride[31:]]
    both = brake_moments(gap, 590.0, BARE)
    assert both.service.state == "unknown"
    assert both.emergency == BrakeMoment("due", pytest.approx(19.5))
    steep = [(t, replace(one, line=Line.uniform(-0.3))) for t, one in ride]
    assert brake_moments(steep, 410.0, BARE).emergency.state == "cannot stop"


@given(st.floats(1.0, 40.0), st.floats(0.0, 600.0), st.floats(0.0, 5.0))
def test_service_is_due_first_and_a_faster_train_earlier(speed, spare, error):
    slow = steady(speed, 60.0, 2.0, Train(speed))
    wide = [(t, replace(train, speed_error_mps=error)) for t, train in slow]
    place = 60.0 * speed + spare
    order = {"before": -1.0, "not due": 1e9}
    for ride in (slow, wide):
        both = brake_moments(ride, place, Policy())
        first, second = (
            one.time_s if one.time_s is not None else order[one.state]
            for one in (both.service, both.emergency)
        )
        assert first <= second
    one, two = (brake_moments(ride, place, Policy()).service for ride in (slow, wide))
    assert (two.time_s if two.time_s is not None else order[two.state]) <= (
        one.time_s if one.time_s is not None else order[one.state]
    ) + 1e-9


def test_unknown_speed_takes_the_cautious_branch():
    far = [RangeMeasurement(0.0, 5000.0, 1.0, (4998.0, 5002.0))]
    assert decide(far, PLAIN, replace(BARE, measurements=1)).action == "none"
    advice = decide(far, PLAIN, replace(BARE, measurements=1), speed_unknown=True)
    assert advice.action == "service"
    assert advice.reason.startswith("the train's speed is unknown: at least service")
    near = [RangeMeasurement(0.0, 50.0, 1.0, (48.0, 52.0))]
    assert decide(near, PLAIN, BARE, speed_unknown=True).action == "emergency"


def test_an_absolute_speed_error_makes_the_train_faster():
    assert replace(PLAIN, speed_error_rel=0.1, speed_error_mps=1.5).fastest_mps == 23.5
    standing = replace(PLAIN, speed_mps=0.0, speed_error_mps=2.0)
    seen = [RangeMeasurement(0.0, 1.0, 0.1, (0.8, 1.2))]
    assert decide(seen, standing, BARE).action == "emergency"
