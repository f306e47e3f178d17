"""The train and its stop: closed forms, an independent integration, files, bad input."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from railops.braking import Brake, Train, stopping_distance
from railops.errors import CannotStopError, DomainError, FileError
from railops.traction import Adhesion, Davis, Line, build_up, line_resistance

FREE = Davis(0.0, 0.0, 0.0)
HILLY = Line(
    ((0.0, 0.0), (50.0, -0.015), (180.0, 0.01), (320.0, -0.02), (600.0, 0.0)),
    ((0.0, math.inf), (100.0, 400.0), (300.0, math.inf)),
)


@pytest.mark.parametrize(
    ("speed", "decel", "delay", "ramp"),
    [(20.0, 1.0, 0.0, 0.0), (20.0, 1.0, 1.3, 0.0), (33.0, 0.7, 0.6, 1.5), (5.0, 1.1, 0.4, 3.0)],
)
def test_closed_form_without_resistance(speed, decel, delay, ramp):
    # Ramp: v falls by b·T/2 over v·T − b·T²/6 metres; then v²/(2·b).
    after = speed - decel * ramp / 2
    expected = speed * delay + speed * ramp - decel * ramp**2 / 6 + after**2 / (2 * decel)
    train = Train(speed, davis=FREE, emergency=Brake(decel, delay, ramp))
    stop = stopping_distance(train)
    assert stop.distance_m == pytest.approx(expected, abs=1e-6)
    assert stop.time_s == pytest.approx(delay + ramp + after / decel, abs=1e-6)


def test_closed_form_with_quadratic_resistance():
    # dv/dt = −(b + c2·v²): s = ln(1 + c2·v²/b) / (2·c2).
    c2, decel, speed = 1e-3, 0.8, 40.0
    train = Train(speed, davis=Davis(0, 0, c2), rotating=0.0, emergency=Brake(decel, 0.0, 0.0))
    expected = math.log(1 + c2 * speed**2 / decel) / (2 * c2)
    assert stopping_distance(train).distance_m == pytest.approx(expected, abs=1e-4)


def test_gradient_shifts_the_deceleration():
    train = Train(20.0, davis=FREE, rotating=0.0, emergency=Brake(1.0, 0.0, 0.0))
    pull = 9.80665 * math.sin(math.atan(0.02))
    down = stopping_distance(replace(train, line=Line.uniform(-0.02)))
    assert down.distance_m == pytest.approx(200.0 / (1.0 - pull), abs=1e-6)


def independent(train, brake, speed):
    """The same physics by another integrator with an event at standstill."""
    table = train.line.table(train.length_m)
    davis = train.davis

    def derivative(time, state):
        v = max(state[1], 0.0)
        b = np.interp(v, *brake.table) * build_up(time, brake.delay_s, brake.build_up_s)
        b = min(b, train.adhesion.limit_mps2(v))
        w = line_resistance(train.position_m + state[0], *table)
        r = davis.c0 + davis.c1 * v + davis.c2 * v * v
        return [state[1], -b - (r + w) / (1 + train.rotating)]

    def stands(time, state):
        return state[1]

    stands.terminal = True
    result = solve_ivp(
        derivative, (0, 600), [0.0, speed], "DOP853", max_step=0.02, rtol=1e-9, events=stands
    )
    return result.y[0, -1]


def euler(train, speed, step):
    """A plain explicit Euler loop, the usual way of doing it."""
    table, brake, davis = train.line.table(train.length_m), train.emergency, train.davis
    s, v, t = 0.0, speed, 0.0
    while v > 0:
        b = np.interp(v, *brake.table) * build_up(t, brake.delay_s, brake.build_up_s)
        b = min(b, train.adhesion.limit_mps2(v))
        w = line_resistance(train.position_m + s, *table)
        r = davis.c0 + davis.c1 * v + davis.c2 * v * v
        s += v * step
        v -= step * (b + (r + w) / (1 + train.rotating))
        t += step
    return s


@pytest.mark.parametrize("speed", [8.0, 22.0, 38.0])
def test_against_an_independent_integration(speed):
    brake = Brake(((0.0, 1.1), (15.0, 1.0), (30.0, 0.85)), 0.7, 1.4)
    train = Train(speed, line=HILLY, length_m=120.0, adhesion=Adhesion(0.45), emergency=brake)
    truth = independent(train, brake, speed)
    error = abs(stopping_distance(train).distance_m - truth)
    assert error < 0.02
    # "As accurate as dt = 0.05 s": at least five times better than Euler with that step.
    assert error < abs(euler(train, speed, 0.05) - truth) / 5


@settings(max_examples=200, deadline=None)
@given(st.floats(0.1, 70.0), st.floats(0.0, 5.0), st.floats(0.5, 1.5), st.floats(0.0, 3.0))
def test_distance_rises_with_speed_and_delay_and_falls_with_the_brake(speed, more, decel, delay):
    train = Train(speed, line=HILLY, emergency=Brake(decel, delay, 1.0))
    base = stopping_distance(train).distance_m
    assert stopping_distance(train, speed_mps=speed + more).distance_m >= base - 1e-3
    assert stopping_distance(train, Brake(decel, delay + more, 1.0)).distance_m >= base - 1e-3
    assert stopping_distance(train, Brake(decel + more / 5, delay, 1.0)).distance_m <= base + 1e-3


def test_low_speed_stops_before_the_brake_bites():
    uphill = Train(0.5, line=Line.uniform(0.03), emergency=Brake(1.0, 20.0, 1.0))
    assert 0 < stopping_distance(uphill).distance_m < 0.6
    assert stopping_distance(Train(0.0)).distance_m == 0.0


def test_runs_over_a_short_steep_descent_but_stops_after_it():
    # Adhesion cannot hold it on the first 100 m, and can afterwards.
    line = Line(((0.0, -0.25), (100.0, 0.0)))
    train = Train(10.0, line=line, length_m=1.0, adhesion=Adhesion(0.5))
    assert stopping_distance(train).distance_m > 100.0


def test_runaway_says_why():
    train = Train(10.0, line=Line.uniform(-0.06), adhesion=Adhesion(0.2))
    message = r"cannot stop: the gradient pulls it with up to 0.554 m/s².*factor 0.2.*runs away"
    with pytest.raises(CannotStopError, match=message):
        stopping_distance(train)


def test_train_file_round_trip(tmp_path):
    train = Train(
        25.0,
        line=HILLY,
        davis=Davis(0.01, 1e-4, 2e-5),
        emergency=Brake(((0.0, 1.2), (30.0, 0.9)), 0.5, 1.0),
    )
    train.save(tmp_path / "train.yaml")
    assert Train.load(tmp_path / "train.yaml") == train
    assert Train.load(tmp_path / "train.yaml", speed_mps=7.0).speed_mps == 7.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed_mps: 10\nwheels: 4", r"unknown keys \['wheels'\]; known: \['speed_mps'"),
        ("length_m: 100", r"has no speed_mps, and no speed was given"),
        ("- 1", r"must hold a mapping"),
        ("speed_mps: 10\nservice: 1.0", r"service: Brake must be a mapping"),
        ("speed_mps: 10\nservice: {decel_mps2: 1.0}", r"service is incomplete"),
        ("speed_mps: [", r"cannot read train file"),
    ],
)
def test_bad_train_files(tmp_path, text, message):
    path = tmp_path / "train.yaml"
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        Train.load(path)
    with pytest.raises(FileError, match="cannot read train file"):
        Train.load(tmp_path / "missing.yaml")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Train(200.0), r"speed_mps is 200.0 m/s; .*\[0, 150\] m/s \(.*100 km/h is 27.8"),
        (lambda: Train(-1.0), r"speed_mps is -1.0 m/s"),
        (lambda: Train(math.nan), r"speed_mps is nan m/s"),
        (lambda: Brake(0.0, 0, 0), r"decel_mps2 is 0.0 m/s².*cannot stop the train"),
        (lambda: Brake(((5.0, 1.0), (5.0, 1.0)), 0, 0), r"pairs with increasing speeds in m/s"),
        (lambda: Brake("hard", 0, 0), r"decel_mps2 is hard; expected a number in m/s² or"),
        (lambda: Brake(1.0, -1, 0), r"delay_s is -1 s; expected a number in \[0, 60\] s"),
        (lambda: stopping_distance(Train(1.0), step_s=0.0), r"step_s is 0.0 s"),
        (lambda: stopping_distance(Train(1.0), speed_mps=math.inf), r"speed_mps is inf m/s"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()
