"""Times of pictures in a folder, from names or a CSV, survive exactly."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from railinspect.batch import inspect_inputs
from railinspect.errors import BadInputError
from railinspect.image_times import stamps_from_names, times_from_names
from railinspect.inspect_settings import InspectSettings
from railinspect.video import open_source
from tests.railinspect.painted_ride import paint, read_paint

START_NS = 1_777_636_800_000_000_000


def folder_of(path: Path, names: list[str], size: int = 48) -> Path:
    path.mkdir()
    for level, name in enumerate(names):
        cv2.imwrite(str(path / name), np.full((size, 64, 3), 10 * level, np.uint8))
    return path


def read(path: Path, **rest):
    source = open_source(path, **rest)
    return list(source), source


@pytest.mark.parametrize(
    ("names", "stamps"),
    [
        (["a_1777636800.000000021", "a_1777636800.040000022"], [21, 40_000_022]),
        (["20260501T120000.040Z", "20260501T120000.080Z"], [40_000_000, 80_000_000]),
        (["cab-2026-05-01_12-00-00-5Z", "cab-2026-05-01_12-00-01Z"], [500_000_000, 10**9]),
        (["c1777636800000", "c1777636800001"], [0, 1_000_000]),
    ],
)
def test_clock_times_in_names(tmp_path, names, stamps):
    frames, source = read(folder_of(tmp_path / "f", [name + ".png" for name in names]))
    assert [f.stamp_ns for f in frames] == [START_NS + ns for ns in stamps]
    assert [f.time_s for f in frames] == [0.0, (stamps[1] - stamps[0]) / 1e9]
    assert source.stamped_by == "the file names"


def test_times_without_a_zone_or_epoch_are_no_clock(tmp_path):
    frames, source = read(
        folder_of(tmp_path / "f", ["20260501T115959.9.png", "20260501T120000.0.png"])
    )
    assert [f.time_s for f in frames] == [0.0, 0.1]
    assert [f.stamp_ns for f in frames] == [None, None]
    assert source.stamped_by is None


@pytest.mark.parametrize(
    "stems",
    [
        ["f1", "f2"],
        ["20261301T120000.0", "20261301T120001.0"],
        ["20260501T120000", "20260501T120000"],
        ["a_1.5", "a_1777636800000"],
        ["a_20260501T120000.0", "a_20260501T120001.0Z"],
    ],
)
def test_what_is_no_time_is_none(stems):
    assert stamps_from_names(stems) is None
    assert times_from_names(stems) is None


@pytest.mark.parametrize(
    ("column", "cells", "stamps", "seconds"),
    [
        ("unix_ns", [START_NS + 7, START_NS + 40_000_008], [7, 40_000_008], [0.0, 0.040000001]),
        ("unix_s", ["1777636800.5", "1777636801.25"], [500_000_000, 1_250_000_000], [0.0, 0.75]),
        (
            "time_utc",
            ["2026-05-01T14:00:00.04+02:00", "2026-05-01T12:00:01Z"],
            [40_000_000, 10**9],
            [0.0, 0.96],
        ),
        ("time_s", ["3.5", "3.6"], None, [3.5, 3.6]),
    ],
)
def test_a_csv_gives_times_and_order(tmp_path, column, cells, stamps, seconds):
    path = folder_of(tmp_path / "f", ["b.png", "a.png"])
    rows = "".join(f"{name};{cell}\n" for name, cell in zip(["b.png", "a.png"], cells, strict=True))
    (path / "Times.csv").write_text(f"file;{column}\n{rows}", encoding="utf-8-sig")
    frames, source = read(path)
    assert [f.time_s for f in frames] == seconds
    assert [int(f.rgb[0, 0, 0]) for f in frames] == [0, 10]  # b comes before a
    if stamps is None:
        assert source.stamped_by is None
    else:
        assert [f.stamp_ns - START_NS for f in frames] == stamps
        assert source.stamped_by == "Times.csv"
    assert [f.time_s for f in read(path, folder_rate_hz=5)[0]] == [0.0, 0.2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name,time_s\na.png,1\n", "needs file and one of"),
        ("file,time_s\na.png,1\n", "does not list 'b.png'"),
        ("file,time_s\na.png,1\nb.png,1\n", "the same time"),
        ("file,time_s\na.png,1\na.png,2\nb.png,3\n", "listed twice"),
        ("file,time_s\na.png,nan\nb.png,1\n", "expected a number"),
        ("file,time_s\na.png,1e400000000\nb.png,1\n", "expected a number"),
        ("file,unix_ns\na.png,\nb.png,1\n", "expected a number"),
        ("file,time_utc\na.png,2026-05-01T12:00:00\nb.png,1\n", "ISO 8601 with its zone"),
        ("file,time_s\n\0", "expected a number"),
    ],
)
def test_a_csv_that_cannot_be_used_is_one_sentence(tmp_path, text, words):
    path = folder_of(tmp_path / "f", ["a.png", "b.png"])
    (path / "times.csv").write_text(text)
    with pytest.raises(BadInputError, match=words) as refused:
        open_source(path)
    assert "\n" not in str(refused.value)


def test_a_csv_may_list_pictures_that_are_gone_and_open_nothing(tmp_path):
    path = folder_of(tmp_path / "f", ["a.png", "b.png"])
    (path / "times.csv").write_text("file,time_s\na.png,1\n../../etc/passwd,2\nb.png,3\n")
    frames, source = read(path)
    assert [f.time_s for f in frames] == [1.0, 3.0]
    assert "1 pictures in times.csv are missing" in source.breaks[0].reason


def test_times_reach_the_frames_file(tmp_path):
    path = tmp_path / "f"
    path.mkdir()
    for index in range(3):
        cv2.imwrite(str(path / f"cab_{START_NS + 40_000_001 * index}.png"), paint()[..., ::-1])
    inspect_inputs([path], tmp_path / "run", read_paint, InspectSettings(overlay=False))
    rows = [json.loads(line) for line in (tmp_path / "run/frames.jsonl").read_text().splitlines()]
    assert [row["stamp_ns"] for row in rows] == [START_NS + 40_000_001 * i for i in range(3)]
    assert [row["time_s"] for row in rows] == [0.0, 0.04, 0.08]  # rounded to 1 µs
    run = json.loads((tmp_path / "run/run.json").read_text())
    assert run["inputs"][0]["stamped_by"] == "the file names"
