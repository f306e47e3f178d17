"""The real cab ride, where it is present: speed is the benchmark's matter, truth is this one's.

The track in the clip is clear throughout, so every event is a false alarm.
"""

from __future__ import annotations

import json
import os
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from railinspect import cli
from railinspect.sinks.json_lines import read_json_lines

FOLDER = Path(os.environ.get("RAILINSPECT_REAL") or Path(__file__).parents[2] / "../shared/real")
CLIP, TRUTH = FOLDER / "cab_ride.mp4", FOLDER / "cab_ride_ego_rails.json"
BUNDLE = files("railinspect") / "bundles" / "fscnn_s.onnx"

pytestmark = [
    pytest.mark.skipif(
        not CLIP.exists(),
        reason="the real clip is not part of the project; set RAILINSPECT_REAL to its folder",
    ),
    pytest.mark.skipif(not BUNDLE.is_file(), reason="this checkout has no shipped bundle"),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("real") / "run"
    assert cli.main(["inspect", str(CLIP), "--out", str(out), "--no-overlay"]) == 0
    return out


def test_every_frame_is_inspected_and_nearly_all_are_followed(run):
    counts = json.loads((run / "run.json").read_text())["counts"]
    assert counts["frames"] == 500
    assert counts["followed_fraction"] >= 0.95


def test_a_clear_track_raises_no_event(run):
    events = list(read_json_lines(run / "events.jsonl"))
    assert len(events) <= 2, [(e["type"], e["first_time_s"], e["first_range_m"]) for e in events]


@pytest.mark.parametrize("index", [200, 330, 470])
def test_rails_lie_where_they_were_marked(run, index):
    truth = json.loads(TRUTH.read_text())["frames"][str(index)]
    record = next(f for f in read_json_lines(run / "frames.jsonl") if f["index"] == index)
    assert record["followed"]
    for side in ("left", "right"):
        marked = np.array(truth[side], float)
        marked = marked[(marked[:, 1] >= 200) & (marked[:, 1] <= 365)]
        rail = np.array(record["rails"][side])
        assert rail[0, 1] <= 200
        error = np.abs(np.interp(marked[:, 1], rail[:, 1], rail[:, 0]) - marked[:, 0])
        assert np.median(error) <= 2.0, side
