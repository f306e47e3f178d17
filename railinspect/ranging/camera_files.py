"""Cameras from the calibration files of public data sets."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError
from railinspect.ranging.calibrate_board import UNKNOWN_HEIGHT_M, UNKNOWN_HEIGHT_STD_M
from railinspect.ranging.stereo_camera import StereoCamera

OSDAR_HEIGHT_STD_M = 0.05
OSDAR_PITCH_STD_RAD = math.radians(0.3)


def camera_from_osdar23(path: Path, sensor: str = "rgb_center") -> Camera:
    """Read one camera of an OSDaR23 scene in OpenLABEL.

    Its base frame looks ahead with x, to the left with y and up with z, z = 0 on the rail tops.

    Args:
        path: The scene's ``…_labels.json``.
        sensor: Name of the camera's stream.

    Raises:
        BadInputError: if the file is no such scene, or the camera is missing or absurd.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))["openlabel"]
        streams, systems = data["streams"], data["coordinate_systems"]
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read calibration file {path}: {error}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise BadInputError(
            f"{path} is no OpenLABEL scene with streams and coordinate systems: {error!r}"
        ) from error
    cameras = sorted(n for n, s in streams.items() if s.get("type") == "camera" and n in systems)
    if sensor not in cameras:
        raise BadInputError(f"{path} has no camera {sensor!r}; it has {', '.join(cameras)}")
    try:
        return _osdar_camera(streams[sensor], systems[sensor])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        if isinstance(error, BadInputError):
            raise
        raise BadInputError(f"{path}: camera {sensor!r} is incomplete: {error!r}") from error


def _osdar_camera(stream: dict[str, Any], system: dict[str, Any]) -> Camera:
    inside = stream["stream_properties"]["intrinsics_pinhole"]
    matrix = np.array(inside["camera_matrix"], float).reshape(3, 4)
    k1, k2, p1, p2, k3 = (float(value) for value in inside["distortion_coeffs"])
    pose = system["pose_wrt_parent"]
    across, high = (float(value) for value in pose["translation"][1:3])
    qx, qy, qz, qw = (float(value) for value in pose["quaternion"])
    # Columns of the rotation from sensor to base: the viewing direction and the left.
    ahead = np.array(
        [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qz * qw), 2 * (qx * qz - qy * qw)]
    )
    left_z = 2 * (qy * qz + qx * qw)
    focal = float(matrix[0, 0])
    return Camera(
        (int(inside["width_px"]), int(inside["height_px"])),
        focal,
        (float(matrix[0, 2]), float(matrix[1, 2])),
        high,
        pitch_rad=-math.asin(float(np.clip(ahead[2], -1.0, 1.0))),
        roll_rad=math.asin(float(np.clip(left_z / math.cos(math.asin(ahead[2])), -1.0, 1.0))),
        yaw_rad=math.atan2(ahead[1], ahead[0]),
        offset_m=across,
        distortion=(k1, k2, p1, p2, k3),
        std=CameraStd(
            focal_px=2e-3 * focal,
            height_m=OSDAR_HEIGHT_STD_M,
            pitch_rad=OSDAR_PITCH_STD_RAD,
            roll_rad=OSDAR_PITCH_STD_RAD,
            gauge_m=0.003,
        ),
    )


def camera_from_kitti(
    path: Path, size_wh: tuple[int, int], height_m: float | None = None
) -> Camera:
    """Read the left camera of a KITTI calibration, whose pictures are rectified.

    The file says nothing of where the camera is: height and pitch are guesses with wide errors
    unless given.

    Args:
        path: The calibration file.
        size_wh: Size of the pictures, pixels.
        height_m: Height above the rail tops, metres, where it is known.
    """
    pair = StereoCamera.from_kitti(path)
    return Camera(
        size_wh,
        pair.focal_px,
        pair.principal_uv,
        UNKNOWN_HEIGHT_M if height_m is None else height_m,
        std=CameraStd(
            focal_px=2e-3 * pair.focal_px,
            height_m=UNKNOWN_HEIGHT_STD_M if height_m is None else 0.05,
            pitch_rad=math.radians(3.0),
            roll_rad=math.radians(1.0),
            gauge_m=0.005,
        ),
    )
