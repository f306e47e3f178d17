import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railinspect.anomalies.ego import (
    NoTrackError,
    check_mask,
    track_of_mask,
    track_of_rails,
    track_of_world,
)
from railinspect.errors import BadInputError
from railinspect.scenes import SceneSettings
from railinspect.scenes.render import view
from railinspect.scenes.world import begin, finish
from tests.railinspect.anomalies.flat_track import a_camera, flat_picture, rails


def heights_px(track, along_m, height_m=1.8):
    foot, head = track.pixels(along_m, 0.0, 0.0), track.pixels(along_m, 0.0, height_m)
    return np.hypot(*(foot - head).T)


@settings(max_examples=40)
@given(
    radius=st.one_of(st.just(np.inf), st.floats(250, 3000), st.floats(-3000, -250)),
    pitch=st.floats(-0.02, 0.12),
    roll=st.floats(-0.05, 0.05),
    yaw=st.floats(-0.08, 0.08),
    height=st.floats(1.6, 4.0),
    bend=st.sampled_from([0.0, -0.12, 0.04]),
    gauge=st.sampled_from([1.0, 1.435, 1.668]),
    grade=st.floats(-0.02, 0.02),
)
def test_two_rails_give_place_and_scale(radius, pitch, roll, yaw, height, bend, gauge, grade):
    camera = a_camera(
        pitch_rad=pitch,
        roll_rad=roll,
        yaw_rad=yaw,
        height_m=height,
        gauge_m=gauge,
        distortion=(bend, 0, 0, 0, 0),
    )
    pair = rails(camera, radius, reach_m=90.0, grade=grade)
    track = track_of_rails(*pair, camera.size_wh, camera)
    near, far = track.section(0.3, 0.8)
    for along in np.linspace(near, min(far, 80.0), 5):
        angle = along / radius
        x = along * np.sinc(angle / np.pi)
        y = along * angle / 2 * np.sinc(angle / 2 / np.pi) ** 2
        found = track.points(along, 0.0, 0.0)
        assert np.hypot(found[0] - x, found[1] - y) < 0.02 * along + 0.1
        true = camera.distort(camera.project([[x, y, grade * along + up] for up in (0.0, 1.8)]))
        true_px = np.hypot(*(true[1] - true[0]))
        assert heights_px(track, np.array([along]))[0] == pytest.approx(true_px, rel=0.02)


@pytest.mark.parametrize("radius", [220.0, -220.0])
def test_a_track_that_turns_away_is_not_taken_for_a_nearer_one(radius):
    # at 60 m it has turned by 0.27 rad: its rails lie 3.7 % farther apart in a row
    camera = a_camera((1280, 720), height_m=3.5, roll_rad=0.03)
    track = track_of_rails(*rails(camera, radius, reach_m=75.0), camera.size_wh, camera)
    angle = 60.0 / radius
    place = [radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0]
    true = camera.project([place, [place[0], place[1], 1.8]])
    row = np.interp(-true[0, 1], -track.rows_px, track.along_m)
    assert row == pytest.approx(60.0, rel=0.01)
    size = np.hypot(*(true[1] - true[0]))
    assert heights_px(track, np.array([row]))[0] == pytest.approx(size, rel=0.01)


def test_without_a_camera_the_scale_holds_but_no_range_is_claimed():
    camera = a_camera()
    pair = rails(camera, 600.0)
    known = track_of_rails(*pair, camera.size_wh, camera)
    guessed = track_of_rails(*pair, camera.size_wh)
    assert known.calibrated
    assert not guessed.calibrated
    for row in (300.0, 350.0, 420.0):
        sizes = []
        for track in (known, guessed):
            along = np.interp(-row, -track.rows_px, track.along_m)
            sizes.append(heights_px(track, np.array([along]))[0])
        assert sizes[1] == pytest.approx(sizes[0], rel=0.03)


