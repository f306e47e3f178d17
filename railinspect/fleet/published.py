"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path


@contextmanager
def publish(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path``, renamed to it once the block is done.

    The name ends in ``.part`` and begins with a dot, so that no reader takes it for a result. If
    the block fails, the file is removed and what was there before stays. What killed processes left
    of the same file is removed once it is whole, so a run that was killed ends with the same files.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
        for left in path.parent.glob(f".{escape(path.name)}.*.part"):
            left.unlink(missing_ok=True)
    finally:
        part.unlink(missing_ok=True)
