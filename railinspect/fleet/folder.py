"""Where things lie in the folder of a fleet run, and who may write there."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from railinspect.errors import OutputError
from railinspect.fleet.storage import remove, replace_file
from railinspect.fleet.tasks import Plan
from railinspect.runfolder import RUN_FILES, refuse_taken

PLAIN_RUN: Final = tuple(name for name in RUN_FILES if name not in ("fleet.json", "report.html"))
"""Files of a run over single inputs; a fleet run does not go into such a folder."""


class FleetFolder:
    """The paths of a run. Everything is published by one rename; ``tmp`` may be deleted any time.

    No path contains anything of an input's name.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(os.path.abspath(path))  # noqa: PTH100  # workers have other folders
        self.state = self.path / "fleet.json"
        self.tmp = self.path / "tmp"
        self.part_folder = self.path / "parts"

    @contextlib.contextmanager
    def claim(self) -> Iterator[None]:
        """Be the only run that writes here, as long as the context lasts.

        Raises:
            OutputError: if the folder cannot be written to, holds another kind of run, or another
                process works in it.
        """
        refuse_taken(self.path, PLAIN_RUN)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = (self.path / "lock").open("w")
        except OSError as error:
            raise OutputError(
                f"cannot write to the output folder {self.path}: {error.strerror or error}; choose "
                "a folder you may write to"
            ) from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise OutputError(
                    f"another run is at work in {self.path}; wait for it or name another folder"
                ) from error
            remove(self.tmp)
            try:
                yield
            finally:
                remove(self.tmp)

    def scratch(self) -> Path:
        """A new folder for what is not finished yet."""
        path = self.tmp / f"{os.getpid()}-{uuid.uuid4().hex}"
        path.mkdir(parents=True)
        return path

    def input(self, input_id: str) -> Path:
        """The folder of a finished input."""
        return self.path / "inputs" / input_id

    def part(self, plan: Plan, stretch: int) -> Path:
        """The folder of an inspected stretch."""
        return self.part_folder / f"{plan.id}-{stretch:05d}"

    def fetched(self, plan_id: str, suffix: str) -> Path:
        """The local copy of a remote input, with one of the endings this package knows, or none."""
        return self.path / "fetched" / f"{plan_id}{suffix}"

    def tidy(self) -> None:
        """Delete what killed runs and inputs of equal content left behind; nobody is at work."""
        for part in self.part_folder.glob("*-*"):
            if self.input(part.name.rsplit("-", 1)[0]).exists():
                remove(part)
        remove(self.path / "fetched")

    def plan(self, address: str) -> Plan | None:
        """What an earlier survey found, if there was one."""
        try:
            return Plan.from_json(json.loads(self._plan_path(address).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def keep_plan(self, address: str, plan: Plan) -> None:
        """Remember what a survey found."""
        text = json.dumps(plan.as_json(), indent=1, ensure_ascii=True)
        replace_file(self._plan_path(address), text.encode(), self.tmp)

    def keep_state(self, document: Mapping[str, Any]) -> None:
        """Write ``fleet.json``."""
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
        replace_file(self.state, (text + "\n").encode("utf-8", "backslashreplace"), self.tmp)

    def _plan_path(self, address: str) -> Path:
        name = hashlib.sha256(os.fsencode(address)).hexdigest()[:32]
        return self.path / "plans" / f"{name}.json"
