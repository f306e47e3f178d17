"""A fleet run: every input surveyed, inspected and finished, by whatever workers there are."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from railinspect.errors import BadInputError, OutputError
from railinspect.fleet import fleet_report
from railinspect.fleet.finished import FinishedInput
from railinspect.fleet.folder import FleetFolder
from railinspect.fleet.inputs import expand, printable, short_name
from railinspect.fleet.processes import Processes
from railinspect.fleet.schedule import Alone, Crew, work
from railinspect.fleet.storage import DEFAULT_LIMIT_BYTES
from railinspect.fleet.tasks import Cut, Finish, Inspect, Outcome, Plan, Survey, Task
from railinspect.fleet.worker import BundleLoader, Setup
from railinspect.inspect_settings import InspectSettings
from railinspect.pipeline import SegmentFunction
from railinspect.progress import Progress, Report
from railinspect.runinfo import installed_version, jsonable

FORMAT: Final = 1
"""Version of ``fleet.json``; rises when a reader would have to change."""

_SAVE_S: Final = 2.0
"""``fleet.json`` is written at most this often on the way, seconds."""

_log = logging.getLogger(__name__)

State = Literal["pending", "done", "bad"]


@dataclass
class _Input:
    """One input on its way."""

    address: str
    name: str
    state: State = "pending"
    reason: str | None = None
    plan: Plan | None = None
    missing: set[int] = field(default_factory=set)
    same_as: str | None = None

    def as_json(self) -> dict[str, Any]:
        plan = self.plan
        return {
            "id": plan.id if plan and not plan.bad else None,
            "name": self.name,
            "address": printable(self.address),
            "bytes": plan.bytes if plan and not plan.bad else None,
            "state": self.state,
            "reason": self.reason,
            "segments": len(plan.starts_s) if plan and not plan.bad else None,
            "same_as": self.same_as,
        }


@dataclass(frozen=True)
class FleetSummary:
    """What a fleet run gave.

    Attributes:
        folder: The run folder.
        run: The run's id.
        inputs: The entries of ``fleet.json``.
        counts: Frames and events over all finished inputs.
        new_frames: Frames inspected by this call, overlaps not counted.
        seconds: Wall-clock time of this call.
    """

    folder: Path
    run: str
    inputs: tuple[Mapping[str, Any], ...]
    counts: Mapping[str, int]
    new_frames: int
    seconds: float

    @property
    def bad(self) -> list[Mapping[str, Any]]:
        """The inputs that could not be inspected, or not to their end, with the reason."""
        return [one for one in self.inputs if one["reason"]]

    def as_json(self) -> dict[str, Any]:
        """The document printed by ``railinspect inspect --json``."""
        states = Counter(one["state"] for one in self.inputs)
        return {
            "run": self.run,
            "inputs": len(self.inputs),
            **{state: states[state] for state in ("done", "bad", "pending")},
            **self.counts,
            "new_frames": self.new_frames,
            "frames_per_s": round(self.new_frames / max(self.seconds, 1e-9), 2),
            "seconds": round(self.seconds, 3),
            "complete": not states["pending"],
            "problems": [{k: one[k] for k in ("address", "state", "reason")} for one in self.bad],
            "paths": {
                "run": str(self.folder),
                "report": str(self.folder / "report.html"),
                "state": str(self.folder / "fleet.json"),
                "dataset": str(self.folder / "dataset"),
                "inputs": str(self.folder / "inputs"),
            },
        }


def inspect_fleet(
    inputs: Sequence[str],
    out: str | Path,
    load: Callable[[], SegmentFunction],
    settings: InspectSettings | None = None,
    *,
    cut: Cut | None = None,
    engine: Literal["serial", "processes", "ray"] = "processes",
    workers: int | None = None,
    address: str | None = None,
    limit_bytes: int = DEFAULT_LIMIT_BYTES,
    progress: Report | None = None,
) -> FleetSummary:
    """Inspect many recordings into one run folder, going on where a former call was stopped.

    The results do not depend on the engine, the number of workers, or the order of the inputs.

    Args:
        inputs: Files, folders, globs, lists and addresses, as
            :func:`railinspect.fleet.inputs.expand` takes them.
        out: The run folder, new or of the same run.
        load: Makes a worker's segmenter; has to be picklable for other engines than "serial".
        settings: How to inspect.
        cut: How recordings are cut.
        engine: This process alone, processes of this machine, or a Ray cluster.
        workers: How many; default: one per core of this machine or cluster.
        address: Of the Ray cluster; None starts a local one.
        limit_bytes: Largest remote object that is fetched.
        progress: Called after every task.

    Returns:
        The summary; ``fleet.json`` says the same of each input.

    Raises:
        BadInputError: if the inputs name nothing or a setting makes no sense.
        OutputError: if the folder cannot be used.
        FleetError: if the run cannot go on.
    """
    began_s = time.monotonic()
    if workers is not None and workers < 1:
        raise BadInputError(f"workers is {workers}; give at least 1")
    settings, cut = settings or InspectSettings(), cut or Cut()
    folder = FleetFolder(out)
    addresses = expand(inputs, folder.path)
    if settings.speed_log is not None and len(addresses) > 1:
        raise BadInputError(
            f"speed log {settings.speed_log.source} fits one recording, not {len(addresses)}; "
            "inspect them one by one"
        )
    setup = Setup(folder.path, load, settings, cut, limit_bytes)
    with folder.claim():
        driver = _Driver(folder, addresses, setup, progress)
        with closing(_crew(engine, setup, workers, address)) as crew:
            driver.run(crew)
        fleet_report.write(folder.path)
        return driver.summary(time.monotonic() - began_s)


def _crew(engine: str, setup: Setup, workers: int | None, address: str | None) -> Crew:
    from railinspect._threads import usable_cores

    if engine == "serial":
        return Alone(setup)
    if engine == "processes":
        return Processes(setup, workers or usable_cores())
    if engine == "ray":
        from railinspect.fleet.on_ray import RayActors

        return RayActors(setup, workers, address)
    raise BadInputError(f"engine is {engine!r}; give serial, processes or ray")


class _Driver:
    """What the run knows of its inputs; decides what is to be done next."""

    def __init__(
        self,
        folder: FleetFolder,
        addresses: Sequence[str],
        setup: Setup,
        progress: Report | None,
    ) -> None:
        self._folder, self._progress = folder, progress
        self._inputs = {one: _Input(one, short_name(one)) for one in addresses}
        self._unsurveyed: Iterator[str] = iter(addresses)
        self._owner: dict[str, _Input] = {}
        self._head = _head(setup, addresses)
        self._new_frames = self._unknown_frames = self._events = 0
        self._saved_s = -_SAVE_S
        former = _former_run(folder)
        if former is not None:
            _refuse_another_run(folder, former, self._head, addresses)
            self._head["run"] = former["run"]
        self._save()

    def run(self, crew: Crew) -> None:
        """Do everything that is to be done; the state is written, whatever happens."""
        try:
            work(crew, self._next_survey(), self._follow)
            self._folder.tidy()
        finally:
            self._save()

    def summary(self, seconds: float) -> FleetSummary:
        """What there is now."""
        counts = Counter(frames=0, unknown_frames=0, finding_frames=0, events=0, breaks=0)
        for one in self._owner.values():
            if one.state == "done" and one.plan is not None:
                known = FinishedInput.read(self._folder.input(one.plan.id)).counts
                counts["frames"] += known.frames
                counts["unknown_frames"] += known.unknown_frames
                counts["finding_frames"] += known.finding_frames
                counts["events"] += known.events
                counts["breaks"] += known.break_count
        rows = tuple(one.as_json() for one in self._inputs.values())
        run = str(self._head["run"])
        return FleetSummary(self._folder.path, run, rows, dict(counts), self._new_frames, seconds)

    def _next_survey(self) -> list[Task]:
        """One survey at a time, in the inputs' order: of two alike, the first is the one."""
        return [Survey(address) for address in [next(self._unsurveyed, None)] if address]

    def _follow(self, outcome: Outcome) -> list[Task]:
        task = outcome.task
        one = self._inputs[task.address]
        new: list[Task] = self._next_survey() if isinstance(task, Survey) else []
        if outcome.bad is not None:
            self._refuse(one, outcome.bad)
        elif isinstance(task, Survey):
            assert outcome.plan is not None
            new += self._surveyed(one, outcome.plan)
        elif isinstance(task, Inspect):
            self._new_frames += outcome.frames
            one.missing.discard(task.stretch)
            if not one.missing and one.state == "pending":
                new.append(Finish(one.address, task.plan, one.name))
        else:
            self._finished(one)
        if time.monotonic() - self._saved_s > _SAVE_S:
            self._save()
        if self._progress is not None:
            self._progress(self._done_so_far(one.name))
        return new

    def _done_so_far(self, name: str) -> Progress:
        states = Counter(one.state for one in self._inputs.values())
        return Progress(
            name,
            self._new_frames,
            self._share(),
            unknown_frames=self._unknown_frames,
            events=self._events,
            inputs=len(self._inputs),
            inputs_done=states["done"],
            inputs_bad=states["bad"],
        )

    def _surveyed(self, one: _Input, plan: Plan) -> list[Task]:
        one.plan = plan
        if plan.bad is not None:
            self._refuse(one, plan.bad)
            return []
        first = self._owner.setdefault(plan.id, one)
        if first is not one:
            one.same_as, one.state, one.reason = first.name, first.state, first.reason
            return []
        if self._folder.input(plan.id).exists():
            self._finished(one)
            return []
        stretches = range(len(plan.starts_s))
        one.missing = {i for i in stretches if not self._folder.part(plan, i).exists()}
        if not one.missing:
            return [Finish(one.address, plan, one.name)]
        return [Inspect(one.address, plan, i) for i in sorted(one.missing)]

    def _refuse(self, one: _Input, reason: str) -> None:
        self._settle(one, "bad", reason)
        _log.info("%s cannot be inspected: %s", printable(one.address), reason)

    def _finished(self, one: _Input) -> None:
        assert one.plan is not None
        counts = FinishedInput.read(self._folder.input(one.plan.id)).counts
        reason = None
        if counts.break_count:
            first = counts.breaks[0]
            reason = f"broke after {first.time_s:.2f} s: {first.reason}"
            if counts.break_count > 1:
                reason += f" (and {counts.break_count - 1} more)"
        self._unknown_frames += counts.unknown_frames
        self._events += counts.events
        self._settle(one, "done", reason)
        _log.info("%s done, %d frames", printable(one.address), counts.frames)

    def _settle(self, one: _Input, state: State, reason: str | None) -> None:
        """Set an input's state, and that of those with the same content."""
        one.state, one.reason = state, reason
        if one.plan is None or self._owner.get(one.plan.id) is not one:
            return
        for other in self._inputs.values():
            if other.same_as is not None and other.plan and other.plan.id == one.plan.id:
                other.state, other.reason = state, reason

    def _share(self) -> float:
        """Share of the inputs that is done, those under way by their stretches."""
        total = 0.0
        for one in self._inputs.values():
            if one.state != "pending":
                total += 1.0
            elif one.plan is not None:
                total += 1.0 - (len(one.missing) + 0.1) / (len(one.plan.starts_s) + 0.1)
        return total / max(len(self._inputs), 1)

    def _save(self) -> None:
        rows = [one.as_json() for one in self._inputs.values()]
        try:
            self._folder.keep_state({**self._head, "inputs": rows})
        except OSError as error:
            raise OutputError(
                f"cannot go on writing to {self._folder.path}: {error.strerror or error}"
            ) from error
        self._saved_s = time.monotonic()


