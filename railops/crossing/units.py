"""The four units of Fig. 5.1: dispatching centre, train, station with level crossing, and car.

Units know only what messages told them and what their own sensors say. Steps of the published
exchange are numbered in the comments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from railops.crossing.bus import Bus, Message
from railops.crossing.geodesy import Position, haversine_m
from railops.crossing.kalman import Estimate, Predictor, Report
from railops.errors import DomainError, MeasurementError, check_range

PERIOD_S = 1.0
"""Every continuous message of the exchange is sent once a second."""


@dataclass(frozen=True)
class Area:
    """A station's area in the centre's database; areas do not overlap.

    Attributes:
        code: The area's id, which is its station's.
        centre: Its middle.
        radius_m: Its radius, m.
    """

    code: str
    centre: Position
    radius_m: float

    def __post_init__(self) -> None:
        check_range("radius_m", self.radius_m, 0.0, 100_000.0, "m", above=True)


@dataclass(frozen=True)
class Policy:
    """When the train unit brakes.

    Attributes:
        current_s: A state older than this is not current, s.
        brake_in_doubt: Brake at the last braking point without a current "clear"; the published
            exchange does not, it waits for "busy".
        margin_m: Distance kept before the crossing, m.
        close_s: How long before its last braking point the train asks for the crossing to be
            closed, s.
    """

    current_s: float = 5.0
    brake_in_doubt: bool = True
    margin_m: float = 20.0
    close_s: float = 35.0

    def __post_init__(self) -> None:
        check_range("current_s", self.current_s, 0.0, 600.0, "s")
        check_range("margin_m", self.margin_m, 0.0, 1000.0, "m")
        check_range("close_s", self.close_s, 0.0, 600.0, "s")


CAUTIOUS = Policy()
AS_PUBLISHED = Policy(brake_in_doubt=False)


class Unit:
    """What units share: an id on the bus, a clock, and the refusal of what cannot be trusted.

    Attributes:
        refused: Why messages were refused, one sentence each.
    """

    def __init__(self, unit_id: str, bus: Bus, clock: Callable[[], float]) -> None:
        self._id, self._bus, self._now = unit_id, bus, clock
        self.refused: list[str] = []
        bus.join(unit_id, self.receive)

    def receive(self, message: Message) -> None:
        """Take a message, or refuse it: from the future, stale, repeated, or nowhere on Earth."""
        try:
            if message.sent_s > self._now():
                expected = f"at most the present {self._now()} s"
                hint = "future timestamp"
                raise MeasurementError("sent_s", f"{message.sent_s} s", expected, hint)
            self._take(message)
        except (DomainError, MeasurementError) as error:
            self.refused.append(f"{message.kind} from {message.sender}: {error}")

    def _take(self, message: Message) -> None:
        """Units with nothing to hear keep this."""


class Centre(Unit):
    """The dispatching centre: compares positions with the areas of its database."""

    def __init__(
        self, unit_id: str, bus: Bus, areas: tuple[Area, ...], clock: Callable[[], float]
    ) -> None:
        codes = [area.code for area in areas]
        if len(set(codes)) != len(codes):
            raise DomainError("area codes", codes, "no duplicates")
        for index, one in enumerate(areas):
            for other in areas[:index]:
                apart = haversine_m(one.centre, other.centre)
                if apart < one.radius_m + other.radius_m:
                    pair = f"{one.code} and {other.code}"
                    raise DomainError("areas", pair, "areas that do not overlap")
        self._areas = areas
        super().__init__(unit_id, bus, clock)

    def _take(self, message: Message) -> None:
        """Step 3: a train in an area is told the area's code."""
        if message.kind != "position":
            return
        here = Position(message.body["latitude_deg"], message.body["longitude_deg"])
        for area in self._areas:
            if haversine_m(here, area.centre) <= area.radius_m:
                self._bus.send("area", self._id, message.sender, code=area.code)


