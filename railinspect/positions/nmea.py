"""Fixes of an NMEA 0183 log: its RMC sentences, the only ones with a date.

    $GPRMC,081836.00,A,5657.0000,N,02406.0000,E,38.9,084.4,010526,003.1,W*hh

are time (UTC), validity, latitude in degrees and minutes, longitude, speed in knots, course, date.
Other sentences, and what a logger writes before the ``$``, are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Final

from railinspect.clock import finite
from railinspect.errors import BadInputError
from railinspect.positions.fixes import Fixes, FixList

KNOT_MPS: Final = 1852 / 3600
"""One knot, m/s."""

MAX_LINE_BYTES: Final = 1024
"""A sentence has at most 82 characters; longer lines are read in pieces and passed over."""

_PIVOT_YEAR: Final = 80
"""Years of two digits below this are of this century."""


def read_nmea(path: Path, what: str) -> Fixes:
    """The valid fixes of a log's RMC sentences; sentences with a wrong check sum are passed over.

    Args:
        path: The file.
        what: What it is to the user, for messages.

    Raises:
        BadInputError: if it cannot be read, has no RMC sentence, or most of them are damaged.
    """
    found = FixList(what)
    sentences = damaged = 0
    for line in _lines(path, what):
        start = line.find(b"$")
        if start < 0 or line[start + 3 : start + 6] != b"RMC":
            continue
        sentences += 1
        try:
            fix = _fix(line[start + 1 :].strip())
        except ValueError:
            damaged += 1
            continue
        if fix is not None:
            found.add(*fix)
    if sentences == 0:
        raise BadInputError(
            f"{what} has no RMC sentence, and other sentences do not say the date; let the "
            "receiver log RMC, or convert the log to GPX"
        )
    if 2 * damaged > sentences:
        raise BadInputError(
            f"{what}: {damaged} of {sentences} RMC sentences are damaged; fetch the log again"
        )
    return found.fixes()


def _lines(path: Path, what: str) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            while line := file.readline(MAX_LINE_BYTES):
                yield line
    except OSError as error:
        raise BadInputError(f"cannot read {what}: {error.strerror or error}") from error


def _fix(sentence: bytes) -> tuple[float, tuple[float, float], float] | None:
    """Clock time, place and speed; None while the receiver has no fix.

    Raises:
        ValueError: if the sentence is damaged.
    """
    body, star, check = sentence.partition(b"*")
    if star and int(check[:2], 16) != reduce(xor, body, 0):
        raise ValueError("check sum")
    cells = body.decode("ascii").split(",")
    if len(cells) < 10:
        raise ValueError("cut short")
    if cells[2] != "A":
        return None
    place = (_degrees(cells[3], 2, cells[4], "NS"), _degrees(cells[5], 3, cells[6], "EW"))
    speed = finite(cells[7]) * KNOT_MPS if cells[7] else math.nan
    return _unix_s(cells[1], cells[9]), place, speed


def _degrees(text: str, digits: int, side: str, sides: str) -> float:
    """Degrees from ``dddmm.mmmm``."""
    minutes = finite(text[digits:])
    if side not in (sides[0], sides[1]) or not text[:digits].isdecimal() or not 0 <= minutes < 60:
        raise ValueError(text)
    return (int(text[:digits]) + minutes / 60) * (1 if side == sides[0] else -1)


def _unix_s(time: str, date: str) -> float:
    """Seconds since 1970 from ``hhmmss.ss`` and ``ddmmyy``."""
    if len(date) != 6 or not (date + time[:6]).isdecimal():
        raise ValueError(f"{date} {time}")
    day, month, year = int(date[:2]), int(date[2:4]), int(date[4:])
    year += 2000 if year < _PIVOT_YEAR else 1900
    hour, minute, seconds = int(time[:2]), int(time[2:4]), finite(time[4:])
    if not 0 <= seconds < 61:  # a leap second is written as 60
        raise ValueError(time)
    return datetime(year, month, day, hour, minute, tzinfo=UTC).timestamp() + seconds
