"""Handing tasks to workers, whatever they are, and surviving those that die."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from railinspect.errors import RailInspectError
from railinspect.fleet.tasks import Finish, Inspect, Outcome, Survey, Task
from railinspect.fleet.worker import Setup, Worker

MAX_LOSSES: Final = 2
"""A task whose worker died so often is given up."""

_URGENCY: Final = {Finish: 0, Inspect: 1, Survey: 2}
"""What is begun is finished before anything else is begun."""


class FleetError(RailInspectError, RuntimeError):
    """The run as a whole cannot go on."""


class Crew(Protocol):
    """Workers, each of which does one task at a time.

    Attributes:
        size: How many there are.
    """

    size: int

    def give(self, worker: int, task: Task) -> None:
        """Have an idle worker do a task; one that died is replaced first."""

    def wait(self) -> list[tuple[int, Outcome | None]]:
        """Wait until workers are idle again: which, and what they did; None if one died."""

    def close(self) -> None:
        """Send everyone home, whatever they are doing."""


class Alone:
    """A crew of one: this process itself."""

    size = 1

    def __init__(self, setup: Setup) -> None:
        self._worker = Worker(setup)
        self._task: Task | None = None

    def give(self, worker: int, task: Task) -> None:
        """Take the task; it is done by :meth:`wait`."""
        self._task = task

    def wait(self) -> list[tuple[int, Outcome | None]]:
        """Do the task."""
        assert self._task is not None
        return [(0, self._worker.perform(self._task))]

    def close(self) -> None:
        """Nothing to do."""


def work(crew: Crew, tasks: Iterable[Task], follow: Callable[[Outcome], Iterable[Task]]) -> None:
    """Do tasks and those that follow from their outcomes until there are none.

    Args:
        crew: The workers.
        tasks: The first tasks.
        follow: Told of every outcome; returns the tasks to be done because of it.

    Raises:
        FleetError: if a worker says that the run cannot go on.
    """
    waiting: list[tuple[int, int, Task]] = []
    count = 0

    def put(new: Iterable[Task]) -> None:
        nonlocal count
        for task in new:
            count += 1
            heapq.heappush(waiting, (_URGENCY[type(task)], count, task))

    put(tasks)
    idle = list(range(crew.size))
    busy: dict[int, Task] = {}
    losses: Counter[Task] = Counter()
    while waiting or busy:
        while waiting and idle:
            worker = idle.pop()
            busy[worker] = heapq.heappop(waiting)[2]
            crew.give(worker, busy[worker])
        for worker, outcome in crew.wait():
            task = busy.pop(worker)
            idle.append(worker)
            if outcome is None:
                losses[task] += 1
                if losses[task] < MAX_LOSSES:
                    put([task])
                    continue
                outcome = Outcome(
                    task,
                    bad=f"the worker died {MAX_LOSSES} times over this input (out of memory, or a "
                    "library's fault); the same command tries it again",
                )
            if outcome.fatal is not None:
                raise FleetError(outcome.fatal)
            put(follow(outcome))
