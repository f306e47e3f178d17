"""Tails to 1e-8 against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from railops.braking import Brake, Train
from railops.braking.montecarlo import DIMENSIONS, Disturbances, StopLaw
from railops.braking.rare import importance, quantile, subset, tail
from railops.errors import DomainError, EvidenceError
from railops.traction import Davis

PLAIN = Train(20.0, davis=Davis(0, 0, 0), rotating=0.0, emergency=Brake(1.0, 0.0, 0.0))
LAW = StopLaw(PLAIN, disturbances=replace(Disturbances.none(), brake_std=0.05))


def linear(z):
    return z.sum(axis=1) / math.sqrt(z.shape[1])


def farthest(z):
    """Two failure modes: P(|z₀| > x) = 2·Φ(−x)."""
    return np.abs(z[:, 0])


@pytest.mark.parametrize("probability", [1e-4, 1e-6, 1e-8])
def test_constant_deceleration_with_gaussian_errors(probability):
    threshold = 200.0 / (1.0 + 0.05 * stats.norm.ppf(probability))
    found = tail(LAW.distances, threshold, DIMENSIONS, np.random.default_rng(1), 30_000)
    assert found.probability == pytest.approx(probability, rel=0.1)
    assert found.cov < 0.1
    assert found.agrees


@pytest.mark.parametrize("method", [subset, importance])
def test_both_methods_are_unbiased_and_honest_about_their_spread(method):
    runs = [method(linear, 4.0, 5, np.random.default_rng(s), 5_000) for s in range(30)]
    ratio = np.array([run.probability for run in runs]) / stats.norm.sf(4.0)
    assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / math.sqrt(30) + 0.01)
    claimed = np.mean([run.cov for run in runs])
    assert ratio.std() / 2 < claimed < 4 * ratio.std()


def test_subset_finds_two_failure_modes():
    found = subset(farthest, 5.0, 3, np.random.default_rng(2), 20_000)
    assert found.probability == pytest.approx(2 * stats.norm.sf(5.0), rel=0.25)


def test_quantile_is_the_inverse():
    x = quantile(LAW.distances, 1e-6, DIMENSIONS, np.random.default_rng(3), 30_000)
    assert x == pytest.approx(200.0 / (1.0 + 0.05 * stats.norm.ppf(1e-6)), rel=2e-3)


def test_full_dynamics_agree_with_plain_monte_carlo():
    law = StopLaw(Train(22.0))
    campaign = law.simulate(400_000, seed=4)
    threshold = campaign.quantile(0.999).value
    found = tail(law.distances, threshold, DIMENSIONS, np.random.default_rng(5), 20_000)
    assert found.probability == pytest.approx(1e-3, rel=0.2)
    assert found.agrees


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda rng: subset(lambda z: np.tanh(z[:, 0]), 2.0, 2, rng, 500),
            EvidenceError,
            r"P\(g > 2\) is below 1e-15",
        ),
        (lambda rng: importance(lambda z: 0 * z[:, 0], 1.0, 2, rng), EvidenceError, "found 0 fail"),
        (lambda rng: subset(linear, math.nan, 2, rng), DomainError, "threshold is nan"),
        (lambda rng: subset(linear, 1.0, 2, rng, 10), DomainError, "samples is 10"),
        (lambda rng: subset(lambda z: z, 1.0, 2, rng, 500), DomainError, "one number per row"),
        (lambda rng: quantile(linear, 0.9, 2, rng), DomainError, "probability is 0.9"),
    ],
)
def test_bad_input_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call(np.random.default_rng(0))
