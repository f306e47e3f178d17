"""Closing speed: by hand, against a batch solution, and what must not average out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.errors import BadInputError
from railinspect.ranging.independent import last_independent
from railinspect.ranging.speed import (
    MotionFilter,
    MotionSettings,
    finite_difference,
    minimum_interval,
    speed_bias,
)

# D₁, D₂, Δt, σ₁, σ₂, σ_Δt → v, σ_v by (9), worked by hand.
SPEEDS = [
    (20.0, 18.0, 1.0, 0.3, 0.4, 0.0, 2.0, 0.5),
    (50.0, 60.0, 2.0, 0.6, 0.8, 0.0, -5.0, 0.5),
    (30.0, 20.0, 1.0, 0.0, 0.0, 0.05, 10.0, 0.5),
    (30.0, 20.0, 1.0, 0.3, 0.4, 0.05, 10.0, math.sqrt(0.5)),
]


@pytest.mark.parametrize(("d1", "d2", "dt", "s1", "s2", "sdt", "v", "sv"), SPEEDS)
def test_finite_difference(
    d1: float, d2: float, dt: float, s1: float, s2: float, sdt: float, v: float, sv: float
) -> None:
    found = finite_difference(d1, d2, dt, s1, s2, sdt)
    assert (found.speed_mps, found.std_mps) == pytest.approx((v, sv))


def test_no_time_no_speed() -> None:
    with pytest.raises(BadInputError, match="interval_s is 0"):
        finite_difference(2, 1, 0.0)
    with pytest.raises(BadInputError, match="standstill"):
        minimum_interval(0.1, 0.0)


def test_the_filter_is_the_batch_solution() -> None:
    # Without jerk the recursion must equal one weighted least squares over all ranges.
    settings = MotionSettings(jerk_std=0.0, speed_std_mps=20.0, accel_std_mps2=2.0, gate_std=1e9)
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.02, 0.3, 20))
    ranges = 90 - 15 * times + 0.4 * times**2 + rng.normal(0, 0.5, 20)
    noise = rng.uniform(0.3, 0.9, 20)
    motions = MotionFilter(settings)
    for t, r, s in zip(times, ranges, noise, strict=True):
        motion = motions.update(float(t), float(r), float(s))
    age = times - times[0]  # the prior holds at the first range
    design = np.stack([np.ones(20), age, age**2 / 2], axis=1)
    gram = design.T @ (design / noise[:, None] ** 2) + np.diag([0.0, 1 / 20.0**2, 1 / 2.0**2])
    start = np.linalg.solve(gram, design.T @ (ranges / noise**2))
    move = np.array([[1, age[-1], age[-1] ** 2 / 2], [0, 1, age[-1]], [0, 0, 1]])
    np.testing.assert_allclose(motion.state, move @ start, rtol=1e-7)
    covariance = move @ np.linalg.inv(gram) @ move.T
    np.testing.assert_allclose(motion.covariance, covariance, rtol=1e-5, atol=1e-9)


@given(speed=st.floats(-30, 30), seed=st.integers(0, 30))
def test_speed_lies_within_its_error(speed: float, seed: float) -> None:
    rng = np.random.default_rng(int(seed))
    motions = MotionFilter()
    for step in range(26):
        t = 0.04 * step
        motion = motions.update(t, 100 - speed * t + rng.normal(0, 0.5), 0.5)
    assert abs(motion.closing.speed_mps - speed) < 4 * motion.closing.std_mps
    assert motion.closing.std_mps < 1.2


def test_noise_averages_out_and_bias_does_not() -> None:
    motions = MotionFilter()
    for step in range(200):
        t = 0.04 * step
        motion = motions.update(t, 200 - 20 * t, 1.0, 0.05 * (200 - 20 * t))
    assert math.sqrt(motion.covariance[0, 0]) < 0.6
    assert motion.range_std_m >= 0.05 * motion.range_m
    assert motion.closing.std_mps >= 0.99 * speed_bias(20.0, 0.05)


def test_time_to_reach() -> None:
    motions = MotionFilter()
    for step in range(60):
        motion = motions.update(0.04 * step, 100 - 20 * 0.04 * step, 0.3)
    assert motion.time_to_reach_s == pytest.approx((100 - 20 * 2.36) / 20, rel=0.02)
    still = MotionFilter()
    for step in range(20):
        motion = still.update(0.04 * step, 100.0, 0.3)
    assert motion.time_to_reach_s is None


def test_one_wild_range_does_not_carry_the_filter_away() -> None:
    motions = MotionFilter()
    for step in range(50):
        wild = 60.0 if step == 40 else 0.0
        motion = motions.update(0.04 * step, 100 - 20 * 0.04 * step + wild, 0.3)
    assert motion.closing.speed_mps == pytest.approx(20.0, abs=3.0)


@pytest.mark.parametrize("bad", [0.0, -3.0, math.nan, math.inf])
def test_impossible_ranges_are_refused(bad: float) -> None:
    with pytest.raises(BadInputError, match="range and noise"):
        MotionFilter().update(0.0, bad, 1.0)


def test_time_runs_forward() -> None:
    motions = MotionFilter()
    motions.update(1.0, 50.0, 1.0)
    with pytest.raises(BadInputError, match="in order"):
        motions.update(0.9, 50.0, 1.0)


def test_independent_measurements_are_apart() -> None:
    class Seen:
        def __init__(self, time_s: float) -> None:
            self.time_s = time_s

    taken = last_independent([Seen(0.05 * i) for i in range(40)], 4, 0.16)
    assert len(taken) == 4
    times = [t.time_s for t in taken]
    assert times[-1] == pytest.approx(1.95)
    assert (np.diff(times) >= 0.159).all()
    assert last_independent([], 3) == []
