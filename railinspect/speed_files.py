"""Reading a speed: a number with its unit, a CSV log, a GPX, NMEA or MCAP log."""

from __future__ import annotations

import csv
import math
import re
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from railinspect.clock import clock_time, finite, iso_utc
from railinspect.errors import BadInputError
from railinspect.positions import POSITION_SUFFIXES, Fixes, read_fixes
from railinspect.positions.files import named_topic
from railinspect.positions.fixes import steps_m
from railinspect.positions.mcap_log import read_mcap_speeds
from railinspect.speed_log import CHANGE_MPS2, SpeedLog
from railops.traction import MAX_SPEED_MPS

Array = npt.NDArray[np.float64]

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
    """Read a CSV log, a GPX track, an NMEA log or an MCAP log.

    A CSV log has a header; of its columns are read ``time_s`` (media time, seconds), ``unix_s``
    (seconds since 1970) or ``time_utc`` (ISO 8601 with its zone); ``speed_mps`` or ``speed_kmh``;
    and, where present, the largest error ``error_mps`` or ``error_kmh``. Cells are separated by
    commas, semicolons or tabs.

    A GPX track has points with times, an NMEA log has RMC sentences. Speeds they state are taken
    as they are; else they follow from the way along the points within two seconds. Of an MCAP log
    the topic is read that states a velocity (``FILE::TOPIC`` where there are several).

    Args:
        path: The file.
        started: Clock time of the recording's time zero, with its zone; needed for logs whose
            times are clock times, refused for those in media time.

    Returns:
        The log in media time.

    Raises:
        BadInputError: if the file cannot be read as what it should be; names the line or point.
    """
    file, topic = named_topic(path)
    suffix = file.suffix.lower()
    if suffix not in (".csv", *POSITION_SUFFIXES):
        raise BadInputError(
            f"speed {path} is neither a speed (20, 20m/s, 72km/h) nor a .csv or "
            f"{', '.join(POSITION_SUFFIXES)} file"
        )
    source, what, clock = file.name, f"speed log {file.name}", True
    if suffix == ".csv":
        try:
            text = file.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise BadInputError(f"cannot read speed log {file}: {error}") from error
        clock, times, speeds, errors = _read_csv(text, source)
    elif suffix == ".mcap":
        times, speeds, errors = read_mcap_speeds(file, what, topic)
    else:
        times, speeds, errors = _speeds_of_fixes(read_fixes(path, what))
    if clock and started is None:
        raise BadInputError(
            f"speed log {source} has clock times; say when the recording's time zero was with "
            f"--started, for example --started {iso_utc(times[0])}"
        )
    if started is not None and not clock:
        raise BadInputError(f"speed log {source} is in media time already; leave out --started")
    zero_s = started.timestamp() if started is not None else 0.0
    return SpeedLog(source, np.array(times) - zero_s, speeds, errors)


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
            at = clock_time(row[when]).timestamp() if when == "time_utc" else finite(row[when])
            cell = speed
            value = finite(row[speed]) * _SPEEDS[speed]
            cell = error or speed
            spread = finite(row[error]) * _ERRORS[error] if error else 0.0
        except (ValueError, TypeError, AttributeError):
            what = "a time with its zone" if cell == "time_utc" else "a number"
            raise BadInputError(
                f"speed log {source}, line {rows.line_num}: {cell} is {row[cell]!r}; expected "
                f"{what} (leave out the lines of missing values)"
            ) from None
        for column, number in zip(columns, (at, value, spread), strict=True):
            column.append(number)
    return when != "time_s", *columns


def _speeds_of_fixes(fixes: Fixes) -> Columns:
    """Clock times, speeds and errors: as the receiver states them, else from the way."""
    times, stated = fixes.unix_s.tolist(), fixes.speed_mps.tolist()
    if len(times) < 2:
        raise BadInputError(f"{fixes.what} has fewer than two track points with times")
    if all(map(math.isfinite, stated)):
        return times, stated, [GPX_SPEED_ERROR_MPS] * len(times)
    for number, (before, after) in enumerate(pairwise(times), start=2):
        if after <= before:
            raise BadInputError(
                f"{fixes.what}, time {number}: {iso_utc(after)} does not come after the one "
                "before; sort the track"
            )
    way_m = np.cumsum([0.0, *steps_m(fixes.latitude_deg, fixes.longitude_deg)])
    return times, *_speeds_along(fixes.unix_s - times[0], way_m)


def _speeds_along(time_s: Array, way_m: Array) -> tuple[list[float], list[float]]:
    """Speeds from positions, and their largest errors, m/s.

    The speed at a point is the way along the points from half a window before to half a window
    after, over the time between. The way is never shorter than the chord, so noise makes the speed
    higher and not lower. Its error: the positions' over the window, and that of taking a mean for
    the speed at one moment, at most a·((t − t₀)² + (t₁ − t)²) / (2·(t₁ − t₀)) for a train that
    changes its speed by at most a.
    """
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
