"""The simulated stopping distance: closed forms, parity of the two integrators, reproducibility."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from railops.braking import Brake, Train, stopping_distance
from railops.braking.montecarlo import (
    DIMENSIONS,
    Campaign,
    Disturbances,
    StopLaw,
    _binomial_quantile,
)
from railops.errors import DomainError
from railops.traction import Adhesion, Davis, Line

FREE = Davis(0.0, 0.0, 0.0)
PLAIN = Train(20.0, davis=FREE, rotating=0.0, emergency=Brake(1.0, 0.0, 0.0), brake_units=10)
ONLY_BRAKE = replace(Disturbances.none(), brake_std=0.05)
HILLY = Line(
    ((0.0, 0.0), (50.0, -0.015), (180.0, 0.01), (320.0, -0.02), (600.0, 0.0)),
    ((0.0, math.inf), (100.0, 400.0), (300.0, math.inf)),
)


# A rise so short that its rate is infinite, at speed and crawling uphill.
@example(3.0, 0.0, 5e-324, 1.0, False, False)
@example(22.0, 0.4, 5e-324, 0.7, True, True)
@example(0.01, 5e-324, 1e-310, 0.3, True, False)
@example(1e-300, 1e-12, 5e-324, 1.0, True, True)
@given(
    st.floats(0.0, 60.0, exclude_min=True),
    st.floats(0.0, 3.0),
    st.floats(0.0, 4.0),
    st.floats(0.3, 1.0),
    st.booleans(),
    st.booleans(),
)
def test_lanes_equal_the_scalar_integrator(speed, delay, ramp, adhesion, hills, steps):
    decel = ((0.0, 1.1), (15.0, 1.0), (30.0, 0.85)) if steps else 0.9
    train = Train(
        speed,
        line=HILLY if hills else Line(),
        length_m=120.0,
        adhesion=Adhesion(adhesion),
        emergency=Brake(decel, delay, ramp),
    )
    lanes = StopLaw(train, disturbances=Disturbances.none()).distances(np.zeros((3, DIMENSIONS)))
    exact = stopping_distance(train, step_s=0.01).distance_m
    # Centimetres at 60 m/s on hills with a step of 1 s; Euler at 0.05 s is off by over a metre.
    assert lanes == pytest.approx(exact, abs=0.05)


def test_a_lane_does_not_depend_on_its_neighbours():
    # Sixteen stops share the number of steps of each phase, up to the integrator's error.
    train = replace(Train(25.0, line=HILLY), emergency=Brake(((0.0, 1.1), (30.0, 0.85)), 0.8, 1.5))
    law = StopLaw(train, disturbances=Disturbances(0.9, 0.05, 0.1, 0.3, 0.3, 1e-3, 1.0, 1.0))
    z = np.random.default_rng(8).standard_normal((160, DIMENSIONS)) * 1.5
    z[::5, 7] = -800.0  # no rise at all beside one of seconds
    alone = np.array([law.distances(row[None])[0] for row in z])
    assert np.ptp(alone) > 1000.0
    assert law.distances(z) == pytest.approx(alone, abs=0.05)


def test_a_steep_running_resistance_gets_shorter_steps():
    # Far above any train's, but inside the range Davis accepts.
    train = Train(140.0, davis=Davis(0.5, 0.1, 0.01), emergency=Brake(3.0, 2.0, 4.0))
    law = StopLaw(train, disturbances=Disturbances.none())
    exact = stopping_distance(train, step_s=0.002).distance_m
    assert law.distances(np.zeros((1, DIMENSIONS))) == pytest.approx(exact, rel=1e-3)


def test_each_disturbance_acts_as_stated():
    train = replace(PLAIN, emergency=Brake(1.0, 1.0, 2.0), davis=Davis(0.02, 0.0, 0.0))
    law = StopLaw(train, disturbances=Disturbances(0.1, 0.05, 0.01, 0.2, 0.3, 1e-3, 0.2, 0.3))

    def distance(axis, value):
        z = np.zeros((1, DIMENSIONS))
        z[0, axis] = value
        return float(law.distances(z)[0])

    def changed(speed=20.0, brake=train.emergency, davis=train.davis, line=train.line):
        other = replace(train, speed_mps=speed, emergency=brake, davis=davis, line=line)
        return stopping_distance(other).distance_m

    share = 2 * stats.norm.cdf(1.3) - 1
    expected = {
        (0, 1.3): changed(speed=20.0 * (1 + 0.1 * share)),
        (1, -2.0): changed(brake=Brake(0.9, 1.0, 2.0)),
        # P(more than 0 of 10 fail) = 0.0956, more than 1: 0.0043: z = 2 fails one unit.
        (2, 2.0): changed(brake=Brake(0.9, 1.0, 2.0)),
        (4, -1.0): changed(davis=Davis(0.014, 0.0, 0.0)),
        (5, -2.0): changed(line=Line.uniform(-2e-3)),
        (6, 1.0): changed(brake=Brake(1.0, math.exp(0.2), 2.0)),
        (7, 1.0): changed(brake=Brake(1.0, 1.0, 2.0 * math.exp(0.3))),
    }
    for (axis, value), metres in expected.items():
        assert distance(axis, value) == pytest.approx(metres, abs=2e-3), axis
    assert distance(3, -20.0) > distance(3, 0.0) + 1.0  # adhesion below the brake's demand


def test_quantiles_of_a_gaussian_brake_lie_in_their_intervals():
    # D = v² / (2·b·(1 + σ·z)): the q-quantile is at z = −Φ⁻¹(q). Seed fixed; at 99 % the chance
    # that one of the three intervals misses its target is 3 %.
    campaign = StopLaw(PLAIN, disturbances=ONLY_BRAKE).simulate(1_000_000, seed=1)
    for level in (0.99, 0.999, 0.9999):
        exact = 200.0 / (1.0 + 0.05 * stats.norm.ppf(1 - level))
        found = campaign.quantile(level, confidence=0.99)
        assert found.low <= exact <= found.high
        assert found.value == pytest.approx(exact, rel=5e-3)


def test_uniform_speed_error_of_equation_9():
    law = StopLaw(PLAIN, disturbances=replace(Disturbances.none(), speed_error_rel=0.1))
    speed = np.sqrt(2.0 * law.simulate(100_000, seed=2).distances_m)
    assert stats.kstest(speed, stats.uniform(18.0, 4.0).cdf).pvalue > 1e-3


def test_brake_units_fail_binomially():
    law = StopLaw(PLAIN, disturbances=replace(Disturbances.none(), unit_failure=0.1))
    working = 200.0 / law.simulate(50_000, seed=3).distances_m
    counts = np.bincount(np.rint(10 * (1 - working)).astype(int), minlength=11)
    expected = stats.binom.pmf(np.arange(11), 10, 0.1) * 50_000
    assert (
        stats.chisquare(
            np.append(counts[:5], counts[5:].sum()), np.append(expected[:5], expected[5:].sum())
        ).pvalue
        > 1e-3
    )


def test_same_seed_same_result_whatever_the_threads():
    law = StopLaw(Train(25.0, line=HILLY))
    one = law.simulate(40_000, seed=4, threads=1).distances_m
    assert np.array_equal(one, law.simulate(40_000, seed=4, threads=3).distances_m)
    assert not np.array_equal(one, law.simulate(40_000, seed=5).distances_m)


def test_error_sign_is_the_papers():
    campaign = Campaign(np.array([210.0, 195.0]), 200.0, 0)
    assert campaign.errors_m.tolist() == [-10.0, 5.0]  # the overrun is negative


def test_runaways_are_counted_and_infinite():
    train = Train(20.0, line=Line.uniform(-0.06), adhesion=Adhesion(0.27))
    law = StopLaw(train, disturbances=replace(Disturbances.none(), adhesion_log_std=0.3))
    campaign = law.simulate(2000, seed=6)
    assert 0 < campaign.not_stopping < 2000
    assert campaign.quantile(0.9).value == math.inf


@pytest.mark.parametrize(("n", "p"), [(1, 0.5), (500, 0.9), (1_000_000, 0.9999)])
def test_binomial_quantile_is_scipys(n, p):
    for level in (0.005, 0.025, 0.5, 0.975, 0.995):
        assert _binomial_quantile(level, n, p) == stats.binom.ppf(level, n, p)


def test_interval_covers_the_quantile():
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(400):
        found = Campaign(rng.random(500), 0.5, 0).quantile(0.9)
        hits += found.low <= 0.9 <= found.high
    assert hits >= 0.95 * 400 - 3 * math.sqrt(400 * 0.95 * 0.05)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Disturbances(brake_std=-0.1), r"brake_std is -0.1; expected a number in \[0, 1\]"),
        (lambda: StopLaw(PLAIN).simulate(0, 1), r"stops is 0"),
        (lambda: StopLaw(PLAIN).simulate(5, -1), r"seed is -1"),
        (lambda: Campaign(np.ones(100), 1.0, 0).quantile(0.999), r"q is 0.999; .* 100 stops can"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()
