"""Run folders: complete after a run, readable after a crash, never overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from railinspect.batch import inspect_inputs
from railinspect.errors import BadInputError, OutputError
from railinspect.inspect_settings import InspectSettings
from railinspect.sinks.json_lines import read_json_lines
from railinspect.video import open_source
from railops.braking import Train
from tests.railinspect.painted_ride import (
    CAMERA,
    SPEED_MPS,
    paint,
    read_paint,
    ride,
    write_video,
)

SETTINGS = InspectSettings(camera=CAMERA, train=Train(speed_mps=SPEED_MPS))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run over one painted video with two people."""
    base = tmp_path_factory.mktemp("run")
    video = write_video(base / "cab <b>ride & ünï.mp4", ride([50.0, 110.0], 62))
    seen = []
    summary = inspect_inputs([video], base / "out", read_paint, SETTINGS, progress=seen.append)
    return base / "out", summary, seen


def test_the_folder_holds_what_the_design_names(finished):
    out, _, _ = finished
    files = {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()}
    assert files == {
        "run.json",
        "frames.jsonl",
        "events.jsonl",
        "events.parquet",
        "report.html",
        "overlay/cab _b_ride _ ünï.mp4",
        "thumbnails/event-00001.jpg",
        "thumbnails/event-00002.jpg",
    }


def test_frames_are_one_line_each_in_order(finished):
    out, summary, _ = finished
    lines = list(read_json_lines(out / "frames.jsonl"))
    assert [line["index"] for line in lines] == list(range(62))
    assert summary.frames == 62
    assert summary.unknown_frames == sum(line["status"] == "unknown" for line in lines)
    assert summary.followed_fraction == sum(line["followed"] for line in lines) / 62
    for line in lines:
        assert line["status"] in ("clear", "finding", "unknown")
        assert set(line["rails"]) == {"left", "right"}
        for found in line["findings"]:
            low, high = found["range_interval_m"]
            assert low <= found["range_m"] <= high


def test_events_agree_between_lines_and_table(finished):
    out, summary, _ = finished
    lines = list(read_json_lines(out / "events.jsonl"))
    assert [line["id"] for line in lines] == [1, 2]
    assert summary.events == 2
    table = pq.read_table(out / "events.parquet")
    assert table["id"].to_pylist() == [1, 2]
    assert table["closest_range_m"].to_pylist() == [line["closest_range_m"] for line in lines]
    assert table["first_range_low_m"][0].as_py() == lines[0]["first_range_interval_m"][0]
    picture = cv2.imread(str(out / lines[0]["thumbnail"]))
    assert picture is not None


def test_run_json_says_what_was_done(finished):
    out, summary, _ = finished
    run = json.loads((out / "run.json").read_text())
    assert run["counts"]["complete"] is True
    assert run["counts"]["frames"] == summary.frames
    assert run["settings"]["speed_mps"] == SPEED_MPS
    assert run["camera"]["focal_px"] == CAMERA.focal_px
    assert run["inputs"][0]["size_wh"] == [640, 360]
    assert run["versions"]["numpy"] == np.__version__


def test_the_overlay_has_the_input_s_times(finished):
    out, summary, _ = finished
    frames = list(open_source(out / summary.inputs[0].overlay))
    assert len(frames) == 62
    assert [f.time_s for f in frames] == pytest.approx([i / 12.5 for i in range(62)], abs=1e-3)


def test_progress_rises_to_the_end(finished):
    _, _, seen = finished
    shares = [p.share for p in seen]
    assert shares == sorted(shares)
    assert shares[-1] > 0.95
    assert seen[-1].frames == 62


def test_several_inputs_share_a_run_and_ids_go_on(tmp_path):
    first = write_video(tmp_path / "ride.mp4", ride([40.0], 25))
    (tmp_path / "b").mkdir()
    second = write_video(tmp_path / "b" / "ride.mp4", ride([40.0], 25))
    folder = tmp_path / "stills"
    folder.mkdir()
    for index, picture in enumerate(ride([40.0], 8)):
        cv2.imwrite(str(folder / f"f{index}.png"), picture[..., ::-1])
    image = folder / "f7.png"
    out = tmp_path / "out"
    summary = inspect_inputs([first, second, folder, image], out, read_paint, SETTINGS)
    assert [one.name for one in summary.inputs] == ["ride", "ride-2", "stills", "f7"]
    assert [one.kind for one in summary.inputs] == ["video", "video", "folder", "image"]
    assert summary.frames == 25 + 25 + 8 + 1
    events = list(read_json_lines(out / "events.jsonl"))
    assert [e["id"] for e in events] == [1, 2, 3, 4]
    assert [e["input"] for e in events] == ["ride", "ride-2", "stills", "f7"]
    assert (out / "overlay" / "f7.png").exists()
    assert "overlay/ride-2.mp4" in (out / "report.html").read_text(encoding="utf-8")


