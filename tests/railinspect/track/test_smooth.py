"""The smooth track passes curves and leaves ripples over."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.track.smooth import centre_bases, fit_smooth, hat_basis

KNOTS = np.array([10.0, 22.0, 40.0, 70.0])


def rails(y: np.ndarray, x: np.ndarray, half: float = 0.75) -> tuple[np.ndarray, ...]:
    slope = np.gradient(y, x)
    lean = np.sqrt(1 + slope**2)
    return (
        np.concatenate([x, x]),
        np.concatenate([y + half * lean, y - half * lean]),
        np.concatenate([np.ones_like(x), -np.ones_like(x)]),
        np.full(2 * len(x), 0.02),
    )


def test_hats_sum_to_one_and_hold_at_the_ends() -> None:
    basis = hat_basis(np.array([0.0, 10.0, 16.0, 55.0, 90.0]), KNOTS)
    assert basis.sum(axis=1) == pytest.approx(np.ones(5))
    assert basis[2, :2] == pytest.approx([0.5, 0.5])
    assert basis[0, 0] == basis[4, 3] == 1.0


def test_basis_integrates_to_known_curves() -> None:
    x = np.linspace(0, 90, 50)
    # y'' = 2 everywhere: y = (x − 10)²; with y₀ = 3 and slope 0.5 in front.
    coefficients = np.array([3.0, 0.5, 2.0, 2.0, 2.0, 2.0])
    assert centre_bases(x, KNOTS)[0] @ coefficients == pytest.approx(
        3 + 0.5 * (x - 10) + (x - 10) ** 2
    )
    assert centre_bases(x, KNOTS)[1] @ coefficients == pytest.approx(0.5 + 2 * (x - 10))
    # y'' = x − 10 up to the last knot: y = (x − 10)³/6.
    inside = np.linspace(10, 70, 40)
    linear = np.concatenate([[0.0, 0.0], KNOTS - 10])
    assert centre_bases(inside, KNOTS)[0] @ linear == pytest.approx((inside - 10) ** 3 / 6)


@given(radius=st.floats(200, 5000), start=st.floats(0, 60), hand=st.sampled_from([-1, 1]))
def test_transitions_and_arcs_leave_next_to_nothing(radius: float, start: float, hand: int) -> None:
    x = 8 + 62 * np.linspace(0, 1, 150) ** 2
    ramp = np.clip((x - start) / 40.0, 0, 1) * hand / radius
    fine = np.linspace(0, 80, 4000)
    slope = np.cumsum(np.interp(fine, x, ramp)) * (fine[1] - fine[0])
    y = np.interp(x, fine, np.cumsum(slope) * (fine[1] - fine[0]))
    at, across, side, sigma = rails(y, x)
    track = fit_smooth(at, across, side, sigma, 0.75)
    assert np.abs(track.y(x) - y).max() < 0.02
    assert track.along(x)[2] == pytest.approx(0.75 * np.ones_like(x), abs=0.01)


@pytest.mark.parametrize("length", [4.0, 8.0])
def test_a_ripple_is_left_over(length: float) -> None:
    x = np.linspace(8, 70, 200)
    wave = np.where((x > 25) & (x < 25 + 2 * length), np.sin(2 * np.pi * (x - 25) / length), 0.0)
    at, across, side, sigma = rails(0.1 * wave, x)
    track = fit_smooth(at, across, side, sigma, 0.75)
    left = 0.1 * wave - track.y(x)
    assert np.abs(left).max() > 0.08
    assert np.abs(track.y(x)[x < 20]).max() < 0.02
