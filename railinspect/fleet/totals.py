"""What a run saw, added up from its data set one file at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from railinspect.fleet.dataset import table_paths
from railinspect.fleet.drift import MATTERS, Block, blocks_of
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.logbook import read_entry
from railinspect.report.summary import general

RANGES_M: Final = (0.0, 25.0, 50.0, 100.0, 150.0, 200.0)
"""Lower bounds of the classes of range, metres; the last class is open."""

MAX_REASONS: Final = 100
"""Different reasons for unknown time that are told apart."""

_COLUMNS: Final = ["time_s", "duration_s", "way_m", "clock_hour", "status", "reason", *MATTERS]


@dataclass
class Exposure:
    """Time and way, and what became of it.

    Attributes:
        known_s: Time in which something can be said, seconds.
        unknown_s: Time in which nothing can be said, seconds.
        way_m: Known way within the known time, metres.
        wayless_s: Known time of which the way is not known, seconds.
        events: Events by type.
    """

    known_s: float = 0.0
    unknown_s: float = 0.0
    way_m: float = 0.0
    wayless_s: float = 0.0
    events: Counter[str] = field(default_factory=Counter)

    @property
    def total_s(self) -> float:
        """All of the time, seconds."""
        return self.known_s + self.unknown_s


@dataclass
class Totals:
    """A whole run.

    Attributes:
        all: Over everything.
        by_line: By line; None for inputs whose line is not known.
        by_hour: By hour of the day; None for inputs without a clock time.
        by_range: Events by type in each class of closest range; None without a range.
        by_input: By input id.
        reasons_s: Seconds each reason accounts for, numbers replaced by "…".
        blocks: Minutes of each camera, by the vehicle's name, or the input's where it has none.
        inputs: The finished inputs.
    """

    all: Exposure = field(default_factory=Exposure)
    by_line: dict[str | None, Exposure] = field(default_factory=dict)
    by_hour: dict[int | None, Exposure] = field(default_factory=dict)
    by_range: dict[float | None, Counter[str]] = field(default_factory=dict)
    by_input: dict[str, Exposure] = field(default_factory=dict)
    reasons_s: Counter[str] = field(default_factory=Counter)
    blocks: dict[str, list[Block]] = field(default_factory=dict)
    inputs: list[FinishedInput] = field(default_factory=list)


def totals_of(run_folder: str | Path) -> Totals:
    """Add up a run whose inputs are all in its data set.

    No more than one input's columns are held at a time.

    Raises:
        FileNotFoundError: if a finished input is not in the data set.
    """
    run, totals = Path(run_folder), Totals()
    for one in finished_inputs(run):
        frames, events = table_paths(run, one.counts.id)
        totals.inputs.append(one)
        entry = read_entry(one.counts.id, run)
        table = pq.read_table(frames, columns=_COLUMNS, partitioning=None)
        whose = [
            totals.all,
            totals.by_line.setdefault(entry.line, Exposure()),
            totals.by_input.setdefault(one.counts.id, Exposure()),
        ]
        _add_frames(totals, whose, table)
        camera = entry.vehicle or one.counts.name
        known = totals.blocks.setdefault(camera, [])
        zero_s = entry.started_unix_s
        if zero_s is None:
            zero_s = len(known) * 60.0
        columns = {name: _floats(table, name) for name in MATTERS}
        known += blocks_of(_floats(table, "time_s"), columns, one.counts.size_wh, zero_s)
        for event in pq.read_table(events, partitioning=None).to_pylist():
            for exposure in [*whose, totals.by_hour.setdefault(event["clock_hour"], Exposure())]:
                exposure.events[event["type"]] += 1
            by_type = totals.by_range.setdefault(range_class(event["closest_range_m"]), Counter())
            by_type[event["type"]] += 1
    return totals


def events_of(run_folder: str | Path, totals: Totals) -> Iterator[dict[str, Any]]:
    """The rows of all events, by input."""
    for one in totals.inputs:
        _, events = table_paths(Path(run_folder), one.counts.id)
        yield from pq.read_table(events, partitioning=None).to_pylist()


def range_class(range_m: float | None) -> float | None:
    """Lower bound of the class of a range, metres.

    Example:
        >>> range_class(60.0), range_class(1000.0), range_class(None)
        (50.0, 200.0, None)
    """
    return None if range_m is None else max(low for low in RANGES_M if low <= max(range_m, 0.0))


def _add_frames(totals: Totals, whose: list[Exposure], table: pa.Table) -> None:
    unknown = np.array(pc.equal(table["status"], "unknown").to_numpy(zero_copy_only=False), bool)
    lasting, way = _floats(table, "duration_s"), _floats(table, "way_m")
    hour = _floats(table, "clock_hour")
    for exposure in whose:
        _add(exposure, unknown, lasting, way)
    for which in np.unique(hour):  # NaN, where there is no clock, comes out once
        inside = np.isnan(hour) if np.isnan(which) else hour == which
        key = None if np.isnan(which) else int(which)
        exposure = totals.by_hour.setdefault(key, Exposure())
        _add(exposure, unknown[inside], lasting[inside], way[inside])
    grouped = table.filter(pa.array(unknown)).group_by("reason").aggregate([("duration_s", "sum")])
    for row in grouped.to_pylist():
        reason = general(row["reason"] or "no reason given")
        if reason not in totals.reasons_s and len(totals.reasons_s) >= MAX_REASONS:
            reason = "other reasons"
        totals.reasons_s[reason] += row["duration_s_sum"]


def _add(
    exposure: Exposure,
    unknown: np.ndarray[Any, np.dtype[np.bool_]],
    lasting_s: np.ndarray[Any, np.dtype[np.float64]],
    way_m: np.ndarray[Any, np.dtype[np.float64]],
) -> None:
    exposure.unknown_s += float(lasting_s[unknown].sum())
    exposure.known_s += float(lasting_s[~unknown].sum())
    exposure.way_m += float(np.nansum(way_m[~unknown]))
    exposure.wayless_s += float(lasting_s[~unknown & np.isnan(way_m)].sum())


def _floats(table: pa.Table, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A column as float64; null is NaN."""
    return np.array(table[name].cast(pa.float64()).to_numpy(zero_copy_only=False), float)
