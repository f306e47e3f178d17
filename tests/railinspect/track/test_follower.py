"""The follower against tracks whose every point is known."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from railinspect import labels
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.evaluation.drawn_tracks import (
    Masks,
    Thing,
    camera,
    centre_line,
    draw,
    rail_points,
)
from railinspect.track import TrackFollower, TrackGeometry


@dataclasses.dataclass(frozen=True)
class Numbered:
    index: int


def follow(masks: Masks, cam: Camera | None, frames: int = 2) -> TrackGeometry:
    follower = TrackFollower(cam)
    for _ in range(frames):
        geometry = follower.update(masks)
    return geometry


def rail_error_px(geometry: TrackGeometry, cam: Camera, curvature: object) -> np.ndarray:
    """Column error of the left polyline, row by row."""
    line = centre_line(curvature)
    line = line[line[:, 0] > 3]
    truth = cam.distort(cam.project(rail_points(line, cam.rail_spacing_m / 2)))
    truth = truth[np.isfinite(truth).all(axis=1)][::-1]
    return np.abs(
        np.interp(geometry.left_uv[:, 1], truth[:, 1], truth[:, 0]) - geometry.left_uv[:, 0]
    )


CASES = [
    (camera(), 0.0),
    (camera(), 1 / 250),
    (camera(pitch_deg=-4, roll_deg=3), -1 / 400),
    (camera(height_m=1.7, fov_deg=70, offset_m=0.4, yaw_rad=0.04), 0.0),
    (camera((1280, 720), 40, 3.5, 4.0, -2.0), 1 / 600),
    (camera(distortion=(0.06, -0.01, 0.001, 0.0, 0.0)), 0.0),
    (camera(gauge_m=1.0), 1 / 300),
    (camera(gauge_m=1.668), 0.0),
]


@pytest.mark.parametrize(("cam", "curvature"), CASES)
def test_rails_are_followed_to_a_fraction_of_a_pixel(cam: Camera, curvature: float) -> None:
    geometry = follow(draw(cam, curvature), cam)
    assert geometry.followed, geometry.reason
    assert geometry.camera.pitch_rad == pytest.approx(cam.pitch_rad, abs=0.0025)
    error = rail_error_px(geometry, cam, curvature)
    assert np.median(error) < 0.3 * cam.size_wh[0] / 640
    assert geometry.path is not None
    assert geometry.path.half_m[:50] == pytest.approx(cam.rail_spacing_m / 2, rel=0.02)


@pytest.mark.parametrize("hand", [-1, 1])
@pytest.mark.parametrize("radius_m", [200, 250, 300, 400])
@pytest.mark.parametrize(("height_m", "pitch_rad"), [(2.3, -0.02), (3.0, 0.03)])
def test_a_first_picture_in_a_curve_is_followed_through_a_long_lens(
    height_m: float, pitch_rad: float, radius_m: int, hand: int
) -> None:
    """There rails begin 11 to 17 m ahead, where their tangents point aside of the track."""
    cam = Camera.from_field_of_view((640, 360), 0.72, height_m, pitch_rad=pitch_rad)

    def into_the_curve(chainage_m: np.ndarray) -> np.ndarray:
        return hand / radius_m * np.clip((chainage_m - 8.0) / 10.0, 0.0, 1.0)

    for curvature in (hand / radius_m, into_the_curve):
        geometry = follow(draw(cam, curvature), cam, frames=1)
        assert geometry.followed, geometry.reason


@pytest.mark.parametrize(("cam", "curvature"), [c for c in CASES if not any(c[0].distortion)][:4])
def test_an_unknown_camera_finds_its_height(cam: Camera, curvature: float) -> None:
    geometry = follow(draw(cam, curvature), None, frames=4)
    assert geometry.followed, geometry.reason
    assert not geometry.calibrated
    assert geometry.camera.height_m == pytest.approx(cam.height_m, rel=0.03)
    horizon = geometry.camera.horizon_v()
    assert horizon == pytest.approx(cam.horizon_v(), abs=3.0)
    assert geometry.camera.std.focal_px / geometry.camera.focal_px > 0.2


def test_path_lies_in_the_cameras_own_world() -> None:
    cam = camera(offset_m=0.3, yaw_rad=-0.03)
    geometry = follow(draw(cam, 0.0), cam)
    path = geometry.path
    assert path is not None
    assert geometry.camera.offset_m == pytest.approx(0.3, abs=0.03)
    assert geometry.camera.yaw_rad == pytest.approx(-0.03, abs=0.004)
    near = path.seen & (path.chainage_m < 60)
    assert np.abs(path.xy_m[near, 1]).max() < 0.06
    back = geometry.camera.ground(path.uv[near])
    assert back == pytest.approx(path.xy_m[near], rel=1e-6, abs=1e-6)
    assert path.chainage_m[near] == pytest.approx(path.xy_m[near, 0], abs=0.05)


def test_polylines_run_from_top_to_bottom_inside_the_image() -> None:
    cam = camera()
    geometry = follow(draw(cam, 1 / 300), cam)
    for line in (geometry.left_uv, geometry.right_uv):
        assert (np.diff(line[:, 1]) > 0).all()
        assert (line >= 0).all()
        assert (line[:, 0] <= 639).all()
        assert line[-1, 1] > 350
    assert geometry.vanishing_uv is not None
    assert geometry.roi_uv.shape == (3, 2)


def test_parallel_tracks_do_not_capture() -> None:
    cam = camera()
    geometry = follow(draw(cam, 1 / 500, others_m=(-4.2, 4.2, 8.4)), cam)
    assert np.median(rail_error_px(geometry, cam, 1 / 500)) < 0.3
    unknown = follow(draw(cam, 0.0, others_m=(-3.6, 3.6)), None)
    assert np.median(rail_error_px(unknown, cam, 0.0)) < 0.5


@pytest.mark.parametrize(
    ("cam", "known", "beside_m", "lorry_m"),
    [
        (camera((640, 360), 39.2, 3.7, 1.0), True, -4.2, 26.0),
        (camera((640, 360), 39.2, 3.7, 1.0), True, 3.8, 30.0),
        (camera(), False, -3.8, 18.0),
    ],
)
def test_a_lorry_on_our_track_does_not_make_the_free_one_beside_it_ours(
    cam: Camera, known: bool, beside_m: float, lorry_m: float
) -> None:
    lorry = Thing(labels.TRUCK, lorry_m, 0.0, 2.4, 3.5)
    masks = draw(cam, 0.0, others_m=(beside_m,), things=[lorry])
    geometry = follow(masks, cam if known else None, frames=1)
    _, right, left = geometry.roi_uv
    assert 0.5 * (left[0] + right[0]) == pytest.approx(319.5, abs=6.0)


def test_a_turnout_does_not_capture() -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    branch = draw(cam, lambda s: np.where(s > 18, 1 / 300, 0.0))
    score = np.maximum(masks.rail_score, branch.rail_score)
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam)
    assert geometry.followed
    error = rail_error_px(geometry, cam, 0.0)
    assert np.median(error) < 0.4
    assert np.quantile(error, 0.9) < 2.5


@pytest.mark.parametrize(("hand", "side"), [(1, "left"), (-1, "right")])
def test_a_track_that_parts_is_kept_and_the_assumed_path_is_said(hand: int, side: str) -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    other = draw(cam, lambda s: np.where((s > 8) & (s < 40), hand / 190, 0.0))
    score = np.maximum(masks.rail_score, other.rail_score)
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam)
    assert geometry.followed
    (branch,) = geometry.branches
    # Which leg is taken for the path is open; the other one is the branch, on its side.
    straight = float(np.median(rail_error_px(geometry, cam, 0.0))) < 1.0
    assert branch.side == (side if straight else {"left": "right", "right": "left"}[side])
    assert f"parts to the {branch.side}" in (geometry.reason or "")
    assert 15 < branch.from_m < 30
    assert branch.support > 0.4


def test_parallel_tracks_and_curves_are_no_branches() -> None:
    cam = camera()
    for curvature, others in ((1 / 300, ()), (0.0, (4.2, -4.2)), (1 / 500, (3.8,))):
        assert follow(draw(cam, curvature, others_m=others), cam).branches == ()


@pytest.mark.parametrize("hand", [1, -1])
def test_a_rail_beside_that_is_brighter_in_some_rows_does_not_pull_ours_over(hand: int) -> None:
    """Where two tracks part, both rails lie in reach of the search for some rows."""
    cam = camera()
    masks = draw(cam, 0.0)
    branch = draw(cam, lambda s: np.where(s > 6, hand / 190, 0.0))
    flicker = np.random.default_rng(2).uniform(0.6, 1.0, (2, 360, 1))
    planes = np.stack([masks.rail_score, branch.rail_score]) * flicker
    score = planes.max(axis=0).astype(np.uint8)
    follower = TrackFollower(cam)
    follower.update(masks)  # which of the two tracks is ours is known from before
    geometry = follower.update(dataclasses.replace(masks, rail_score=score))
    assert geometry.followed
    error = rail_error_px(geometry, cam, 0.0)
    right = geometry.right_uv
    spacing = np.interp(geometry.left_uv[:, 1], right[:, 1], right[:, 0]) - geometry.left_uv[:, 0]
    metre = np.maximum(spacing, 1.0) / cam.rail_spacing_m
    assert (error < 1.5 + 0.05 * metre).all()  # the other rail's head touches ours for a while


def test_a_hole_is_crossed_and_reported() -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    score = masks.rail_score.copy()
    score[225:250] = 0
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam)
    assert geometry.followed
    both = [g for g in geometry.gaps if g.rail == "both" and g.continued]
    assert len(both) == 1
    assert both[0].from_v == pytest.approx(250, abs=3)
    assert both[0].to_v == pytest.approx(224, abs=3)
    assert both[0].from_m < both[0].to_m


def test_one_rail_missing_is_a_gap_of_that_rail() -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    score = masks.rail_score.copy()
    score[230:260, :320] = 0
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam)
    assert [g.rail for g in geometry.gaps] == ["left"]


@pytest.mark.parametrize("curvature", [0.0, 1 / 500])
def test_a_rail_hidden_near_the_camera_is_found_farther_on(curvature: float) -> None:
    cam = camera()
    masks = draw(cam, curvature)
    score = masks.rail_score.copy()
    score[215:, :320] = 0  # the left rail up to 30 m: a wiper
    hidden = dataclasses.replace(masks, rail_score=score)
    geometry = follow(hidden, cam, frames=1)
    assert geometry.path is not None
    seen = geometry.left_uv[:, 1] < 213
    assert np.median(rail_error_px(geometry, cam, curvature)[seen]) < 0.5
    assert not geometry.followed  # too little is seen of it to call the track clear
    assert follow(hidden, None, frames=1).path is None  # only a known camera says where it runs


@pytest.mark.parametrize(("curvature", "centre"), [(0.0, 320.0), (1 / 400, 304.0)])
def test_a_rail_hidden_near_the_camera_does_not_make_the_track_beside_it_ours(
    curvature: float, centre: float
) -> None:
    cam = camera((640, 360), 39.2, 3.7, 1.0)
    masks = draw(cam, curvature, others_m=(4.2,))
    score = masks.rail_score.copy()
    score[205:, 320:420] = 0  # the right rail
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam, frames=1)
    _, right, left = geometry.roi_uv
    assert 0.5 * (left[0] + right[0]) == pytest.approx(centre, abs=6.0)


@pytest.mark.parametrize("rail", [(220, 320), (320, 420)])
@pytest.mark.parametrize("beside_m", [-4.2, 4.2])
@pytest.mark.parametrize("curvature", [0.0, 1 / 400, -1 / 400])
def test_with_one_rail_hidden_the_track_beside_it_is_never_called_ours(
    curvature: float, beside_m: float, rail: tuple[int, int]
) -> None:
    cam = camera((640, 360), 39.2, 3.7, 1.0)
    masks = draw(cam, curvature, others_m=(beside_m,))
    for top in (190, 205, 220):
        score = masks.rail_score.copy()
        score[top:, slice(*rail)] = 0
        follower = TrackFollower(cam)
        for _ in range(3):
            geometry = follower.update(dataclasses.replace(masks, rail_score=score))
            _, right, left = geometry.roi_uv if len(geometry.roi_uv) else ((320, 0),) * 3
            aside = abs(0.5 * (left[0] + right[0]) - 320.0)
            assert aside < 25 or not geometry.followed
            assert aside < 25 or "ours" in geometry.reason


def test_rails_that_end_early_are_not_followed() -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    score = masks.rail_score.copy()
    score[:280] = 0
    geometry = follow(dataclasses.replace(masks, rail_score=score), cam)
    assert not geometry.followed
    assert geometry.reason is not None
    assert "end" in geometry.reason


def test_mirrored_masks_give_the_mirrored_track() -> None:
    cam = camera()
    masks = draw(cam, 1 / 350, others_m=(4.5,))
    one, other = follow(masks, cam), follow(masks.mirrored(), cam)
    assert one.followed
    assert other.followed
    n = min(len(one.left_uv), len(other.right_uv))
    mirrored = other.right_uv[-n:] * [-1, 1] + [639, 0]
    assert np.abs(mirrored - one.left_uv[-n:])[:, 0].max() < 0.5
    assert other.reach_m == pytest.approx(one.reach_m, rel=0.05)


def test_pitch_is_followed_from_frame_to_frame() -> None:
    follower = TrackFollower(camera(pitch_deg=2.0))
    for pitch in (2.0, 2.1, 2.2, 2.3, 2.4):
        cam = camera(pitch_deg=pitch)
        geometry = follower.update(draw(cam, 0.0))
        assert np.degrees(geometry.camera.pitch_rad) == pytest.approx(pitch, abs=0.1)


def test_state_can_be_saved_and_restored() -> None:
    cam = camera()
    masks = [draw(cam, k) for k in (0.0, 1 / 900, 1 / 700)]
    straight = TrackFollower(None)
    for m in masks[:2]:
        straight.update(m)
    other = TrackFollower(None)
    other.restore(pickle.loads(pickle.dumps(straight.state())))
    a, b = straight.update(masks[2]), other.update(masks[2])
    assert np.array_equal(a.left_uv, b.left_uv)
    assert a.reach_m == b.reach_m


def test_a_jump_in_the_frame_numbers_starts_anew() -> None:
    follower = TrackFollower(camera())
    masks = draw(camera(), 0.0)
    follower.update(masks, Numbered(0))
    assert follower.state().pair is not None
    follower.update(Masks(*(np.zeros((360, 640), np.uint8),) * 3), Numbered(100))
    assert follower.state().pair is None


def test_after_a_loss_the_last_beginning_points_stay_for_a_while() -> None:
    follower = TrackFollower(camera())
    masks = draw(camera(), 0.0)
    for _ in range(3):
        follower.update(masks)
    blank = dataclasses.replace(masks, rail_score=np.zeros_like(masks.rail_score))
    geometry = follower.update(blank)
    assert not geometry.followed
    assert follower.state().pair is not None
    for _ in range(8):
        assert not follower.update(blank).followed
    assert follower.state().pair is None
    assert follower.state().home is not None
    for _ in range(24):
        assert not follower.update(blank).followed
    assert follower.state().home is None
    assert follower.update(masks).followed


def blank(shape: tuple[int, int]) -> Masks:
    return Masks(
        np.full(shape, labels.TERRAIN, np.uint8),
        np.zeros(shape, np.uint8),
        np.zeros(shape, np.uint8),
    )


def full(shape: tuple[int, int]) -> Masks:
    return Masks(
        np.full(shape, labels.RAIL_RAISED, np.uint8), *(np.full(shape, 255, np.uint8),) * 2
    )


@pytest.mark.parametrize("cam", [None, camera()])
@pytest.mark.parametrize("shape", [(1, 1), (1, 640), (360, 1), (15, 15), (360, 640), (90, 160)])
@pytest.mark.parametrize("make", [blank, full])
def test_masks_without_a_track_are_not_followed(
    cam: Camera | None, shape: tuple[int, int], make: object
) -> None:
    geometry = follow(make(shape), cam)
    assert not geometry.followed
    assert geometry.reason


def test_one_rail_alone_is_not_followed() -> None:
    cam = camera()
    masks = draw(cam, 0.0)
    score = masks.rail_score.copy()
    score[:, :320] = 0
    for given in (cam, None):
        assert not follow(dataclasses.replace(masks, rail_score=score), given).followed


def test_crossing_lines_are_not_followed() -> None:
    import cv2

    score = np.zeros((360, 640), np.uint8)
    cv2.line(score, (120, 359), (520, 175), 255, 3)
    cv2.line(score, (520, 359), (120, 175), 255, 3)
    masks = dataclasses.replace(blank((360, 640)), rail_score=score)
    for given in (camera(), None):
        assert not follow(masks, given).followed


@pytest.mark.parametrize("seed", range(6))
def test_noise_never_crashes_and_is_never_followed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    planes = rng.integers(0, 19, (120, 200)).astype(np.uint8)
    score = rng.integers(0, 256, (120, 200)).astype(np.uint8)
    assert not follow(Masks(planes, score, score), camera() if seed % 2 else None).followed


@pytest.mark.parametrize(
    ("labels", "score", "words"),
    [
        (np.zeros((4, 4), np.uint8), np.zeros((4, 5), np.uint8), "differ in size"),
        (np.full((4, 4), 19, np.uint8), np.zeros((4, 4), np.uint8), "class id 19"),
        (np.zeros((4, 4)), np.zeros((4, 4), np.uint8), "uint8"),
        (np.zeros((0, 4), np.uint8), np.zeros((0, 4), np.uint8), "non-empty"),
        (np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint8), r"\(H, W\)"),
    ],
)
def test_masks_that_are_none(labels: np.ndarray, score: np.ndarray, words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        TrackFollower().update(Masks(labels, score, score))


def test_an_object_on_the_track_cuts_the_reach() -> None:
    cam = camera()
    free = follow(draw(cam, 0.0), cam)
    cut = follow(draw(cam, 0.0, things=[Thing(labels.TRUCK, 40.0, 0.0, 2.6, 3.5)]), cam)
    assert free.reach_m is not None
    assert cut.reach_m is not None
    assert cut.reach_m == pytest.approx(40.0, abs=2.0)
    assert free.reach_m > 100
