"""Beginning points, vanishing point and horizon, each on hand-made points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from railinspect.evaluation.drawn_tracks import camera
from railinspect.track.begin import Line, Prior, find_lines, lone_pairs, pair_of, pairs_of
from railinspect.track.horizon import Horizon, fit_growth, prior_horizon
from railinspect.track.ridges import ridge_points
from railinspect.track.vanishing import smoothed, vanishing_point

PRIOR = Prior(0.0, 20.0, 0.5, 0.3, 0.0, 0.15, 0.0, 40.0)


def points_on(lines: list[tuple[float, float]], bottom: float, rows: int) -> np.ndarray:
    """Points of lines (X at the bottom, slope), one per row, with weight and image row."""
    found = []
    for row in range(rows):
        y = bottom - rows + 1 + row
        found += [(x + slope * (y - bottom), y, 1.0, row) for x, slope in lines]
    return np.array(found, float)


def test_ridge_centres_are_weighted_and_wide_areas_left_out() -> None:
    score = np.zeros((4, 60), np.uint8)
    score[2, 10:13] = (100, 200, 200)
    score[3, 20:50] = 255
    found = ridge_points(score, 0, 1, 0.3, 12)
    weights = np.array([100, 200, 200]) - 76 + 1
    assert found.shape == (1, 3)
    assert found[0] == pytest.approx([10 + weights @ [0, 1, 2] / weights.sum(), 2, 200 / 255])


def test_ridge_points_of_an_empty_mask() -> None:
    assert ridge_points(np.zeros((3, 3), np.uint8), 0, 1, 0.3, 2).shape == (0, 3)


def test_lines_through_points_are_found_to_a_fraction_of_a_pixel() -> None:
    truth = [(-48.0, -0.25), (48.0, 0.25), (150.0, 0.79)]
    lines = find_lines(points_on(truth, 190.0, 120), 190.0, 70.0, 320.0, 120, 2.5, (0.0, 0.0), 60.0)
    for x, slope in truth:
        nearest = min(lines, key=lambda line: abs(line.bottom_px - x))
        assert nearest.bottom_px == pytest.approx(x, abs=0.1)
        assert nearest.slope == pytest.approx(slope, abs=0.003)
        assert nearest.votes == pytest.approx(1.0)


def test_the_ego_pair_wins_over_a_parallel_track() -> None:
    # Rails of the ego track at ±0.25 per row, of a neighbour 4.5 m aside at 1.25 and 1.75.
    lines = [Line(s * 190.0, s, 1.0) for s in (-0.25, 0.25, 1.25, 1.75)]
    best = pairs_of(lines, 190.0, PRIOR)[0]
    assert (best.left.slope, best.right.slope) == (-0.25, 0.25)
    assert best.vanishing_px == pytest.approx((0.0, 0.0))
    assert best.growth == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (Line(-50, 0.3, 1.0), Line(50, 0.3, 1.0)),  # parallel: no vanishing point
        (Line(-50, 0.4, 1.0), Line(50, -0.4, 1.0)),  # diverging upwards
        (Line(-2, -0.01, 1.0), Line(2, 0.01, 1.0)),  # much too narrow
    ],
)
def test_lines_that_are_no_track(left: Line, right: Line) -> None:
    assert pair_of(left, right, 190.0, PRIOR) is None


def test_vanishing_point_weighs_votes() -> None:
    # Worked by hand: three vertical-ish lines X = 0, X = 4 with votes 3 and 1, and a horizontal
    # pull from X = Y: with normals (1, 0), (1, 0), (1, −1)/√2 the point is X = 1, Y = 1.
    lines = [Line(0.0, 0.0, 3.0), Line(4.0, 0.0, 1.0), Line(10.0, 1.0, 1.0)]
    point, residual = vanishing_point(lines, 10.0, (1.0, 1.0), 10.0)
    assert point == pytest.approx((1.0, 1.0))
    assert residual == pytest.approx((3 * 1 + 1 * 9) / 5)


def test_vanishing_point_ignores_lines_that_miss_it() -> None:
    lines = [Line(-5.0, -0.5, 1.0), Line(5.0, 0.5, 1.0), Line(90.0, 0.1, 1.0)]
    point, residual = vanishing_point(lines, 10.0, (0.0, 0.0), 4.0)
    assert point == pytest.approx((0.0, 0.0), abs=1e-9)
    assert residual == pytest.approx(0.0, abs=1e-12)


def test_smoothing_follows_a_good_fit_and_doubts_a_bad_one() -> None:
    assert smoothed(None, (3.0, 4.0), 99.0, 0.05) == (3.0, 4.0)
    half = math.log(2) / 0.05  # e^(−ψε) = ½
    assert smoothed((0.0, 0.0), (10.0, 4.0), half, 0.05) == pytest.approx((5.0, 2.0))


def test_spacing_line_gives_horizon_and_growth_despite_outliers() -> None:
    rows = np.linspace(40, 190, 120)
    spacing = 0.5 * (rows - 12.0)
    spacing[::17] += 9.0
    found = fit_growth(rows, spacing, 0.5)
    assert found is not None
    assert found[0] == pytest.approx(12.0, abs=0.6)
    assert found[1] == pytest.approx(0.5, abs=0.004)


def test_too_few_rows_give_no_horizon() -> None:
    assert fit_growth(np.arange(5.0), np.arange(5.0), 0.5) is None
    assert fit_growth(np.linspace(0, 90, 60), np.full(60, 20.0), 0.5) is None


def test_horizon_filter_moves_by_the_share_of_the_variances() -> None:
    start = Horizon(0.0, 0.5, np.diag([4.0, 1.0]))
    after = start.updated(8.0, 0.5, np.diag([12.0, 1.0]))
    assert after.row_px == pytest.approx(2.0)  # 8·4/(4 + 12)
    assert after.covariance[0, 0] == pytest.approx(3.0)
    assert after.later(1.0, 0.0).covariance[0, 0] == pytest.approx(4.0)


def test_a_calibrated_camera_knows_its_horizon_and_growth() -> None:
    cam = camera(pitch_deg=3)
    known = prior_horizon(cam, calibrated=True)
    vague = prior_horizon(cam, calibrated=False)
    assert known.row_px == pytest.approx(-cam.focal_px * math.tan(cam.pitch_rad))
    assert known.growth == pytest.approx(cam.rail_spacing_m * math.cos(cam.pitch_rad) / 2.8)
    assert known.row_std_px < vague.row_std_px
    assert known.growth_std < vague.growth_std


@pytest.mark.parametrize("side", [-0.25, 0.25])
def test_one_rail_alone_says_where_the_other_runs(side: float) -> None:
    best, other = lone_pairs([Line(side * 190.0, side, 0.8)], 190.0, PRIOR)
    assert (best.left.slope, best.right.slope) == pytest.approx((-0.25, 0.25))
    assert best.left.bottom_px == pytest.approx(-47.5)
    assert best.right.bottom_px == pytest.approx(47.5)
    assert best.vanishing_px == pytest.approx((0.0, 0.0))
    assert best.score == pytest.approx(0.8)  # what is not seen adds nothing
    assert other.score < best.score  # the track on the rail's other side lies aside of the camera


def test_no_line_or_one_far_aside_makes_no_lone_pair() -> None:
    assert lone_pairs([], 190.0, PRIOR) == []
    assert lone_pairs([Line(1.6 * 190.0, 1.6, 1.0)], 190.0, PRIOR) == []
