"""Calibration from boards, from a ride, from data sets' files; and the drift alarm."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError
from railinspect.evaluation import true_segmentation
from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.ranging.calibrate_board import calibrate_boards, calibrate_folder
from railinspect.ranging.calibrate_ride import DriftMonitor, RideCalibrator, with_ride
from railinspect.ranging.camera_files import camera_from_kitti, camera_from_osdar23
from railinspect.scenes import Ride, demo_settings, tables
from railinspect.track import TrackFollower

REAL = Path(__file__).parents[4] / "shared" / "real"


def board_picture(focal_px: float, turn: npt.ArrayLike, at: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """A 10x7 checkerboard of 50 mm squares seen by a pinhole camera of 640x480."""
    squares = np.indices((7 + 2, 10 + 2)).sum(axis=0) % 2
    squares[[0, -1]] = 1
    squares[:, [0, -1]] = 1
    texture = cv2.resize((squares * 200 + 30).astype(np.uint8), None, fx=40, fy=40, interpolation=0)
    corners = np.array([[0, 0, 0], [12, 0, 0], [12, 9, 0], [0, 9, 0]]) * 0.05 - [0.3, 0.225, 0]
    rotation = cv2.Rodrigues(np.asarray(turn, float))[0]
    seen = corners @ rotation.T + np.asarray(at, float)
    pixels = (seen[:, :2] / seen[:, 2:] * focal_px + [319.5, 239.5]).astype(np.float32)
    flat = np.array([[0, 0], [480, 0], [480, 360], [0, 360]], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(flat, pixels)
    return np.asarray(
        cv2.warpPerspective(texture, warp, (640, 480), flags=cv2.INTER_AREA, borderValue=230),
        np.uint8,
    )


POSES = [
    ((0.4, 0.1, 0.0), (0.0, 0.0, 1.1)),
    ((-0.4, 0.2, 0.1), (0.1, 0.0, 1.2)),
    ((0.1, 0.5, 0.0), (-0.1, 0.05, 1.1)),
    ((0.1, -0.5, 0.2), (0.1, -0.05, 1.3)),
    ((0.3, 0.4, -0.2), (0.0, 0.1, 1.2)),
    ((-0.3, -0.4, 0.0), (0.0, -0.1, 1.1)),
]


def test_boards_give_the_focal_length_with_its_error(tmp_path: Path) -> None:
    for number, (turn, at) in enumerate(POSES):
        cv2.imwrite(str(tmp_path / f"{number}.png"), board_picture(700.0, turn, at))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 128, np.uint8))
    found = calibrate_folder(tmp_path, (9, 6), 0.05)
    assert found.without == ("empty.png",)
    assert found.rms_px < 0.5
    assert found.camera.focal_px == pytest.approx(700.0, rel=0.01)
    assert abs(found.camera.focal_px - 700.0) < 4 * found.camera.std.focal_px
    assert found.camera.std.height_m > 0.5  # no board knows how high the camera hangs


def test_too_few_boards(tmp_path: Path) -> None:
    grey = np.full((480, 640), 128, np.uint8)
    with pytest.raises(BadInputError, match="found in 0 of 2 pictures"):
        calibrate_boards([("a", grey), ("b", grey)], (9, 6), 0.05)
    with pytest.raises(BadInputError, match="differ in size"):
        calibrate_boards([("a", grey), ("b", grey[:100])], (9, 6), 0.05)
    with pytest.raises(BadInputError, match="no folder"):
        calibrate_folder(tmp_path / "none", (9, 6), 0.05)


def test_a_ride_calibrates_its_own_camera() -> None:
    ride = Ride.plan(1, demo_settings(), duration_s=10)
    sleepers = float(ride.world.tracks[0][tables.TRACK_SLEEPER_PITCH])
    calibrator = RideCalibrator((640, 360), sleeper_m=sleepers)
    for index in range(0, 125, 6):
        frame = ride.frame(index)
        calibrator.update(true_segmentation(frame.labels), frame.rgb)
    found, truth = calibrator.result().camera, ride.camera
    assert found.focal_px == pytest.approx(truth.focal_px, rel=0.03)
    assert found.height_m == pytest.approx(truth.height_m, rel=0.02)
    assert found.pitch_rad == pytest.approx(truth.pitch_rad, abs=math.radians(0.1))
    assert found.std.focal_px / found.focal_px < 0.03
    # A wrong spacing of the sleepers goes straight into the focal length, and says so.
    assert found.std.focal_px / found.focal_px >= 0.009


def test_without_sleepers_or_rails_there_is_no_calibration() -> None:
    calibrator = RideCalibrator((640, 360))
    masks = draw(camera())
    calibrator.update(masks, np.zeros((360, 640, 3), np.uint8))
    with pytest.raises(BadInputError, match="at least 20"):
        calibrator.result()
    with pytest.raises(BadInputError, match=r"0\.3 to 1\.2"):
        RideCalibrator((640, 360), sleeper_m=0.0)
    with pytest.raises(BadInputError, match="the calibration is for"):
        calibrator.update(masks, np.zeros((10, 10, 3), np.uint8))


def test_drift_is_said() -> None:
    cam = camera()
    tilted = dataclasses.replace(cam, pitch_rad=cam.pitch_rad + math.radians(0.8))
    for seen, expected in ((cam, False), (tilted, True)):
        monitor, follower = DriftMonitor(cam, window=5), TrackFollower(cam)
        masks = draw(seen)
        drift = None
        for _ in range(6):
            drift = monitor.update(follower.update(masks))
        assert drift is not None
        assert (drift.alarm is not None) == expected
        if expected:
            assert "pitch has moved by +0." in str(drift.alarm)
            assert math.degrees(drift.pitch_rad) == pytest.approx(0.8, abs=0.15)


def test_board_and_ride_together() -> None:
    ride = Camera((640, 360), 700.0, (319.5, 179.5), 2.6, pitch_rad=0.05)
    board = Camera((640, 360), 650.0, (319.5, 179.5), 2.4, std=CameraStd(focal_px=2.0))
    both = with_ride(board, ride)
    assert (both.focal_px, both.height_m) == (650.0, 2.6)
    # The horizon's row is what the ride measured: it stays.
    assert both.horizon_v() == pytest.approx(ride.horizon_v())


OSDAR = {
    "openlabel": {
        "coordinate_systems": {
            "front": {
                "pose_wrt_parent": {
                    "translation": [0.1, -0.3, 3.5],
                    "quaternion": [0.0, math.sin(0.05), 0.0, math.cos(0.05)],
                }
            }
        },
        "streams": {
            "front": {
                "type": "camera",
                "stream_properties": {
                    "intrinsics_pinhole": {
                        "camera_matrix": [4600.0, 0, 1230, 0, 0, 4600.0, 800, 0, 0, 0, 1, 0],
                        "distortion_coeffs": [-0.09, 0.6, 0.0, 0.0, 0.4],
                        "width_px": 2464,
                        "height_px": 1600,
                    }
                },
            }
        },
    }
}


def test_osdar23(tmp_path: Path) -> None:
    path = tmp_path / "labels.json"
    path.write_text(json.dumps(OSDAR))
    found = camera_from_osdar23(path, "front")
    assert (found.focal_px, found.height_m, found.offset_m) == (4600.0, 3.5, -0.3)
    assert found.pitch_rad == pytest.approx(0.1)  # turned about y, to the left: looks down
    with pytest.raises(BadInputError, match="it has front"):
        camera_from_osdar23(path, "rear")
    path.write_text("{}")
    with pytest.raises(BadInputError, match="no OpenLABEL"):
        camera_from_osdar23(path)


@pytest.mark.skipif(
    not (REAL / "osdar23_calibration_labels.json").is_file(), reason="no shared/real here"
)
def test_a_real_osdar23_scene() -> None:
    path = REAL / "osdar23_calibration_labels.json"
    found = camera_from_osdar23(path, "rgb_highres_center")
    assert found.size_wh == (4112, 2504)
    assert found.height_m == pytest.approx(3.50982)
    assert math.degrees(found.pitch_rad) == pytest.approx(6.46, abs=0.01)


def test_kitti_is_wide_about_where_the_camera_hangs(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    row = "721.5 0 609.6 {} 0 721.5 172.9 0 0 0 1 0"
    path.write_text(f"P2: {row.format(44.9)}\nP3: {row.format(-339.5)}\n")
    found = camera_from_kitti(path, (1242, 375))
    assert found.focal_px == 721.5
    assert found.std.height_m >= 0.5


@pytest.mark.parametrize(
    "bad",
    [
        {"focal_px": 0.0},
        {"focal_px": math.nan},
        {"height_m": -2.0},
        {"principal_uv": (math.nan, 0.0)},
        {"offset_m": math.inf},
        {"std": CameraStd(height_m=-1.0)},
        {"std": CameraStd(focal_px=math.nan)},
    ],
)
def test_absurd_cameras_are_refused(bad: dict[str, object]) -> None:
    good = Camera((640, 360), 700.0, (319.5, 179.5), 2.6)
    with pytest.raises(BadInputError):
        dataclasses.replace(good, **bad)
