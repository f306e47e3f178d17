"""What a worker is asked to do, and what it answers; both travel between processes.

An input takes three kinds of task, one after the other: **survey** it (identity, length, where it
is cut), **inspect** each of its stretches, **finish** it (put the stretches together). Each leaves
its result in the run folder under its final name, or nothing; so each may be done again.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from railinspect.errors import BadInputError


@dataclass(frozen=True)
class Cut:
    """How long recordings are cut into stretches. The same recording is always cut alike.

    Attributes:
        stretch_s: Length of a stretch, seconds of media time; what is left over, less than half
            of it, goes to the last one. Infinity cuts nothing.
        lead_in_s: So much earlier the inspection of a stretch begins, seconds, so that the
            follower, the estimated camera and the events are what they are in the whole recording.
        run_on_s: So much longer it goes on at most while an event of it is still in sight, seconds.
    """

    stretch_s: float = 600.0
    lead_in_s: float = 30.0
    run_on_s: float = 60.0

    def __post_init__(self) -> None:
        if not (self.stretch_s > 0 and self.lead_in_s >= 0 and self.run_on_s >= 0):
            raise BadInputError(
                f"stretches of {self.stretch_s} s with {self.lead_in_s} s of lead-in and "
                f"{self.run_on_s} s of run-on make no sense; give a length above 0 and no negative "
                "overlap"
            )

    def starts_s(self, first_s: float, last_s: float) -> tuple[float, ...]:
        """Where the stretches of a recording begin; the first at its first frame.

        Example:
            >>> Cut(stretch_s=60).starts_s(0.5, 160.0), Cut(stretch_s=60).starts_s(0.0, 89.0)
            ((0.5, 60.5, 120.5), (0.0,))
        """
        count = 1
        if math.isfinite(self.stretch_s):
            count = max(1, math.floor((last_s - first_s) / self.stretch_s + 0.5))
        return tuple(round(first_s + i * self.stretch_s, 6) if i else first_s for i in range(count))


@dataclass(frozen=True)
class Plan:
    """What the survey of an input found.

    Attributes:
        address: The input.
        version: What :func:`railinspect.fleet.storage.version` said of it.
        id: First 16 hex digits of the SHA-256 of its content; empty for a bad one.
        bytes: Its size.
        starts_s: Where its stretches begin, media seconds.
        bad: Why it cannot be inspected; None if it can.
    """

    address: str
    version: str
    id: str = ""
    bytes: int = 0
    starts_s: tuple[float, ...] = (0.0,)
    bad: str | None = None

    def as_json(self) -> dict[str, Any]:
        """The plan as it is stored."""
        return asdict(self)

    @staticmethod
    def from_json(document: dict[str, Any]) -> Plan:
        """Read it back; TypeError, KeyError or ValueError if it is none."""
        return Plan(**{**document, "starts_s": tuple(map(float, document["starts_s"]))})

    def span_s(self, stretch: int) -> tuple[float, float]:
        """From when (inclusive) to when (exclusive) a stretch goes, media seconds."""
        start_s = self.starts_s[stretch] if stretch else -math.inf
        last = stretch + 1 == len(self.starts_s)
        return start_s, math.inf if last else self.starts_s[stretch + 1]


@dataclass(frozen=True)
class Survey:
    """Find out what an input is."""

    address: str


@dataclass(frozen=True)
class Inspect:
    """Inspect one stretch of an input."""

    address: str
    plan: Plan
    stretch: int


@dataclass(frozen=True)
class Finish:
    """Put the stretches of an input together."""

    address: str
    plan: Plan
    name: str


Task = Survey | Inspect | Finish


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes:
        task: The task.
        plan: What a survey found.
        frames: Frames inspected.
        bad: Why the input cannot be inspected; None if the task is done.
        fatal: Why the whole run cannot go on.
    """

    task: Task
    plan: Plan | None = None
    frames: int = 0
    bad: str | None = None
    fatal: str | None = None