def test_the_order_of_a_polyline_does_not_matter():
    camera = a_camera()
    left, right = rails(camera)
    one = track_of_rails(left, right, camera.size_wh, camera)
    other = track_of_rails(left[::-1], right, camera.size_wh, camera)
    np.testing.assert_array_equal(one.along_m, other.along_m)


def test_the_section_is_equations_44_to_46():
    camera = a_camera()
    track = track_of_rails(*rails(camera), camera.size_wh, camera)
    near, far = track.section(0.3, 0.8)
    bottom, top = track.rows_px[0], camera.horizon_v()
    rows = np.interp([near, far], track.along_m, track.rows_px)
    expected = [bottom - share * (bottom - top) for share in (0.3, 0.8)]
    np.testing.assert_allclose(rows, expected, atol=1.0)


def test_a_mask_gives_the_same_track_as_its_rails():
    camera = a_camera()
    _, labels, track = flat_picture(camera)
    found = track_of_mask(labels, camera)
    near, far = track.section(0.3, 0.7)
    along = np.linspace(near, far, 9)
    np.testing.assert_allclose(heights_px(found, along), heights_px(track, along), rtol=0.03)


def test_a_rendered_world_knows_its_track():
    settings = SceneSettings(size_wh=(480, 270), weather=False, kind="line")
    draft, alignment, camera = begin(4, settings)
    world = finish(draft, 4, alignment, camera)
    picture = view(world, np.random.default_rng(0))
    true = track_of_world(world, picture)
    found = track_of_rails(*picture.ego_rails, (480, 270), picture.camera)
    near, far = true.section(0.3, 0.8)
    for row in np.interp([near, 0.5 * (near + far), far], true.along_m, true.rows_px):
        ranges = [np.interp(-row, -t.rows_px, t.along_m) for t in (true, found)]
        assert ranges[1] == pytest.approx(ranges[0], rel=0.02)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ([[1, 2]], [[3, 4]]),
        ([[100, 500], [200, 300]], [[100, 100], [90, 50]]),
        ([[500, 500], [400, 300]], [[300, 500], [380, 300]]),
        ([[300, 500], [450, 250]], [[500, 500], [350, 250]]),
        ([[300, 500], [np.nan, 250]], [[500, 500], [480, 250]]),
        ([[400, 500], [400, 250]], [[402, 500], [401, 250]]),
        ([[300, 500], [1e9, 250]], [[500, 500], [480, 250]]),
    ],
    ids=["one point", "no common row", "swapped", "crossing", "NaN", "too near", "huge"],
)
def test_what_is_no_track_is_refused_or_measured_where_it_is_one(left, right):
    try:
        track = track_of_rails(np.array(left, float), np.array(right, float), (960, 540))
    except NoTrackError as error:
        assert len(str(error)) > 20  # noqa: PT017 - crossing rails may be a track up to there
    else:
        assert (track.right_px - track.left_px > 0).all()


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((5, 5, 3), np.uint8),
        np.zeros((0, 4), np.uint8),
        np.zeros((4, 4), float),
        np.full((40, 40), 77, np.uint8),
    ],
)
def test_what_is_no_mask_is_refused(mask):
    with pytest.raises(BadInputError):
        check_mask(mask)


@pytest.mark.parametrize(
    "mask",
    [
        np.full((1, 1), 17, np.uint8),
        np.full((200, 300), 17, np.uint8),
        np.full((200, 300), 255, np.uint8),
        np.zeros((120, 160), np.uint8),
    ],
)
def test_masks_without_two_rails_have_no_track(mask):
    with pytest.raises(NoTrackError):
        track_of_mask(mask)


def test_one_rail_is_no_track():
    camera = a_camera()
    _, labels, track = flat_picture(camera)
    middle = np.interp(
        np.arange(540), track.rows_px[::-1], (track.left_px + track.right_px)[::-1] / 2
    )
    for row in range(540):
        right = labels[row, int(middle[row]) :]
        right[right == 17] = 9
    with pytest.raises(NoTrackError):
        track_of_mask(labels, camera)
