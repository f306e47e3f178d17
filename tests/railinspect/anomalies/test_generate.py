import cv2
import numpy as np
import pytest

from railinspect.anomalies.cutouts import Cutout
from railinspect.anomalies.ego import NoTrackError
from railinspect.anomalies.generate import GeneratorSettings, generate, place
from railinspect.errors import BadInputError
from railinspect.labels import CONSTRUCTION, GROUND, HUMAN, VEGETATION
from tests.railinspect.anomalies.flat_track import a_camera, flat_picture


def a_board(kind="trespasser", height_m=1.8, label=HUMAN):
    rgba = np.full((200, 80, 4), 255, np.uint8)
    rgba[..., :3] = (250, 60, 60)
    return Cutout("board", kind, rgba, height_m, label)


BOARDS = GeneratorSettings(
    cutouts=(a_board(), a_board("obstruction", 0.8, CONSTRUCTION)), shadow=0.0
)


@pytest.mark.parametrize("roll", [0.0, 0.04])
@pytest.mark.parametrize("along", [11.0, 18.0, 30.0, 60.0])
def test_a_board_stands_as_high_as_the_camera_says(along, roll):
    camera = a_camera((1280, 720), roll_rad=roll)
    rgb, labels, track = flat_picture(camera)
    foot, head = track.pixels(along, 0.4, [track.ground_m, track.ground_m + 1.8])
    placed = place(rgb, labels, track, a_board(), along, 0.4, 1.0)
    true = np.hypot(*(head - foot))
    # the area of the matte is its width times its height, whatever its turn
    assert placed.matte.sum() / (true * 0.4) == pytest.approx(true, rel=0.03)
    v, u = np.indices(placed.matte.shape)
    middle = np.array([(placed.matte * u).sum(), (placed.matte * v).sum()]) / placed.matte.sum()
    np.testing.assert_allclose(middle + placed.at_xy, 0.5 * (foot + head), atol=0.3)
    assert placed.box_xyxy[3] == pytest.approx(foot[1], abs=1.0 + 20 * roll)


def test_what_is_placed_changes_mask_and_picture_in_its_outline_alone():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    before, mask = rgb.copy(), labels.copy()
    placed = place(rgb, labels, track, a_board(), 20.0, 0.0, 1.0, BOARDS)
    where = labels != mask
    assert (labels[where] == HUMAN).all()
    left, top, right, bottom = (round(edge) for edge in placed.box_xyxy)
    assert where[top : bottom + 1, left : right + 1].mean() > 0.97
    assert where.sum() == where[top : bottom + 1, left : right + 1].sum()
    changed = (rgb != before).any(axis=2)
    assert changed[where].all()
    assert changed.sum() < 1.3 * where.sum() + 40


def test_a_shadow_darkens_the_ground_at_the_foot():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    before = rgb.astype(int)
    placed = place(rgb, labels, track, a_board(), 12.0, 0.0, 1.0)
    left, _, right, bottom = (round(edge) for edge in placed.box_xyxy)
    under = np.s_[bottom + 1 : bottom + 3, left:right]
    assert rgb[under].mean() < 0.85 * before[under].mean()


@pytest.mark.parametrize("radius_m", [120.0, -250.0, np.inf])
def test_a_bend_shows_at_right_angles_to_the_rails(radius_m):
    # In a sharp curve the rails run along the rows, and a shift along those moves nothing.
    camera = a_camera((640, 360))
    rgb, labels, track = flat_picture(camera, radius_m)
    off_rails = cv2.distanceTransform((labels != 17).astype(np.uint8), cv2.DIST_L2, 5)
    for seed in range(25):
        one = generate(rgb, labels, "distortion", np.random.default_rng(seed), track)
        bent = off_rails[one.labels == 17].max()
        assert bent > 1.5, seed
        assert bent == pytest.approx(one.blend["amplitude_px"], abs=1.3)
        assert one.height_m <= 0.45


