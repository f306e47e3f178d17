"""Centres measured along a straight track that was grown on the ground exactly."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from railinspect.evaluation.drawn_tracks import camera
from railinspect.track.centres import Centres, measure_centres
from railinspect.track.growing import HALF, MERGED, PSI, SIGMA, Growth, S, X, Y
from railinspect.track.level import Level
from railinspect.track.settings import FollowerSettings

_HALF_M = 0.75
_SETTINGS = FollowerSettings()


def painted(level: Level, lines_m: list[float]) -> np.ndarray:
    """Rail probability of straight rails of 7 cm at these places beside the centre line."""
    width, height = level.camera.size_wh
    fine = np.zeros((4 * height, 4 * width), np.uint8)
    x = np.linspace(4.0, 90.0, 400)
    for y in lines_m:
        sides = [np.stack([x, np.full_like(x, y + aside)], axis=1) for aside in (0.035, -0.035)]
        outline = level.pixels(np.concatenate([sides[0], sides[1][::-1]]))
        cv2.fillPoly(fine, [np.round(4 * outline + 1.5).astype(np.int32)], 255)
    return cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)


def measured(lines_m: list[float], first_m: float = 6.0, psi: float = 0.0) -> Centres:
    """Centres along a path straight ahead, or turned by ``psi`` at its first node."""
    level = Level.of(camera())
    f, h = level.camera.focal_px, level.camera.height_m
    x = np.geomspace(first_m, 60.0, 40)
    nodes = np.zeros((40, SIGMA + 1))
    nodes[:, X], nodes[:, HALF] = x, _HALF_M
    nodes[:, Y], nodes[:, PSI] = np.tan(psi) * (x - first_m), psi
    nodes[:, S] = f * h / (np.cos(level.pitch_rad) ** 2 * (x + h * np.tan(level.pitch_rad)))
    growth = Growth(nodes, len(nodes), MERGED, 1.0)
    s_first = level.bottom_px - level.horizon_px
    return measure_centres(painted(level, lines_m), level, growth, s_first, _SETTINGS)


def test_centres_lie_where_the_rails_were_painted() -> None:
    centres = measured([0.85, -0.70])
    sharp = (centres.path[:, 0] > 6) & (centres.path[:, 0] < 30)
    assert np.median(centres.offset_m[sharp, 0]) == pytest.approx(0.10, abs=0.005)
    assert np.median(centres.offset_m[sharp, 1]) == pytest.approx(0.05, abs=0.005)
    assert centres.peak[sharp].min() > 0.6
    assert np.median(centres.width_px[sharp][:, 0] / centres.metre_px[sharp]) < 0.12
    assert centres.between[sharp].max() == 0.0


def test_the_path_goes_on_straight_towards_the_camera() -> None:
    centres = measured([0.75, -0.75], first_m=12.0, psi=0.02)
    near = centres.path[:, 0] < 11.0
    assert np.count_nonzero(near) > 20
    expected = np.tan(0.02) * (centres.path[near, 0] - 12.0)
    assert centres.path[near, 1] == pytest.approx(expected, abs=1e-9)
    assert np.all(centres.path[near, 3] == _HALF_M)


@pytest.mark.parametrize(
    ("aside_m", "seen"),
    [
        (0.75 + 0.80, True),  # outside the left rail
        (-0.75 - 0.80, True),
        (0.75 - 0.65, True),  # between the rails
        (0.0, True),
        (0.75 + 0.20, False),  # too near to be told from the rail itself
        (-0.75 - 1.30, False),  # too far to belong to a switch
    ],
)
def test_another_rail_counts_within_a_metre_of_ours(aside_m: float, seen: bool) -> None:
    clear, other = measured([0.75, -0.75]), measured([0.75, -0.75, aside_m])
    sharp = (clear.path[:, 0] > 6) & (clear.path[:, 0] < 25)
    assert np.count_nonzero(sharp) > 50
    assert clear.beside[sharp].max() < _SETTINGS.switch_score
    if seen:
        assert other.beside[sharp].min() > _SETTINGS.switch_score
    else:
        assert other.beside[sharp].max() < _SETTINGS.switch_score
