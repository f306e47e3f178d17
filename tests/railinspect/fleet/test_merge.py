"""Stretches written by hand: which events are one, which are kept, and under which numbers."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import pytest

from railinspect.fleet.finished import FinishedInput
from railinspect.fleet.merge import merge
from railinspect.fleet.tasks import Cut, Plan
from railinspect.sinks import JsonLines

STARTS_S = (0.0, 10.0, 20.0)
PLAN = Plan("/a.mp4", "v", "0" * 16, 1, STARTS_S)


def box(kind: str) -> list[float]:
    """Where a thing stands in the picture, each at a place of its own."""
    left = 100.0 * "abcdef".index(kind)
    return [left, 0.0, left + 50.0, 80.0]


def event(own_id, confirmed_s, last_s, offset, closest_m=50.0, advice="warn"):
    """The row of an event seen once a second, as a stretch numbers it."""
    return {
        "id": own_id,
        "input": "",
        "type": "obstruction",
        "first_time_s": confirmed_s - 1,
        "confirmed_time_s": confirmed_s,
        "last_time_s": last_s,
        "first_frame": round(confirmed_s - 1) - offset,
        "last_frame": round(last_s) - offset,
        "best_frame": round(confirmed_s) - offset,
        "frames_seen": round(last_s - confirmed_s) + 1,
        "first_range_m": 90.0,
        "first_range_interval_m": [80.0, 95.0],
        "closest_range_m": closest_m,
        "closest_range_interval_m": [closest_m - 1, closest_m + 1],
        "closest_time_s": last_s,
        "advice": advice,
        "advice_reason": advice,
        "advice_time_s": confirmed_s,
        **dict.fromkeys(("service_by", "emergency_by"), "due"),
        **dict.fromkeys(("service_by_time_s", "emergency_by_time_s"), closest_m),
        "doubt": None,
        "thumbnail": None,
    }


def part(folder, stretch, seen, events, unended=(), lead_in=5, run_on=0):
    """Write a stretch of one frame per second; ``seen`` is {time: {own id: thing}}."""
    folder.mkdir()
    start, end = 10 * stretch, 10 * stretch + 10
    first = max(start - lead_in, 0)
    frames, overlap = JsonLines(folder / "frames.jsonl"), JsonLines(folder / "overlap.jsonl")
    for time_s in range(first, end + run_on):
        found = [
            {"event_id": own, "box_xyxy": box(kind)} for own, kind in seen.get(time_s, {}).items()
        ]
        if start <= time_s < end:
            frames.write({"index": time_s - first, "time_s": float(time_s), "findings": found})
        elif found:
            overlap.write({"time_s": float(time_s), "findings": found})
    frames.close()
    overlap.close()
    rows = JsonLines(folder / "events.jsonl")
    for row in events:
        rows.write(row)
    rows.close()
    counts = dict.fromkeys(
        ("clear_frames", "finding_frames", "unknown_frames", "followed_frames"), 1
    )
    summary = {
        **counts,
        "frames": 10,
        "speed_unknown_frames": 0,
        "break_count": stretch == 1,
        "breaks": [{"time_s": 13.0, "frame_index": 8, "reason": "x"}] if stretch == 1 else [],
        "first_time_s": float(start),
        "last_time_s": end - 1.0,
        "kind": "video",
        "size_wh": [640, 360],
        "first_index": start - first,
        "unended": list(unended),
    }
    (folder / "part.json").write_text(json.dumps(summary))
    return folder


def merged(tmp_path, *parts):
    out = tmp_path / "out"
    out.mkdir()
    counts = merge(PLAN, "a", parts, out)
    whole = FinishedInput.read(out)
    assert whole.counts == counts
    rows = list(whole.frames())
    assert [row["index"] for row in rows] == list(range(30))
    shown = {
        row["index"]: [f["event_id"] for f in row["findings"]] for row in rows if row["findings"]
    }
    return list(whole.events()), shown, counts


def run(ids, kind, first, last):
    return {time_s: {ids: kind} for time_s in range(first, last + 1)}


def test_an_event_across_a_seam_is_one_and_numbers_go_on(tmp_path):
    events, shown, counts = merged(
        tmp_path,
        part(tmp_path / "0", 0, run(1, "a", 7, 12), [event(1, 7, 12, 0)], run_on=4),
        part(
            tmp_path / "1",
            1,
            {**run(1, "a", 8, 12), **run(2, "b", 15, 17)},
            [event(1, 8, 12, 5), event(2, 15, 17, 5)],
        ),
        part(tmp_path / "2", 2, run(1, "b", 15, 17), [event(1, 15, 17, 15)]),
    )
    assert [(e["id"], e["confirmed_time_s"], e["last_frame"]) for e in events] == [
        (1, 7, 12),
        (2, 15, 17),
    ]
    assert shown == {**{i: [1] for i in range(7, 13)}, **{i: [2] for i in range(15, 18)}}
    assert (counts.frames, counts.events, counts.break_count) == (30, 2, 1)
    assert counts.breaks[0].frame_index == 13


@pytest.mark.parametrize(("first_says", "second_says"), [(9, 10), (10, 9)])
def test_one_confirmed_on_either_side_of_the_seam_is_one(tmp_path, first_says, second_says):
    """The stretches disagree by a frame on when it was confirmed."""
    events, _, _ = merged(
        tmp_path,
        part(tmp_path / "0", 0, run(3, "a", 9, 12), [event(3, first_says, 12, 0)], run_on=4),
        part(tmp_path / "1", 1, run(1, "a", 9, 12), [event(1, second_says, 12, 5)]),
        part(tmp_path / "2", 2, {}, []),
    )
    assert len(events) == 1


def test_what_only_one_side_saw_is_kept_where_it_was_seen(tmp_path):
    events, shown, _ = merged(
        tmp_path,
        part(tmp_path / "0", 0, run(1, "a", 5, 7), [event(1, 5, 7, 0)]),
        part(
            tmp_path / "1",
            1,
            {**run(1, "b", 6, 8), **run(2, "c", 8, 13)},
            [event(1, 6, 8, 5), event(2, 8, 13, 5)],
        ),
        part(tmp_path / "2", 2, {}, []),
    )
    # b ended before the stretch that saw it began: that was the first stretch's to say.
    assert [(e["id"], e["confirmed_time_s"]) for e in events] == [(1, 5), (2, 8)]
    assert shown[10] == [2]


def test_an_event_longer_than_the_run_on_is_continued_over_several_seams(tmp_path):
    events, shown, _ = merged(
        tmp_path,
        part(tmp_path / "0", 0, run(1, "a", 8, 11), [event(1, 8, 11, 0)], [1], run_on=2),
        part(
            tmp_path / "1",
            1,
            run(1, "a", 8, 21),
            [event(1, 8, 21, 5, 40.0, "service")],
            [1],
            run_on=2,
        ),
        part(tmp_path / "2", 2, run(1, "a", 17, 25), [event(1, 17, 25, 15, 30.0, "none")]),
    )
    (one,) = events
    assert (one["first_frame"], one["last_frame"], one["last_time_s"]) == (7, 25, 25)
    assert one["frames_seen"] == 18  # every second from 8 to 25
    assert (one["closest_range_m"], one["closest_time_s"]) == (30.0, 25)
    assert one["advice"] == "service"
    assert one["first_range_m"] == 90.0
    assert shown == {i: [1] for i in range(8, 26)}


def test_an_ended_event_is_not_continued_by_another_view_of_it(tmp_path):
    """The next stretch began in its midst and lost it later: the first stretch's word counts."""
    events, _, _ = merged(
        tmp_path,
        part(tmp_path / "0", 0, run(1, "a", 4, 11), [event(1, 4, 11, 0)], run_on=4),
        part(tmp_path / "1", 1, run(1, "a", 6, 12), [event(1, 6, 12, 5)]),
        part(tmp_path / "2", 2, {}, []),
    )
    assert [e["last_time_s"] for e in events] == [11]


def test_stretches_cover_a_recording_once():
    cut = Cut(stretch_s=10.0)
    for last_s in (3.0, 14.9, 15.1, 29.0, 36.0):
        plan = Plan("a", "v", "i", 1, cut.starts_s(0.5, 0.5 + last_s))
        spans = [plan.span_s(i) for i in range(len(plan.starts_s))]
        assert spans[0][0] == -math.inf
        assert spans[-1][1] == math.inf
        assert all(a[1] == b[0] for a, b in pairwise(spans))
    assert Cut(stretch_s=math.inf).starts_s(0.0, 1e6) == (0.0,)
