"""Clock times and numbers as people's files state them."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from railinspect.errors import BadInputError


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


def iso_utc(unix_s: float) -> str:
    """Seconds since 1970 as ISO 8601 in UTC; an example of one where there is no such time.

    Example:
        >>> iso_utc(1777636800.0)
        '2026-05-01T12:00:00Z'
    """
    try:
        return datetime.fromtimestamp(unix_s, UTC).isoformat().replace("+00:00", "Z")
    except (ValueError, OverflowError, OSError):
        return "2026-05-01T12:00:00Z"


def finite(text: str) -> float:
    """A number that is neither infinite nor NaN.

    Raises:
        ValueError: if the text is none.
    """
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number
