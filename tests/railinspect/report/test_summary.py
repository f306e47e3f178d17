from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from railinspect.report.summary import BINS, MAX_STRETCHES, summarise


def frame(index, status, reason=None, rate=25.0, findings=()):
    return {
        "input": "a",
        "index": index,
        "time_s": index / rate,
        "status": status,
        "reason": reason,
        "findings": list(findings),
    }


def timeline_of(frames):
    last = frames[-1]["time_s"]
    inputs = [{"name": "a", "frames": len(frames), "first_time_s": 0.0, "last_time_s": last}]
    return summarise(frames, inputs)["a"]


def test_successive_unknown_frames_are_one_stretch_with_their_reasons():
    statuses = ["clear"] * 10 + ["unknown"] * 5 + ["clear"] * 3 + ["unknown"] * 2
    frames = [frame(i, s, f"too dark at row {i}") for i, s in enumerate(statuses)]
    stretches = timeline_of(frames).stretches
    assert [(s.first_frame, s.frames) for s in stretches] == [(10, 5), (18, 2)]
    assert stretches[0].reasons == {"too dark at row …": 5}


def test_a_column_shows_its_worst_status():
    frames = [frame(i, "unknown" if i == 500 else "clear", "x") for i in range(100_000)]
    timeline = timeline_of(frames)
    assert timeline.status.count("unknown") == 1
    assert None not in timeline.status


def test_few_frames_fill_the_whole_band():
    timeline = timeline_of([frame(i, "clear") for i in range(7)])
    assert None not in timeline.status


def test_a_hole_in_the_recording_stays_a_hole():
    frames = [frame(i, "clear") for i in range(200)] + [frame(i, "clear") for i in range(800, 1000)]
    timeline = timeline_of(frames)
    assert 500 < timeline.status.count(None) < 650


@given(st.lists(st.sampled_from(["clear", "finding", "unknown"]), min_size=1, max_size=400))
def test_no_unknown_frame_is_lost(statuses):
    timeline = timeline_of([frame(i, s, "why") for i, s in enumerate(statuses)])
    assert sum(s.frames for s in timeline.stretches) == statuses.count("unknown")
    assert ("unknown" in timeline.status) == ("unknown" in statuses)
    assert len(timeline.status) == BINS


def test_memory_is_bounded_however_restless_the_recording():
    frames = (frame(i, "unknown" if i % 2 else "clear", f"reason {i % 7}x") for i in range(20_000))
    inputs = [{"name": "a", "frames": 20_000, "first_time_s": 0.0, "last_time_s": 800.0}]
    timeline = summarise(frames, inputs)["a"]
    assert len(timeline.stretches) == MAX_STRETCHES
    assert timeline.dropped_stretches == 10_000 - MAX_STRETCHES
