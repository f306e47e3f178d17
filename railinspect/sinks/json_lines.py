"""JSON Lines: one object per line, flushed often enough to survive a crash."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

FLUSH_S: Final = 2.0
"""At most this much wall-clock time of lines is lost in a crash, seconds."""


class JsonLines:
    """Writes objects as lines of UTF-8 JSON without NaN or infinities."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="utf-8", newline="\n")
        self._flushed_s = time.monotonic()

    def write(self, item: Mapping[str, Any]) -> None:
        """Append one object."""
        line = json.dumps(item, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        self._file.write(line + "\n")
        if time.monotonic() - self._flushed_s > FLUSH_S:
            self._file.flush()
            self._flushed_s = time.monotonic()

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def read_json_lines(path: Path) -> Iterator[dict[str, Any]]:
    """The objects of a file; a last line cut short by a crash is left out."""
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            if not line.endswith("\n"):
                return
            yield json.loads(line)
