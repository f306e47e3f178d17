"""The events as a Parquet table, one row each, with the units in the column names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from railinspect.records import flat_for_parquet

_TEXT: Final = (
    "input",
    "type",
    "advice",
    "advice_reason",
    "doubt",
    "service_by",
    "emergency_by",
    "thumbnail",
)
_COUNTS: Final = ("id", "first_frame", "last_frame", "best_frame", "frames_seen")
_NUMBERS: Final = (
    "confidence",
    "first_time_s",
    "confirmed_time_s",
    "last_time_s",
    "first_range_m",
    "first_range_low_m",
    "first_range_high_m",
    "closest_range_m",
    "closest_range_low_m",
    "closest_range_high_m",
    "closest_time_s",
    "advice_time_s",
    "service_by_time_s",
    "emergency_by_time_s",
    "best_box_left_px",
    "best_box_top_px",
    "best_box_right_px",
    "best_box_bottom_px",
)

SCHEMA: Final = pa.schema(
    [(name, pa.int64()) for name in _COUNTS]
    + [(name, pa.string()) for name in _TEXT]
    + [(name, pa.float64()) for name in _NUMBERS]
)
"""Columns of ``events.parquet``; the same whether or not there are events."""


def write_events_parquet(path: Path, events: Sequence[dict[str, Any]]) -> None:
    """Write ``events.jsonl`` objects as a table; intervals become ``…_low_m``, ``…_high_m``."""
    rows = [flat_for_parquet(event) for event in events]
    pq.write_table(pa.Table.from_pylist(rows, schema=SCHEMA), path, compression="zstd")
