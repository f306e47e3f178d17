"""Reading a speed: a number with its unit, a CSV log, or a GPX track."""

from __future__ import annotations

import csv
import math
import re
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.speed_log import CHANGE_MPS2, SpeedLog
from railops.traction import MAX_SPEED_MPS

Array = npt.NDArray[np.float64]

EARTH_RADIUS_M: Final = 6_371_008.8

GPX_SPEED_ERROR_MPS: Final = 0.5
"""Largest error of a speed that a satellite receiver states itself (from the Doppler shift)."""

GPX_WINDOW_S: Final = 2.0
"""A speed from positions is that over the points so far around, seconds."""

GPX_DRIFT_M: Final = 2.0
"""By this much the error of a position may change within that window, metres."""

_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(m/s|km/h)?", re.IGNORECASE)
_TIMES: Final = ("time_s", "unix_s", "time_utc")
_SPEEDS: Final = {"speed_mps": 1.0, "speed_kmh": 1 / 3.6}
_ERRORS: Final = {"error_mps": 1.0, "error_kmh": 1 / 3.6}


def constant_speed_mps(text: str) -> float | None:
    """The speed a text states, m/s; None if it is no number.

    Raises:
        BadInputError: if it lies outside 0 … 150 m/s.

    Example:
        >>> constant_speed_mps("72km/h"), constant_speed_mps("20"), constant_speed_mps("ride.csv")
        (20.0, 20.0, None)
    """
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        return None
    speed = float(match[1]) / (3.6 if (match[2] or "").lower() == "km/h" else 1.0)
    if not 0 <= speed <= MAX_SPEED_MPS:
        raise BadInputError(
            f"speed is {text}, that is {speed:g} m/s; give 0 to {MAX_SPEED_MPS:g} m/s (a number "
            "without a unit is m/s; 72km/h is km/h)"
        )
    return speed


def read_speed_log(path: str | Path, started: datetime | None = None) -> SpeedLog:
    """Read a CSV log or a GPX track.

    A CSV log has a header; of its columns are read ``time_s`` (media time, seconds), ``unix_s``
    (seconds since 1970) or ``time_utc`` (ISO 8601 with its zone); ``speed_mps`` or ``speed_kmh``;
    and, where present, the largest error ``error_mps`` or ``error_kmh``. Cells are separated by
    commas, semicolons or tabs.

    A GPX track has points with times. Speeds it states are taken as they are; else they follow
    from the way along the points within two seconds.

    Args:
        path: The file.
        started: Clock time of the recording's time zero, with its zone; needed for logs whose
            times are clock times, refused for those in media time.

    Returns:
        The log in media time.

    Raises:
        BadInputError: if the file cannot be read as what it should be; names the line or point.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        raise BadInputError(
            f"speed log {path} is an MCAP log, which is not read yet; export its speed topic as CSV"
        )
    if suffix not in (".csv", ".gpx"):
        raise BadInputError(
            f"speed {path} is neither a speed (20, 20m/s, 72km/h) nor a .csv or .gpx file"
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read speed log {path}: {error}") from error
    source = path.name
    if suffix == ".csv":
        clock, times, speeds, errors = _read_csv(text, source)
    else:
        clock, (times, speeds, errors) = True, _read_gpx(text, source)
    if clock and started is None:
        raise BadInputError(
            f"speed log {source} has clock times; say when the recording's time zero was with "
            f"--started, for example --started {_iso(times[0])}"
        )
    if started is not None and not clock:
        raise BadInputError(f"speed log {source} is in media time already; leave out --started")
    zero_s = started.timestamp() if started is not None else 0.0
    return SpeedLog(source, np.array(times) - zero_s, speeds, errors)


def clock_time(text: str) -> datetime:
    """A clock time in ISO 8601 with its zone.

    Raises:
        BadInputError: if it is none, or does not say its zone.

    Example:
        >>> clock_time("2026-05-01T12:00:00Z").timestamp()
        1777636800.0
    """
    try:
        time = datetime.fromisoformat(text.strip())
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise BadInputError(
            f"time {text!r} is no clock time with a zone; write it like 2026-05-01T12:00:00Z or "
            "2026-05-01T14:00:00+02:00"
        )
    return time


def _iso(unix_s: float) -> str:
    try:
        return datetime.fromtimestamp(unix_s, UTC).isoformat().replace("+00:00", "Z")
    except (ValueError, OverflowError, OSError):
        return "2026-05-01T12:00:00Z"


Columns = tuple[list[float], list[float], list[float]]


def _read_csv(text: str, source: str) -> tuple[bool, list[float], list[float], list[float]]:
    """Whether its times are clock times; times, speeds in m/s, errors in m/s."""
    lines = text.splitlines()
    head = lines[0] if lines else ""
    rows = csv.DictReader(lines, delimiter=max(",;\t", key=head.count))
    names = [name.strip() for name in rows.fieldnames or []]
    rows.fieldnames = names
    when = next((name for name in _TIMES if name in names), None)
    speed = next((name for name in _SPEEDS if name in names), None)
    error = next((name for name in _ERRORS if name in names), None)
    if when is None or speed is None:
        raise BadInputError(
            f"speed log {source} has the columns {', '.join(names) or 'none'}; it needs one of "
            f"{', '.join(_TIMES)} and one of {', '.join(_SPEEDS)}"
        )
    columns: Columns = ([], [], [])
    for row in rows:
        cell: str = when
        try:
            at = clock_time(row[when]).timestamp() if when == "time_utc" else _finite(row[when])
            cell = speed
            value = _finite(row[speed]) * _SPEEDS[speed]
            cell = error or speed
            spread = _finite(row[error]) * _ERRORS[error] if error else 0.0
        except (ValueError, TypeError, AttributeError):
            what = "a time with its zone" if cell == "time_utc" else "a number"
            raise BadInputError(
                f"speed log {source}, line {rows.line_num}: {cell} is {row[cell]!r}; expected "
                f"{what} (leave out the lines of missing values)"
            ) from None
        for column, number in zip(columns, (at, value, spread), strict=True):
            column.append(number)
    return when != "time_s", *columns


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number


def _read_gpx(text: str, source: str) -> Columns:
    """Clock times, speeds and errors of a track's points."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInputError(f"speed log {source} declares a document type; GPX files have none")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise BadInputError(f"speed log {source} is not a GPX file: {error}") from error
    times: list[float] = []
    places: list[tuple[float, float]] = []
    stated: list[float] = []
    for number, point in enumerate(p for p in root.iter() if _tag(p) == "trkpt"):
        values = {_tag(child): (child.text or "") for child in point.iter()}
        try:
            at = clock_time(values["time"]).timestamp()
            place = (_finite(point.attrib["lat"]), _finite(point.attrib["lon"]))
            speed = _finite(values["speed"]) if "speed" in values else math.nan
        except (KeyError, ValueError):
            raise BadInputError(
                f"speed log {source}, track point {number + 1}: needs lat, lon and a time with its "
                "zone, all of them readable"
            ) from None
        if times and (at, place) == (times[-1], places[-1]):
            continue  # receivers repeat the last point at the turn of a segment
        times.append(at)
        places.append(place)
        stated.append(speed)
    if len(times) < 2:
        raise BadInputError(f"speed log {source} has fewer than two track points with times")
    if all(map(math.isfinite, stated)):
        return times, stated, [GPX_SPEED_ERROR_MPS] * len(times)
    for number, (before, after) in enumerate(pairwise(times), start=2):
        if after <= before:
            raise BadInputError(
                f"speed log {source}, time {number}: {_iso(after)} does not come after the one "
                "before; sort the track"
            )
    return times, *_speeds_along(np.array(times) - times[0], np.radians(places))


