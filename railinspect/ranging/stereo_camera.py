"""Rectified stereo cameras and their calibration files."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StereoCamera:
    """Two rectified cameras side by side, the left one the reference.

    Attributes:
        focal_px: Focal length f of both, pixels.
        baseline_m: Distance l_T between them, metres.
        principal_uv: Principal point of the left one, pixels.
        offset_px: Right principal point's column less the left one's: added to a disparity.
        focal_std_px: Standard deviation of the focal length (bias).
        baseline_std_m: Standard deviation of the baseline (bias).
        offset_std_px: Standard deviation of the offset: the rectification's error (bias).
    """

    focal_px: float
    baseline_m: float
    principal_uv: tuple[float, float]
    offset_px: float = 0.0
    focal_std_px: float = 0.0
    baseline_std_m: float = 0.0
    offset_std_px: float = 0.05

    def __post_init__(self) -> None:
        for name in ("focal_px", "baseline_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadInputError(f"stereo {name} is {value}; give a positive number")
        if not all(math.isfinite(v) for v in (*self.principal_uv, self.offset_px)):
            raise BadInputError("stereo principal point and offset must be finite numbers")

    def range_m(self, disparity_px: npt.ArrayLike) -> Array:
        """Z = f·l_T/(d + offset), (3); NaN where that is not positive.

        Example:
            >>> StereoCamera(1000.0, 1.5, (0.0, 0.0)).range_m([15.0, 0.0, -3.0])
            array([100.,  nan,  nan])
        """
        parallax = np.asarray(disparity_px, float) + self.offset_px
        with np.errstate(invalid="ignore"):
            parallax = np.where(parallax > 0, parallax, np.nan)
        return np.asarray(self.focal_px * self.baseline_m / parallax, np.float64)

    def noise_m(self, disparity_px: npt.ArrayLike, disparity_std_px: npt.ArrayLike) -> Array:
        """Standard deviation of the range from the disparity's, metres: Z²/(f·l_T)·σ_d."""
        z = self.range_m(disparity_px)
        std = np.asarray(disparity_std_px, float)
        return np.asarray(z**2 / (self.focal_px * self.baseline_m) * std, np.float64)

    def bias_m(self, disparity_px: npt.ArrayLike) -> Array:
        """Standard deviation of the range from the calibration, metres."""
        z = self.range_m(disparity_px)
        scale = math.hypot(self.focal_std_px / self.focal_px, self.baseline_std_m / self.baseline_m)
        far = z / (self.focal_px * self.baseline_m) * self.offset_std_px
        return np.asarray(z * np.hypot(scale, far), np.float64)

    @staticmethod
    def load(path: Path) -> StereoCamera:
        """Read a calibration file of either kind.

        Raises:
            BadInputError: if the file is missing, incomplete or absurd.
        """
        known = "cam0" in _entries(path, "=")
        return (StereoCamera.from_middlebury if known else StereoCamera.from_kitti)(path)

    @staticmethod
    def from_middlebury(path: Path) -> StereoCamera:
        """Read a ``calib.txt`` as Middlebury 2014 pairs have it (baseline in millimetres).

        Raises:
            BadInputError: if the file is missing, incomplete or absurd.
        """
        entries = _entries(path, "=")
        matrix = _numbers(path, entries, "cam0", 9).reshape(3, 3)
        baseline_mm = float(_numbers(path, entries, "baseline", 1)[0])
        offset = float(_numbers(path, entries, "doffs", 1)[0]) if "doffs" in entries else 0.0
        return StereoCamera(
            float(matrix[0, 0]), baseline_mm / 1000.0, (matrix[0, 2], matrix[1, 2]), offset
        )

    @staticmethod
    def from_kitti(path: Path) -> StereoCamera:
        """Read a KITTI calibration: ``P2``/``P3`` of the object set or ``P_rect_02``/``03``.

        The colour pair is used where it is given, else the grey pair ``P0``/``P1``.

        Raises:
            BadInputError: if the file is missing, incomplete or absurd.
        """
        entries = _entries(path, ":")
        pairs = [("P2", "P3"), ("P_rect_02", "P_rect_03"), ("P0", "P1"), ("P_rect_00", "P_rect_01")]
        names = next((p for p in pairs if p[0] in entries and p[1] in entries), None)
        if names is None:
            raise BadInputError(
                f"{path} has no pair of projection matrices; expected P2 and P3 or P_rect_02 and "
                "P_rect_03"
            )
        left, right = (_numbers(path, entries, name, 12).reshape(3, 4) for name in names)
        focal = float(left[0, 0])
        if not focal > 0:
            raise BadInputError(f"{path}: focal length {focal} of {names[0]} must be positive")
        baseline = float(left[0, 3] - right[0, 3]) / focal
        if baseline < 0:
            raise BadInputError(
                f"{path}: {names[1]} lies to the left of {names[0]}; the sides are swapped"
            )
        offset = float(right[0, 2] - left[0, 2])
        return StereoCamera(focal, baseline, (left[0, 2], left[1, 2]), offset)


def _entries(path: Path, mark: str) -> dict[str, str]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read calibration file {path}: {error}") from error
    lines = (line.split(mark, 1) for line in text.splitlines() if mark in line)
    return {name.strip(): value for name, value in lines}


def _numbers(path: Path, entries: dict[str, str], name: str, count: int) -> Array:
    if name not in entries:
        raise BadInputError(f"calibration file {path} has no entry {name!r}")
    words = re.split(r"[\s;,\[\]]+", entries[name].strip("[] \t"))
    try:
        values = np.array([float(word) for word in words if word])
    except ValueError as error:
        raise BadInputError(f"{path}: entry {name!r} holds no numbers: {error}") from error
    if len(values) != count or not np.isfinite(values).all():
        raise BadInputError(
            f"{path}: entry {name!r} must hold {count} finite numbers, not "
            f"{entries[name].strip()!r}"
        )
    return values
