"""Pearson type I and generalised Pareto fits, and the protective section's bounds."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from railops.braking.protection import (
    Section,
    collision_bound,
    collision_probability,
    product_as_printed,
)
from railops.braking.tails import (
    PearsonI,
    chi_square,
    peaks_over_threshold,
    pearson_likelihood,
    pearson_moments,
)
from railops.errors import DomainError, EvidenceError

BETA = stats.beta(2.5, 4.0, loc=-3.0, scale=4.5)  # the paper's range −3 … 1.5 m


@pytest.mark.parametrize("fit", [pearson_moments, pearson_likelihood])
def test_pearson_recovers_a_beta_law(fit):
    found = fit(BETA.rvs(20_000, random_state=1))
    assert (found.low, found.high) == pytest.approx((-3.0, 1.5), abs=0.25)
    assert (found.a, found.b) == pytest.approx((2.5, 4.0), rel=0.15)
    levels = np.array([0.01, 0.1, 0.5, 0.9, 0.99])
    assert found.quantile(levels) == pytest.approx(BETA.ppf(levels), abs=0.05)
    assert found.cdf(found.quantile(levels)) == pytest.approx(levels)
    assert found.chi2_p > 1e-3


def test_likelihood_is_never_worse_than_moments():
    for seed, law in enumerate([stats.beta(1.2, 1.5), stats.beta(8, 2, -5, 9), stats.uniform()]):
        sample = law.rvs(3000, random_state=seed)
        scores = []
        for fit in (pearson_moments(sample), pearson_likelihood(sample)):
            scale = fit.high - fit.low
            scores.append(stats.beta.logpdf(sample, fit.a, fit.b, fit.low, scale).sum())
        assert scores[1] >= scores[0] - 0.5


def test_moments_are_exact_for_exact_moments():
    # Golden: beta(2, 3) on [0, 1] has mean 0.4, variance 0.04; quantiles as a dense sample.
    dense = stats.beta(2, 3).ppf((np.arange(200_000) + 0.5) / 200_000)
    found = pearson_moments(dense)
    assert (found.a, found.b, found.low, found.high) == pytest.approx((2, 3, 0, 1), abs=2e-3)


def test_a_gaussian_passes_chi_square_and_the_tail_is_still_wrong():
    """FACTS: fitted to 5000 Gaussian samples the 1 − 1e-9 quantile comes out near 5.6 σ, not 6."""
    sample = np.random.default_rng(3).normal(size=5000)
    found = pearson_moments(sample)
    assert found.chi2_p > 0.05
    assert found.quantile(1 - 1e-9) < 5.8 < stats.norm.ppf(1 - 1e-9)
    assert "cannot certify a tail" in found.caution
    beside = peaks_over_threshold(sample)
    low, high = beside.interval(1e-9)
    assert low < stats.norm.isf(1e-9) < high


def test_chi_square_by_hand():
    # 32 values make int(2·32^0.4) = 8 bins of 4 expected; 8, 0 and six times 4 give 16/4 + 16/4
    # = 8 on 8 − 1 − 4 degrees of freedom.
    uniform = PearsonI(1.0, 1.0, 0.0, 1.0, "moments", np.nan)
    counts = [8, 0, 4, 4, 4, 4, 4, 4]
    sample = np.repeat((np.arange(8) + 0.5) / 8, counts)
    assert chi_square(sample, uniform, 4) == pytest.approx(stats.chi2.sf(8.0, 3))


def test_chi_square_rejects_a_wrong_law():
    found = pearson_moments(BETA.rvs(2000, random_state=2))
    assert chi_square(stats.expon.rvs(size=2000, random_state=3) - 3, found, 4) < 1e-6


def test_heavy_tails_are_not_type_i():
    with pytest.raises(EvidenceError, match="too heavy for a bounded fit"):
        pearson_moments(stats.t(4).rvs(5000, random_state=4))


@pytest.mark.parametrize(("law", "shape"), [(stats.expon(), 0.0), (stats.t(4), 0.25)])
def test_peaks_recover_the_tail_index(law, shape):
    found = peaks_over_threshold(law.rvs(100_000, random_state=5), keep=0.02)
    assert found.shape == pytest.approx(shape, abs=0.1)
    low, high = found.interval(1e-5)
    assert low < law.isf(1e-5) < high
    assert found.quantile(0.01) == pytest.approx(law.isf(0.01), rel=0.03)


LAWS = {
    "normal": stats.norm(),
    "uniform": stats.uniform(-1, 2),
    "exponential": stats.expon(-1),
    "Student 3": stats.t(3),
    "beta": stats.beta(2, 5, -1, 3),
    "lognormal": stats.lognorm(0.5),
}


@pytest.mark.parametrize(("x", "y"), list(itertools.product(LAWS, LAWS)))
def test_the_bound_is_never_below_the_convolution_and_the_printed_product_always(x, y):
    """Eq. 7 as printed is the probability that both exceed: a lower bound of the collision."""
    for p, q in itertools.product((1e-2, 1e-4, 1e-8), repeat=2):
        section = LAWS[x].isf(p) + LAWS[y].isf(q)
        exact = collision_probability(LAWS[x].sf, LAWS[y].isf, section, nodes=16)
        assert exact <= collision_bound(p, q) * (1 + 1e-9)
        assert product_as_printed(p, q) <= exact * (1 + 1e-6) + 1e-25


@pytest.mark.parametrize("section", [0.0, 3.0, 6.0, 9.0])
def test_convolution_of_two_normals(section):
    exact = stats.norm.sf(section / np.sqrt(2))
    found = collision_probability(stats.norm.sf, stats.norm.isf, section)
    assert found == pytest.approx(exact, rel=1e-9)


@given(st.floats(0, 1), st.floats(0, 1))
def test_bound_is_at_least_either_and_at_most_the_union(p, q):
    assert max(p, q) * (1 - 1e-12) <= collision_bound(p, q) <= collision_bound(p, q, False)
    assert product_as_printed(p, q) <= collision_bound(p, q) * (1 + 1e-12)


def test_section_names_the_error_that_governs():
    section = Section(3.0, 400.0, 1e-2, 1e-8)
    assert section.length_m == 403.0
    with pytest.raises(EvidenceError, match=r"bounds .* by 0.01, not 1e-08; the stopping error"):
        section.require(1e-8)
    Section(12.0, 400.0, 4e-9, 4e-9).require(1e-8)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: pearson_moments([1.0, 2.0]), DomainError, "sample is 2 values; expected at least"),
        (lambda: pearson_moments(np.ones(50)), DomainError, "constant or not finite"),
        (lambda: peaks_over_threshold(np.arange(100.0)), EvidenceError, "a tail fit needs 30"),
        (lambda: peaks_over_threshold(BETA.rvs(999)).quantile(0.9), DomainError, "probability"),
        (lambda: Section(-1.0, 0.0, 0.1, 0.1), DomainError, r"stop_error_m is -1.0 m"),
        (lambda: collision_bound(2.0, 0.1), DomainError, r"stop_exceedance is 2.0"),
        (
            lambda: collision_probability(lambda x: x * np.nan, stats.norm.isf, 1.0),
            DomainError,
            "a probability for every distance",
        ),
    ],
)
def test_bad_input_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call()
