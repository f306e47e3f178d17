"""Each instrument and their combination against numbers worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import norm

from railinspect.errors import BadInputError
from railinspect.ranging import Estimate, combine, range_from_row, range_from_size

# D = l·f/p by hand; the relative errors are those of l, p and f.
SIZES = [
    # size m, extent px, focal px, range m
    (1.507, 15.07, 1000.0, 100.0),
    (1.507, 45.21, 3000.0, 100.0),
    (1.592, 31.84, 600.0, 30.0),
    (2.7, 13.5, 1000.0, 200.0),  # the train front of source 001
    (1.072, 53.6, 800.0, 16.0),
]


@pytest.mark.parametrize(("size", "extent", "focal", "expected"), SIZES)
def test_range_from_size(size: float, extent: float, focal: float, expected: float) -> None:
    assert range_from_size(size, extent, focal).range_m == pytest.approx(expected)


def test_range_from_size_errors() -> None:
    # 0.03/1.5 = 2 %, 0.5/25 = 2 %, 10/1000 = 1 %: √(4 + 4 + 1) = 3 %.
    found = range_from_size(1.5, 25.0, 1000.0, 0.03, 0.5, 10.0)
    assert found.range_m == pytest.approx(60.0)
    assert found.std_m == pytest.approx(0.03 * 60.0)
    assert (found.size_rel, found.extent_rel, found.focal_rel) == pytest.approx((0.02, 0.02, 0.01))


# x = f·h/(s·cos²θ) − h·tan θ by hand.
ROWS = [
    # rows below horizon, height m, focal px, pitch rad, range m
    (30.0, 3.0, 1000.0, 0.0, 100.0),
    (30.0, 2.5, 3000.0, 0.0, 250.0),
    (100.0, 2.0, 1000.0, math.atan(0.1), 20.0 * 1.01 - 0.2),
    (50.0, 4.0, 500.0, -math.atan(0.05), 40.0 * 1.0025 + 0.2),
]


@pytest.mark.parametrize(("below", "height", "focal", "pitch", "expected"), ROWS)
def test_range_from_row(
    below: float, height: float, focal: float, pitch: float, expected: float
) -> None:
    assert range_from_row(below, height, focal, pitch).range_m == pytest.approx(expected)


def test_range_from_row_errors() -> None:
    # Row 0.6/30 = 2 %, horizon 0.3/30 = 1 %, height 2 %, plane 0.0006·100/3 = 2 %, focal 1 %.
    found = range_from_row(30.0, 3.0, 1000.0, 0.0, 0.6, 0.3, 0.06, 10.0, gradient_std=0.0006)
    assert found.std_m == pytest.approx(100 * math.sqrt(4 + 1 + 4 + 4 + 1) / 100)


def test_one_pixel_of_row_is_what_the_source_issue_says() -> None:
    # f 3000 px, h 2.5 m: one pixel of the foot's row is 1.3 m at 100 m and 8 m at 250 m.
    for range_m, expected in ((100.0, 1.3), (250.0, 8.3)):
        below = 3000 * 2.5 / range_m
        step = range_from_row(below - 1, 2.5, 3000.0).range_m - range_m
        assert step == pytest.approx(expected, abs=0.4)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_impossible_inputs_are_refused(bad: float) -> None:
    with pytest.raises(BadInputError, match="below_px"):
        range_from_row(bad, 3.0, 1000.0)
    with pytest.raises(BadInputError, match="height_m"):
        range_from_row(30.0, bad, 1000.0)
    with pytest.raises(BadInputError, match="extent_px"):
        range_from_size(1.5, bad, 1000.0)
    with pytest.raises(BadInputError, match="focal_px"):
        range_from_size(1.5, 10.0, bad)


# Combination


def test_independent_equals_average() -> None:
    found = combine([Estimate("a", 100.0, {"a": 0.1}), Estimate("b", 100.0, {"b": 0.1})])
    assert found.range_m == pytest.approx(100.0)
    assert found.std_m == pytest.approx(10 / math.sqrt(2))
    assert found.method == "a+b"


def test_an_exact_estimate_stays_exact_whatever_the_tails() -> None:
    found = combine([Estimate("a", 40.0, {"a": 0.0})], tails={"a": (3.0, 2.0)})
    assert found.interval_m == pytest.approx((40.0, 40.0))
    assert found.std_m == 0.0


def test_inverse_variance_by_hand() -> None:
    # Variances 0.01 and 0.04: weights 0.8 and 0.2; log-mean of 100 and 110.
    found = combine([Estimate("a", 100.0, {"a": 0.1}), Estimate("b", 110.0, {"b": 0.2})])
    assert found.range_m == pytest.approx(100 * 1.1**0.2)
    assert found.std_m / found.range_m == pytest.approx(math.sqrt(0.8**2 * 0.01 + 0.2**2 * 0.04))


def test_a_shared_error_does_not_average_out() -> None:
    one, two = (Estimate(n, 80.0, {"focal": 0.2, n: 0.01}) for n in "ab")
    assert combine([one, two]).std_m > 80 * 0.2
    assert combine([one, two]).std_m < 80 * 0.2006


def test_an_estimate_that_is_only_a_worse_copy_gets_no_weight() -> None:
    good = Estimate("good", 50.0, {"row": 0.02})
    worse = Estimate("worse", 60.0, {"row": 0.02, "own": 0.3})
    assert combine([good, worse]).range_m == pytest.approx(50.0, rel=0.002)
    assert combine([good, worse]).method == "good"


def test_no_weight_is_negative() -> None:
    # One cause that moves the second three times as far: C⁻¹·1 would give it −0.5 and extrapolate.
    near = Estimate("near", 100.0, {"shared": 0.1})
    far = Estimate("far", 120.0, {"shared": 0.3, "own": 0.01})
    found = combine([near, far])
    assert found.range_m == pytest.approx(100.0)
    assert found.method == "near"
    assert found.std_m == pytest.approx(10.0)


def test_what_is_left_after_dropping_one_is_weighed_anew() -> None:
    # Without c, a and b have equal variances (0.1² + 0.05² and 0.05² + 0.1²): the geometric mean.
    # Merely cutting c's negative weight off would leave a with three quarters.
    estimates = [
        Estimate("a", 100.0, {"shared": 0.1, "a": 0.05}),
        Estimate("b", 121.0, {"shared": 0.05, "b": 0.1}),
        Estimate("c", 150.0, {"shared": 0.3, "c": 0.01}),
    ]
    found = combine(estimates)
    assert found.range_m == pytest.approx(110.0)
    assert found.method == "a+b"


def test_opposed_signs_cancel() -> None:
    # The same cause lengthens one and shortens the other: equal weights remove it.
    found = combine(
        [Estimate("a", 100.0, {"c": 0.1, "a": 0.01}), Estimate("b", 100.0, {"c": -0.1, "b": 0.01})]
    )
    assert found.std_m == pytest.approx(100 * 0.01 / math.sqrt(2))


def test_a_usual_size_that_does_not_fit_is_left_out() -> None:
    rails = Estimate("gauge", 100.0, {"row": 0.01})
    sits = Estimate("height", 160.0, {"extent": 0.02}, {"size": 0.1}, opinion=True)
    stands = Estimate("height", 104.0, {"extent": 0.02}, {"size": 0.1}, opinion=True)
    alone, odd, usual = combine([rails]), combine([rails, sits]), combine([rails, stands])
    assert (odd.range_m, odd.std_m, odd.method) == (alone.range_m, alone.std_m, "gauge")
    assert not odd.readings[1].agrees
    assert alone.range_m < usual.range_m < 101.0
    assert usual.readings[1].agrees
    by_itself = combine([sits])
    assert by_itself.range_m == pytest.approx(160.0)


def test_an_error_that_is_not_normal_reaches_as_far_as_it_says() -> None:
    alone = combine([Estimate("a", 100.0, {"row": 0.03})], {"row": (1.0, 5.0)})
    low, high = (math.log(bound / 100.0) for bound in alone.interval_m)
    assert (low, high) == pytest.approx((-0.03, 0.15), rel=1e-6)
    one = Estimate("a", 100.0, {"row": 0.03, "own a": 0.01}, {"shared": 0.02})
    two = Estimate("b", 100.0, {"row": 0.03, "own b": 0.01}, {"shared": 0.02})
    plain = combine([one, two])
    both = combine([one, two], {"row": (1.0, 5.0)})
    assert both.std_m == plain.std_m
    assert both.interval_m[0] > plain.interval_m[0]
    assert both.interval_m[1] > plain.interval_m[1]
    normal = combine([one, two], {"row": (1.959964, 1.959964)})
    assert normal.interval_m == pytest.approx(plain.interval_m, rel=1e-6)


@pytest.mark.parametrize("rest", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_rounding_and_a_normal_error_reach_as_far_as_their_sum(rest: float) -> None:
    even = math.sqrt(3.0) * np.linspace(-1.0, 1.0, 2001)  # of standard deviation 1
    exact = brentq(lambda q: float(norm.cdf((q - even) / rest).mean()) - 0.975, 0.0, 20.0)
    one = Estimate("a", 100.0, {"row": 0.01, "own": 0.01 * rest})
    found = combine([one], {"row": (0.95 * math.sqrt(3.0), 0.95 * math.sqrt(3.0))})
    assert 100 * math.log(found.interval_m[1] / 100.0) == pytest.approx(exact, rel=0.03)


def test_disagreement_widens() -> None:
    calm = combine([Estimate("a", 100.0, {"a": 0.01}), Estimate("b", 100.0, {"b": 0.01})])
    torn = combine([Estimate("a", 100.0, {"a": 0.01}), Estimate("b", 130.0, {"b": 0.01})])
    assert torn.std_m > 5 * calm.std_m
    assert torn.interval_m[0] < 105
    assert torn.interval_m[1] > 125


@given(
    ranges=st.lists(st.floats(1, 500), min_size=1, max_size=4),
    own=st.floats(0.001, 0.3),
    shared=st.floats(0, 0.3),
)
def test_the_result_lies_between_its_parts(ranges: list[float], own: float, shared: float) -> None:
    found = combine(
        [Estimate(str(i), r, {"shared": shared, str(i): own}) for i, r in enumerate(ranges)]
    )
    assert min(ranges) * 0.999 <= found.range_m <= max(ranges) * 1.001
    low, high = found.interval_m
    assert 0 < low < found.range_m < high
    assert found.std_m >= 0.999 * shared * found.range_m
