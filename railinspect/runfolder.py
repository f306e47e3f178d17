"""The folder of one run: claimed once, written under temporary names, published at the end."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

from railinspect.errors import OutputError

PART: Final = ".part"
"""Ending of a file that is still being written."""

RUN_FILES: Final = (
    "run.json",
    "frames.jsonl",
    "events.jsonl",
    "events.parquet",
    "report.html",
    "fleet.json",
)
"""Files whose presence, finished or not, says that a folder already holds a run."""


class RunFolder:
    """A folder that results are written to.

    Every file is written under its name plus ``.part`` and renamed by :meth:`publish`, so a
    finished name always means a finished file. After a crash the ``.part`` files remain; those of
    JSON Lines and of the overlay video can be read up to where they end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._pending: list[Path] = []

    @staticmethod
    def claim(path: str | Path) -> RunFolder:
        """Create or take over a folder that holds no run yet.

        Raises:
            OutputError: if it cannot be created or written to, or already holds a run.
        """
        path = Path(path)
        refuse_taken(path, RUN_FILES)
        try:
            path.mkdir(parents=True, exist_ok=True)
            probe = path / f".railinspect-{os.getpid()}{PART}"
            probe.write_bytes(b"")
            probe.unlink()
        except OSError as error:
            raise OutputError(
                f"cannot write to the output folder {path}: {error.strerror or error}; choose a "
                "folder you may write to"
            ) from error
        return RunFolder(path)

    def part(self, name: str) -> Path:
        """Temporary path of a result, e.g. ``overlay/ride.mp4``; its folder is created."""
        final = self.path / name
        final.parent.mkdir(parents=True, exist_ok=True)
        if final not in self._pending:
            self._pending.append(final)
        return final.with_name(final.name + PART)

    def current(self, name: str) -> Path:
        """Where a result lies now: under its final name, or still under its temporary one."""
        final = self.path / name
        return final if final.exists() else final.with_name(final.name + PART)

    def publish(self) -> None:
        """Give every file written so far its final name, ``run.json`` last."""
        for final in sorted(self._pending, key=lambda path: path.name == "run.json"):
            part = final.with_name(final.name + PART)
            if part.exists():
                part.replace(final)
        self._pending.clear()


def refuse_taken(path: Path, names: tuple[str, ...]) -> None:
    """Refuse a folder in which one of these files exists, finished or not.

    Raises:
        OutputError: if one does.
    """
    for name in names:
        for candidate in (path / name, path / (name + PART)):
            if os.path.lexists(candidate):
                raise OutputError(
                    f"output folder {path} already holds a run ({candidate.name}); name another "
                    "folder, or delete this one first"
                )


def unique_names(paths: list[Path]) -> list[str]:
    """A short file name for each input, safe in any file system, all different.

    Example:
        >>> unique_names([Path("a/ride.mp4"), Path("b/ride.mkv"), Path("c/<x> ü.mp4")])
        ['ride', 'ride-2', '_x_ ü']
    """
    names: list[str] = []
    for path in paths:
        stem = path.resolve().name if path.is_dir() else path.stem
        base = re.sub(r"[^\w .+=@-]", "_", stem).strip(". ")[:80] or "input"
        name, count = base, 1
        while name.casefold() in (taken.casefold() for taken in names):
            count += 1
            name = f"{base}-{count}"
        names.append(name)
    return names
