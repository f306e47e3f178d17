"""Zero-exceedance and Clopper–Pearson bounds: corrected Table 1, coverage, files, refusals."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from railops.braking.bounds import (
    allowed_exceedances,
    bound,
    error_bound,
    largest_probability,
    read_errors,
    trials_needed,
)
from railops.errors import DomainError, EvidenceError, FileError

# Corrected Table 1 (n recomputed from the paper's own formula) and the row for 1e-8.
TABLE_1 = [
    (1e-2, 0.9, 230),
    (1e-2, 0.99, 459),
    (1e-2, 0.999, 688),
    (1e-4, 0.9, 23025),
    (1e-4, 0.99, 46050),
    (1e-4, 0.999, 69075),
    (1e-6, 0.9, 2302584),
    (1e-6, 0.99, 4605168),
    (1e-6, 0.999, 6907752),
    (1e-8, 0.9, 230258509),
    (1e-8, 0.99, 460517017),
    (1e-8, 0.999, 690775525),
]


@pytest.mark.parametrize(("p", "confidence", "trials"), TABLE_1)
def test_corrected_table_1(p, confidence, trials):
    assert trials_needed(p, confidence) == trials
    assert largest_probability(trials, confidence) <= p
    assert largest_probability(trials - 1, confidence) > p


@pytest.mark.parametrize(("p", "printed"), [(1e-2, 229), (1e-6, 2302534)])
def test_table_1_as_printed_is_short(p, printed):
    """The two misprinted cells at β = 0.9 do not support the probability they stand for."""
    with pytest.raises(EvidenceError, match=f"{printed} trials with 0 exceedances support p >="):
        bound(printed, 0.9, p=p)


def test_exact_quotient_is_not_rounded_up():
    assert trials_needed(0.9, 0.99) == 2
    assert trials_needed(0.5, 0.9375) == 4


@pytest.mark.parametrize(
    # Clopper and Pearson 1934 / binomial tables: upper 95 % limits for r of n.
    ("trials", "exceedances", "upper"),
    [(10, 0, 0.25887), (10, 1, 0.39416), (10, 3, 0.60662), (20, 2, 0.28262), (10, 10, 1.0)],
)
def test_clopper_pearson_golden(trials, exceedances, upper):
    assert largest_probability(trials, 0.95, exceedances) == pytest.approx(upper, abs=1e-5)


@settings(max_examples=200, deadline=None)
@given(st.floats(1e-5, 0.5), st.floats(0.5, 0.999), st.integers(0, 20))
def test_trials_needed_is_the_smallest(p, confidence, exceedances):
    n = trials_needed(p, confidence, exceedances)
    assert stats.binom.cdf(exceedances, n, p) <= (1 - confidence) * (1 + 1e-9)
    if n - 1 > exceedances:
        assert stats.binom.cdf(exceedances, n - 1, p) > (1 - confidence) * (1 - 1e-9)
        assert allowed_exceedances(n, p * (1 + 1e-9), confidence) >= exceedances


def test_bound_read_off_the_errors():
    errors = np.random.default_rng(1).normal(0.0, 2.0, 1000)
    result = error_bound(errors, 0.9, p=1e-2)
    # 1000 trials allow r exceedances with CP(1000, r) <= 1 %: r = 5 (upper limit 0.92 %).
    assert result.exceedances == 5
    assert result.error_max_m == np.sort(errors)[-6]
    assert result.p_max <= 1e-2
    assert largest_probability(1000, 0.9, 6) > 1e-2
    assert "independent" in result.statement
    assert "same distribution as in use" in result.statement


def test_errors_on_the_safe_side_bound_at_zero():
    assert error_bound([-3.0, -1.0], 0.5).error_max_m == 0.0


@pytest.mark.parametrize("law", [stats.norm(0, 3), stats.uniform(-1, 2), stats.t(2), stats.expon()])
def test_coverage_over_10000_campaigns(law):
    # The threshold is read off the data, so the coverage is exactly 1 − 0.99^230 = 0.9009; three
    # standard errors of 10 000 campaigns are 0.009.
    rng = np.random.default_rng(5)
    errors = law.rvs((10_000, 230), random_state=rng)
    beyond = law.sf(errors.max(axis=1))
    assert np.mean(beyond <= 1e-2) >= 0.9 - 0.009


def test_coverage_with_a_threshold_set_beforehand():
    # Clopper–Pearson is conservative for a count: coverage never below β for any true p.
    rng = np.random.default_rng(6)
    for true_p in (0.003, 0.01, 0.02):
        counts = rng.binomial(459, true_p, 10_000)
        limits = {int(r): largest_probability(459, 0.9, int(r)) for r in np.unique(counts)}
        assert np.mean([limits[int(r)] >= true_p for r in counts]) >= 0.9


@pytest.mark.parametrize(
    "text",
    [
        "1.5\n-2\n# why\n0.25\n",
        "id,error_m\n1,1.5\n2,-2\n3,0.25",
        "measured_m,true_m\n101.5,100\n98,100\n100.25,100\n",
    ],
)
def test_error_files(tmp_path, text):
    path = tmp_path / "errors.csv"
    path.write_text(text)
    assert read_errors(path) == pytest.approx([1.5, -2.0, 0.25])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no errors"),
        ("error_m\n", "holds no errors"),
        ("1.0\nlots\n", r"line 2: 'lots' is not a finite error in m; give one number per line"),
        ("error_m\nnan\n", "line 2: 'nan' is not a finite error"),
        ("1,2\n", "line 1: '1,2'"),
    ],
)
def test_bad_error_files(tmp_path, text, message):
    path = tmp_path / "errors.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        read_errors(path)
    with pytest.raises(FileError, match="cannot read error file"):
        read_errors(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: bound(100, 0.9, p=1e-4), EvidenceError, r"not p = 0.0001; .* needs 23025 trials"),
        (lambda: error_bound([1.0], 0.9, p=1e-2), EvidenceError, r"1 trials with 0 exceedances"),
        (
            lambda: trials_needed(0.0, 0.9),
            DomainError,
            r"p is 0.0; .* \[1e-30, 1\)",
        ),
        (lambda: trials_needed(5e-324, 0.9), DomainError, "p is 5e-324"),
        (lambda: trials_needed(0.1, 1.0), DomainError, r"confidence is 1.0"),
        (lambda: largest_probability(0, 0.9), DomainError, r"trials is 0"),
        (lambda: largest_probability(5, 0.9, 6), DomainError, r"exceedances is 6; .*\[0, 5\]"),
        (lambda: error_bound([], 0.9), DomainError, r"errors_m is empty"),
        (lambda: error_bound([1.0, math.nan], 0.9), DomainError, r"errors_m\[1\] is nan m"),
    ],
)
def test_bad_input_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call()
