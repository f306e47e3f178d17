"""Reading fixes from a file by what it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from railinspect.errors import BadInputError
from railinspect.positions.fixes import Fixes
from railinspect.positions.gpx import read_gpx
from railinspect.positions.mcap_log import read_mcap_fixes
from railinspect.positions.nmea import read_nmea

POSITION_SUFFIXES: Final = (".gpx", ".nmea", ".mcap")
"""File name endings of logs with fixes, lower case."""


def read_fixes(path: str | Path, what: str | None = None) -> Fixes:
    """Read a GPX track, an NMEA log or the fixes of an MCAP log.

    Args:
        path: The file; for MCAP with several topics of fixes ``FILE::TOPIC``.
        what: What it is to the user, for messages (default: ``positions NAME``).

    Raises:
        BadInputError: if it is none of these, or cannot be read as what its name says.
    """
    file, topic = named_topic(path)
    what = what or f"positions {file.name}"
    suffix = file.suffix.lower()
    if suffix == ".gpx":
        return read_gpx(file, what)
    if suffix == ".nmea":
        return read_nmea(file, what)
    if suffix == ".mcap":
        return read_mcap_fixes(file, what, topic)
    raise BadInputError(
        f"{what} has an unknown ending; expected one of {', '.join(POSITION_SUFFIXES)}"
    )


def named_topic(path: str | Path) -> tuple[Path, str | None]:
    """File and topic of ``FILE`` or ``FILE::TOPIC``.

    Example:
        >>> named_topic("ride.mcap::/gnss/fix")
        (PosixPath('ride.mcap'), '/gnss/fix')
    """
    name, colons, topic = str(path).partition("::")
    return (Path(name), topic) if colons and topic else (Path(path), None)
