"""What a command names, where it lies, and that no name means anything but itself."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import fsspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from railinspect.errors import BadInputError
from railinspect.fleet.finished import finished_inputs
from railinspect.fleet.inputs import expand, is_address, names_many, short_name
from tests.railinspect.fleet.rides import inspect
from tests.railinspect.painted_ride import paint, write_video


@pytest.fixture
def tree(tmp_path) -> Path:
    """Recordings in folders, stills in another, and what is neither."""
    for name in ("a.mp4", "deep/er/b.MKV", "notes.txt", "deep/list.json", "run/c.mp4"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")
    (tmp_path / "stills").mkdir()
    cv2.imwrite(str(tmp_path / "stills" / "f0.png"), np.zeros((40, 40, 3), np.uint8))
    return tmp_path


def test_folders_patterns_and_lists_name_the_same(tree):
    every = tuple(str(tree / name) for name in ("a.mp4", "deep/er/b.MKV", "stills"))
    assert expand([str(tree)], tree / "run") == every
    assert expand([str(tree / "**" / "*.MKV"), str(tree / "s*"), str(tree / "a.mp4")]) == every
    (tree / "list.csv").write_text("line,address\nS1,a.mp4\nS1,deep/er/b.MKV\n,stills\n,\n")
    assert expand([str(tree / "list.csv")]) == every
    pq.write_table(pa.table({"path": list(every), "km": [1, 2, 3]}), tree / "list.parquet")
    assert expand([str(tree / "list.parquet"), every[0]]) == every
    assert expand(list(reversed(every))) == every


def test_which_inputs_make_a_fleet_run(tree, monkeypatch):
    monkeypatch.chdir(tree)
    many = ("deep", "*.mp4", "list.csv", "x.parquet", "s3://rides/a.mp4", "memory://x")
    assert all(names_many(one) for one in many)
    assert not any(names_many(one) for one in ("a.mp4", "stills", "none.mp4", "stills/f0.png"))


def test_names_mean_nothing_but_themselves(tree, monkeypatch):
    monkeypatch.chdir(tree)
    hostile = ("concat:a|b.mp4", "a[1].mp4", "-y.mp4", "q?.mp4", "é\n.mp4")
    for name in hostile:
        Path(name).write_bytes(b"x")
    named = expand(list(hostile))
    assert set(named) == {str(tree / name) for name in hostile}
    assert all(Path(one).is_absolute() for one in named)
    raw = os.fsdecode(b"\xff\xfe.mp4")
    Path(raw).write_bytes(b"x")
    assert str(tree / raw) in expand(["."])
    assert short_name(f"/x/{raw}").isascii()
    assert not is_address("/x/a::b")
    assert not is_address("c:/x")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("empty", "holds no image and no video"),
        ("*.nothing", "names no recording"),
        ("none.csv", "cannot read the list"),
        ("bad.csv", "has the columns line, km"),
        ("bad.parquet", "cannot read the list"),
        ("nonsense://x/y", "cannot open nonsense://x/y"),
    ],
)
def test_what_names_nothing_is_refused(tmp_path, monkeypatch, text, expected):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("bad.csv").write_text("line,km\nS1,3\n")
    Path("bad.parquet").write_text("no table")
    with pytest.raises(BadInputError, match=expected):
        expand([text])


@pytest.fixture
def bucket():
    """An object store in memory with three recordings, one of them none."""
    store = fsspec.filesystem("memory")
    store.store.clear()
    yield store
    store.store.clear()


def test_objects_are_fetched_inspected_and_let_go(bucket, tmp_path):
    local = write_video(tmp_path / "a.mp4", [paint([30.0])] * 6)
    bucket.pipe("/rides/day 1/a.mp4", local.read_bytes())
    bucket.pipe("/rides/bad.mp4", b"nothing")
    bucket.pipe("/rides/notes.txt", b"nothing")
    cv2.imwrite(str(tmp_path / "a.png"), paint([30.0])[..., ::-1])
    bucket.pipe("/still.png", (tmp_path / "a.png").read_bytes())
    out = tmp_path / "run"
    summary = inspect(["memory://rides", "memory:///still.png", local], out)
    by_name = {one["name"]: one for one in summary.inputs}
    assert (by_name["bad"]["state"], by_name["still"]["state"]) == ("bad", "done")
    assert "memory://" in by_name["bad"]["reason"]
    assert len(finished_inputs(out)) == 2, "the object and its local copy have one content"
    assert not (out / "fetched").exists()
    assert {one.counts.kind for one in finished_inputs(out)} == {"video", "image"}


def test_an_object_beyond_the_limit_is_not_fetched(bucket, tmp_path):
    bucket.pipe("/rides/a.mp4", b"x" * 5000)
    summary = inspect(["memory://rides/*.mp4"], tmp_path / "run", limit_bytes=4999)
    (one,) = summary.inputs
    assert one["state"] == "bad"
    assert "larger than the limit" in one["reason"]
    gone = inspect(["memory://rides/none.mp4"], tmp_path / "other")
    assert "does not exist" in gone.inputs[0]["reason"]


def test_an_input_that_changes_is_surveyed_again(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"")
    out = tmp_path / "run"
    assert "is empty (0 bytes)" in inspect([path], out).inputs[0]["reason"]
    write_video(path, [paint()] * 3)
    assert inspect([path], out).inputs[0]["state"] == "done"
