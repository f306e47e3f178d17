from __future__ import annotations

import json

import numpy as np
import pytest

from railinspect.errors import OutputError
from railinspect.ride_file import RidePlan, record_ride, rendered
from railinspect.scenes import demo_settings
from railinspect.video import open_source

PLAN = RidePlan(5, demo_settings((320, 180)), duration_s=1.0, frame_rate=6.0, anomalies="clear")


def test_two_workers_render_what_one_does():
    alone, together = list(rendered(PLAN, 1)), list(rendered(PLAN, 2))
    assert len(alone) == len(together) == 6
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


def test_the_video_shows_the_ride_with_its_times(tmp_path):
    seen = []
    ride = record_ride(
        PLAN,
        tmp_path / "a.mp4",
        tmp_path / "a.json",
        workers=1,
        progress=lambda done, total: seen.append((done, total)),
    )
    frames = list(open_source(tmp_path / "a.mp4"))
    assert [f.time_s for f in frames] == pytest.approx([i / 6 for i in range(6)], abs=1e-3)
    assert np.abs(frames[3].rgb.astype(int) - ride.frame(3).rgb).mean() < 6
    assert seen[-1] == (6, 6)
    truth = json.loads((tmp_path / "a.json").read_text())
    assert truth["planted"] == []
    assert truth["speed_mps"] == 20.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "a.mp4"]


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(OutputError, match="cannot write the ride"):
        record_ride(PLAN, tmp_path / "none" / "a.mp4", tmp_path / "a.json", workers=1)
