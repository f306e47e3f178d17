"""Immune memory: detectors and caught situations in one SQLite file, to be loaded again."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from railops.crossing.detectors import DetectorSet
from railops.crossing.situation import Array, as_points
from railops.errors import FileError

_SCHEMA = """
CREATE TABLE IF NOT EXISTS detector_set (id INTEGER PRIMARY KEY, about TEXT NOT NULL,
    centres BLOB NOT NULL, radii BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS caught (id INTEGER PRIMARY KEY, detector INTEGER NOT NULL,
    situation TEXT NOT NULL, reaction TEXT NOT NULL);
"""


class Memory:
    """Detectors and caught situations on disk; every call opens and closes the file itself."""

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)

    @contextmanager
    def _open(self, must_exist: bool) -> Iterator[sqlite3.Connection]:
        """The open file, closed behind the block; what goes wrong there is a FileError."""
        if must_exist and not self._path.is_file():
            raise FileError(f"no immune memory at {self._path}: train one first")
        try:
            with closing(sqlite3.connect(self._path)) as connection, connection:
                connection.executescript(_SCHEMA)
                yield connection
        except (sqlite3.Error, ValueError, TypeError, KeyError) as error:
            raise FileError(f"cannot use {self._path} as immune memory: {error}") from error

    def save(self, detectors: DetectorSet) -> None:
        """Keep a detector set; the newest one is what :meth:`load` returns."""
        about = {
            "self_radius": detectors.self_radius,
            "method": detectors.method,
            "seed": detectors.seed,
            "units": detectors.units,
        }
        row = (json.dumps(about), detectors.centres.tobytes(), detectors.radii.tobytes())
        with self._open(must_exist=False) as connection:
            connection.execute(
                "INSERT INTO detector_set (about, centres, radii) VALUES (?, ?, ?)", row
            )

    def load(self) -> DetectorSet:
        """The newest detector set.

        Raises:
            FileError: if the file is missing, no immune memory, or holds no detectors.
        """
        with self._open(must_exist=True) as connection:
            row = connection.execute(
                "SELECT about, centres, radii FROM detector_set ORDER BY id DESC LIMIT 1"
            ).fetchone()
            if row is not None:
                radii = np.frombuffer(row[2], dtype=np.float64)
                centres = np.frombuffer(row[1], dtype=np.float64).reshape(len(radii), -1)
                return DetectorSet(centres, radii, **json.loads(row[0]))
        raise FileError(f"{self._path} holds no detectors: train some first")

    def remember(
        self, situations: Array, detectors: Sequence[int], reactions: Sequence[str]
    ) -> None:
        """Keep caught situations with the detector each activated and what was done.

        Args:
            situations: In their own units, shape (N, 8).
            detectors: Detector numbers, N.
            reactions: What was done, in words, N.
        """
        rows = [
            (int(detector), json.dumps(list(map(float, point))), reaction)
            for point, detector, reaction in zip(
                as_points(situations), detectors, reactions, strict=True
            )
        ]
        with self._open(must_exist=False) as connection:
            connection.executemany(
                "INSERT INTO caught (detector, situation, reaction) VALUES (?, ?, ?)", rows
            )

    def caught(self) -> tuple[Array, tuple[int, ...], tuple[str, ...]]:
        """Everything remembered: situations (N, 8), detector numbers, reactions."""
        with self._open(must_exist=True) as connection:
            rows = connection.execute(
                "SELECT situation, detector, reaction FROM caught ORDER BY id"
            ).fetchall()
            points = as_points([json.loads(row[0]) for row in rows])
        return points, tuple(row[1] for row in rows), tuple(row[2] for row in rows)
