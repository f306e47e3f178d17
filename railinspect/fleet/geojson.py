"""The events as GeoJSON (RFC 7946) where their places are known."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from railinspect.fleet.dataset import event_rows
from railinspect.fleet.finished import finished_inputs
from railinspect.fleet.logbook import read_entry
from railinspect.fleet.published import publish

DIGITS: Final = 7
"""Decimals of a degree; the last is a centimetre."""


def write_geojson(run_folder: str | Path) -> int:
    """Write ``events.geojson`` into a run folder; without any place there is no such file.

    Returns:
        How many events it holds.
    """
    run = Path(run_folder)
    target = run / "events.geojson"
    features = _features(run)
    first = next(features, None)
    if first is None:
        target.unlink(missing_ok=True)
        return 0
    count = 0
    with publish(target) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write('{"type":"FeatureCollection","features":[\n')
        feature: dict[str, Any] | None = first
        while feature is not None:
            text = json.dumps(feature, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
            file.write((",\n" if count else "") + text)
            count += 1
            feature = next(features, None)
        file.write("\n]}\n")
    return count


def _features(run: Path) -> Iterator[dict[str, Any]]:
    for one in finished_inputs(run):
        entry = read_entry(one.counts.id, run)
        if entry.positions is not None:
            for row in event_rows(one, entry):
                if row.get("latitude_deg") is not None:
                    yield feature_of(row)


def feature_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of the events' data set as a GeoJSON feature; longitude comes first."""
    place = [round(row["longitude_deg"], DIGITS), round(row["latitude_deg"], DIGITS)]
    properties = {name: value for name, value in row.items() if not name.endswith("tude_deg")}
    if isinstance(properties.get("time_utc"), datetime):
        properties["time_utc"] = properties["time_utc"].isoformat()
    return {
        "type": "Feature",
        "id": f"{row['input']}/{row['id']}",
        "geometry": {"type": "Point", "coordinates": place},
        "properties": properties,
    }
