"""The same results from every engine; killed at any moment; broken inputs stop nobody."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from railinspect.errors import OutputError
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.tasks import Cut
from railinspect.sinks.json_lines import read_json_lines
from tests.railinspect.fleet.rides import inspect, paint_rides, results
from tests.railinspect.painted_ride import paint, ride, write_video

ROOT = Path(__file__).parents[3]
LONG = bool(os.environ.get("RAILINSPECT_LONG"))
"""The long forms: ``RAILINSPECT_LONG=1 python -m pytest tests/railinspect/fleet``."""


@pytest.fixture(scope="module")
def rides(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("rides")
    paint_rides(folder, 12 if LONG else 2)
    return folder


@pytest.fixture(scope="module")
def undisturbed(rides, tmp_path_factory) -> Path:
    """The run of one process, to which all others must be equal."""
    out = tmp_path_factory.mktemp("undisturbed") / "run"
    inspect([rides], out)
    return out


def command(rides: Path, out: Path, engine: str, workers: int) -> list[str]:
    module = "tests.railinspect.fleet.rides"
    return [sys.executable, "-m", module, str(rides), str(out), engine, str(workers)]


def children(process: int) -> list[int]:
    """The living processes that a process started."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rsplit(")", 1)[1].split()
            words = (status.parent / "cmdline").read_text()
        except OSError:
            continue
        if int(fields[1]) == process and fields[0] != "Z" and "spawn_main" in words:
            found.append(int(status.parent.name))
    return found


def test_a_finished_input_says_all_of_it(undisturbed):
    state = json.loads((undisturbed / "fleet.json").read_text())
    assert [one["state"] for one in state["inputs"]] == ["done"] * len(state["inputs"])
    for one, entry in zip(
        sorted(state["inputs"], key=lambda one: one["id"]),
        finished_inputs(undisturbed),
        strict=True,
    ):
        counts = entry.counts
        frames, events = list(entry.frames()), list(entry.events())
        assert (counts.id, counts.name, counts.address) == (one["id"], one["name"], one["address"])
        assert [row["index"] for row in frames] == list(range(counts.frames)) == list(range(50))
        assert [row["time_s"] for row in frames] == pytest.approx([i / 12.5 for i in range(50)])
        assert {row["input"] for row in (*frames, *events)} == {counts.id}
        assert {row["name"] for row in (*frames, *events)} == {counts.name}
        assert [event["id"] for event in events] == list(range(1, counts.events + 1))
        assert counts.events >= 1
        shown = {f["event_id"] for row in frames for f in row["findings"]} - {None}
        assert shown == {event["id"] for event in events}
        assert all(entry.thumbnail(event).read_bytes()[:2] == b"\xff\xd8" for event in events)
        assert counts.segments == one["segments"] == 2
        assert counts.unknown_frames == sum(row["status"] == "unknown" for row in frames)
    assert not list((undisturbed / "parts").iterdir())
    assert not (undisturbed / "tmp").exists()


@pytest.mark.skipif(not Path("/proc").exists(), reason="finds worker processes in /proc")
def test_a_run_killed_at_random_moments_ends_as_if_undisturbed(rides, undisturbed, tmp_path):
    """Workers and drivers die by SIGKILL; the same command goes on. Two processes, not one."""
    dice = random.Random(6)
    kills, killed, outs = 20 if LONG else 2, 0, [tmp_path / "0" / "run"]
    while killed < kills:
        driver = subprocess.Popen(command(rides, outs[-1], "processes", 2), cwd=ROOT)
        while driver.poll() is None and killed < kills:
            workers = children(driver.pid)
            if len(workers) < 2:
                time.sleep(0.02)
                continue
            time.sleep(dice.uniform(0.0, 3.0))
            with contextlib.suppress(ProcessLookupError):
                os.kill(driver.pid if killed % 2 else dice.choice(workers), signal.SIGKILL)
                killed += 1
        driver.wait(timeout=300)
        if driver.returncode == 0:  # it was done before the dice fell
            outs.append(tmp_path / str(len(outs)) / "run")
    for out in outs:
        subprocess.run(command(rides, out, "processes", 2), cwd=ROOT, check=True, timeout=600)
        assert results(out) == results(undisturbed)


@pytest.mark.skipif(not LONG, reason="a Ray cluster takes ten seconds to start; RAILINSPECT_LONG=1")
def test_ray_gives_the_same(rides, undisturbed, tmp_path):
    subprocess.run(command(rides, tmp_path / "run", "ray", 2), cwd=ROOT, check=True)
    assert results(tmp_path / "run") == results(undisturbed)


def test_nothing_is_done_twice_and_inputs_may_be_added(tmp_path):
    folder = tmp_path / "rides"
    folder.mkdir()
    write_video(folder / "m.mp4", [paint()] * 6)
    out = tmp_path / "run"
    assert inspect([folder], out).new_frames == 6
    before = results(out)
    assert inspect([folder], out).new_frames == 0
    assert results(out) == before
    write_video(folder / "a.mp4", [paint([30.0])] * 7)
    (folder / "z.mp4").write_bytes((folder / "m.mp4").read_bytes())
    summary = inspect([folder], out)
    assert summary.new_frames == 7
    assert [one["name"] for one in summary.inputs] == ["a", "m", "z"]
    assert summary.inputs[2]["same_as"] == "m"
    assert summary.counts["frames"] == 13
    assert len(finished_inputs(out)) == 2