class Station(Unit):
    """The station's device: registers trains, hears standing cars, publishes its node states."""

    def __init__(
        self, unit_id: str, bus: Bus, graph: Mapping[str, Any], clock: Callable[[], float]
    ) -> None:
        if not graph.get("tracks"):
            raise DomainError("station graph", graph, "a crossing with at least one track")
        self._graph = graph
        self._registered: dict[str, Predictor] = {}
        self._closed_for: set[str] = set()
        self._standing_at: dict[str, float] = {}
        self._left_at: dict[str, float] = {}
        super().__init__(unit_id, bus, clock)

    def _take(self, message: Message) -> None:
        """Steps 4, 5, 7, 8 and 9: registration, graph, closing, a standing car, it leaving."""
        if message.kind == "register":
            self._registered.setdefault(message.sender, Predictor())
            self._bus.send("graph", self._id, message.sender, **self._graph)
        elif message.kind == "position" and message.sender in self._registered:
            report = Report(message.sent_s, message.body["distance_m"], message.body["speed_mps"])
            self._registered[message.sender].add(report, self._now())
        elif message.kind == "close" and message.sender in self._registered:
            self._closed_for.add(message.sender)
        elif message.kind == "standing":
            table = self._standing_at if message.body["standing"] else self._left_at
            table[message.sender] = max(table.get(message.sender, -1.0), message.sent_s)

    def busy(self) -> bool:
        """Whether a car may stand on the crossing.

        Only a *newer* report that it left ends that: neither silence nor an older report does.
        """
        return any(
            self._left_at.get(car, -math.inf) < since for car, since in self._standing_at.items()
        )

    def predict(self, train_id: str) -> Estimate:
        """Where a registered train is now, from its late reports.

        Raises:
            DomainError: if the train is not registered.
            MeasurementError: if its reports are missing or stale.
        """
        if train_id not in self._registered:
            raise DomainError("train id", train_id, "a registered train")
        return self._registered[train_id].estimate(self._now())

    def publish(self) -> None:
        """Step 6: send the node states to every registered train."""
        for train in self._registered:
            closed = train in self._closed_for
            self._bus.send("state", self._id, train, busy=self.busy(), closed=closed)


class CarUnit(Unit):
    """The car's device: says so when the car stands in the crossing's area, and when it left."""

    def __init__(self, unit_id: str, bus: Bus, station: str, clock: Callable[[], float]) -> None:
        self._station, self._stood = station, False
        super().__init__(unit_id, bus, clock)

    def tick(self, standing: bool) -> None:
        """Step 8, once a period: report standing; after it, report having left."""
        if standing or self._stood:
            self._bus.send("standing", self._id, self._station, standing=standing)
        self._stood = self._stood or standing


class TrainUnit(Unit):
    """The train's device: reports, registers, follows the crossing's state, and brakes."""

    def __init__(
        self, unit_id: str, bus: Bus, centre: str, policy: Policy, clock: Callable[[], float]
    ) -> None:
        self._centre, self._policy = centre, policy
        self._station: str | None = None
        self._graph = False
        self._state_sent_s = -math.inf
        self._busy = False
        self._closed = False
        self.brake_reason: str | None = None
        super().__init__(unit_id, bus, clock)

    def _take(self, message: Message) -> None:
        """Steps 3, 5 and 6; a state older than the newest one known is not taken."""
        if message.kind == "area":
            self._station = str(message.body["code"])
        elif message.kind == "graph":
            self._graph = True
        elif message.kind == "state" and message.sent_s > self._state_sent_s:
            self._state_sent_s, self._busy = message.sent_s, bool(message.body["busy"])
            self._closed = bool(message.body["closed"])

    def report(self, here: Position, distance_m: float, speed_mps: float) -> None:
        """Steps 2 and 4, once a period: position to the centre; registration until the graph."""
        place = {"latitude_deg": here.latitude_deg, "longitude_deg": here.longitude_deg}
        self._bus.send("position", self._id, self._centre, **place)
        if self._station is None:
            return
        if not self._graph:
            self._bus.send("register", self._id, self._station)
        state = {"distance_m": distance_m, "speed_mps": speed_mps}
        self._bus.send("position", self._id, self._station, **state)

    def ask_to_close(self, distance_m: float, speed_mps: float, stopping_m: float) -> None:
        """Step 7, once a period: near the last braking point, until the state says "closed"."""
        near = distance_m - stopping_m <= speed_mps * self._policy.close_s
        if self._station is not None and near and not self._closed:
            self._bus.send("close", self._id, self._station)

    def must_brake(self, distance_m: float, stopping_m: float) -> bool:
        """Step 10, every control cycle: on "busy" at once, in doubt at the last braking point."""
        if self.brake_reason is not None:
            return True
        if distance_m <= 0.0:
            return False
        age = self._now() - self._state_sent_s
        if self._busy:
            self.brake_reason = "busy"
        elif (
            self._policy.brake_in_doubt
            and age > self._policy.current_s
            and distance_m - stopping_m <= self._policy.margin_m
        ):
            known = "no state" if math.isinf(age) else f"the newest state is {age:.1f} s old"
            self.brake_reason = f"doubt: {known}"
        return self.brake_reason is not None