def _head(setup: Setup, addresses: Sequence[str]) -> dict[str, Any]:
    """What ``fleet.json`` says of the run, without any time of day."""
    bundle = None
    if isinstance(setup.load, BundleLoader):
        bundle = hashlib.sha256(setup.load.data).hexdigest()
    settings = jsonable(setup.settings)
    del settings["overlay"]  # a fleet run draws none
    log = setup.settings.speed_log
    settings["speed_log"] = None if log is None else log.source
    cut = jsonable(asdict(setup.cut))
    what = {"bundle": bundle, "cut": cut, "settings": settings}
    digest = hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()
    run = hashlib.sha256(digest.encode())
    for one in addresses:
        run.update(os.fsencode(one) + b"\0")
    return {
        "format": FORMAT,
        "run": run.hexdigest()[:16],
        "package": installed_version("railinspect"),
        "digest": digest,
        **what,
    }


def _former_run(folder: FleetFolder) -> dict[str, Any] | None:
    """The ``fleet.json`` of a former call, if there was one."""
    try:
        document: dict[str, Any] = json.loads(folder.state.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot read {folder.state}: {error}; name another folder") from error
    return document


def _refuse_another_run(
    folder: FleetFolder, former: Mapping[str, Any], head: Mapping[str, Any], now: Sequence[str]
) -> None:
    """Refuse to go on with a run that was begun otherwise.

    Raises:
        OutputError: if the settings, the bundle or the package differ, or inputs have gone.
    """
    for key, what in (
        ("format", "another version of the package"),
        ("package", "another version of the package"),
        ("bundle", "another bundle"),
        ("digest", "other settings"),
    ):
        if former.get(key) != head[key]:
            raise OutputError(
                f"{folder.path} holds a run with {what}; go on with the same command, or name "
                "another folder"
            )
    gone = {one["address"] for one in former["inputs"]} - {printable(one) for one in now}
    if gone:
        raise OutputError(
            f"{folder.path} holds a run over {len(gone)} more inputs, such as {min(gone)}; inputs "
            "may be added to a run but not taken away"
        )
