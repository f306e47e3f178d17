"""A run's progress as JSON lines, for programs that start runs and show how far they are."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TextIO

from railinspect.errors import OutputError
from railinspect.logs import STANDARD_ERROR
from railinspect.progress import Progress
from railinspect.runinfo import jsonable

EVERY_S: Final = 1.0
"""At most one line in this wall-clock time, seconds."""


class ProgressStream:
    """Appends one object per line; the last says ``"state": "done"`` or ``"stopped"``.

    Args:
        target: File, named pipe, or "-" for standard error.
        every_s: At most one line in this wall-clock time, seconds; the first and the last line
            are written in any case.

    Raises:
        OutputError: if the file cannot be opened.
    """

    def __init__(self, target: str | Path, every_s: float = EVERY_S) -> None:
        self._own = str(target) != STANDARD_ERROR
        self._stream: TextIO = sys.stderr
        if self._own:
            try:
                self._stream = Path(target).open("a", encoding="utf-8")  # noqa: SIM115
            except OSError as error:
                raise OutputError(
                    f"cannot write progress to {target}: {error.strerror or error}; choose a file "
                    "in an existing folder you may write to"
                ) from error
        self._every_s = every_s
        self._start_s = time.monotonic()
        self._written_s: float | None = None
        self._last: Progress | None = None

    def show(self, progress: Progress) -> None:
        """Take in how far the run is; writes a line when one is due."""
        self._last = progress
        now_s = time.monotonic()
        if self._written_s is None or now_s - self._written_s >= self._every_s:
            self._written_s = now_s
            self._write("running")

    def close(self, complete: bool) -> None:
        """Write the last line; ``complete`` is False where the run was interrupted or failed."""
        self._write("done" if complete else "stopped")
        if self._own:
            self._stream.close()

    def _write(self, state: str) -> None:
        elapsed_s = time.monotonic() - self._start_s
        known: dict[str, Any] = asdict(self._last) if self._last else {}
        share = known.get("share")
        left_s = elapsed_s * (1 - share) / share if share and state == "running" else None
        line = {
            "time": datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "state": state,
            **known,
            "elapsed_s": round(elapsed_s, 3),
            "frames_per_s": round(known.get("frames", 0) / max(elapsed_s, 1e-6), 3),
            "left_s": None if left_s is None else round(left_s, 1),
        }
        self._stream.write(json.dumps(jsonable(line), ensure_ascii=False, allow_nan=False) + "\n")
        self._stream.flush()
