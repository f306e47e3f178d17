"""Several measurements and channels: the paper's examples, common cause, curves, bad input."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from railops.braking.channels import (
    Channel,
    joint_exceedance,
    measurements_needed,
    plan,
    sight_distance_m,
    tries_needed,
)
from railops.errors import DomainError, EvidenceError
from railops.traction import Line


@pytest.mark.parametrize(
    ("p", "k", "c", "joint"),
    [
        (1e-2, 2, 0.0, 1e-4),  # SIL-4 paper, section on the smallest of k
        (1e-2, 3, 0.0, 1e-6),  # its worked example
        (1e-2, 4, 0.0, 1e-8),
        (1e-4, 2, 0.01, 1.0099e-6),  # with a common cause of 1 %: not 1e-8
        (1e-2, 0, 0.0, 1.0),
    ],
)
def test_joint_exceedance_golden(p, k, c, joint):
    assert joint_exceedance(p, k, c) == pytest.approx(joint, rel=1e-9)


def test_four_measurements_for_sil_4():
    assert measurements_needed(1e-8, 1e-2) == 4
    assert measurements_needed(1e-8, 1e-4) == 2
    assert measurements_needed(1e-6, 1e-2, common_cause=5e-5) == 4


def test_common_cause_floor_is_refused():
    with pytest.raises(EvidenceError, match=r"common cause alone gives 0.01·0.0001 = 1e-06"):
        measurements_needed(1e-8, 1e-4, common_cause=0.01)


@given(st.floats(1e-6, 0.5), st.integers(1, 8), st.floats(0, 1))
def test_joint_lies_between_floor_and_single(p, k, c):
    joint = joint_exceedance(p, k, c)
    assert c * p <= joint <= p * (1 + 1e-12)
    assert joint_exceedance(p, k + 1, c) <= joint * (1 + 1e-12)


def test_tries_with_missing_measurements():
    # P(at least 1 success in n) = 1 − 0.5^n >= 0.99 at n = 7.
    assert tries_needed(1, 0.5) == 7
    assert tries_needed(4, 0.0) == 4


def test_two_channels_and_the_growth_while_measuring():
    onboard = Channel("onboard", 1e-2, 3, period_s=0.2)
    wayside = Channel("wayside", 1e-2, 2, period_s=0.5, sees_round_curves=True)
    both = plan([onboard, wayside], 30.0, required_m=500.0)
    assert both.exceedance == pytest.approx(1e-10)
    assert both.duration_s == pytest.approx(1.0)
    assert both.growth_m == pytest.approx(30.0)
    shared = plan([onboard, wayside], 30.0, common_cause=0.1)
    assert shared.exceedance == pytest.approx(0.1 * 1e-6 + 0.9e-10)


def test_a_curve_blinds_the_onboard_channel():
    onboard = Channel("onboard", 1e-2, 4)
    wayside = Channel("wayside", 1e-2, 2, sees_round_curves=True)
    sight = sight_distance_m(Line.uniform(radius_m=300.0), 0.0)
    blind = plan([onboard, wayside], 20.0, required_m=400.0, sight_m=sight)
    assert (blind.usable, blind.blind) == (("wayside",), ("onboard",))
    assert blind.exceedance == pytest.approx(1e-4)
    assert not blind.meets_target
    alone = plan([onboard], 20.0, required_m=400.0, sight_m=sight)
    assert (alone.exceedance, alone.usable, alone.meets_target) == (1.0, (), False)


@pytest.mark.parametrize("radius", [250.0, 600.0, 2000.0])
def test_sight_in_one_long_curve(radius):
    # Middle ordinate of a chord: c = L² / (8·R).
    expected = math.sqrt(8 * radius * 3.0)
    assert sight_distance_m(Line.uniform(radius_m=radius), 0.0) == pytest.approx(expected, rel=0.02)


def test_sight_on_straight_track_and_before_a_curve():
    assert sight_distance_m(Line(), 0.0, longest_m=1500.0) == 1500.0
    line = Line(curves=((0.0, math.inf), (200.0, 300.0)))
    before = sight_distance_m(line, 0.0)
    # Further than inside the curve, and the straight is seen to its end and beyond.
    assert before > 200.0 > sight_distance_m(line, 200.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: measurements_needed(0.0, 1e-2), r"target is 0.0"),
        (lambda: measurements_needed(1e-8, 1.0), r"exceedance is 1.0"),
        (lambda: tries_needed(0, 0.1), r"count is 0"),
        (lambda: Channel("onboard", 1e-2, 0), r"measurements is 0"),
        (lambda: plan([], 1.0), r"channels is 0 channels; expected one or two"),
        (lambda: plan([Channel("a", 0.1, 1)], 500.0), r"speed_mps is 500.0 m/s"),
        (lambda: sight_distance_m(Line(), 0.0, 0.0), r"clearance_m is 0.0 m"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()
