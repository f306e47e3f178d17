"""Bent rails are found, and what only looks like them is not: curves, switches, crossings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from railinspect.evaluation.drawn_tracks import Masks, camera, centre_line, draw, draw_rail
from railinspect.findings import find
from railinspect.thresholds import Thresholds
from tests.railinspect.judged import clear, judge, wave


def test_a_rail_that_bends_alone_has_to_bend_more_in_a_still() -> None:
    assert Thresholds().still().bend_one_rail > Thresholds().bend_one_rail
    assert Thresholds().still().person_confidence < Thresholds().still().least_confidence


def parting(hand: int, from_m: float, bend: object = None) -> Masks:
    """A straight track from which another one parts."""
    own = draw(camera(), 0.0, bend=bend)
    other = draw(camera(), lambda s: np.where((s > from_m) & (s < from_m + 32), hand / 190, 0.0))
    score = np.maximum(own.rail_score, other.rail_score)
    return dataclasses.replace(own, rail_score=score)


@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize("from_m", [4.0, 8.0, 12.0, 18.0, 26.0, 35.0])
def test_a_switch_is_no_distortion(hand: int, from_m: float) -> None:
    _, found = judge(parting(hand, from_m), camera())
    assert found == ()


def crossed(hand: int, at_m: float, ratio: float, bend: object = None) -> Masks:
    """A straight track that another one crosses at an angle of 1 in ``ratio``."""
    own = draw(camera(), 0.0, bend=bend)
    score = np.zeros_like(own.rail_score)
    angle = hand * math.atan(1 / ratio)
    s = centre_line(0.0)[:, 0]
    along = s - 160.0
    x, y = at_m + along * math.cos(angle), along * math.sin(angle)
    line = np.stack([s, x, y, np.full_like(s, angle)], axis=1)[x > 2.0]
    for side in (1, -1):
        draw_rail(score, camera(), line, np.full(len(line), side * 0.75))
    return dataclasses.replace(own, rail_score=np.maximum(own.rail_score, score))


@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize(
    ("at_m", "ratio"), [(10.0, 14.0), (14.0, 14.0), (14.0, 20.0), (18.0, 14.0)]
)
def test_a_jump_to_a_crossing_tracks_rails_and_back_is_no_bend(
    hand: int, at_m: float, ratio: float
) -> None:
    """Where they cross, the rails' measured places go along with the other track's for a while."""
    _, found = judge(crossed(hand, at_m, ratio), camera())
    assert found == ()


@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize("amplitude", [0.25, -0.25])
def test_rails_that_bend_behind_the_blades_are_a_distortion(hand: int, amplitude: float) -> None:
    _, found = judge(parting(hand, 4.0, wave(32, 10, amplitude)), camera())
    assert [f.type for f in found] == ["distortion"]


@pytest.mark.parametrize("at", [9.0, 11.0, 13.0])
@pytest.mark.parametrize("amplitude", [0.27, -0.27])
def test_a_buckle_just_ahead_does_not_end_the_track(at: float, amplitude: float) -> None:
    cam = camera(height_m=1.8)
    geometry, found = judge(draw(cam, 0.0, bend=wave(at, 11.5, amplitude)), cam)
    assert [f.type for f in found] == ["distortion"]
    assert geometry.followed, geometry.reason


@pytest.mark.parametrize("curvature", [0.0, 1 / 300, -1 / 500])
@pytest.mark.parametrize(
    "bend",
    [wave(30, 10, 0.2), wave(30, 10, -0.2), wave(25, 12, 0.12, 6.0), wave(40, 14, 0.3)],
    ids=["left", "right", "ripple", "far"],
)
def test_bent_rails_are_found(curvature: float, bend: object) -> None:
    _, found = judge(draw(camera(), curvature, bend=bend), camera())
    assert [f.type for f in found] == ["distortion"]
    assert "smooth track" in found[0].evidence


@pytest.mark.parametrize("range_m", [15.0, 20.0, 30.0])
@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize("period_m", [0.0, 5.0])
def test_a_bend_of_a_pixel_and_a_half_is_found(range_m: float, hand: int, period_m: float) -> None:
    length_m = 15.0 if period_m else 10.0
    height_m = hand * 1.5 * range_m / camera().focal_px
    bend = wave(range_m - length_m / 2, length_m, height_m, period_m)
    _, found = judge(draw(camera(), 0.0, bend=bend), camera())
    assert [f.type for f in found] == ["distortion"]


def bent_aside(aside_px: Callable[[np.ndarray], np.ndarray], slant: float = 1.0) -> list[str]:
    """Types found on a clear track whose rails are said to lie aside along their rows."""
    masks = clear(0.0)
    geometry, _ = judge(masks, camera())
    assert geometry.profile is not None
    assert geometry.path is not None
    profile, path = geometry.profile, geometry.path
    residual = aside_px(profile.chainage_m) / profile.metre_px
    profile = dataclasses.replace(profile, residual_m=np.stack([residual, residual], axis=1))
    path = dataclasses.replace(path, across_px=path.metre_px * slant)
    bent = dataclasses.replace(geometry, profile=profile, path=path)
    return [f.type for f in find(masks, bent)]


def test_a_bends_pixels_count_at_right_angles_to_the_track() -> None:
    assert bent_aside(wave(25.0, 15.0, 2.0)) == ["distortion"]
    assert bent_aside(wave(25.0, 15.0, 2.0), slant=0.5) == []


def test_only_a_jump_from_the_top_of_a_deviation_is_another_rails() -> None:
    """A bend may end where another track's rail comes near; what went along with one jumps back."""

    def cut(end_m: float) -> Callable[[np.ndarray], np.ndarray]:
        bulge = wave(14.0, 12.0, 12.0)
        return lambda s: np.where(s < end_m, bulge(s), 0.0)

    assert bent_aside(cut(23.2)) == ["distortion"]  # at 0.45 of its height
    assert bent_aside(cut(21.0)) == []


