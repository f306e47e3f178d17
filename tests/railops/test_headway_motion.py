"""Runs: closed-form golden values, energy, limits over the whole train, the regulator."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.headway import random_pair
from railops.headway import Regulator, RunTimeError, Section, Stock, StuckError
from railops.headway.ceiling import ceiling, ceiling_speed
from railops.headway.regulator import departure
from railops.traction import Davis, Effort, Line

FREE = Davis(0.0, 0.0, 0.0)
SEEDS = st.integers(0, 2**32 - 1)


def plain(length_m, limit_kmh=500.0, power=200.0):
    stock = Stock(100.0, Effort(1.0, power), FREE, brake_mps2=1.0)
    return Section(length_m, stock=stock, limits_kmh=((0.0, limit_kmh),))


def test_triangle_without_resistance():
    # 1 m/s² up and down over 900 m: v = 30 m/s, 30 s each way.
    run = Regulator(plain(900.0, power=200.0)).shortest
    assert run.run_time_s == pytest.approx(60.0, abs=1e-9)
    assert run.nodes.speed_mps.max() == pytest.approx(30.0, abs=1e-9)
    # Work per mass is v²/2 times (1 + γ): the rotating masses are accelerated too.
    assert run.work_jpkg == pytest.approx(450.0 * 1.08, rel=1e-6)


def test_trapezium_at_a_limit():
    # 20 m/s limit over 1000 m: 20 s up, 20 s down (200 m each), 600 m at 20 m/s.
    run = Regulator(plain(1000.0, 72.0)).shortest
    assert run.run_time_s == pytest.approx(70.0, abs=1e-9)


def test_coasting_without_resistance_keeps_the_speed():
    # Cut at v after v²/2 metres; 1000 = v² + v·t, T = 2v + t: v = 20 → t = 30, T = 70.
    run = Regulator(plain(1000.0)).run(70.0)
    assert run.cut_off_m == pytest.approx(200.0, abs=1e-5)
    assert run.nodes.speed_mps.max() == pytest.approx(20.0, abs=1e-6)
    assert np.isfinite(run.passage_s(np.array([500.0]))[0])
    assert run.passage_s(np.array([500.0]))[0] == pytest.approx(20.0 + 300.0 / 20.0, abs=1e-6)


def test_constant_power():
    # Above the corner speed v²/2 grows by P·t: with a = 1, P = 4: corner 4 m/s at 4 s.
    run = Regulator(plain(2000.0, power=4.0)).shortest
    at = np.interp(20.0, run.nodes.time_s, run.nodes.speed_mps)
    assert at == pytest.approx(math.sqrt(16.0 + 8.0 * 16.0), rel=1e-4)


def test_a_rise_of_the_limit_waits_for_the_rear():
    table = ceiling(((0.0, 10.0), (300.0, 20.0)), 100.0, 1.0)
    at = np.array([0.0, 299.0, 399.0, 401.0])
    assert ceiling_speed(table, at).tolist() == [10.0, 10.0, 10.0, 20.0]


def test_a_drop_is_braked_for_and_a_code_binds_the_front_only():
    table = ceiling(((0.0, 20.0), (400.0, 10.0)), 100.0, 1.0, 1000.0, ((0.0, 15.0), (200.0, 30.0)))
    at = np.array([100.0, 201.0, 250.0, 300.0, 400.0, 949.0, 950.0, 1000.0 - 2.0])
    expected = [15.0, 20.0, 20.0, math.sqrt(300.0), 10.0, 10.0, 10.0, 2.0]
    assert ceiling_speed(table, at) == pytest.approx(expected)


def test_drawing_away_leaves_from_the_stop():
    run = departure(plain(1000.0), 1200.0)
    assert run.nodes.position_m[0] == 1000.0
    assert run.run_time_s == pytest.approx(20.0, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_a_longer_run_is_slower_everywhere_and_cheaper(seed):
    pair, *_ = random_pair(np.random.default_rng(seed))
    shortest = pair.regulator.shortest_s
    longest = min(1.3 * shortest, pair.regulator.longest().run_time_s)
    fast, slow = (pair.run(shortest + part * (longest - shortest)) for part in (0.3, 0.8))
    assert fast.work_jpkg >= slow.work_jpkg - 1e-6
    at = np.linspace(1.0, pair.section.length_m - 1.0, 60)
    assert np.all(slow.passage_s(at) >= fast.passage_s(at) - 3e-5)


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_a_run_takes_the_wanted_time_and_keeps_its_ceiling(seed):
    pair, second, _, _ = random_pair(np.random.default_rng(seed))
    run = pair.run(second)
    assert run.run_time_s == pytest.approx(second, abs=2e-5)
    assert run.nodes.position_m[-1] == pytest.approx(pair.section.length_m)
    assert run.nodes.speed_mps[-1] == pytest.approx(0.0, abs=1e-6)
    assert np.all(np.diff(run.nodes.time_s) > 0.0)
    inside = run.nodes.position_m < pair.section.length_m - 0.01
    top = ceiling_speed(pair.section.ceiling(), run.nodes.position_m[inside])
    assert np.all(run.nodes.speed_mps[inside] <= top + 1e-6)


def test_the_step_does_not_matter():
    section = Section(1500.0, line=Line(((0.0, 0.0), (300.0, -0.02), (900.0, 0.015))))
    times = [Regulator(section, step).at_cut(280.0).run_time_s for step in (0.4, 0.1, 0.02)]
    assert np.ptp(times) < 2e-4


def test_a_run_time_too_short_says_the_shortest():
    with pytest.raises(RunTimeError, match=r"run time over A is 50 s; expected 60\.0 s \(the sho"):
        Regulator(Section(900.0, stock=plain(900.0).stock, limits_kmh=((0, 500),), name="A")).run(
            50.0
        )


def test_a_run_time_too_long_says_the_longest():
    regulator = Regulator(Section(900.0))
    with pytest.raises(RunTimeError, match="the longest without pulling") as caught:
        regulator.run(5000.0)
    assert caught.value.longest_s == pytest.approx(regulator.longest().run_time_s)
    assert caught.value.shortest_s == regulator.shortest_s


def test_a_train_that_cannot_climb_says_where_it_stops():
    steep = Line(((0.0, 0.0), (400.0, 0.2)))
    with pytest.raises(StuckError, match=r"at \d+ m of 2000 m its traction no longer overcomes"):
        Regulator(Section(2000.0, line=steep))
    with pytest.raises(StuckError, match="cuts traction at 1 m does not reach the end"):
        Regulator(Section(2000.0)).at_cut(1.0)
    away = Line(((0.0, 0.0), (1000.0, 0.3)))
    with pytest.raises(StuckError, match="does not draw away from the end of section"):
        departure(Section(1000.0, line=away), 1400.0)
