"""Structured logs: one JSON object per line, for machines that collect them.

The package logs to the standard library's logger ``railinspect`` and is silent until someone
listens: :func:`log_to` for JSON lines, or any handler of the caller's own.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from railinspect.errors import OutputError
from railinspect.runinfo import jsonable

LOGGER: Final = logging.getLogger("railinspect")
LOGGER.addHandler(logging.NullHandler())

STANDARD_ERROR: Final = "-"
"""In place of a file: lines go to standard error."""


def note(message: str, /, *, level: int = logging.INFO, **fields: object) -> None:
    """Log what happened, with the values a machine may filter by.

    Args:
        message: What happened, always the same words for the same thing; values go to fields.
        level: Level of the standard ``logging`` module.
        fields: Values; what JSON lacks (NaN, paths) is turned into what it has.
    """
    if LOGGER.isEnabledFor(level):
        LOGGER.log(level, message, extra={"fields": fields})


class JsonFormatter(logging.Formatter):
    """A record as one line of JSON: ``time`` (UTC), ``level``, ``message`` and its fields.

    Example:
        >>> record = logging.makeLogRecord(
        ...     {"msg": "input ended", "levelname": "INFO", "fields": {"frames": 50}}
        ... )
        >>> line = JsonFormatter().format(record)
        >>> line[line.index('"level"') :]
        '"level": "info", "message": "input ended", "frames": 50}'
    """

    def format(self, record: logging.LogRecord) -> str:
        """One line, whatever newlines a name from outside contains."""
        time = datetime.fromtimestamp(record.created, UTC)
        line: dict[str, Any] = {
            "time": time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        fields = jsonable(getattr(record, "fields", {}))
        line |= {name: value for name, value in fields.items() if name not in line}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, allow_nan=False)


@contextmanager
def log_to(target: str | Path) -> Iterator[None]:
    """Write the package's logs as JSON lines to a file, appended, or to standard error ("-").

    Raises:
        OutputError: if the file cannot be opened.
    """
    handler: logging.Handler
    if str(target) == STANDARD_ERROR:
        handler = logging.StreamHandler(sys.stderr)
    else:
        try:
            handler = logging.FileHandler(target, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise OutputError(
                f"cannot write the log to {target}: {error.strerror or error}; choose a file in "
                "an existing folder you may write to"
            ) from error
    handler.setFormatter(JsonFormatter())
    before = LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(before)
        handler.close()
