"""The levelled view agrees with the camera it is made from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.camera import Camera
from railinspect.evaluation.drawn_tracks import camera
from railinspect.track.level import Level, bilinear, project, sample_line, world_pixels, x_at

CAMERAS = [
    camera(),
    camera(pitch_deg=-4, roll_deg=3),
    camera((1920, 1080), 40, 3.6, 5, -2),
    camera(roll_deg=2, distortion=(0.08, -0.02, 0.001, -0.002, 0.003)),
]
POINTS = np.array([[12.0, 1.0], [25.0, -2.0], [80.0, 6.0], [150.0, 0.0]])


@pytest.mark.parametrize("cam", CAMERAS)
def test_ground_points_fall_where_the_camera_projects_them(cam: Camera) -> None:
    expected = cam.distort(cam.project(np.c_[POINTS, np.zeros(4)]))
    assert Level.of(cam).pixels(POINTS) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("cam", CAMERAS)
def test_compiled_projection_is_the_same(cam: Camera) -> None:
    level = Level.of(cam)
    compiled = np.array([project(level.vector, x, y) for x, y in POINTS])
    assert compiled == pytest.approx(level.pixels(POINTS), abs=1e-6)


@pytest.mark.parametrize("cam", CAMERAS)
def test_pixels_and_ground_undo_each_other(cam: Camera) -> None:
    level = Level.of(cam)
    assert level.ground(level.pixels(POINTS)) == pytest.approx(POINTS, rel=1e-4, abs=1e-3)


def test_row_to_distance_matches_the_plane() -> None:
    level = Level.of(camera(pitch_deg=3))
    xy = level.ground_from_level(np.array([[0.0, level.horizon_px + 40.0]]))
    assert x_at(level.vector, 40.0) == pytest.approx(float(xy[0, 0]))


def test_at_or_above_the_horizon_there_is_no_ground() -> None:
    level = Level.of(camera())
    above = np.array([[0.0, level.horizon_px], [5.0, level.horizon_px - 3]])
    assert np.isnan(level.ground_from_level(above)).all()


def test_spacing_grows_linearly_and_needs_no_focal_length() -> None:
    near, far = camera(fov_deg=35), camera(fov_deg=80)
    for cam in (near, far):
        level = Level.of(cam)
        ends = level.level_from_ground(np.array([[30.0, 0.75], [30.0, -0.75]]))
        s = ends[0, 1] - level.horizon_px
        growth = (ends[1, 0] - ends[0, 0]) / s
        assert growth == pytest.approx(1.5 * np.cos(cam.pitch_rad) / cam.height_m)


def test_bilinear_hand_worked() -> None:
    image = np.array([[0, 100], [200, 40]], np.uint8)
    assert bilinear(image, 0.5, 0.0) == pytest.approx(50.0)
    assert bilinear(image, 0.25, 0.5) == pytest.approx(0.5 * 25 + 0.5 * 160)
    assert bilinear(image, 1.0, 1.0) == pytest.approx(40.0)
    assert bilinear(image, -0.01, 0.0) == -1.0
    assert bilinear(image, 0.0, 1.01) == -1.0


@given(
    k1=st.floats(-0.15, 0.15),
    k2=st.floats(-0.03, 0.03),
    p1=st.floats(-0.004, 0.004),
    u=st.floats(0, 639),
    v=st.floats(0, 359),
)
def test_undistort_undoes_distort(k1: float, k2: float, p1: float, u: float, v: float) -> None:
    cam = camera(distortion=(k1, k2, p1, -p1, 0.0))
    pixel = np.array([u, v])
    assert cam.undistort(cam.distort(pixel)) == pytest.approx(pixel, abs=0.02)


def test_without_distortion_pixels_stay() -> None:
    pixels = np.array([[3.0, 4.0]])
    assert camera().distort(pixels) == pytest.approx(pixels)
    assert camera().undistort(pixels) == pytest.approx(pixels)


def test_a_line_of_grey_values_is_the_places_one_by_one() -> None:
    """Inside, over the border and off the image; the shortcut for whole lines changes no value."""
    image = np.random.default_rng(1).integers(0, 256, (12, 20), np.uint8)
    for u, v, du, dv in ((9.3, 5.2, 1.0, 0.2), (17.6, 5.0, 1.0, 0.0), (2.0, 10.5, 0.5, 0.4)):
        line = np.empty(9)
        sample_line(image, u, v, du, dv, -4, 2.0, line)
        places = [(u + k / 2 * du, v + k / 2 * dv) for k in range(-4, 5)]
        assert line.tolist() == [max(0.0, bilinear(image, *place)) / 255 for place in places]
    assert line[-1] == 0.0  # the last line ends below the image


@pytest.mark.parametrize("cam", CAMERAS)
def test_world_pixels_are_the_cameras_own(cam: Camera) -> None:
    cam = replace(cam, yaw_rad=0.05, offset_m=0.3)
    expected = cam.distort(cam.project(np.c_[POINTS, np.zeros(4)]))
    assert world_pixels(cam, POINTS) == pytest.approx(expected, abs=1e-6)
