"""Workers as processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from railinspect.fleet.tasks import Outcome, Task
from railinspect.fleet.worker import Setup, Worker

_SPAWN = multiprocessing.get_context("spawn")


class Processes:
    """A crew of processes, started when they are first needed and replaced when they die.

    Args:
        setup: What each is told.
        size: How many, at least 1.
    """

    def __init__(self, setup: Setup, size: int) -> None:
        self.size = size
        self._setup = setup
        self._members: dict[int, tuple[SpawnProcess, Connection]] = {}
        self._busy: set[int] = set()

    @property
    def process_ids(self) -> list[int]:
        """Process ids of the living workers."""
        return [process.pid for process, _ in self._members.values() if process.pid is not None]

    def give(self, worker: int, task: Task) -> None:
        """Have an idle worker do a task."""
        self._busy.add(worker)
        for _ in range(2):
            if worker not in self._members:
                self._members[worker] = self._started(worker)
            try:
                self._members[worker][1].send(task)
            except OSError:  # it died while it was idle
                self._bury(worker)
                continue
            return

    def wait(self) -> list[tuple[int, Outcome | None]]:
        """Wait until a worker has answered or died."""
        gone = [worker for worker in self._busy if worker not in self._members]
        if not gone:
            ready = set(wait([self._members[worker][1] for worker in self._busy]))
        done: list[tuple[int, Outcome | None]] = []
        for worker in sorted(self._busy):
            if worker in gone:
                done.append((worker, None))
            elif not gone and self._members[worker][1] in ready:
                done.append((worker, self._answer(worker)))
        self._busy.difference_update(worker for worker, _ in done)
        return done

    def close(self) -> None:
        """End every process."""
        for process, _ in self._members.values():
            process.kill()
        for worker in list(self._members):
            self._bury(worker)
        self._busy.clear()

    def _started(self, worker: int) -> tuple[SpawnProcess, Connection]:
        ours, theirs = _SPAWN.Pipe()
        process = _SPAWN.Process(
            target=_serve, args=(self._setup, theirs), name=f"railinspect-{worker}", daemon=True
        )
        process.start()
        theirs.close()  # so that the end of the process ends the pipe
        return process, ours

    def _answer(self, worker: int) -> Outcome | None:
        try:
            outcome: Outcome = self._members[worker][1].recv()
        except (EOFError, OSError):
            self._bury(worker)
            return None
        return outcome

    def _bury(self, worker: int) -> None:
        process, pipe = self._members.pop(worker)
        pipe.close()
        process.kill()
        process.join()
        process.close()


def _serve(setup: Setup, pipe: Connection) -> None:
    """The life of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the driver ends us
    threading.Thread(target=_leave_with_driver, daemon=True).start()
    worker: Worker | str
    try:
        worker = Worker(setup)
    except Exception as error:  # whatever it is, the driver has to hear of it
        worker = f"a worker cannot start: {error}"
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        if isinstance(worker, str):
            pipe.send(Outcome(task, fatal=worker))
        else:
            pipe.send(worker.perform(task))


def _leave_with_driver() -> None:
    """End this process as soon as the one that started it has ended, however it did."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