def _tag(element: ElementTree.Element) -> str:
    """An element's name without its namespace, which differs between versions of GPX."""
    return element.tag.rpartition("}")[2].lower()


def _speeds_along(time_s: Array, place_rad: Array) -> tuple[list[float], list[float]]:
    """Speeds from positions, and their largest errors, m/s.

    The speed at a point is the way along the points from half a window before to half a window
    after, over the time between. The way is never shorter than the chord, so noise makes the speed
    higher and not lower. Its error: the positions' over the window, and that of taking a mean for
    the speed at one moment, at most a·((t − t₀)² + (t₁ − t)²) / (2·(t₁ − t₀)) for a train that
    changes its speed by at most a.
    """
    north = np.diff(place_rad[:, 0])
    east = np.diff(place_rad[:, 1]) * np.cos((place_rad[1:, 0] + place_rad[:-1, 0]) / 2)
    way_m = np.concatenate([[0.0], np.cumsum(EARTH_RADIUS_M * np.hypot(north, east))])
    half = 0.5 * GPX_WINDOW_S
    count = time_s.size
    first = np.searchsorted(time_s, time_s - half - 1e-3)
    last = np.searchsorted(time_s, time_s + half + 1e-3) - 1
    here = np.arange(count)
    alone = first == last  # no point within the window: reach for the neighbours
    first = np.where(alone, np.maximum(here - 1, 0), first)
    last = np.where(alone, np.minimum(here + 1, count - 1), last)
    span = np.maximum(time_s[last] - time_s[first], 1e-9)
    speed = (way_m[last] - way_m[first]) / span
    spread = (time_s - time_s[first]) ** 2 + (time_s[last] - time_s) ** 2
    error = GPX_DRIFT_M / span + CHANGE_MPS2 * spread / (2 * span)
    return speed.tolist(), np.minimum(error, MAX_SPEED_MPS).tolist()
