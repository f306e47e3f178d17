"""Putting the stretches of an input together, so that no event is lost or doubled at a seam.

An event belongs to the stretch within which it was confirmed. The stretch after it sees the same
event, confirmed in its lead-in; both inspected the frames from that lead-in's beginning to the end
of the first one's run-on, so it is recognised there by its box. What a stretch confirmed in its
lead-in and the stretch before did not is kept if it is still seen in the stretch's own frames:
rather an event that the whole recording would not have than one less. An event that outlasts the
run-on is continued by what the next stretch saw of it.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, Final

from railinspect.adviser import ACTIONS
from railinspect.boxes import Box, iou
from railinspect.fleet.finished import InputCounts
from railinspect.fleet.stretch import PART
from railinspect.fleet.tasks import Plan
from railinspect.input_results import thumbnail_path
from railinspect.runinfo import write_json
from railinspect.sinks import JsonLines
from railinspect.sinks.json_lines import read_json_lines
from railinspect.source import MAX_BREAKS, Break

Row = dict[str, Any]

SAME_BOX: Final = 0.5
"""Two boxes of one frame with at least this much in common are one thing (share of the union)."""

COUNTED: Final = (
    "frames",
    "clear_frames",
    "finding_frames",
    "unknown_frames",
    "followed_frames",
    "speed_unknown_frames",
    "break_count",
)


@dataclass
class _Part:
    """One stretch: its summary, its events by their own ids, and what they are in the whole."""

    folder: Path
    summary: Row
    events: dict[int, Row]
    offset: int
    ids: dict[int, int] = field(default_factory=dict)

    def frames(self) -> Iterator[Row]:
        return read_json_lines(self.folder / "frames.jsonl")

    def sightings(self) -> Iterator[tuple[float, Row]]:
        """The time and each finding of an event, in the stretch's own frames and the overlap."""
        for row in chain(read_json_lines(self.folder / "overlap.jsonl"), self.frames()):
            for found in row["findings"]:
                if found["event_id"] is not None:
                    yield row["time_s"], found


@dataclass
class _Event:
    """One event of the whole input and where its picture lies."""

    row: Row
    picture: Path | None
    stretch: int


def merge(plan: Plan, name: str, parts: Sequence[Path], folder: Path) -> InputCounts:
    """Write a finished input from its stretches.

    Args:
        plan: The input's survey.
        name: Its name for people.
        parts: The folders of its stretches, in order.
        folder: Existing empty folder to write to.

    Returns:
        Its counts, also written as ``summary.json``.
    """
    read = _read(parts)
    events: list[_Event] = []
    for stretch, part in enumerate(read):
        _place_events(plan, read, stretch, events)
        for event in events:
            if event.stretch == stretch:
                _shift(event.row, part.offset)
    order = sorted(range(len(events)), key=lambda i: (events[i].row["confirmed_time_s"], i))
    final = {old: new for new, old in enumerate(order, start=1)}
    labels = {"input": plan.id, "name": name}
    _write_events(folder, [events[old] for old in order], labels)
    _write_frames(folder, read, final, labels)
    counts = _counts(plan, name, read, len(events))
    write_json(folder / "summary.json", counts.as_json())
    return counts


def _read(parts: Sequence[Path]) -> list[_Part]:
    read: list[_Part] = []
    before = 0
    for folder in parts:
        summary = json.loads((folder / PART).read_text(encoding="utf-8"))
        events = {row["id"]: row for row in read_json_lines(folder / "events.jsonl")}
        read.append(_Part(folder, summary, events, before - (summary["first_index"] or 0)))
        before += summary["frames"]
    return read


def _place_events(plan: Plan, parts: list[_Part], stretch: int, events: list[_Event]) -> None:
    """Decide what each event of a stretch is in the whole input; new ones join ``events``."""
    part = parts[stretch]
    start_s, end_s = plan.span_s(stretch)
    before = parts[stretch - 1] if stretch else None
    same = _recognised(part, before) if before else {}
    seen_s = _seen_s(part) if before else {}
    for own_id in sorted(part.events):
        row = part.events[own_id]
        if before and own_id in same:
            known = before.ids.get(same[own_id])
            if known is not None:
                part.ids[own_id] = known
                if same[own_id] in before.summary["unended"]:
                    _continue(events[known], row, part.offset, seen_s.get(own_id, set()))
                continue
        confirmed_s = row["confirmed_time_s"]
        own = any(start_s <= time_s < end_s for time_s in seen_s.get(own_id, ()))
        if confirmed_s >= end_s or (confirmed_s < start_s and not own):
            continue
        part.ids[own_id] = len(events)
        picture = part.folder / row["thumbnail"] if row["thumbnail"] else None
        events.append(_Event(dict(row), picture, stretch))