def test_another_run_is_not_mixed_in(tmp_path):
    first = write_video(tmp_path / "a.mp4", [paint()] * 3)
    second = write_video(tmp_path / "b.mp4", [paint()] * 4)
    out = tmp_path / "run"
    inspect([first], out)
    with pytest.raises(OutputError, match="other settings"):
        inspect([first], out, cut=Cut(stretch_s=99.0))
    with pytest.raises(OutputError, match="added to a run but not taken away"):
        inspect([second], out)
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "run.json").write_text("{}")
    with pytest.raises(OutputError, match="already holds a run"):
        inspect([first], tmp_path / "plain")


def test_a_second_run_in_the_same_folder_is_refused(tmp_path):
    from railinspect.fleet.folder import FleetFolder

    with (
        FleetFolder(tmp_path / "run").claim(),
        pytest.raises(OutputError, match="another run is at work"),
        FleetFolder(tmp_path / "run").claim(),
    ):
        pass


def grey_video(level: int) -> bytes:
    """A tiny recording without a track."""
    import tempfile

    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        picture = np.full((64, 96, 3), level % 250, np.uint8)
        noise = np.random.default_rng(level).integers(0, 40, picture.shape, np.uint8)
        path = write_video(Path(folder) / "a.mkv", [picture + noise // 2] * 8)
        return path.read_bytes()


def damaged(folder: Path, number: int, whole: bytes) -> None:
    """One damaged input, of a kind and with a name that the number chooses."""
    dice = random.Random(number)
    names = (
        "two\nlines {}.mp4",
        "<script>{}.mp4",
        "-rf {}.mkv",
        "concat:{}|x.mp4",
        "'; drop {} --.avi",
        "%2e%2e%2f{}.mp4",
        "‮drow{}.mov",
        "x" * 200 + "{}.mp4",
    )
    name = names[number // 5 % len(names)].format(number)
    path = folder / name
    if number % 7 == 6:
        path = Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe%d.mp4" % number))
    kind = number % 5
    if kind == 0:
        path.write_bytes(b"")
    elif kind == 1:
        path.write_bytes(whole[: dice.randrange(1, len(whole) // 2)])
    elif kind == 2:
        flipped = bytearray(whole)
        for _ in range(len(whole) // 20):
            flipped[dice.randrange(len(whole))] ^= 1 << dice.randrange(8)
        path.write_bytes(flipped)
    elif kind == 3:
        path.write_text("this is a log file\n" * dice.randrange(1, 40))
    else:
        path.write_bytes(dice.randbytes(dice.randrange(1, 3000)))


def test_damaged_inputs_are_listed_and_the_good_ones_done(tmp_path):
    count = 200 if LONG else 10
    folder = tmp_path / "rides"
    folder.mkdir()
    for number in range(count):
        (folder / f"good {number}.mkv").write_bytes(grey_video(number))
        damaged(folder, number, grey_video(number + 1000))
    outside = set(tmp_path.rglob("*"))
    engine = {"engine": "processes"} if LONG else {}
    summary = inspect([folder], tmp_path / "run", **engine)
    assert len(summary.inputs) == 2 * count
    good = [one for one in summary.inputs if one["name"].startswith("good ")]
    assert len(good) == count
    assert all((one["state"], one["reason"]) == ("done", None) for one in good)
    for one in good:
        finished = FinishedInput.read(tmp_path / "run" / "inputs" / one["id"])
        assert finished.counts.frames == 8
    # What was cut or has flipped bits may still show pictures; all else has none.
    rest = [one for one in summary.inputs if one not in good]
    assert all(one["reason"] for one in rest if one["state"] == "bad")
    silent = [one for one in rest if not one["reason"]]
    assert len(silent) <= count // 5, "only flipped bits inside a picture can go unnoticed"
    assert sum(one["state"] == "bad" for one in rest) >= 3 * count // 5
    made = set(tmp_path.rglob("*")) - outside
    assert all(tmp_path / "run" in (path, *path.parents) for path in made)
    assert all(name.isascii() for name in results(tmp_path / "run"))
    state = json.loads((tmp_path / "run" / "fleet.json").read_text(encoding="utf-8"))
    assert len(state["inputs"]) == 2 * count


def test_events_at_seams_are_those_of_the_whole(tmp_path):
    """Five people met at any distance from the seams: the same events, ranges within 0.1 m."""
    video = write_video(tmp_path / "a.mp4", ride([45.0, 62.0, 110.0, 150.0, 155.0], 100))
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    inspect([video], whole, cut=Cut(stretch_s=float("inf")))
    inspect([video], cut, cut=Cut(stretch_s=4.0, lead_in_s=3.0, run_on_s=1.0))
    (one,), (other,) = finished_inputs(whole), finished_inputs(cut)
    assert (one.counts.segments, other.counts.segments) == (1, 2)
    exact = ("id", "type", "first_frame", "last_frame", "confirmed_time_s", "frames_seen", "advice")
    expected, found = list(one.events()), list(other.events())
    assert len(expected) >= 3
    assert [[e[k] for k in exact] for e in found] == [[e[k] for k in exact] for e in expected]
    for a, b in zip(expected, found, strict=True):
        for key in ("first_range_m", "closest_range_m"):
            assert b[key] == pytest.approx(a[key], abs=0.1)
        assert b["service_by"] == a["service_by"]
        if a["emergency_by_time_s"] is not None:
            assert b["emergency_by_time_s"] == pytest.approx(a["emergency_by_time_s"], abs=0.05)
    rows = list(read_json_lines(whole / "inputs" / one.counts.id / "frames.jsonl"))
    others = list(other.frames())
    for key in ("index", "time_s", "status", "followed"):
        assert [row[key] for row in others] == [row[key] for row in rows]
