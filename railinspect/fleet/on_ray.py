"""Workers as actors of a Ray cluster."""

from __future__ import annotations

import logging
import os
from typing import Any

from railinspect._threads import usable_cores
from railinspect.errors import BadInputError
from railinspect.fleet.tasks import Outcome, Task
from railinspect.fleet.worker import Setup, Worker


class RayActors:
    """A crew of Ray actors, one core each; the bundle is loaded once per actor.

    Args:
        setup: What each is told. The run folder has to lie on storage that every node sees under
            the same path.
        size: How many; None for one per core of the cluster.
        address: Of the cluster, as for ``ray.init``; None starts a local one.

    Raises:
        BadInputError: if Ray is not installed or the cluster cannot be reached.
    """

    def __init__(self, setup: Setup, size: int | None, address: str | None) -> None:
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        try:
            import ray
        except ImportError as error:
            raise BadInputError(
                "--engine ray needs Ray; install railinspect[ray], or use --workers N"
            ) from error
        self._ray: Any = ray
        local = address is None
        try:
            ray.init(
                address=address or "local",
                num_cpus=(size or usable_cores()) if local else None,
                include_dashboard=False if local else None,
                log_to_driver=False,
                logging_level=logging.ERROR,
            )
        except Exception as error:  # Ray's errors share no narrower base class
            raise BadInputError(f"cannot start or reach Ray at {address}: {error}") from error
        self.size = size or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        self._actor: Any = ray.remote(num_cpus=1, max_restarts=0)(_Member)
        self._setup = ray.put(setup)
        self._members: dict[int, Any] = {}
        self._answers: dict[Any, int] = {}

    def give(self, worker: int, task: Task) -> None:
        """Have an idle worker do a task."""
        if worker not in self._members:
            self._members[worker] = self._actor.remote(self._setup)
        self._answers[self._members[worker].perform.remote(task)] = worker

    def wait(self) -> list[tuple[int, Outcome | None]]:
        """Wait until a worker has answered or died."""
        ready, _ = self._ray.wait(list(self._answers), num_returns=1)
        done: list[tuple[int, Outcome | None]] = []
        for answer in ready:
            worker = self._answers.pop(answer)
            try:
                done.append((worker, self._ray.get(answer)))
            except self._ray.exceptions.RayError:
                self._ray.kill(self._members.pop(worker))
                done.append((worker, None))
        return done

    def close(self) -> None:
        """Leave the cluster; its actors end."""
        self._ray.shutdown()


class _Member:
    """The actor's side."""

    def __init__(self, setup: Setup) -> None:
        self._worker: Worker | str
        try:
            self._worker = Worker(setup)
        except Exception as error:  # whatever it is, the driver has to hear of it
            self._worker = f"a worker cannot start: {error}"

    def perform(self, task: Task) -> Outcome:
        """Do a task."""
        if isinstance(self._worker, str):
            return Outcome(task, fatal=self._worker)
        return self._worker.perform(task)
