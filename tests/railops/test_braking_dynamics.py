"""Target-braking controllers and trains of several vehicles."""

import math
from dataclasses import replace

import numpy as np
import pytest

from railops.braking import Brake, Train, stopping_distance
from railops.braking.target import Controller, stopping_errors, suburban
from railops.braking.vehicles import Consist, stop_consist
from railops.errors import CannotStopError, DomainError
from railops.traction import Adhesion, Davis, Line

# SIL-4 paper: ranges of the stopping error over 200 runs, metres.
PAPER = {"acceleration": (-3.0, 1.5), "speed": (-2.0, 3.5)}


@pytest.mark.parametrize("kind", PAPER)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_error_ranges_of_the_paper_within_a_metre(kind, seed):
    errors = stopping_errors(suburban(kind), Train(20.0), 200, seed)
    low, high = PAPER[kind]
    assert errors.min() == pytest.approx(low, abs=1.0)
    assert errors.max() == pytest.approx(high, abs=1.0)


@pytest.mark.parametrize("kind", PAPER)
def test_without_disturbances_there_is_no_error(kind):
    exact = replace(suburban(kind), speed_error_rel=0.0, resistance_std=0.0)
    assert np.abs(stopping_errors(exact, Train(20.0), 5, 1)).max() == 0.0


@pytest.mark.parametrize("kind", PAPER)
def test_underestimated_speed_overruns(kind):
    """The sign convention: negative is an overrun, and seeing too low a speed causes it."""
    errors = stopping_errors(replace(suburban(kind), resistance_std=0.0), Train(20.0), 300, 4)
    speed_errors = 0.1 * (2 * np.random.default_rng(4).random(300) - 1)
    assert np.corrcoef(errors, speed_errors)[0, 1] > 0.8
    assert (errors[speed_errors < -0.05] < 0).all()


def test_controller_reproduces_from_its_seed():
    runs = [stopping_errors(suburban("speed"), Train(20.0), 20, 9) for _ in range(2)]
    assert np.array_equal(*runs)


HILLY = Line(((0.0, 0.0), (120.0, -0.015), (300.0, 0.01)))


@pytest.mark.parametrize("line", [Line(), HILLY])
def test_a_stiff_train_moves_like_the_point_mass(line):
    train = Train(18.0, line=line, length_m=150.0, emergency=Brake(1.0, 0.4, 1.2))
    stop = stop_consist(train, Consist(vehicles=6, stiffness_n_per_m=5e8, damping_ns_per_m=2e6))
    assert stop.distance_m == pytest.approx(stopping_distance(train).distance_m, abs=0.3)


def test_one_vehicle_is_the_point_mass():
    train = Train(18.0, davis=Davis(0.02, 1e-4, 1e-5))
    assert stop_consist(train, Consist(vehicles=1)).distance_m == pytest.approx(
        stopping_distance(train).distance_m, abs=0.02
    )


def test_isolated_brakes_lengthen_the_stop_by_their_share():
    train = Train(15.0, davis=Davis(0, 0, 0), rotating=0.0, emergency=Brake(1.0, 0.0, 0.0))
    stop = stop_consist(train, Consist(vehicles=10, isolated=(3, 7)))
    assert stop.distance_m == pytest.approx(15.0**2 / (2 * 0.8), rel=0.01)


def test_a_slow_command_compresses_the_train():
    train = Train(20.0, length_m=400.0)
    quick = stop_consist(train, Consist(vehicles=20))
    slow = stop_consist(train, Consist(vehicles=20, wave_mps=250.0, slack_m=0.02))
    assert slow.largest_push_n.max() > 2 * quick.largest_push_n.max() + 1e4
    # The mean command delay is half of 400 m / 250 m/s; the train runs on that long.
    assert slow.distance_m - quick.distance_m == pytest.approx(20.0 * 0.8, rel=0.15)


def test_coupler_force_by_hand():
    # Two vehicles of 1000 kg each, only the rear one braked with 1 m/s² (free of resistance):
    # the train slows with 0.5 m/s², and the coupler pulls the front back with 500 N.
    train = Train(
        10.0,
        mass_kg=2000.0,
        length_m=40.0,
        davis=Davis(0, 0, 0),
        rotating=0.0,
        emergency=Brake(1.0, 0.0, 8.0),
    )
    stop = stop_consist(train, Consist(2, 1e6, 1e5, isolated=(0,)))
    assert stop.largest_pull_n[0] == pytest.approx(500.0, rel=0.05)


def test_runaway_train_of_vehicles():
    train = Train(10.0, line=Line.uniform(-0.06), adhesion=Adhesion(0.2))
    with pytest.raises(CannotStopError, match="runs away"):
        stop_consist(train, Consist(vehicles=2))
    assert stop_consist(replace(train, speed_mps=0.0), Consist()).distance_m == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Controller("feeling", 0.7, 1, 0.5), r"kind is feeling; expected 'acceleration'"),
        (lambda: Controller("speed", 0.0, 1, 0.5), r"decel_mps2 is 0.0 m/s²"),
        (lambda: stopping_errors(suburban("speed"), Train(20.0), 0, 1), r"runs is 0"),
        (lambda: Consist(vehicles=0), r"vehicles is 0"),
        (
            lambda: stop_consist(Train(5.0, mass_kg=100.0), Consist()),
            r"couplers whose motion steps of 0.001 s resolve for vehicles of 10 kg",
        ),
        (lambda: Consist(wave_mps=math.nan), r"wave_mps is nan m/s"),
        (lambda: Consist(vehicles=3, isolated=(3,)), r"isolated is 3; expected .* \[0, 2\]"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()
