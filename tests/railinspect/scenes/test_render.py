import hashlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railinspect import fovea
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, HUMAN, RAIL_HEAD_WIDTH_M, RAIL_RAISED, RAILS
from railinspect.scenes import (
    Ride,
    SceneSettings,
    demo_settings,
    render,
    render_stereo,
    write_images,
)
from railinspect.scenes.dataset import IMAGES, MASKS
from railinspect.scenes.ground import FAR_M
from railinspect.scenes.planting import plant
from railinspect.scenes.rails import RAIL_SIDE_M
from railinspect.scenes.render import Rendered, rail_points, view
from railinspect.scenes.tracks import TURN_REACH_M, add_track
from railinspect.scenes.world import begin, finish

SMALL = (320, 180)
CLEAR = SceneSettings(size_wh=SMALL, kind="line", occluders=False, weather=False, distractors=False)


def on_rails(picture: Rendered) -> float:
    """Share of the nearer two thirds of rail points that lie within a pixel of a rail label."""
    rails = np.isin(picture.labels, RAILS).astype(np.uint8)
    near = cv2.dilate(rails, np.ones((3, 3), np.uint8))
    points = np.concatenate([rail[len(rail) // 3 :] for rail in picture.ego_rails])
    where = np.clip(np.round(points).astype(int), 0, np.array(picture.labels.shape)[::-1] - 1)
    return float(near[where[:, 1], where[:, 0]].mean())


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_same_seed_same_bytes_and_a_complete_picture(seed: int) -> None:
    choice = SceneSettings(size_wh=SMALL)
    first, second = render(seed, choice), render(seed, choice)
    assert first.rgb.tobytes() == second.rgb.tobytes()
    assert first.labels.tobytes() == second.labels.tobytes()
    assert first.labels.max() < len(CLASSES)
    assert first.depth_m.min() > 0
    for rail in first.ego_rails:
        assert (np.diff(rail[:, 1]) > -60).all()
        assert (rail >= -0.5).all()
        assert (rail <= np.array(SMALL) - 0.5).all()


def test_different_seeds_differ() -> None:
    assert render(1, CLEAR).rgb.tobytes() != render(2, CLEAR).rgb.tobytes()


@pytest.mark.parametrize("seed", range(20, 26))
def test_true_rails_lie_on_rail_labels_where_nothing_hides_them(seed: int) -> None:
    assert on_rails(render(seed, CLEAR)) > 0.85


def test_rails_stay_true_through_a_distorting_lens() -> None:
    camera = Camera.from_field_of_view(
        SMALL, 1.2, 2.5, pitch_rad=0.05, distortion=(-0.15, 0.0, 0.0, 0.0, 0.0)
    )
    picture = render(21, replace(CLEAR, camera=camera))
    assert len(picture.ego_rails[0]) > 50
    assert on_rails(picture) > 0.85


def level_world(seed: int = 3, fov: float = 0.9) -> tuple:
    camera = Camera.from_field_of_view((640, 360), fov, 2.5, pitch_rad=0.05)
    draft, alignment, camera = begin(
        seed,
        SceneSettings(
            camera=camera, kind="line", occluders=False, weather=False, distractors=False
        ),
    )
    draft.crossings.clear()
    level = replace(
        alignment, curvature_per_m=alignment.curvature_per_m * 0, gradient=alignment.gradient * 0
    )
    return draft, level, camera


@pytest.mark.parametrize(("lateral_m", "side_face_m"), [(0.0, 0.0), (-4.5, RAIL_SIDE_M)])
def test_a_rail_is_labelled_as_wide_as_its_head_is_seen(
    lateral_m: float, side_face_m: float
) -> None:
    """The ego track's heads from above, another track's with the side face towards the camera."""
    draft, level, camera = level_world(fov=0.5)
    draft.offsets[1:], draft.tracks[1:] = [], []
    if lateral_m:
        add_track(draft, np.full(draft.along.size, lateral_m), like=draft.tracks[0])
    world = finish(draft, 3, level, camera)
    picture = view(world, np.random.default_rng(0))
    along = np.linspace(20.0, 26.0, 13)
    half = RAIL_HEAD_WIDTH_M / 2
    nearer = lateral_m + world.spacing_m / 2  # left of the camera's middle only for the ego track
    towards = 1.0 if lateral_m else -1.0

    def column(across: float, height: float, row: float) -> float:
        """Column where the line at this lateral position and height crosses the row."""
        edge = np.column_stack(
            [np.linspace(8, 60, 400), np.full(400, across), np.full(400, height)]
        )
        pixels = camera.project(edge)
        return float(np.interp(row, pixels[::-1, 1], pixels[::-1, 0]))

    rows = np.round(camera.project(rail_points(world, level.local(0.0, FAR_M), 0.0, along, 1.0)))
    widths, expected = [], []
    for row in np.unique(rows[:, 1].astype(int)):
        near_edge = column(nearer + towards * half, -side_face_m, row)
        far_edge = column(nearer - towards * half, 0.0, row)
        low, high = sorted((near_edge, far_edge))
        labels = picture.labels[row, int(low) - 6 : int(high) + 7]
        widths.append(int((labels == RAIL_RAISED).sum()))
        expected.append(high - low)
    assert len(widths) > 10
    assert np.mean(widths) == pytest.approx(np.mean(expected), abs=0.35)
    assert min(expected) > 2.5


@pytest.mark.parametrize("slope", [0.0, 0.7, -2.2])
def test_the_gauge_is_square_to_a_track_that_runs_aslant(slope: float) -> None:
    draft, level, camera = level_world(fov=1.2)
    draft.offsets[1:], draft.tracks[1:] = [], []
    draft.kit = type(draft.kit)()  # nothing stands before it
    course = 6.0 + slope * (draft.along - 25.0)
    add_track(draft, course, like=draft.tracks[0])
    world = finish(draft, 3, level, camera)
    picture = view(world, np.random.default_rng(0))
    along = np.linspace(23.0, 27.0, 33)
    normal = np.array([-slope, 1.0]) / np.hypot(slope, 1.0)
    found = []
    for side in (1.0, -1.0):
        middle = np.column_stack([along, 6.0 + slope * (along - 25.0)])
        head = middle + side * world.spacing_m / 2 * normal
        points = np.column_stack([head, np.zeros(len(head))])
        u, v = np.round(camera.project(points)).astype(int).T
        found.append(np.isin(picture.labels[v, u], RAILS).mean())
    assert min(found) > 0.9


def test_a_junction_turns_every_tram_track_and_keeps_the_street_open() -> None:
    """Turns leave the corridor on one side, on paved ground; the ego track runs straight on."""
    tram = SceneSettings(kind="tram")
    drafts = [begin(seed, tram)[0] for seed in range(40)]
    junctions = [draft for draft in drafts if draft.turns]
    assert 8 < len(junctions) < 32
    for draft in junctions:
        assert (draft.offsets[0] == 0.0).all()
        near, far = draft.crossings[0][:2]
        for turn in draft.turns:
            there = np.isfinite(turn)
            assert there.any()
            assert near < draft.along[there].min() < draft.along[there].max() < far
            assert np.abs(turn[there]).max() <= TURN_REACH_M
            assert not draft.in_the_open(float(draft.along[there].mean()))
        assert draft.in_the_open(far + 10.0)


def test_depth_of_level_ground_is_the_camera_models() -> None:
    draft, alignment, camera = level_world()
    picture = view(finish(draft, 3, alignment, camera), np.random.default_rng(0))
    rails = np.argwhere(np.isin(picture.labels, RAILS))[::37]
    pixels = rails[:, ::-1].astype(float)
    ground = camera.ground(pixels)
    points = np.column_stack([ground, np.zeros(len(ground))])
    seen = (points - [0, 0, camera.height_m]) @ camera.camera_from_world.T
    near = seen[:, 2] < 150
    depth = picture.depth_m[rails[:, 0], rails[:, 1]]
    np.testing.assert_allclose(depth[near], seen[near, 2], rtol=0.01)


def test_rails_are_labelled_while_the_two_can_be_told_apart() -> None:
    draft, level, camera = level_world()
    curve = replace(level, curvature_per_m=np.full_like(level.curvature_per_m, 1 / 300))
    world = finish(draft, 3, curve, camera)
    picture = view(world, np.random.default_rng(0))
    far = curve.local(0.0, FAR_M)
    along = np.linspace(20, 400, 600)
    left, right = (
        camera.project(rail_points(world, far, 0.0, along, side)) for side in (1.0, -1.0)
    )
    step = np.gradient(left, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]]) / np.hypot(*step.T)[:, None]
    gap = np.abs(((right - left) * normal).sum(1))
    where = np.round(left).astype(int)
    inside = (where >= 0).all(1) & (where < np.array(camera.size_wh)).all(1)
    seen = np.zeros(len(where), bool)
    seen[inside] = np.isin(picture.labels[where[inside, 1], where[inside, 0]], RAILS)
    told, merged = inside & (gap > 1.4), inside & (gap < 0.7)
    assert told.sum() > 50
    assert merged.sum() > 50
    assert seen[told].mean() > 0.85  # here and there something stands before it
    assert not seen[merged].any()


@pytest.mark.parametrize("distance", [12.0, 30.0, 60.0])
def test_a_person_stands_as_tall_as_the_camera_model_says(distance: float) -> None:
    draft, alignment, camera = level_world()
    thing = plant(draft, "trespasser", distance, np.random.default_rng(5))
    picture = view(finish(draft, 3, alignment, camera), np.random.default_rng(0))
    (seen,) = [o for o in picture.objects if o.id == thing.id]
    assert seen.range_m == pytest.approx(distance)
    place = np.array([distance, thing.lateral_m, -0.17])
    foot, head = camera.project([place, place + np.array([0, 0, thing.height_m])])
    step = np.array([0.4, 0, 0])
    stride = camera.project([place - step, place + step])[:, 1]
    assert seen.box_xyxy[1] == pytest.approx(head[1], abs=0.03 * (foot[1] - head[1]) + 1)
    assert stride[1] - 1 <= seen.box_xyxy[3] <= stride[0] + 1
    rows, columns = np.nonzero(picture.labels == HUMAN)
    assert np.median(picture.depth_m[rows, columns]) == pytest.approx(distance, rel=0.05)


def test_distortion_bends_rails_and_labels_alike() -> None:
    draft, alignment, camera = level_world()
    plant(draft, "distortion", 15.0, np.random.default_rng(1), clear_of_m=0.29)
    picture = view(finish(draft, 3, alignment, camera), np.random.default_rng(0))
    assert [o.type for o in picture.objects] == ["distortion"]
    assert on_rails(picture) > 0.95


def test_stereo_disparity_is_focal_times_baseline_over_depth() -> None:
    left, right = render_stereo(11, 0.4, CLEAR)
    rows, columns = np.nonzero((left.depth_m > 6) & (left.depth_m < 25))
    disparity = left.camera.focal_px * 0.4 / left.depth_m[rows, columns]
    there = np.round(columns - disparity).astype(int)
    inside = there >= 0
    same = left.labels[rows, columns][inside] == right.labels[rows[inside], there[inside]]
    assert same.mean() > 0.9
    assert np.median(disparity) > 2


def test_image_set_does_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    choice = SceneSettings(size_wh=(160, 96))
    digests = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        names = [p.name for p in write_images(out, range(40, 46), choice, workers)]
        assert names == [f"rs000{n}.jpg" for n in range(40, 46)]
        files = sorted(p for p in out.rglob("*") if p.is_file())
        digests.append(hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest())
    assert digests[0] == digests[1]


def test_image_set_continues_where_it_stopped(tmp_path: Path) -> None:
    choice = SceneSettings(size_wh=(160, 96))
    list(write_images(tmp_path, [1, 2], choice))
    kept = (tmp_path / IMAGES / "rs00001.jpg").stat().st_mtime_ns
    list(write_images(tmp_path, [1, 2, 3], choice))
    assert (tmp_path / IMAGES / "rs00001.jpg").stat().st_mtime_ns == kept
    mask = cv2.imread(str(tmp_path / MASKS / "rs00003.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(mask, render(3, choice).labels)


def test_ride_is_continuous_and_tells_its_truth() -> None:
    ride = Ride.plan(3, demo_settings(SMALL), duration_s=45, anomalies="demo", anomaly_count=7)
    assert {p.type for p in ride.planted} == {"distortion", "obstruction", "trespasser"}
    assert len(ride) == round(45 * 12.5)
    index = int((ride.planted[0].chainage_m - 40) / 20 * 12.5)
    first, second = ride.frame(index), ride.frame(index + 1)
    range_before = {o.id: o.range_m for o in first.objects}
    for thing in second.objects:
        if thing.id in range_before:
            assert range_before[thing.id] - thing.range_m == pytest.approx(20 / 12.5)
    assert range_before
    assert second.time_s - first.time_s == pytest.approx(1 / 12.5)
    change = np.abs(first.rgb.astype(int) - second.rgb.astype(int)).mean()
    far = np.abs(first.rgb.astype(int) - ride.frame(index + 200).rgb.astype(int)).mean()
    assert 0 < change < far
    assert ride.frame(index).rgb.tobytes() == first.rgb.tobytes()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SceneSettings(size_wh=(10, 10)), "64…4096"),
        (lambda: SceneSettings(min_radius_m=50), "200 m"),
        (lambda: SceneSettings(camera=Camera.from_field_of_view((64, 64), 1, 2)), "resized"),
        (lambda: Ride.plan(1, speed_mps=-1.0), "speed_mps is -1.0"),
        (lambda: Ride.plan(1, duration_s=5.0, anomalies="demo"), "no room"),
    ],
)
def test_bad_settings_are_refused_in_one_sentence(make, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        make()


def test_frames_outside_the_ride_are_refused() -> None:
    with pytest.raises(IndexError, match="12 frames"):
        Ride.plan(1, CLEAR, duration_s=1.0, frame_rate=12).frame(12)


@pytest.mark.parametrize("closer", [2, 4])
def test_a_closer_look_is_narrow_and_has_the_horizon_where_looks_have_it(closer: int) -> None:
    horizons = []
    for seed in range(6):
        whole = begin(seed, SceneSettings())[2]
        close = begin(seed, SceneSettings(closer=closer))[2]
        assert close.focal_px == pytest.approx(closer * whole.focal_px)
        horizons.append(close.horizon_v() / close.size_wh[1])
    assert np.mean(horizons) == pytest.approx(1 - fovea.BELOW, abs=0.1)


def test_anomalies_stand_where_a_closer_look_shows_them() -> None:
    seen = 0
    for seed in range(4):
        picture = render(seed, SceneSettings(size_wh=(320, 180), closer=4, crowded=True))
        seen += any(thing.on_track for thing in picture.objects)
    assert seen >= 3


def test_a_given_cameras_view_is_not_narrowed() -> None:
    camera = Camera.from_field_of_view((640, 360), 1.0, 2.5)
    with pytest.raises(BadInputError, match="closer is 2"):
        SceneSettings(camera=camera, closer=2)
    with pytest.raises(BadInputError, match="closer is 0"):
        SceneSettings(closer=0)
