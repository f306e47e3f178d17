"""Tasks reach workers in order, outlive them, and are given up in the end."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path

import pytest

from railinspect.fleet.processes import Processes
from railinspect.fleet.schedule import FleetError, work
from railinspect.fleet.tasks import Finish, Inspect, Outcome, Plan, Survey
from railinspect.fleet.worker import Setup
from tests.railinspect.fleet.rides import CUT, SETTINGS

PLAN = Plan("a", "v", "0" * 16)


class Told:
    """A crew that answers what it was told to, one worker at a time."""

    def __init__(self, size=1, deaths=(), fatal=()):
        self.size, self.deaths, self.fatal = size, list(deaths), fatal
        self.done, self.now = [], {}

    def give(self, worker, task):
        assert worker not in self.now, "a worker has one task at a time"
        self.now[worker] = task

    def wait(self):
        worker, task = next(iter(self.now.items()))
        del self.now[worker]
        if task in self.deaths:
            self.deaths.remove(task)
            return [(worker, None)]
        self.done.append(task)
        return [(worker, Outcome(task, fatal="disk full" if task in self.fatal else None))]

    def close(self):
        pass


def test_what_is_begun_is_finished_first():
    crew = Told()
    surveys = [Survey("a"), Survey("b")]
    after = {
        surveys[0]: [Inspect("a", PLAN, 0), Inspect("a", PLAN, 1)],
        Inspect("a", PLAN, 1): [Finish("a", PLAN, "a")],
    }
    work(crew, surveys, lambda outcome: after.get(outcome.task, []))
    inspects = after[surveys[0]]
    assert crew.done == [surveys[0], *inspects, Finish("a", PLAN, "a"), surveys[1]]


@pytest.mark.parametrize("size", [1, 3])
def test_a_lost_task_is_done_again_and_given_up_the_second_time(size):
    tasks = [Survey(name) for name in "abcd"]
    seen = {}
    crew = Told(size, deaths=[tasks[1], tasks[2], tasks[2]])

    def note(outcome):
        seen[outcome.task] = outcome.bad
        return []

    work(crew, tasks, note)
    assert set(seen) == set(tasks)
    assert [task for task in tasks if seen[task]] == [tasks[2]]
    assert "died 2 times" in seen[tasks[2]]


def test_a_full_disk_ends_the_run():
    with pytest.raises(FleetError, match="disk full"):
        work(Told(fatal=[Survey("b")]), [Survey("a"), Survey("b"), Survey("c")], lambda _: [])


@dataclass(frozen=True)
class Deadly:
    """Loads nothing: the first process that tries is killed, as by a lack of memory."""

    mark: str

    def __call__(self):
        mark = Path(self.mark)
        if not mark.exists():
            mark.write_text("")
            os.kill(os.getpid(), signal.SIGKILL)
        raise ValueError("no such network")


def test_a_worker_that_dies_is_replaced_and_one_that_cannot_start_says_why(tmp_path):
    crew = Processes(Setup(tmp_path / "run", Deadly(str(tmp_path / "mark")), SETTINGS, CUT), 1)
    try:
        with pytest.raises(FleetError, match="a worker cannot start: no such network"):
            work(crew, [Survey(str(tmp_path / "a.mp4"))], lambda _: [])
        assert (tmp_path / "mark").exists()
    finally:
        crew.close()
    assert crew.process_ids == []
