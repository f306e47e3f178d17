"""What is known about recordings besides their pictures: line, vehicle, start and positions.

A logbook is a CSV file with a header and one row per input:

    input,line,vehicle,started,positions
    ride,Riga–Jelgava,ER2-1301,2026-05-01T12:00:00+03:00,ride.gpx

``input`` is the input's id, its name, or the file name of its address; every other column may be
missing or empty. ``started`` is the clock time of the recording's time zero, with its zone: hours
of the day are told in that zone. ``positions`` is a log of fixes, relative to the logbook; it needs
``started``.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from railinspect.clock import clock_time
from railinspect.errors import BadInputError
from railinspect.fleet.finished import FinishedInput
from railinspect.fleet.published import publish
from railinspect.positions import Fixes, PositionLog, read_fixes

COLUMNS: Final = ("input", "line", "vehicle", "started", "positions")

MAX_LOGBOOK_BYTES: Final = 16 << 20
"""Larger logbooks are refused."""

_ID: Final = re.compile(r"[0-9A-Za-z_-]{1,64}")
_TABLE: Final = pa.schema(
    [(name, pa.float64()) for name in ("time_s", "latitude_deg", "longitude_deg")]
)


@dataclass(frozen=True)
class Entry:
    """What the logbook says about one input.

    Attributes:
        line: Name of the railway line, or None.
        vehicle: Name of the vehicle that carries the camera, or None.
        started_unix_s: Clock time of media time zero, seconds since 1970, or None.
        utc_offset_s: Offset of the zone it was told in, seconds.
        positions: Where the train was, in media time, or None.
    """

    line: str | None = None
    vehicle: str | None = None
    started_unix_s: float | None = None
    utc_offset_s: float = 0.0
    positions: PositionLog | None = None


def safe_id(text: str) -> str:
    """An id that may name a file.

    Raises:
        BadInputError: if it holds anything but letters, digits, ``_`` and ``-``.
    """
    if not _ID.fullmatch(text):
        raise BadInputError(
            f"id {text[:80]!r} is none a run writes; expected letters and digits, at most 64"
        )
    return text


def enter_logbook(logbook: Path, inputs: tuple[FinishedInput, ...], run_folder: Path) -> list[str]:
    """Read a logbook, and the logs it names, into a run folder.

    Args:
        logbook: The CSV file.
        inputs: The run's finished inputs.
        run_folder: The run.

    Returns:
        Ids of the inputs the logbook speaks of.

    Raises:
        BadInputError: if the logbook or one of its logs cannot be read as such, or a row fits no
            input or several.
    """
    logs: dict[Path, Fixes] = {}
    entered: dict[str, Entry] = {}
    for number, row in _rows(logbook):
        where = f"logbook {logbook.name}, line {number}"
        one = _input_of(row["input"], inputs, where)
        if one.counts.id in entered:
            raise BadInputError(f"{where}: input {row['input']} comes twice; leave one row")
        entered[one.counts.id] = _entry(row, one, logbook.parent, logs, where)
    for input_id, entry in entered.items():
        _write(entry, input_id, run_folder)
    return sorted(entered)


def read_entry(input_id: str, run_folder: Path) -> Entry:
    """What was entered about an input; an empty entry if nothing was.

    Raises:
        BadInputError: if the files in the run folder are damaged.
    """
    base = run_folder / "logbook" / safe_id(input_id)
    try:
        data = json.loads(base.with_suffix(".json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return Entry()
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"cannot read {base}.json ({error}); enter the logbook again"
        ) from error
    source = data.pop("positions")
    if source is None:
        return Entry(**data)
    table = pq.read_table(base.with_suffix(".parquet"), schema=_TABLE)
    columns = (table[name].to_numpy() for name in _TABLE.names)
    return Entry(**data, positions=PositionLog(source, *columns))


def _write(entry: Entry, input_id: str, run_folder: Path) -> None:
    base = run_folder / "logbook" / safe_id(input_id)
    log = entry.positions
    if log is not None:
        table = pa.table([log.time_s, log.latitude_deg, log.longitude_deg], schema=_TABLE)
        with publish(base.with_suffix(".parquet")) as part:
            pq.write_table(table, part, compression="zstd")
    data: dict[str, Any] = asdict(replace(entry, positions=None))
    data["positions"] = log.source if log else None
    with publish(base.with_suffix(".json")) as part:
        part.write_text(json.dumps(data, ensure_ascii=False) + "\n", encoding="utf-8")


def _rows(logbook: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Line numbers and cells; columns that are missing are empty."""
    try:
        if logbook.stat().st_size > MAX_LOGBOOK_BYTES:
            raise BadInputError(f"logbook {logbook} is larger than 16 MiB; it is no list of inputs")
        text = logbook.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read logbook {logbook}: {error}") from error
    lines = text.splitlines()
    head = lines[0] if lines else ""
    reader = csv.DictReader(lines, delimiter=max(",;\t", key=head.count))
    names = [name.strip() for name in reader.fieldnames or []]
    if "input" not in names or (unknown := set(names) - set(COLUMNS)):
        said = f"unknown columns {sorted(unknown)}" if "input" in names else "no column input"
        raise BadInputError(f"logbook {logbook} has {said}; known are {', '.join(COLUMNS)}")
    reader.fieldnames = names
    try:
        for row in reader:
            yield reader.line_num, {n: str(row.get(n) or "").strip() for n in COLUMNS}
    except csv.Error as error:
        raise BadInputError(f"logbook {logbook}, line {reader.line_num}: {error}") from error


def _input_of(text: str, inputs: tuple[FinishedInput, ...], where: str) -> FinishedInput:
    for key in (_by_id, _by_name, _by_file):
        found = [one for one in inputs if key(one) == text]
        if len(found) == 1:
            return found[0]
        if found:
            ids = ", ".join(one.counts.id for one in found[:5])
            raise BadInputError(f"{where}: {text!r} may be {ids}; write the id")
    raise BadInputError(
        f"{where}: {text!r} is no finished input of the run; write its id, name or file name"
    )


def _by_id(one: FinishedInput) -> str:
    return one.counts.id


def _by_name(one: FinishedInput) -> str:
    return one.counts.name


def _by_file(one: FinishedInput) -> str:
    return PurePosixPath(one.counts.address.replace("\\", "/")).name


def _entry(
    row: dict[str, str], one: FinishedInput, base: Path, logs: dict[Path, Fixes], where: str
) -> Entry:
    entry = Entry(line=row["line"] or None, vehicle=row["vehicle"] or None)
    if row["started"]:
        try:
            started = clock_time(row["started"])
        except BadInputError as error:
            raise BadInputError(f"{where}: {error}") from error
        offset = started.utcoffset()
        entry = replace(
            entry,
            started_unix_s=started.timestamp(),
            utc_offset_s=offset.total_seconds() if offset else 0.0,
        )
    if not row["positions"]:
        return entry
    if entry.started_unix_s is None:
        raise BadInputError(f"{where}: positions have clock times; say when the recording started")
    path = base / row["positions"]
    if path not in logs:
        logs.clear()  # logs are large, and rows of one log stand together
        logs[path] = read_fixes(path)
    first, last = one.counts.first_time_s, one.counts.last_time_s
    if first is None or last is None or not math.isfinite(last - first):
        return entry
    try:
        positions = PositionLog.within(logs[path], entry.started_unix_s, first, last)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error
    return replace(entry, positions=positions)