def test_a_single_image_is_inspected(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), paint([40.0])[..., ::-1])
    summary = inspect_inputs([tmp_path / "a.png"], tmp_path / "out", read_paint, SETTINGS)
    assert (summary.frames, summary.events) == (1, 1)


def test_a_recording_that_breaks_off_is_kept_and_the_report_says_where(tmp_path):
    path = write_video(
        tmp_path / "cut.mkv", ride([60.0], 60), codec_options={"g": "10", "crf": "20"}
    )
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    summary = inspect_inputs([path], tmp_path / "out", read_paint, SETTINGS)
    (one,) = summary.inputs
    assert 20 < one.frames < 60
    assert one.breaks[0].frame_index == one.frames - 1
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'id="break"' in report
    assert "earlier" in report


def test_a_bad_input_leaves_no_folder_behind(tmp_path):
    good = write_video(tmp_path / "a.mp4", [paint()] * 3)
    with pytest.raises(BadInputError, match="does not exist"):
        inspect_inputs([good, tmp_path / "none.mp4"], tmp_path / "out", read_paint)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_a_run_is_refused(tmp_path):
    good = write_video(tmp_path / "a.mp4", [paint()] * 3)
    inspect_inputs([good], tmp_path / "out", read_paint, SETTINGS)
    before = (tmp_path / "out" / "run.json").read_bytes()
    with pytest.raises(OutputError, match="already holds a run"):
        inspect_inputs([good], tmp_path / "out", read_paint, SETTINGS)
    assert (tmp_path / "out" / "run.json").read_bytes() == before


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_was_finished_survives_an_interruption(tmp_path, error):
    path = write_video(tmp_path / "a.mp4", ride([45.0], 40))
    calls = 0

    def failing(rgb):
        nonlocal calls
        calls += 1
        if calls == 26:
            raise error
        return read_paint(rgb)

    with pytest.raises(error):
        inspect_inputs([path], tmp_path / "out", failing, SETTINGS)
    out = tmp_path / "out"
    assert len(list(read_json_lines(out / "frames.jsonl"))) == 25
    assert len(list(read_json_lines(out / "events.jsonl"))) == 1
    assert json.loads((out / "run.json").read_text())["counts"]["complete"] is False
    assert "interrupted" in (out / "report.html").read_text(encoding="utf-8")
    assert len(list(open_source(out / "overlay" / "a.mp4"))) == 25
    assert not list(out.rglob("*.part"))


def test_a_killed_run_leaves_readable_parts(tmp_path):
    """After kill −9 the .part files hold every finished line, and another run is refused."""
    import subprocess
    import sys
    import textwrap
    import time

    path = write_video(tmp_path / "a.mp4", ride([45.0], 60))
    script = textwrap.dedent(
        f"""
        import time
        from tests.railinspect.painted_ride import CAMERA, read_paint
        from railinspect.batch import inspect_inputs
        from railinspect.inspect_settings import InspectSettings
        def slow(rgb):
            time.sleep(0.15)
            return read_paint(rgb)
        inspect_inputs([{str(path)!r}], {str(tmp_path / "out")!r}, slow,
                       InspectSettings(camera=CAMERA))
        """
    )
    root = Path(__file__).parents[2]
    process = subprocess.Popen([sys.executable, "-c", script], cwd=root)
    part = tmp_path / "out" / "frames.jsonl.part"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (part.exists() and part.stat().st_size > 20_000):
        time.sleep(0.05)
    process.kill()
    process.wait()
    lines = list(read_json_lines(part))
    assert [line["index"] for line in lines] == list(range(len(lines)))
    assert len(lines) > 3
    assert not (tmp_path / "out" / "run.json").exists()
    with pytest.raises(OutputError, match="already holds a run"):
        inspect_inputs([path], tmp_path / "out", read_paint)


def test_pictures_of_odd_size_get_an_overlay(tmp_path):
    picture = paint()[:-1, :-1]
    path = write_video(
        tmp_path / "odd.mkv", [picture] * 5, codec="ffv1", pix_fmt="bgr0", codec_options={}
    )
    summary = inspect_inputs([path], tmp_path / "out", read_paint, SETTINGS)
    frames = list(open_source(tmp_path / "out" / "overlay" / "odd.mp4"))
    assert summary.inputs[0].size_wh == (639, 359)
    assert frames[0].rgb.shape == (360, 640, 3)
