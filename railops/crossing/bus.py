"""The message bus: every message may come late, out of order, or never."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from railops.errors import DomainError, check_range


@dataclass(frozen=True)
class Link:
    """What the radio does to a message; the defaults are what the field trials met.

    Attributes:
        delay_low_s: Least delay, s; delays are uniform and independent, so messages overtake.
        delay_high_s: Largest delay, s.
        loss: Probability that a message never arrives.
    """

    delay_low_s: float = 1.0
    delay_high_s: float = 15.0
    loss: float = 0.05

    def __post_init__(self) -> None:
        check_range("delay_low_s", self.delay_low_s, 0.0, 600.0, "s")
        check_range("delay_high_s", self.delay_high_s, self.delay_low_s, 600.0, "s")
        check_range("loss", self.loss, 0.0, 1.0)


PERFECT = Link(0.0, 0.0, 0.0)
FIELD = Link()
WORST = Link(15.0, 15.0, 0.05)


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        kind: position, area, register, graph, state, close, or standing.
        sender: Unit that sent it.
        receiver: Unit it is for.
        sent_s: When, s.
        body: Its content.
    """

    kind: str
    sender: str
    receiver: str
    sent_s: float
    body: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class Trace:
    """A message and its fate: when it arrived, s, or None if it was lost (or is under way)."""

    message: Message
    arrived_s: float | None = None


class Bus:
    """Carries messages between units; ids are unique."""

    def __init__(self, env: Any, link: Link, rng: np.random.Generator) -> None:
        self._env, self._link, self._rng = env, link, rng
        self._units: dict[str, Callable[[Message], None]] = {}
        self.log: list[Trace] = []

    def join(self, unit_id: str, receive: Callable[[Message], None]) -> None:
        """Connect a unit.

        Raises:
            DomainError: if the id is taken.
        """
        if unit_id in self._units:
            raise DomainError("unit id", unit_id, "an id no other unit has")
        self._units[unit_id] = receive

    def send(self, kind: str, sender: str, receiver: str, **body: Any) -> None:
        """Send a message; it arrives later, or never.

        Raises:
            DomainError: if there is no such receiver.
        """
        if receiver not in self._units:
            raise DomainError("receiver", receiver, f"one of {sorted(self._units)}")
        trace = Trace(Message(kind, sender, receiver, float(self._env.now), body))
        self.log.append(trace)
        delay = self._rng.uniform(self._link.delay_low_s, self._link.delay_high_s)
        if self._rng.random() >= self._link.loss:
            self._env.process(self._carry(trace, delay))

    def _carry(self, trace: Trace, delay_s: float) -> Any:
        yield self._env.timeout(delay_s)
        trace.arrived_s = float(self._env.now)
        self._units[trace.message.receiver](trace.message)