def test_a_distortions_place_is_told() -> None:
    geometry, found = judge(draw(camera(), 0.0, bend=wave(30, 10, 0.25)), camera())
    foot = geometry.camera.ground(found[0].foot_uv)
    assert 28 < foot[0] < 36
    assert found[0].box_xyxy[3] <= found[0].foot_uv[1] + 1


@pytest.mark.parametrize("transition", [30.0, 80.0])
@pytest.mark.parametrize("radius", [200.0, 400.0, -250.0])
def test_transition_curves_are_no_distortion(radius: float, transition: float) -> None:
    for start in (10.0, 40.0):
        masks = draw(
            camera(),
            lambda s, a=start: np.clip((s - a) / transition, 0, 1) / radius,
        )
        geometry, found = judge(masks, camera())
        assert found == (), found
        assert geometry.followed


@pytest.mark.parametrize("hand", [1, -1])
@pytest.mark.parametrize(("at_m", "ratio"), [(14.0, 2.0), (22.0, 2.0)])
def test_bent_rails_that_others_cross_are_a_distortion(
    hand: int, at_m: float, ratio: float
) -> None:
    _, found = judge(crossed(hand, at_m, ratio, wave(14.0, 10.0, 0.25)), camera())
    assert [f.type for f in found] == ["distortion"]


@pytest.mark.parametrize(("left_behind", "found"), [(1.0, []), (0.0, ["distortion"])])
def test_rails_that_part_both_at_once_are_no_ripple(left_behind: float, found: list[str]) -> None:
    """Where a rail still lies on the smooth track, what went aside beside it is another's."""
    masks = clear(0.0)
    geometry, _ = judge(masks, camera())
    assert geometry.profile is not None
    swing = wave(24.0, 4.0, 3.5, 4.0)(geometry.profile.chainage_m)
    swing = np.where(swing > 0, 0.4 * swing, swing)
    aside = np.stack([swing, swing], axis=1)
    profile = dataclasses.replace(
        geometry.profile,
        residual_m=aside / geometry.profile.metre_px[:, None],
        smooth_peak=np.full_like(aside, left_behind),
        doubtful=np.stack([swing, swing], axis=1) < -0.5,
    )
    parted = dataclasses.replace(geometry, profile=profile)
    assert [f.type for f in find(masks, parted)] == found
