"""The one routine that every engine's workers run: a task in, its result in the run folder."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2

from railinspect.errors import BadInputError, RailInspectError
from railinspect.fleet import dataset
from railinspect.fleet.folder import FleetFolder
from railinspect.fleet.inputs import VIDEO_SUFFIXES, is_address, printable
from railinspect.fleet.merge import merge
from railinspect.fleet.storage import (
    DEFAULT_LIMIT_BYTES,
    content_hash,
    fetch,
    publish,
    remove,
    version,
)
from railinspect.fleet.stretch import Stretch, inspect_stretch
from railinspect.fleet.tasks import Cut, Finish, Inspect, Outcome, Plan, Survey, Task
from railinspect.images import IMAGE_SUFFIXES
from railinspect.inspect_settings import InspectSettings
from railinspect.pipeline import SegmentFunction
from railinspect.segmenter import Segmenter
from railinspect.video import Source, open_source
from railinspect.warmup import warm_up
from railops.errors import RailOpsError

NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)
"""What is wrong with the run folder and not with an input."""


@dataclass(frozen=True)
class BundleLoader:
    """Loads the same bundle in every worker, on whichever machine it runs."""

    data: bytes = field(repr=False)
    name: str = "bundle"

    def __call__(self) -> SegmentFunction:
        """The segmenter; one thread, since every core has a worker of its own."""
        return Segmenter(self.data, self.name, threads=1)


@dataclass(frozen=True)
class Setup:
    """Everything a worker needs to know; it travels to other processes and machines.

    Attributes:
        folder: The run folder, where every worker can reach it.
        load: Makes the segmenter; called once per worker.
        settings: How to inspect.
        cut: How recordings are cut.
        limit_bytes: Largest remote object that is fetched.
    """

    folder: Path
    load: Callable[[], SegmentFunction]
    settings: InspectSettings
    cut: Cut = field(default_factory=Cut)
    limit_bytes: int = DEFAULT_LIMIT_BYTES


class Worker:
    """Does tasks, one after the other, on one core."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._folder = FleetFolder(setup.folder)
        cv2.setNumThreads(1)
        self._segmenter = setup.load()
        warm_up()

    def perform(self, task: Task) -> Outcome:
        """Do a task; never raises for what is wrong with an input.

        What a task leaves is complete or not there. An input's fault is the outcome's ``bad``, the
        run folder's its ``fatal``.
        """
        scratch = self._folder.scratch()
        try:
            if isinstance(task, Survey):
                return Outcome(task, self._survey(task, scratch))
            if isinstance(task, Inspect):
                return Outcome(task, frames=self._inspect(task, scratch))
            self._finish(task, scratch)
            return Outcome(task)
        except (RailInspectError, RailOpsError) as error:
            return Outcome(task, bad=_sentence(error))
        except OSError as error:
            if error.errno in NO_ROOM:
                why = f"cannot go on writing to {self._folder.path}: {error.strerror}"
                return Outcome(task, fatal=why)
            return Outcome(task, bad=_sentence(error))
        except Exception as error:  # a fault of ours with one input must not stop the others
            return Outcome(task, bad=f"{type(error).__name__}: {_sentence(error)}")
        finally:
            remove(scratch)

    def _survey(self, task: Survey, scratch: Path) -> Plan:
        address = task.address
        seen = ""
        try:
            seen = version(address)
            kept = self._folder.plan(address)
            if kept is not None and kept.version == seen:
                return kept
            plan = self._surveyed(address, seen, scratch)
        except RailInspectError as error:
            plan = Plan(printable(address), seen, bad=_sentence(error))
        self._folder.keep_plan(address, plan)
        return plan

    def _surveyed(self, address: str, seen: str, scratch: Path) -> Plan:
        path = Path(address)
        if is_address(address):
            path = scratch / f"fetched{_suffix(address)}"
            fetch(address, path, self._setup.limit_bytes)
        digest, size = content_hash(path)
        source = self._open(path, address)
        try:
            first_s, last_s = source.clock() or (0.0, 0.0)
        finally:
            source.close()
        starts_s: tuple[float, ...] = (first_s,)
        if self._setup.settings.speed_log is None:
            starts_s = self._setup.cut.starts_s(first_s, last_s)
        plan = Plan(printable(address), seen, digest[:16], size, starts_s)
        if is_address(address):
            publish(path, self._folder.fetched(plan.id, path.suffix))
        return plan

    def _open(self, path: Path, address: str) -> Source:
        """Open an input; what is wrong is said of the input, not of its copy."""
        try:
            settings = self._setup.settings
            return open_source(
                path, settings.folder_rate_hz, decoder_threads=1, topic=settings.topic
            )
        except RailInspectError as error:
            said = str(error).replace(str(path), printable(address))
            raise type(error)(said) from error

    def _inspect(self, task: Inspect, scratch: Path) -> int:
        plan, setup = task.plan, self._setup
        if version(task.address) != plan.version:
            raise BadInputError(
                f"input {plan.address} was changed while the run was at work; run the command again"
            )
        source = self._open(self._local(task, scratch), task.address)
        stretch = Stretch(plan.span_s(task.stretch), plan.starts_s[0], setup.cut)
        made = scratch / "part"
        made.mkdir()
        frames = inspect_stretch(source, stretch, self._segmenter, setup.settings, made)
        publish(made, self._folder.part(plan, task.stretch))
        return frames

    def _local(self, task: Inspect, scratch: Path) -> Path:
        """Where the content lies on this machine; fetched again if a killed run left no copy."""
        if not is_address(task.address):
            return Path(task.address)
        kept = self._folder.fetched(task.plan.id, _suffix(task.address))
        if not kept.exists():
            fetch(task.address, scratch / "fetched", self._setup.limit_bytes)
            publish(scratch / "fetched", kept)
        return kept

    def _finish(self, task: Finish, scratch: Path) -> None:
        plan = task.plan
        parts = [self._folder.part(plan, i) for i in range(len(plan.starts_s))]
        made = scratch / plan.id
        made.mkdir()
        merge(plan, task.name, parts, made)
        dataset.add(made, self._folder.path)  # before the folder that says the input is finished
        publish(made, self._folder.input(plan.id))
        for part in parts:
            remove(part)
        remove(self._folder.fetched(plan.id, _suffix(task.address)))


def _suffix(address: str) -> str:
    """The ending of an input's name where it says what the input is."""
    suffix = Path(address).suffix.lower()
    return suffix if suffix in (*VIDEO_SUFFIXES, *IMAGE_SUFFIXES) else ""


def _sentence(error: BaseException) -> str:
    """What an error says, on one printable line."""
    text = (getattr(error, "strerror", None) or str(error)) or type(error).__name__
    return printable(" ".join(str(text).split()))[:500]
