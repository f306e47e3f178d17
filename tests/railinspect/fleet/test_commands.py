"""``railinspect inspect`` over many inputs."""

from __future__ import annotations

import json

import pytest

from railinspect import cli
from tests.railinspect.hand_bundle import bundle
from tests.railinspect.painted_ride import paint, write_video


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "net.onnx").write_bytes(bundle())
    rides = tmp_path / "rides"
    rides.mkdir()
    for number in range(2):
        write_video(rides / f"{number}.mp4", [paint()[::4, ::4]] * (3 + number))
    return tmp_path


def inspect(folder, *options: object) -> int:
    fixed = ["--out", folder / "run", "--bundle", folder / "net.onnx", "--engine", "serial"]
    return cli.main(["inspect", *map(str, [folder / "rides", *fixed, *options])])


def test_a_folder_is_inspected_with_one_json_document(folder, capsys):
    assert inspect(folder, "--json") == cli.DONE
    document = json.loads(capsys.readouterr().out)
    assert (document["inputs"], document["done"], document["bad"]) == (2, 2, 0)
    assert document["frames"] == document["new_frames"] == 7
    assert document["complete"] is True
    state = json.loads((folder / "run" / "fleet.json").read_text())
    assert state["run"] == document["run"]
    assert inspect(folder, "--json") == cli.DONE
    assert json.loads(capsys.readouterr().out)["new_frames"] == 0


def test_the_exit_status_and_the_list_say_what_was_bad(folder, capsys):
    (folder / "rides" / "bad.mp4").write_text("hello")
    assert inspect(folder) == cli.FAILED_CHECK
    text = capsys.readouterr().out
    assert "2 of 3 inputs done, 1 bad" in text
    assert "bad.mp4 is text, not a video" in text


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--workers", "0", "--engine", "processes"), "workers is 0; give at least 1"),
        (("--address", "auto"), "give --engine ray with it"),
        (("--segment", "-1"), "give a length above 0"),
        (("--fetch-limit", "0"), "give more than 0"),
        (("--threads", "2"), "take more workers"),
        (("--speed", "speed.csv"), "fits one recording, not 2"),
    ],
)
def test_bad_options_are_refused(folder, capsys, monkeypatch, options, expected):
    monkeypatch.chdir(folder)
    (folder / "speed.csv").write_text("time_s,speed_mps\n0,20\n1,20\n")
    assert inspect(folder, *options) == cli.BAD_INPUT
    assert expected in capsys.readouterr().err
    assert not (folder / "run" / "fleet.json").exists()
