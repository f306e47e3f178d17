"""Stereo: pairs made from known disparities, real scenes, calibration files, and bad pairs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from railinspect.errors import BadInputError
from railinspect.ranging import Absent
from railinspect.ranging.stereo import Disparity, StereoSettings, match, region_range
from railinspect.ranging.stereo_camera import StereoCamera

REAL = Path(__file__).parents[4] / "shared" / "real"
SETTINGS = StereoSettings(most_px=48)
CAMERA = StereoCamera(1000.0, 1.5, (160.0, 90.0))


def pair(disparity: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.uint8], ...]:
    """A textured right picture and the left one whose disparity is given."""
    rng = np.random.default_rng(0)
    right = cv2.GaussianBlur(rng.integers(0, 256, disparity.shape).astype(np.float32), (0, 0), 1.2)
    right = cv2.normalize(right, None, 0, 255, cv2.NORM_MINMAX)
    height, width = disparity.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    left = cv2.remap(right, (u - disparity).astype("f4"), v.astype("f4"), cv2.INTER_CUBIC)
    return np.clip(left, 0, 255).astype(np.uint8), right.astype(np.uint8)


def test_a_slanted_plane_to_a_fraction_of_a_pixel() -> None:
    truth = np.tile(np.linspace(6.0, 26.0, 180)[:, None], (1, 320))
    found = match(*pair(truth), SETTINGS).disparity_px
    inside = np.isfinite(found[:, 60:])
    assert inside.mean() > 0.9
    error = np.abs(found - truth)[:, 60:][inside]
    assert np.median(error) < 0.1
    assert np.mean(error > 1) < 0.02


def test_a_region_ignores_its_background() -> None:
    truth = np.full((180, 320), 8.0)
    truth[60:120, 140:200] = 20.0
    disparity = match(*pair(truth), SETTINGS)
    region = np.zeros(truth.shape, bool)
    region[55:125, 132:208] = True  # a third of it is background
    found = region_range(disparity, region, CAMERA)
    assert not isinstance(found, Absent)
    assert found.range_m == pytest.approx(75.0, rel=0.01)
    mean = float(CAMERA.range_m(np.nanmean(disparity.disparity_px[region])))
    assert abs(mean - 75.0) > 8.0


def test_swapped_sides_are_said() -> None:
    truth = np.tile(np.linspace(6.0, 26.0, 180)[:, None], (1, 320))
    left, right = pair(truth)
    with pytest.raises(BadInputError, match="swapped"):
        match(right, left, SETTINGS)


def test_pairs_that_are_none() -> None:
    grey = np.zeros((40, 60), np.uint8)
    with pytest.raises(BadInputError, match="one size"):
        match(grey, grey[:, :50], SETTINGS)
    with pytest.raises(BadInputError, match="uint8"):
        match(grey.astype(float), grey.astype(float), SETTINGS)


def test_nothing_to_match_is_no_range() -> None:
    nothing = np.full((20, 20), np.nan, np.float32)
    found = region_range(Disparity(nothing, nothing), np.ones((20, 20), bool), CAMERA)
    assert isinstance(found, Absent)
    zero = Disparity(np.zeros((20, 20), np.float32), nothing)
    away = region_range(zero, np.ones((20, 20), bool), CAMERA)
    assert isinstance(away, Absent)
    assert "not positive" in away.reason


def test_errors_by_hand() -> None:
    # Z = 100 m at 15 px: Z²/(f·l) = 6.67 m per pixel; 1 % of focal length is 1 m.
    assert float(CAMERA.noise_m(15.0, 0.3)) == pytest.approx(2.0)
    vague = StereoCamera(1000.0, 1.5, (0, 0), focal_std_px=10.0, offset_std_px=0.0)
    assert float(vague.bias_m(15.0)) == pytest.approx(1.0)
    assert np.isnan(CAMERA.range_m([0.0, -2.0])).all()


MIDDLEBURY = """cam0=[542.019 0 541.836; 0 542.019 255.198; 0 0 1]
cam1=[542.019 0 543.836; 0 542.019 255.198; 0 0 1]
doffs=2
baseline=59.5549
width=941
"""
KITTI = """P0: 721.5 0 609.6 0 0 721.5 172.9 0 0 0 1 0
P1: 721.5 0 609.6 -387.6 0 721.5 172.9 0 0 0 1 0
P2: 721.5 0 609.6 44.9 0 721.5 172.9 0.2 0 0 1 0.003
P3: 721.5 0 609.6 -339.5 0 721.5 172.9 2.2 0 0 1 0.003
"""


def test_middlebury_file(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(MIDDLEBURY)
    camera = StereoCamera.from_middlebury(path)
    assert camera.focal_px == pytest.approx(542.019)
    assert camera.baseline_m == pytest.approx(0.0595549)
    # Z = f·b/(d + doffs)
    assert float(camera.range_m(30.0)) == pytest.approx(542.019 * 0.0595549 / 32)


def test_kitti_file(tmp_path: Path) -> None:
    path = tmp_path / "000000.txt"
    path.write_text(KITTI)
    camera = StereoCamera.from_kitti(path)
    assert camera.baseline_m == pytest.approx((44.9 + 339.5) / 721.5)
    path.write_text(KITTI.replace("P2", "PX").replace("P3", "P2").replace("PX", "P3"))
    with pytest.raises(BadInputError, match="swapped"):
        StereoCamera.from_kitti(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("baseline=59", "no entry 'cam0'"),
        ("cam0=[1 2; 3]\nbaseline=59", "9 finite numbers"),
        ("cam0=[0 0 1; 0 0 1; 0 0 1]\nbaseline=59", "focal_px is 0.0"),
        (MIDDLEBURY.replace("59.5549", "nan"), "finite"),
        (MIDDLEBURY.replace("59.5549", "-4"), "baseline_m"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message):
        StereoCamera.from_middlebury(path)
    with pytest.raises(BadInputError, match="cannot read"):
        StereoCamera.from_kitti(tmp_path / "none.txt")


@pytest.mark.skipif(not (REAL / "stereo_cones").is_dir(), reason="no shared/real/stereo_cones here")
def test_middlebury_cones() -> None:
    folder = REAL / "stereo_cones"
    left, right = (cv2.imread(str(folder / f"{side}.png"), 0) for side in ("left", "right"))
    truth = cv2.imdecode(np.fromfile(folder / "disp_left.tif", np.uint8), cv2.IMREAD_UNCHANGED)
    found = match(left, right, StereoSettings(most_px=64)).disparity_px
    known = (truth > 0) & np.isfinite(found)
    error = np.abs(found - truth)[known]
    assert known.sum() / (truth > 0).sum() > 0.8
    assert np.median(error) <= 0.35
    assert np.mean(error > 2.0) <= 0.10
