"""The commands calibrate, range and camera report."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from railinspect.camera import Camera, CameraStd
from railinspect.cli import main
from railinspect.errors import BadInputError
from railinspect.ranging.feasibility import Operation, motion_blur, report
from railinspect.scenes import Ride, SceneSettings
from railops.pilot.camera import Optics
from tests.railinspect.ranging.test_calibration import OSDAR
from tests.railinspect.ranging.test_stereo import MIDDLEBURY, pair

CAMERA = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5, std=CameraStd(focal_px=15.0))


def test_a_camera_file_is_made_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = tmp_path / "scene.json", tmp_path / "camera.yaml"
    scene.write_text(json.dumps(OSDAR))
    arguments = ["calibrate", "osdar23", str(scene), "--sensor", "front", "--out", str(out)]
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["camera"]["focal_px"] == 4600.0
    assert Camera.load(out).height_m == 3.5
    assert main(["camera", "report", str(out), "--speed-kmh", "160", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["braking_distance_m"] == pytest.approx(44.44 * 0.5 + 44.44**2 / 2.4, rel=1e-3)
    assert any("shorter than the braking distance" in p for p in document["problems"])
    lens = ["--focal-mm", "25", "--f-number", "4"]
    assert main(["camera", "report", str(out), *lens]) == 0
    said = capsys.readouterr().out
    assert "reliable range" in said
    assert "sharp" in said


def test_report_numbers() -> None:
    found = report(CAMERA, Operation(40.0), Optics(0.3, 2.8, 3.5e-5, 100.0))
    assert found["sharp_m"] == pytest.approx([90.21, 112.18], abs=0.01)
    row = found["ranges"][3]
    assert row["range_m"] == 100.0
    assert row["row_m_per_px"] == pytest.approx(100**2 / (3000 * 2.5))
    assert row["lateral_shift_m"] == pytest.approx(600 - np.sqrt(600**2 - 100**2))
    assert row["bias_m"] >= 0.5  # 15 px of 3000 px are half a per cent
    # 2.5 m below the axis at 10 m: 750 px; 40 mm on at 9.96 m: 753 px.
    assert motion_blur(3000.0, 40.0, 1e-3, 10.0, 2.5) == pytest.approx(7500 / 9.96 - 750)
    assert motion_blur(3000.0, 40.0, 1.0, 10.0, 2.5) == np.inf
    with pytest.raises(BadInputError, match="speed_mps"):
        Operation(-1.0)


def test_a_stereo_pair_is_ranged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [tmp_path / "left.png", tmp_path / "right.png"]
    for name, image in zip(names, pair(np.full((120, 320), 14.0)), strict=True):
        cv2.imwrite(str(name), image)
    calibration = tmp_path / "calib.txt"
    calibration.write_text(MIDDLEBURY)
    command = ["range", str(names[0]), "--right", str(names[1]), "--calibration", str(calibration)]
    assert main([*command, "--box", "80,20,200,100", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["range_m"] == pytest.approx(542.019 * 0.0595549 / 16, rel=0.01)
    assert main([*command, "--box", "80,20,2000,100"]) == 2
    assert "does not lie in the picture" in capsys.readouterr().err
    swapped = ["range", str(names[1]), "--right", str(names[0]), "--calibration", str(calibration)]
    assert main(swapped) == 2
    assert "swapped" in capsys.readouterr().err
    assert main(["range", str(names[0]), "--box", "80,20,200,100"]) == 2
    assert "give --right and --calibration as well" in capsys.readouterr().err


def test_a_wide_picture_is_looked_at_closely(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A person 89 m ahead: six of the network's pixels wide at first, 22 in its closest look.
    camera = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5, pitch_rad=0.03)
    settings = SceneSettings(
        size_wh=camera.size_wh, camera=camera, kind="line", weather=False, min_radius_m=400.0
    )
    frame = Ride.plan(215, settings, duration_s=60, anomalies="demo").frame(83)
    person = next(o for o in frame.objects if o.type == "trespasser" and o.range_m < 100.0)
    picture, calibration = tmp_path / "far.png", tmp_path / "camera.yaml"
    cv2.imwrite(str(picture), frame.rgb[..., ::-1])
    camera.save(calibration)
    assert main(["range", str(picture), "--camera", str(calibration), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["findings"]
    nearest = min(found, key=lambda one: abs(one["range_m"] - person.range_m))
    assert nearest["type"] == "trespasser"
    assert nearest["range_m"] == pytest.approx(person.range_m, rel=0.05)
    low, high = nearest["range_interval_m"]
    assert low < person.range_m < high


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("focal_px: 0", "focal_px is 0"),
        ("height_m: -1", "height_m is -1"),
        ("focal_px: .nan", "focal_px is nan"),
        ("principal_uv: [.nan, 1]", "finite"),
    ],
)
def test_absurd_camera_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    path = tmp_path / "camera.yaml"
    CAMERA.save(path)
    key = text.split(":")[0]
    kept, skip = [], False
    for line in path.read_text().splitlines():
        skip = line.startswith(f"{key}:") or (skip and line.startswith("- "))
        if not skip:
            kept.append(line)
    path.write_text("\n".join([*kept, text, ""]))
    assert main(["camera", "report", str(path)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
