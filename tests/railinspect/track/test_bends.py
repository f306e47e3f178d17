"""The stretch that is left out of the smooth track."""

from __future__ import annotations

import numpy as np
import pytest

from railinspect.track.bends import bent_stretch, comes_back, stands_out, upright
from railinspect.track.smooth import fit_smooth

STIFFNESS = (1 / 150, 1.2e-4)


def stretch(
    bend_m: np.ndarray, x: np.ndarray, curvature: float = 0.0, sure: np.ndarray | None = None
) -> tuple[float, float] | None:
    """The stretch found on a track of a curvature whose rails are bent."""
    sure = np.ones(len(x), bool) if sure is None else sure
    half, sigma = 0.75, np.full(len(x), 0.025)
    y = 0.5 * curvature * x**2 + bend_m
    lean = np.sqrt(1 + (curvature * x) ** 2)
    both, side = np.tile(x, 2), np.repeat([1.0, -1.0], len(x))
    rails = np.concatenate([y + half * lean, y - half * lean])
    smooth = fit_smooth(both, rails, side, np.tile(sigma, 2), half, *STIFFNESS)
    left_over = (y - smooth.y(x)) / lean
    return bent_stretch(smooth, x, left_over, sigma, sure, *STIFFNESS, 0.43)


def bulge(x: np.ndarray, near_m: float, length_m: float, height_m: float) -> np.ndarray:
    t = (x - near_m) / length_m
    return np.where((t > 0) & (t < 1), height_m * np.sin(np.pi * t) ** 2, 0.0)


ROWS = 1 / np.linspace(1 / 8, 1 / 90, 150)
"""Ground distances of the rows of a picture."""


@pytest.mark.parametrize("curvature", [0.0, 1 / 300, -1 / 300])
@pytest.mark.parametrize("near_m", [12.0, 18.0, 26.0])
def test_a_bulge_is_the_stretch_to_leave_out(near_m: float, curvature: float) -> None:
    found = stretch(bulge(ROWS, near_m, 10.0, 0.1), ROWS, curvature)
    assert found is not None
    middle = near_m + 5.0
    assert found[0] < middle < found[1]
    assert found[0] == pytest.approx(near_m, abs=4.0)
    assert found[1] == pytest.approx(near_m + 10.0, abs=4.0)


@pytest.mark.parametrize("curvature", [0.0, 1 / 200, -1 / 500])
def test_no_stretch_of_a_clear_track_stands_out(curvature: float) -> None:
    noise = 0.01 * np.random.default_rng(3).standard_normal(len(ROWS))
    assert stretch(noise, ROWS, curvature) is None


def test_rows_of_other_tracks_say_nothing() -> None:
    bend = bulge(ROWS, 18.0, 10.0, 0.1)
    sure = (ROWS < 16.0) | (ROWS > 30.0)
    assert stretch(bend, ROWS) is not None
    assert stretch(bend, ROWS, sure=sure) is None


def test_what_does_not_come_back_is_no_bend() -> None:
    sure = np.ones(60, bool)
    inside = np.zeros(60, bool)
    inside[20:40] = True
    bend = np.where(inside, 3.0, 0.1)
    assert comes_back(bend, sure, inside, 1.0)
    bend[44:50] = 1.0
    assert not comes_back(bend, sure, inside, 1.0)
    assert comes_back(bend, sure & ((np.arange(60) < 42) | (np.arange(60) > 52)), inside, 1.0)


def test_a_single_row_does_not_stand_out() -> None:
    sure = np.ones(30, bool)
    common = np.zeros(30)
    common[10] = 1.0
    assert not stands_out(common, sure, 1.0)
    common[9:12] = 0.6
    assert stands_out(common, sure, 1.0)
    assert not stands_out(common, sure, 2.0)
    assert not stands_out(common[:2], sure[:2], 1.0)


def test_upright_is_the_sine_of_the_angle_to_the_rows() -> None:
    v = np.arange(100.0, 60.0, -1.0)
    assert upright(np.stack([0 * v, v], axis=1)) == pytest.approx(np.ones(40))
    aslant = upright(np.stack([-v * np.sqrt(3.0), v], axis=1))
    assert aslant == pytest.approx(np.full(40, 0.5))
