from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from railinspect import cli
from railinspect.camera import Camera


def run(capsys, *arguments):
    assert cli.main(["scenes", *(str(a) for a in arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_images_come_in_railsem19_s_layout(tmp_path, capsys):
    out = tmp_path / "set"
    document = run(capsys, "images", "--out", out, "--count", 2, "--seed", 4, "--size", "320x180")
    assert document["images"] == 2
    for folder, suffix in (("jpgs", ".jpg"), ("uint8", ".png"), ("jsons", ".json")):
        names = sorted(p.name for p in (out / folder / "rs19_val").iterdir())
        assert names == [f"rs00004{suffix}", f"rs00005{suffix}"]
    assert (out / "rs19-config.json").exists()


def test_a_stereo_pair_comes_with_depth_and_camera(tmp_path, capsys):
    out = tmp_path / "pairs"
    run(capsys, "stereo", "--out", out, "--baseline-m", 0.3, "--size", "320x180")
    left = cv2.imread(str(out / "pair00000_left.png"))
    right = cv2.imread(str(out / "pair00000_right.png"))
    depth = np.load(out / "pair00000_depth_m.npy")
    assert left.shape == right.shape == (180, 320, 3)
    assert depth.shape == (180, 320)
    assert Camera.load(out / "pair00000_camera.yaml").size_wh == (320, 180)
    assert json.loads((out / "pair00000.json").read_text())["baseline_m"] == 0.3


def test_a_ride_is_a_video_with_its_truth(tmp_path, capsys):
    out = tmp_path / "ride"
    options = ("--duration-s", 1, "--frame-rate", 5, "--size", "320x180", "--workers", 1)
    assert run(capsys, "ride", "--out", out, *options)["frames"] == 5
    assert json.loads((out / "truth.json").read_text())["planted"] == []
    assert (out / "ride.mp4").stat().st_size > 1000
    assert cli.main(["scenes", "ride", "--out", str(out), *map(str, options)]) == 2


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("images", "--count", "0"), "give at least 1"),
        (("images", "--seed", "-1"), "at least 0"),
        (("images", "--size", "640"), "as in 640x360"),
        (("images", "--size", "9x9"), "64…4096"),
        (("stereo", "--baseline-m", "0"), "give a positive number"),
        (("ride", "--speed-kmh", "0"), "give a positive number"),
        (("ride", "--anomalies", "-2"), "at least 0"),
        (("ride", "--anomalies", "50", "--duration-s", "10"), "no room for 50 anomalies"),
    ],
)
def test_bad_settings_are_refused(tmp_path, capsys, options, expected):
    assert cli.main(["scenes", *options, "--out", str(tmp_path / "x")]) == 2
    err = capsys.readouterr().err
    assert expected in err
    assert err.count("\n") == 1