def _recognised(part: _Part, before: _Part) -> dict[int, int]:
    """The former stretch's id of each event that both saw."""
    here: dict[float, list[Row]] = {}
    for time_s, found in part.sightings():
        here.setdefault(time_s, []).append(found)
    votes: dict[int, Counter[int]] = {}
    for time_s, found in before.sightings():
        for own in here.get(time_s, ()):
            if iou(_box(own), _box(found)) >= SAME_BOX:
                votes.setdefault(own["event_id"], Counter())[found["event_id"]] += 1
    return {own_id: min(c, key=lambda i: (-c[i], i)) for own_id, c in votes.items()}


def _seen_s(part: _Part) -> dict[int, set[float]]:
    """When each event was seen, as a finding of its own, media seconds."""
    times: dict[int, set[float]] = {}
    for time_s, found in part.sightings():
        times.setdefault(found["event_id"], set()).add(time_s)
    return times


def _box(found: Row) -> Box:
    left, top, right, bottom = found["box_xyxy"]
    return left, top, right, bottom


def _continue(event: _Event, row: Row, offset: int, seen_s: set[float]) -> None:
    """Add to an event what a later stretch saw of it after the earlier one had to stop."""
    known = event.row
    if row["last_time_s"] <= known["last_time_s"]:
        return
    known["frames_seen"] += sum(time_s > known["last_time_s"] for time_s in seen_s)
    known["last_time_s"], known["last_frame"] = row["last_time_s"], row["last_frame"] + offset
    nearer = known["closest_range_m"], row["closest_range_m"]
    if nearer[1] is not None and (nearer[0] is None or nearer[1] < nearer[0]):
        for key in ("closest_range_m", "closest_range_interval_m", "closest_time_s"):
            known[key] = row[key]
    if known["first_range_m"] is None:
        for key in ("first_range_m", "first_range_interval_m"):
            known[key] = row[key]
    if _rank(row["advice"]) > _rank(known["advice"]):
        for key in ("advice", "advice_reason", "advice_time_s"):
            known[key] = row[key]
    for key in ("service_by", "service_by_time_s", "emergency_by", "emergency_by_time_s", "doubt"):
        known[key] = row[key]


def _rank(advice: str | None) -> int:
    return -1 if advice is None else ACTIONS.index(advice)


def _shift(row: Row, offset: int) -> None:
    for key in ("first_frame", "last_frame", "best_frame"):
        row[key] += offset


def _write_events(folder: Path, events: Sequence[_Event], labels: Row) -> None:
    lines = JsonLines(folder / "events.jsonl")
    for event_id, event in enumerate(events, start=1):
        thumbnail = None
        if event.picture is not None:
            thumbnail = thumbnail_path(event_id)
            (folder / thumbnail).parent.mkdir(exist_ok=True)
            shutil.copyfile(event.picture, folder / thumbnail)
        lines.write({**event.row, **labels, "id": event_id, "thumbnail": thumbnail})
    lines.close()


def _write_frames(folder: Path, parts: Sequence[_Part], final: dict[int, int], labels: Row) -> None:
    lines = JsonLines(folder / "frames.jsonl")
    for part in parts:
        for row in part.frames():
            for found in row["findings"]:
                known = part.ids.get(found["event_id"])
                found["event_id"] = None if known is None else final[known]
            lines.write({**row, **labels, "index": row["index"] + part.offset})
    lines.close()


def _counts(plan: Plan, name: str, parts: Sequence[_Part], events: int) -> InputCounts:
    summaries = [part.summary for part in parts]
    breaks = [
        Break(one["time_s"], one["frame_index"] + part.offset, one["reason"])
        for part in parts
        for one in part.summary["breaks"]
    ]
    firsts = [one["first_time_s"] for one in summaries if one["frames"]]
    lasts = [one["last_time_s"] for one in summaries if one["frames"]]
    width, height = summaries[0]["size_wh"]
    return InputCounts(
        id=plan.id,
        name=name,
        address=plan.address,
        kind=summaries[0]["kind"],
        size_wh=(width, height),
        **{key: sum(one[key] for one in summaries) for key in COUNTED},
        first_time_s=firsts[0] if firsts else None,
        last_time_s=lasts[-1] if lasts else None,
        events=events,
        breaks=tuple(breaks[:MAX_BREAKS]),
        segments=len(parts),
    )
