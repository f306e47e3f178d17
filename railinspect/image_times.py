"""When each picture of a folder was taken: from its file name, or from a CSV file beside it.

Times are kept as whole nanoseconds until the last step, so a Unix time loses nothing.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Final

from railinspect.errors import BadInputError

TIMES_FILES: Final = ("times.csv", "timestamps.csv")
"""Names under which a folder's times are looked for, lower case."""

MAX_TIMES_BYTES: Final = 256 * 1024 * 1024
"""Largest CSV file accepted, bytes; at 40 bytes a line that is three days at 25 per second."""

_COLUMNS: Final = ("unix_ns", "unix_s", "time_utc", "time_s")
_NS: Final = 1_000_000_000
_FIRST_CLOCK_NS: Final = 100_000_000 * _NS
"""Seconds from here on (1973) are a Unix time, below it a time since some start."""


@dataclass(frozen=True)
class Stamps:
    """Times of pictures, whole nanoseconds.

    Attributes:
        times_ns: One per picture, strictly rising.
        is_clock: They are Unix times; else they run from a start nobody names.
    """

    times_ns: tuple[int, ...]
    is_clock: bool

    def seconds(self, since_ns: int) -> list[float]:
        """Seconds since a time, exact to 1 ns."""
        return [round((time - since_ns) / _NS, 9) for time in self.times_ns]


def times_from_names(stems: list[str]) -> list[float] | None:
    """Seconds since the first file, where every name ends in a time stamp.

    Returns:
        Strictly increasing times, one per name; None if any name has none or two are equal.

    Example:
        >>> times_from_names(["cab_12.040", "cab_12.080"])
        [0.0, 0.04]
        >>> times_from_names(["20260501T115959.960Z", "20260501T120000.000Z"])
        [0.0, 0.04]
        >>> times_from_names(["rs00001", "rs00002"]) is None
        True
    """
    stamps = stamps_from_names(stems)
    return None if stamps is None else stamps.seconds(stamps.times_ns[0])


def stamps_from_names(stems: Sequence[str]) -> Stamps | None:
    """The time at the end of every name.

    Recognised are date and time (``20260501T120000.040Z``, ``2026-05-01_12-00-00-040``; only a
    final Z makes them a clock time), Unix times of 13, 16 or 19 digits (milli-, micro-,
    nanoseconds), and seconds with a decimal point (``cab_12.040``; a Unix time from 1973 on).
    Plain counters are no times.

    Returns:
        The times; None if a name has none, if they are of different kinds, or do not rise.
    """
    read = [_stamp(stem) for stem in stems]
    kinds = {None if one is None else one[1:] for one in read}
    if len(kinds) != 1 or None in kinds:
        return None
    times = tuple(one[0] for one in read if one is not None)
    ((_, is_clock),) = (kind for kind in kinds if kind is not None)
    return Stamps(times, is_clock) if all(a < b for a, b in pairwise(times)) else None


_DATE = re.compile(
    r"(?:^|[^0-9])(\d{4})-?(\d\d)-?(\d\d)[T_ -](\d\d)[-_.]?(\d\d)[-_.]?(\d\d)"
    r"(?:[._,-](\d{1,9}))?(Z?)$",
    re.ASCII,
)
_EPOCH = re.compile(r"(?:^|[^0-9])([0-9]{13}|[0-9]{16}|[0-9]{19})$")
_SECONDS = re.compile(r"(?:^|[^0-9.])([0-9]{1,10}\.[0-9]{1,12})$")


def _stamp(stem: str) -> tuple[int, str, bool] | None:
    """Nanoseconds, kind of stamp, and whether it is a Unix time."""
    if match := _DATE.search(stem):
        year, month, day, hour, minute, second = (int(part) for part in match.groups()[:6])
        try:
            moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
        except ValueError:
            return None
        whole = round((moment - datetime(1970, 1, 1, tzinfo=UTC)) / timedelta(seconds=1))
        return whole * _NS + int((match[7] or "").ljust(9, "0")), "date", match[8] == "Z"
    if match := _EPOCH.search(stem):
        return int(match[1]) * 10 ** (19 - len(match[1])), "epoch", True
    if match := _SECONDS.search(stem):
        nanoseconds = int(Decimal(match[1]) * _NS)
        return nanoseconds, "seconds", nanoseconds >= _FIRST_CLOCK_NS
    return None


def times_file(folder: Path) -> Path | None:
    """The folder's CSV file of times, or None."""
    names = {file.name.casefold(): file for file in folder.iterdir() if file.is_file()}
    return next((names[name] for name in TIMES_FILES if name in names), None)


def read_times(path: Path) -> tuple[dict[str, int], str]:
    """Read a CSV file of times.

    It has a header with ``file`` (the picture's name) and one of ``unix_ns``, ``unix_s``,
    ``time_utc`` (ISO 8601 with its zone) or ``time_s`` (media time, seconds); cells are separated
    by commas, semicolons or tabs.

    Returns:
        Nanoseconds by file name, and the column they were read from.

    Raises:
        BadInputError: if it is not such a file.
    """
    try:
        size = path.stat().st_size
        if size > MAX_TIMES_BYTES:
            raise BadInputError(
                f"{path} has {size} bytes; at most {MAX_TIMES_BYTES} are accepted, so split the "
                "folder"
            )
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"cannot read the times in {path}: {error}") from error
    first = text.partition("\n")[0]
    separator = max(",;\t", key=first.count)
    reader = csv.DictReader(io.StringIO(text), delimiter=separator)
    try:
        columns = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = columns
        column = next((name for name in _COLUMNS if name in columns), None)
        if "file" not in columns or column is None:
            raise BadInputError(
                f"{path} has the columns {', '.join(columns)[:200] or 'none'}; it needs file and "
                f"one of {', '.join(_COLUMNS)}"
            )
        times: dict[str, int] = {}
        for row in reader:
            name = (row["file"] or "").strip()
            if name in times:
                raise BadInputError(f"{path}, line {reader.line_num}: {name!r} is listed twice")
            times[name] = _nanoseconds(row[column] or "", column, path, reader.line_num)
    except csv.Error as error:
        raise BadInputError(f"{path}, line {reader.line_num}: {error}") from error
    return times, column


def _nanoseconds(cell: str, column: str, path: Path, line: int) -> int:
    try:
        if column == "time_utc":
            moment = datetime.fromisoformat(cell.strip())
            if moment.tzinfo is None:
                raise ValueError
            since = moment - datetime(1970, 1, 1, tzinfo=UTC)
            return (since.days * 86400 + since.seconds) * _NS + since.microseconds * 1000
        value = Decimal(cell.strip())
        if not value.is_finite() or abs(value) >= Decimal(2**63):
            raise ValueError
        nanoseconds = int(value if column == "unix_ns" else value * _NS)
        if abs(nanoseconds) >= 2**63:
            raise ValueError
    except (ValueError, ArithmeticError):
        wanted = "ISO 8601 with its zone" if column == "time_utc" else "a number"
        raise BadInputError(
            f"{path}, line {line}: {column} is {cell[:40]!r}; expected {wanted}"
        ) from None
    return nanoseconds
