"""Characteristics as tables: text for people, CSV and Parquet for programs, and back from CSV."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from railops.errors import FileError
from railops.headway.characteristic import Characteristic

_LONGEST_S = 86_400.0
COLUMNS = ("interval_s", "run_s", "front_run_s", "dwell_s")


def as_text(table: Characteristic, dwell_s: float | None = None) -> str:
    """The intervals as a grid: one row per run time of the second train."""
    interval = table.interval_s(dwell_s)
    dwell = table.dwell_s if dwell_s is None else dwell_s
    head = "T(n) \\ T(n-1)".ljust(14) + "".join(f"{time:8.1f}" for time in table.first_s)
    lines = [f"shortest interval, s, for a dwell of {dwell:g} s: {table.name}", head]
    for run, row in zip(table.second_s, interval, strict=True):
        cells = "".join("       –" if np.isnan(value) else f"{value:8.1f}" for value in row)
        lines.append(f"{run:<14.1f}{cells}")
    return "\n".join(lines)


def write_csv(table: Characteristic, path: str | Path, dwell_s: float | None = None) -> None:
    """Write one row per pair; the columns are those of :meth:`Characteristic.rows`."""
    rows = table.rows(dwell_s)
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else list(COLUMNS))
        writer.writeheader()
        writer.writerows(rows)


def write_parquet(table: Characteristic, path: str | Path, dwell_s: float | None = None) -> None:
    """Write the same rows as a Parquet file."""
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(table.rows(dwell_s)), path)


def read_csv(path: str | Path) -> Characteristic:
    """Read a measured or printed characteristic: interval_s, run_s, front_run_s and dwell_s.

    Raises:
        FileError: if it cannot be read; the message names the line.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = sorted(set(COLUMNS) - set(reader.fieldnames or ()))
            if missing:
                raise FileError(f"{path}, line 1: missing columns {missing}")
            rows, dwells = [], set()
            for row in reader:
                try:
                    interval, run, front, dwell = (float(row[name]) for name in COLUMNS)
                except (TypeError, ValueError):
                    raise FileError(
                        f"{path}, line {reader.line_num}: {list(row.values())} are not all numbers"
                    ) from None
                possible = all(time < _LONGEST_S for time in (interval, run, front, dwell))
                if not (possible and min(interval, run, front) > 0.0 and dwell >= 0.0):
                    raise FileError(
                        f"{path}, line {reader.line_num}: times must be positive and below a day"
                    )
                rows.append((run, front, interval))
                dwells.add(dwell)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"cannot read {path}: {error}") from error
    if not rows:
        raise FileError(f"{path} has no rows below its header")
    if len(dwells) > 1:
        raise FileError(f"{path} mixes dwells {sorted(dwells)}; a characteristic has one")
    return Characteristic.published(rows, dwells.pop(), Path(path).stem)
