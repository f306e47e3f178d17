"""The Parquet data set of a run: one file of frames and one of events per finished input.

    RUN/dataset/frames/run=<run id>/<input id>.parquet
    RUN/dataset/events/run=<run id>/<input id>.parquet

The columns are the same in every file of every run. Adding an input again replaces its files, so
whatever is added twice, or was half added when the machine went down, ends the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from railinspect.fleet.finished import FinishedInput, run_id
from railinspect.fleet.logbook import Entry, read_entry, safe_id
from railinspect.fleet.published import publish
from railinspect.fleet.view import view_of
from railinspect.records import flat_for_parquet
from railinspect.sinks.parquet import SCHEMA as EVENT_COLUMNS

LONGEST_FRAME_S: Final = 1.0
"""A frame speaks for the time until the next one, at most for this; the rest is a hole, seconds."""

BATCH_ROWS: Final = 4096
"""Rows held at a time while a file is written."""

_CLOCK: Final = [("time_utc", pa.timestamp("us", tz="UTC")), ("clock_hour", pa.int8())]
_PLACE: Final = [("latitude_deg", pa.float64()), ("longitude_deg", pa.float64())]
_WHOSE: Final = [(name, pa.string()) for name in ("input", "name", "line", "vehicle")]

FINDING: Final = pa.struct(
    [
        ("type", pa.string()),
        ("event_id", pa.int64()),
        *((name, pa.float64()) for name in ("confidence", "range_m", "range_std_m")),
        *((name, pa.float64()) for name in ("range_low_m", "range_high_m")),
        *((f"box_{side}_px", pa.float64()) for side in ("left", "top", "right", "bottom")),
    ]
)
"""One element of a frame's ``findings``."""

FRAMES: Final = pa.schema(
    [
        *_WHOSE,
        ("index", pa.int64()),
        ("time_s", pa.float64()),
        ("duration_s", pa.float64()),
        ("way_m", pa.float64()),
        *_CLOCK,
        *_PLACE,
        ("status", pa.string()),
        ("followed", pa.bool_()),
        ("reason", pa.string()),
        *((name, pa.float64()) for name in ("reach_m", "speed_mps", "speed_error_mps")),
        *((f"vanishing_{axis}_px", pa.float64()) for axis in "uv"),
        ("horizon_v_px", pa.float64()),
        ("spacing_per_row", pa.float64()),
        ("advice", pa.string()),
        ("required_m", pa.float64()),
        ("available_m", pa.float64()),
        ("findings", pa.list_(FINDING)),
    ]
)
"""Columns of the frames. ``duration_s`` is the time a frame speaks for, ``way_m`` how far the train
went in it; ``clock_hour`` is 0 … 23 in the zone of the logbook."""

EVENTS: Final = pa.schema(
    [
        *_WHOSE,
        *((field.name, field.type) for field in EVENT_COLUMNS if field.name != "input"),
        *_CLOCK,
        *_PLACE,
        ("place", pa.string()),
    ]
)
"""Columns of the events: those of ``events.parquet``, when (first seen) and where. ``place`` is
``ahead`` where the thing's own place is known, ``train`` where only that of the train is."""


def add(input_folder: str | Path, run_folder: str | Path) -> None:
    """Put a finished input into the run's data set, in place of what was there of it.

    Args:
        input_folder: ``RUN/inputs/<input id>``.
        run_folder: ``RUN``.

    Raises:
        BadInputError: if the folder holds no finished input, or the run has no ``fleet.json``.
        OSError: if the files cannot be written.
    """
    run = Path(run_folder)
    one = FinishedInput.read(input_folder)
    entry = read_entry(one.counts.id, run)
    frames, events = table_paths(run, one.counts.id)
    with publish(frames) as part:
        _write(part, FRAMES, _frame_rows(one, entry))
    with publish(events) as part:
        _write(part, EVENTS, event_rows(one, entry))


def table_paths(run_folder: Path, input_id: str) -> tuple[Path, Path]:
    """Where the frames and the events of an input lie."""
    base, part = run_folder / "dataset", f"run={safe_id(run_id(run_folder))}"
    name = f"{safe_id(input_id)}.parquet"
    return base / "frames" / part / name, base / "events" / part / name


def _write(path: Path, schema: pa.Schema, rows: Iterable[dict[str, Any]]) -> None:
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        batch: list[dict[str, Any]] = []
        for row in rows:
            batch.append(row)
            if len(batch) == BATCH_ROWS:
                writer.write_batch(pa.RecordBatch.from_pylist(batch, schema=schema))
                batch = []
        writer.write_batch(pa.RecordBatch.from_pylist(batch, schema=schema))