@pytest.mark.parametrize("kind", ["distortion", "obstruction", "trespasser"])
def test_the_truth_of_what_is_generated(kind):
    camera = a_camera()
    rgb, labels, track = flat_picture(camera, 700.0)
    kept = rgb.copy(), labels.copy()
    near, far = track.section(0.3, 0.8)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        one = generate(rgb, labels, kind, rng, track, BOARDS)
        assert near <= one.range_m <= far
        assert (one.rgb != rgb).any()
        assert (one.labels != labels).any()
        changed_v, changed_u = np.nonzero(one.labels != labels)
        left, top, right, bottom = one.box_xyxy
        assert top - 1 <= changed_v.min() <= changed_v.max() <= bottom + 1
        if kind == "distortion":
            assert set(np.unique(one.labels)) <= set(np.unique(labels))
            assert one.blend["amplitude_px"] >= 2.49
        else:
            assert left - 1 <= changed_u.min() <= changed_u.max() <= right + 1
            foot = track.pixels(one.range_m, one.lateral_m, track.ground_m)
            assert bottom == pytest.approx(foot[1], abs=1.0)
            reach = 1.5 if kind == "trespasser" else track.camera.rail_spacing_m / 2
            assert abs(one.lateral_m) <= reach
    np.testing.assert_array_equal(rgb, kept[0])
    np.testing.assert_array_equal(labels, kept[1])


def test_the_same_state_gives_the_same_bytes():
    camera = a_camera((640, 360))
    rgb, labels, track = flat_picture(camera)
    made = [
        generate(rgb, labels, "obstruction", np.random.default_rng(4), track, BOARDS)
        for _ in range(2)
    ]
    assert made[0].rgb.tobytes() == made[1].rgb.tobytes()
    assert made[0].polygon_uv.tobytes() == made[1].polygon_uv.tobytes()


def test_without_a_track_it_is_found_in_the_mask():
    camera = a_camera()
    rgb, labels, _ = flat_picture(camera)
    one = generate(rgb, labels, "trespasser", np.random.default_rng(1), None, BOARDS, camera)
    assert one.range_m is not None
    other = generate(rgb, labels, "trespasser", np.random.default_rng(1), None, BOARDS)
    assert other.range_m is None


def test_no_place_is_no_place():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    labels[np.isin(labels, GROUND)] = CONSTRUCTION
    for kind in ("distortion", "obstruction", "trespasser"):
        with pytest.raises(NoTrackError):
            generate(rgb, labels, kind, np.random.default_rng(0), track, BOARDS)


@pytest.mark.parametrize(
    ("rgb", "labels"),
    [
        (np.zeros((40, 40), np.uint8), np.zeros((40, 40), np.uint8)),
        (np.zeros((40, 40, 3), float), np.zeros((40, 40), np.uint8)),
        (np.zeros((40, 40, 3), np.uint8), np.zeros((40, 41), np.uint8)),
        (np.zeros((40, 40, 3), np.uint8), np.full((40, 40), 99, np.uint8)),
        (np.zeros((1, 1, 3), np.uint8), np.full((1, 1), VEGETATION, np.uint8)),
        (np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.uint8)),
    ],
)
def test_bad_pictures_are_refused(rgb, labels):
    with pytest.raises(BadInputError):
        generate(rgb, labels, "obstruction", np.random.default_rng(0))


@pytest.mark.parametrize(
    "wrong",
    [
        {"near_share": 0.9},
        {"obstruction_alpha": 1.2},
        {"trespasser_alpha": float("nan")},
        {"padding_px": 0},
        {"amplitude_m": (0.0, 0.1)},
        {"distortions": ("wiggle",)},
        {"distortions": ()},
        {"person_reach_m": -1.0},
    ],
)
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(BadInputError):
        GeneratorSettings(**wrong)


def test_cutouts_of_the_other_type_alone_are_refused():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    people = GeneratorSettings(cutouts=(a_board(),))
    with pytest.raises(BadInputError, match="is for type obstruction"):
        generate(rgb, labels, "obstruction", np.random.default_rng(0), track, people)
