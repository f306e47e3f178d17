"""Calibration of a camera's inside from pictures of a checkerboard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError

Image = npt.NDArray[np.uint8]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
UNKNOWN_HEIGHT_M, UNKNOWN_HEIGHT_STD_M = 2.4, 0.6
UNKNOWN_PITCH_STD_RAD = math.radians(3.0)


@dataclass(frozen=True)
class BoardCalibration:
    """What the boards gave.

    Attributes:
        camera: The camera; what a board cannot know (height, pitch, roll) is a guess with a wide
            deviation.
        rms_px: Root mean square of the corners' distance from the model, pixels.
        used: Names of the pictures used.
        without: Names of those in which no board was found.
    """

    camera: Camera
    rms_px: float
    used: tuple[str, ...]
    without: tuple[str, ...]


def calibrate_folder(
    folder: Path,
    corners_wh: tuple[int, int],
    square_m: float,
    height_m: float | None = None,
    height_std_m: float = 0.02,
) -> BoardCalibration:
    """Calibrate from all pictures of a folder.

    Args:
        folder: Folder of pictures of one size.
        corners_wh: Inner corners of the board along its two sides.
        square_m: Side of a square, metres, > 0.
        height_m: Height of the camera above the rail tops, metres, where it was measured.
        height_std_m: Its standard deviation.

    Raises:
        BadInputError: if there are fewer than three usable pictures or their sizes differ.
    """
    if not folder.is_dir():
        raise BadInputError(f"{folder} is no folder; give one with pictures of a checkerboard")
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURES)
    pictures = []
    for path in paths:
        grey = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise BadInputError(f"{path} cannot be read as a picture")
        pictures.append((path.name, np.asarray(grey, np.uint8)))
    return calibrate_boards(pictures, corners_wh, square_m, height_m, height_std_m)


def calibrate_boards(
    pictures: Sequence[tuple[str, Image]],
    corners_wh: tuple[int, int],
    square_m: float,
    height_m: float | None = None,
    height_std_m: float = 0.02,
) -> BoardCalibration:
    """The same from grey pictures, each with its name."""
    across, down = corners_wh
    if across < 3 or down < 3:
        raise BadInputError(
            f"a board of {across}x{down} inner corners is too small; use 3x3 or more"
        )
    if not (math.isfinite(square_m) and square_m > 0):
        raise BadInputError(f"square_m is {square_m}; give the side of a square in metres")
    sizes = {image.shape for _, image in pictures}
    if len(sizes) > 1:
        raise BadInputError(
            f"the pictures differ in size: {sorted(sizes)}; one camera has one size"
        )
    found = [(name, _corners(image, corners_wh)) for name, image in pictures]
    used = [(name, corners) for name, corners in found if corners is not None]
    if len(used) < 3:
        raise BadInputError(
            f"a board of {across}x{down} inner corners was found in {len(used)} of "
            f"{len(pictures)} pictures; at least 3 are needed, better 15 from many angles"
        )
    rows, columns = pictures[0][1].shape
    grid = np.zeros((across * down, 3), np.float32)
    grid[:, :2] = np.mgrid[:across, :down].T.reshape(-1, 2) * square_m
    start = np.array([[columns, 0, (columns - 1) / 2], [0, columns, (rows - 1) / 2], [0, 0, 1.0]])
    rms, matrix, lens, _, _, deviations, *_ = cv2.calibrateCameraExtended(
        [grid] * len(used),
        [corners for _, corners in used],
        (columns, rows),
        start,
        np.zeros(5),
        flags=cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS,
    )
    k1, k2, p1, p2, k3 = (float(value) for value in lens.ravel()[:5])
    focal = float(matrix[0, 0])
    camera = Camera(
        (columns, rows),
        focal,
        (float(matrix[0, 2]), float(matrix[1, 2])),
        UNKNOWN_HEIGHT_M if height_m is None else height_m,
        distortion=(k1, k2, p1, p2, k3),
        std=CameraStd(
            # Corners share the board's own unevenness: never surer than a part in a thousand.
            focal_px=math.hypot(float(deviations.ravel()[:2].max()), 1e-3 * focal),
            height_m=UNKNOWN_HEIGHT_STD_M if height_m is None else height_std_m,
            pitch_rad=UNKNOWN_PITCH_STD_RAD,
            roll_rad=UNKNOWN_PITCH_STD_RAD / 2,
            gauge_m=0.005,
        ),
    )
    without = tuple(name for name, corners in found if corners is None)
    return BoardCalibration(camera, float(rms), tuple(name for name, _ in used), without)


def _corners(image: Image, corners_wh: tuple[int, int]) -> npt.NDArray[np.float32] | None:
    good, corners = cv2.findChessboardCornersSB(
        image, corners_wh, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    )
    return np.asarray(corners, np.float32) if good else None