def _frame_rows(one: FinishedInput, entry: Entry) -> Iterator[dict[str, Any]]:
    whose = _whose(one, entry)
    for frame, duration_s in _with_durations(one.frames()):
        time_s, vanishing, view = frame["time_s"], frame["vanishing_point"], view_of(frame)
        advice = frame["advice"] or {}
        yield {
            **whose,
            **{name: frame[name] for name in ("index", "time_s", "status", "followed", "reason")},
            **{name: frame.get(name) for name in ("reach_m", "speed_mps", "speed_error_mps")},
            "duration_s": duration_s,
            "way_m": _way_m(time_s, duration_s, frame.get("speed_mps"), entry),
            **_clock(time_s, entry),
            **_train_place(time_s, entry),
            "vanishing_u_px": vanishing[0] if vanishing else None,
            "vanishing_v_px": vanishing[1] if vanishing else None,
            "horizon_v_px": view.horizon_v_px if view else None,
            "spacing_per_row": view.spacing_per_row if view else None,
            "advice": advice.get("action"),
            "required_m": advice.get("required_m"),
            "available_m": advice.get("available_m"),
            "findings": [_finding(found) for found in frame["findings"]],
        }


def _with_durations(
    frames: Iterator[dict[str, Any]],
) -> Iterator[tuple[dict[str, Any], float]]:
    """Each frame with the time until the next one; the last with that before it."""
    last_s = 0.0
    before: dict[str, Any] | None = None
    for frame in chain(frames, [None]):
        if before is not None:
            if frame is not None:
                last_s = min(max(frame["time_s"] - before["time_s"], 0.0), LONGEST_FRAME_S)
            yield before, last_s
        before = frame


def _way_m(time_s: float, duration_s: float, speed_mps: float | None, entry: Entry) -> float | None:
    """How far the train went from a time on: along its positions, else by its speed."""
    if entry.positions is not None:
        way_m, known_s = entry.positions.way_m(time_s, time_s + duration_s)
        if known_s >= duration_s - 1e-9:
            return way_m
    return None if speed_mps is None else speed_mps * duration_s


def _finding(found: Mapping[str, Any]) -> dict[str, Any]:
    low, high = found["range_interval_m"] or (None, None)
    row = {name: found[name] for name in ("type", "event_id", "confidence", "range_m")}
    row |= {"range_std_m": found["range_std_m"], "range_low_m": low, "range_high_m": high}
    sides = zip(("left", "top", "right", "bottom"), found["box_xyxy"], strict=True)
    return row | {f"box_{side}_px": value for side, value in sides}


def event_rows(one: FinishedInput, entry: Entry) -> Iterator[dict[str, Any]]:
    """The rows of an input's events, as the data set has them."""
    whose = _whose(one, entry)
    for event in one.events():
        time_s = event["first_time_s"]
        yield {**flat_for_parquet(event), **whose, **_clock(time_s, entry), **_place(event, entry)}


def _whose(one: FinishedInput, entry: Entry) -> dict[str, Any]:
    counts = one.counts
    return {
        "input": counts.id,
        "name": counts.name,
        "line": entry.line,
        "vehicle": entry.vehicle,
    }


def _clock(time_s: float, entry: Entry) -> dict[str, Any]:
    if entry.started_unix_s is None:
        return {}
    unix_s = entry.started_unix_s + time_s
    hour = math.floor((unix_s + entry.utc_offset_s) / 3600) % 24
    return {"time_utc": datetime.fromtimestamp(unix_s, UTC), "clock_hour": hour}


def _train_place(time_s: float, entry: Entry) -> dict[str, Any]:
    place = entry.positions.at(time_s) if entry.positions else None
    if place is None:
        return {}
    return {"latitude_deg": place.latitude_deg, "longitude_deg": place.longitude_deg}


def _place(event: Mapping[str, Any], entry: Entry) -> dict[str, Any]:
    """Where the thing lies: the range it was seen at last, along the way the train then took."""
    log, range_m, at_s = entry.positions, event["closest_range_m"], event["closest_time_s"]
    if log is not None and range_m is not None and at_s is not None:
        place = log.ahead(at_s, range_m)
        if place is not None:
            return {
                "latitude_deg": place.latitude_deg,
                "longitude_deg": place.longitude_deg,
                "place": "ahead",
            }
    train = _train_place(event["last_time_s"], entry)
    return {**train, "place": "train"} if train else {}
