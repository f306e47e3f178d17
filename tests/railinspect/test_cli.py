"""The commands: one JSON document, one sentence for bad input, the documented exit status."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from railinspect import cli
from railinspect.segmenter import Segmenter
from railinspect.sinks.json_lines import read_json_lines
from tests.railinspect.painted_ride import CAMERA, paint, read_paint, ride, write_video

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def painted(monkeypatch):
    """The shipped network is replaced by the reader of painted pictures."""
    monkeypatch.setattr(Segmenter, "default", staticmethod(lambda threads=None: read_paint))


@pytest.fixture
def video(tmp_path) -> Path:
    return write_video(tmp_path / "ride.mp4", ride([40.0], 25))


def refused(capsys, *arguments) -> str:
    """Run a command that must refuse its input; returns its one sentence."""
    assert cli.main([str(a) for a in arguments]) == cli.BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("railinspect: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


def test_inspect_prints_exactly_one_json_document(capsys, tmp_path, video):
    out = tmp_path / "run"
    assert cli.main(["inspect", str(video), "--out", str(out), "--no-overlay", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames"] == 25
    assert document["events"] == 1
    assert document["unknown_frames"] == 0
    assert document["followed_fraction"] >= 0.9
    assert document["frames_per_s"] > 0
    assert Path(document["paths"]["report"]).exists()
    assert document["paths"]["overlay"] == []


def test_inspect_prints_for_people(capsys, tmp_path, video):
    camera = tmp_path / "camera.yaml"
    CAMERA.save(camera)
    out = tmp_path / "run"
    status = cli.main(
        ["inspect", str(video), "--out", str(out), "--camera", str(camera), "--speed-kmh", "72"]
    )
    assert status == 0
    text = capsys.readouterr().out
    assert "25 frames at" in text
    assert str(out / "overlay" / "ride.mp4") in text
    run = json.loads((out / "run.json").read_text())
    assert run["settings"]["speed_is_known"] is True
    assert run["settings"]["speed_mps"] == pytest.approx(20.0)


def test_an_unknown_speed_is_assumed_and_said_to_be(tmp_path, video):
    out = tmp_path / "run"
    assert cli.main(["inspect", str(video), "--out", str(out), "--no-overlay"]) == 0
    assert "80 km/h (assumed, as none was given)" in (out / "report.html").read_text()


TRAIN = """
davis: {c0: 0.0, c1: 0.0, c2: 0.0}
speed_error_rel: 0.0
service: {decel_mps2: 2.5, delay_s: 0.0, build_up_s: 0.0}
emergency: {decel_mps2: 3.2, delay_s: 0.0, build_up_s: 0.0}
adhesion: {factor: 1.5}
"""


def last_moment(place_m: float, decel_mps2: float, until_s: float) -> float:
    """When the bare train above, at 20 m/s and logged every 0.5 s, still stopped short of a place.

    By hand: between entries it may be 1.5 m/s² · (time to the nearer one) faster than logged. From
    that speed V it needs 1.05 · V² / (2·b) + 3 m + 5 m + 0.5 s · V, the default policy's parts.
    """
    time_s = np.arange(0.0, until_s, 1e-3)
    off_s = np.abs(time_s - np.round(2.0 * time_s) / 2.0)
    fastest = 20.0 + 1.5 * off_s
    needed_m = 1.05 * fastest**2 / (2.0 * decel_mps2) + 3.0 + 5.0 + 0.5 * fastest
    return float(time_s[place_m - 20.0 * time_s >= needed_m].max())


def test_a_train_file_and_a_speed_log_give_the_moments_of_braking(tmp_path):
    video = write_video(tmp_path / "ride.mp4", ride([110.0], 62))
    (tmp_path / "train.yaml").write_text(TRAIN)
    rows = "".join(f"{i / 2},20\n" for i in range(8))  # ends at 3.5 s of 4.9 s
    (tmp_path / "speed.csv").write_text("time_s,speed_mps\n" + rows)
    out = tmp_path / "run"
    command = ["inspect", video, "--out", out, "--train", tmp_path / "train.yaml"]
    command += ["--speed", tmp_path / "speed.csv", "--no-overlay"]
    CAMERA.save(tmp_path / "camera.yaml")
    command += ["--camera", tmp_path / "camera.yaml"]
    assert cli.main([str(part) for part in command]) == 0
    (event,) = read_json_lines(out / "events.jsonl")
    frames = list(read_json_lines(out / "frames.jsonl"))
    # The person's place follows from the measurement with the least to deduct while the speed was
    # known: 44.09 m at 3.28 s, less 3 · 0.89 m, is 107.02 m, where the truth is 110 m.
    seen = [
        (max(3 * found["range_std_m"], found["range_m"] - found["range_interval_m"][0]), f, found)
        for f in frames
        if f["advice"] and f["speed_mps"] is not None
        for found in f["findings"]
    ]
    deducted_m, best, found = min(seen, key=lambda one: one[0])
    place_m = 20.0 * best["time_s"] + found["range_m"] - deducted_m
    assert 104.0 < place_m < 110.0
    assert [event["service_by"], event["emergency_by"]] == ["due", "due"]
    service_s, emergency_s = (last_moment(place_m, decel, best["time_s"]) for decel in (2.5, 3.2))
    assert event["service_by_time_s"] == pytest.approx(service_s, abs=0.005)  # 0.150 s
    assert event["emergency_by_time_s"] == pytest.approx(emergency_s, abs=0.005)  # 1.111 s
    table = pq.read_table(out / "events.parquet")
    assert table["service_by_time_s"].to_pylist() == [event["service_by_time_s"]]
    assert table["emergency_by"].to_pylist() == ["due"]
    assert {f["speed_mps"] for f in frames} == {20.0, None}
    run = json.loads((out / "run.json").read_text())
    assert run["counts"]["speed_unknown_frames"] == sum(f["speed_mps"] is None for f in frames)
    assert run["settings"]["speed_log"]["source"] == "speed.csv"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'class="m-service"' in page
    assert "service braking had to start" in page
    assert "The speed log says nothing about" in page


@pytest.mark.parametrize(
    ("train", "option", "kmh", "known"),
    [
        (None, ("--speed", "15"), 54.0, True),
        (None, ("--speed", "90km/h"), 90.0, True),
        ("speed_mps: 12.0", (), 43.2, True),
        ("length_m: 90", (), 80.0, False),
        ("speed_mps: 12.0", ("--speed-kmh", "72"), 72.0, True),
    ],
)
def test_where_the_speed_comes_from(tmp_path, train, option, kmh, known):
    arguments = ["inspect", "a.mp4", "--out", "b", *option]
    if train is not None:
        (tmp_path / "train.yaml").write_text(train)
        arguments += ["--train", str(tmp_path / "train.yaml")]
    found, log, is_known = cli._train(cli.build_parser().parse_args(arguments))
    assert (found.speed_mps * 3.6, is_known, log) == (pytest.approx(kmh), known, None)


def bad_files(base: Path) -> dict[str, tuple[Path, str]]:
    def file(name: str, data: bytes) -> Path:
        (base / name).write_bytes(data)
        return base / name

    cv2.imwrite(str(base / "dot.png"), np.zeros((1, 1, 3), np.uint8))
    whole = write_video(base / "whole.mp4", [paint()] * 5).read_bytes()
    (base / "folder").mkdir()
    return {
        "missing": (base / "none.mp4", "does not exist; check the spelling"),
        "empty": (file("empty.mp4", b""), "is empty (0 bytes); copy the recording again"),
        "text": (file("text.mp4", b"hello world\n" * 40), "is text, not a video"),
        "noise": (file("noise.mp4", bytes(range(256)) * 40), "not a video this program can read"),
        "cut": (file("cut.mp4", whole[: len(whole) // 2]), "index (moov) is missing"),
        "dot": (base / "dot.png", "1×1 pixels; each side must be at least 32"),
        "no frames": (base / "folder", "holds no image"),
    }


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "noise", "cut", "dot", "no frames"])
def test_bad_inputs_are_refused_with_one_sentence_and_nothing_is_left(capsys, tmp_path, kind):
    path, expected = bad_files(tmp_path)[kind]
    out = tmp_path / "run"
    assert expected in refused(capsys, "inspect", path, "--out", out)
    assert not out.exists()


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("kind", ["grey", "rgba", "rgb"])
def test_unusual_images_are_read(capsys, tmp_path, depth, kind):
    picture = paint([40.0])[..., ::-1]
    if kind == "grey":
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    if kind == "rgba":
        picture = np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])
    picture = picture.astype(depth) * (257 if depth == np.uint16 else 1)
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    out = tmp_path / "run"
    assert cli.main(["inspect", str(tmp_path / "a.png"), "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames"] == 1
    if kind != "grey":  # the painted person is red
        assert document["events"] == 1


def test_a_used_or_unwritable_folder_is_refused(capsys, tmp_path, video):
    out = tmp_path / "run"
    assert cli.main(["inspect", str(video), "--out", str(out), "--no-overlay"]) == 0
    capsys.readouterr()
    assert "already holds a run" in refused(capsys, "inspect", video, "--out", out)
    below = refused(capsys, "inspect", video, "--out", video / "run")
    assert "cannot write to the output folder" in below


def test_bad_settings_are_refused(capsys, tmp_path, video):
    out = tmp_path / "run"
    (tmp_path / "late.csv").write_text("time_s,speed_mps\n100,20\n101,20\n")
    (tmp_path / "weak.yaml").write_text("service: {decel_mps2: 0, delay_s: 1, build_up_s: 1}\n")
    for option, value, expected in (
        ("--speed-kmh", "-3", "give 0 to 500 km/h"),
        ("--speed-kmh", "nan", "give 0 to 500 km/h"),
        ("--speed", "160", "give 0 to 150 m/s"),
        (
            "--speed",
            "fast",
            "is neither a speed (20, 20m/s, 72km/h) nor a .csv or .gpx, .nmea, .mcap file",
        ),
        ("--speed", "ride.mcap", "cannot read"),
        ("--speed", tmp_path / "late.csv", "runs from 100.0 s to 101.0 s of media time, the rec"),
        ("--started", "noon", "is no clock time with a zone"),
        ("--started", "2026-05-01T12:00:00Z", "give one with --speed"),
        ("--train", tmp_path / "weak.yaml", "weak.yaml: service: decel_mps2 is 0.0 m/s²"),
        ("--rate", "0", "give a positive number"),
        ("--threads", "0", "give at least 1"),
        ("--camera", tmp_path / "none.yaml", "cannot read camera file"),
        ("--train", tmp_path / "none.yaml", "cannot read train file"),
        ("--bundle", tmp_path / "none.onnx", "cannot read bundle"),
        ("--bundle", video, "is not an ONNX file"),
    ):
        message = refused(capsys, "inspect", video, "--out", out, f"{option}={value}")
        assert expected in message, message
    assert not out.exists()


def test_a_video_that_breaks_off_is_done_and_says_where(capsys, tmp_path):
    path = write_video(tmp_path / "cut.mkv", ride([60.0], 60), codec_options={"g": "10"})
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    out = tmp_path / "run"
    assert cli.main(["inspect", str(path), "--out", str(out), "--no-overlay"]) == 0
    assert "cut: broke after" in capsys.readouterr().out
    assert 'id="break"' in (out / "report.html").read_text()


@pytest.mark.parametrize(
    "command",
    [
        ["demo"],
        ["inspect"],
        ["scenes"],
        ["scenes", "images"],
        ["scenes", "stereo"],
        ["scenes", "ride"],
        ["verify"],
    ],
)
def test_help_states_units_and_defaults(capsys, command):
    with pytest.raises(SystemExit) as stop:
        cli.main([*command, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert "usage: railinspect" in text
    if command == ["inspect"]:
        assert "km/h" in text
        assert "default" in text


def test_a_misused_command_is_one_sentence(capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main(["inspect", "a.mp4"])
    assert stop.value.code == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "--out" in err


def test_an_interrupt_keeps_what_was_finished(capsys, tmp_path, video, monkeypatch):
    calls = 0

    def interrupted(rgb):
        nonlocal calls
        calls += 1
        if calls == 10:
            raise KeyboardInterrupt
        return read_paint(rgb)

    monkeypatch.setattr(Segmenter, "default", staticmethod(lambda threads=None: interrupted))
    out = tmp_path / "run"
    assert cli.main(["inspect", str(video), "--out", str(out)]) == cli.INTERRUPTED
    assert "what was finished is kept" in capsys.readouterr().err
    assert json.loads((out / "run.json").read_text())["counts"]["frames"] == 9


def test_the_module_runs_as_a_command_without_the_training_stack(tmp_path):
    code = (
        "import sys; from railinspect.cli import main\n"
        "status = main(['inspect', 'none.mp4', '--out', 'x', '--bundle', 'none.onnx'])\n"
        "print(status, 'torch' in sys.modules, 'lightning' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.split() == ["2", "False", "False"]
    done = subprocess.run(
        [sys.executable, "-m", "railinspect", "--version"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
    )
    assert done.stdout.startswith("railinspect ")


def test_help_is_quick_because_it_loads_no_heavy_library():
    code = (
        "import sys; from railinspect.cli import build_parser; build_parser()\n"
        "print([m for m in ('onnxruntime', 'av', 'numba', 'pyarrow', 'cv2') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.strip() == "[]"
