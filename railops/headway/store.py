"""Sections and their characteristics in SQLite, versioned by content.

A section is stored under the hash of everything that decides its characteristic, so a changed
section is a new version and an unchanged one is never computed twice. Results are kept as the two
parts A and B: any dwell is read from them.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from railops.errors import FileError
from railops.headway.characteristic import Characteristic, characteristic
from railops.headway.files import Reader, content_hash, plain, section_from
from railops.headway.section import Section

Array = npt.NDArray[np.float64]

METHOD = 1  # raised when the computation changes, so that older results are not taken for new
_SCHEMA = """
CREATE TABLE IF NOT EXISTS section (
    hash TEXT PRIMARY KEY, name TEXT NOT NULL, definition TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS version (
    number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, hash TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS interval (
    hash TEXT NOT NULL, method INTEGER NOT NULL, run_s REAL NOT NULL, front_run_s REAL NOT NULL,
    before_s REAL NOT NULL, after_s REAL NOT NULL, critical TEXT NOT NULL,
    PRIMARY KEY (hash, method, run_s, front_run_s)
);
"""


class Version(NamedTuple):
    """One stored version of a section: its number, rising, and its content hash."""

    number: int
    hash: str


class Store:
    """A database of sections and results; use it as a context manager.

    Example:
        >>> with Store(":memory:") as store:
        ...     table, fresh = store.characteristic(Section(1500.0, name="A"), [100.0, 110.0])
        ...     again, computed = store.characteristic(Section(1500.0, name="A"), [100.0, 110.0])
        >>> fresh, computed, bool(np.array_equal(table.interval_s(), again.interval_s()))
        (True, False, True)
    """

    def __init__(self, path: str | Path) -> None:
        try:
            self._base = sqlite3.connect(path)
            self._base.executescript(_SCHEMA)
        except sqlite3.Error as error:
            raise FileError(f"cannot open {path} as a database of sections: {error}") from error

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
        if isinstance(error, sqlite3.Error):  # a database of another make
            raise FileError(f"the database of sections cannot be used: {error}") from error

    def close(self) -> None:
        """Close the database."""
        self._base.close()

    def put(self, section: Section) -> str:
        """Store a section and return its hash; a new version if its content changed."""
        key = content_hash(section)
        with self._base:
            self._base.execute(
                "INSERT OR REPLACE INTO section VALUES (?, ?, ?)",
                (key, section.name, json.dumps(plain(section), default=float)),
            )
            latest = self.versions(section.name)
            if not latest or latest[-1].hash != key:
                self._base.execute(
                    "INSERT INTO version (name, hash) VALUES (?, ?)", (section.name, key)
                )
        return key

    def versions(self, name: str) -> list[Version]:
        """All versions of the section of a name, oldest first."""
        rows = self._base.execute(
            "SELECT number, hash FROM version WHERE name = ? ORDER BY number", (name,)
        )
        return [Version(*row) for row in rows]

    def section(self, key: str) -> Section:
        """The section stored under a hash.

        Raises:
            FileError: if there is none.
        """
        row: Any = self._base.execute(
            "SELECT definition FROM section WHERE hash = ?", (key,)
        ).fetchone()
        if row is None:
            raise FileError(f"the database holds no section with the hash {key}")
        return section_from(json.loads(row[0]), Reader(f"database entry {key[:12]}", {}))

    def characteristic(
        self, section: Section, run_times_s: Sequence[float] | None = None
    ) -> tuple[Characteristic, bool]:
        """The characteristic of a section, from the database where it is there.

        Args:
            section: The section; it is stored.
            run_times_s: Run times of both trains, s, rising; default: those the section allows.

        Returns:
            (the characteristic, whether it had to be computed).
        """
        key = self.put(section)
        times = tuple(run_times_s) if run_times_s is not None else section.run_times_s
        if times and (found := self._read(key, section, times)) is not None:
            return found, False
        table = characteristic(section, times or None)
        self._write(key, table)
        return table, True

    def _write(self, key: str, table: Characteristic) -> None:
        rows = [
            (
                key,
                METHOD,
                run,
                front,
                table.before_s[i, j],
                table.after_s[i, j],
                table.critical[i][j],
            )
            for i, run in enumerate(table.second_s.tolist())
            for j, front in enumerate(table.first_s.tolist())
        ]
        with self._base:
            self._base.executemany(
                "INSERT OR REPLACE INTO interval VALUES (?, ?, ?, ?, ?, ?, ?)", rows
            )

    def _read(self, key: str, section: Section, times: tuple[float, ...]) -> Characteristic | None:
        rows = self._base.execute(
            "SELECT run_s, front_run_s, before_s, after_s, critical FROM interval "
            "WHERE hash = ? AND method = ?",
            (key, METHOD),
        )
        known = {(run, front): rest for run, front, *rest in rows}
        wanted = [[known.get((run, front)) for front in times] for run in times]
        if any(cell is None for row in wanted for cell in row):
            return None
        cells = [[cell for cell in row if cell is not None] for row in wanted]
        return Characteristic(
            np.array(times),
            np.array(times),
            np.array([[cell[0] for cell in row] for row in cells]),
            np.array([[cell[1] for cell in row] for row in cells]),
            section.dwell.mean_s,
            section.name,
            tuple(tuple(cell[2] for cell in row) for row in cells),
        )
