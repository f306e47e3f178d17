"""One drive: a train, a crossing, and a car that stalls on it; discrete events move the messages.

The world moves the train by the shared equation of motion and knows the truth; the units of
:mod:`railops.crossing.units` know only their messages. The car stalls whether or not the crossing
has been closed by then: lights and barriers do not push a car off the track.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from railops._extras import extra
from railops.braking import Train
from railops.braking.stopping import Motion, motion_of, runge_kutta, stop
from railops.crossing.bus import Bus, Link, Trace
from railops.crossing.geodesy import Position, offset
from railops.crossing.rules import with_valve
from railops.crossing.units import PERIOD_S, Area, CarUnit, Centre, Policy, Station, TrainUnit
from railops.errors import FileError, MeasurementError, check_range
from railops.seeds import generator
from railops.traction import build_up

CYCLE_S = 0.25
PLACE = Position(56.9786, 24.1947)
ZONE = "1000"


@dataclass(frozen=True)
class Plan:
    """What happens on one drive, whatever the radio does.

    Attributes:
        seed: Seed of the drive and of its messages.
        speed_mps: The train's speed, m/s.
        start_m: Where it starts, m before the crossing.
        stalls_s: When the car stalls on the crossing, s after the start.
        stands_s: How long it stands there, s.
    """

    seed: int
    speed_mps: float
    start_m: float
    stalls_s: float
    stands_s: float

    def __post_init__(self) -> None:
        check_range("speed_mps", self.speed_mps, 1.0, 100.0, "m/s")
        check_range("start_m", self.start_m, 1.0, 50_000.0, "m")
        check_range("stalls_s", self.stalls_s, 0.0, 86_400.0, "s")
        check_range("stands_s", self.stands_s, 0.0, 86_400.0, "s")

    @staticmethod
    def random(seed: int) -> Plan:
        """A train at 40 … 100 km/h from 2500 m; the car stalls at any time before it arrives."""
        rng = generator(seed, 0)
        speed = float(rng.uniform(40.0, 100.0)) / 3.6
        arrives = 2500.0 / speed
        return Plan(
            seed, speed, 2500.0, float(rng.uniform(0.0, arrives)), float(rng.uniform(10.0, 120.0))
        )

    def occupied(self, time_s: float) -> bool:
        """Whether the car stands on the crossing."""
        return self.stalls_s <= time_s < self.stalls_s + self.stands_s


@dataclass(frozen=True)
class Drive:
    """How a drive went; every time in seconds after the start.

    Attributes:
        plan: What was to happen.
        collided: The front reached the crossing while the car stood there.
        impact_mps: Speed at that moment, m/s; 0 without collision.
        passed_s: When the front reached the crossing; None: it stopped before.
        braked_s: When the unit braked; None: never.
        brake_reason: Why.
        last_point_s: The last moment at which braking would have stopped it before the crossing.
        occupied_s: When the car stalled; None: it did not before the end.
        station_knew_s: When the station first heard of the car; None: never.
        train_knew_s: When "busy" first reached the train; None: never.
        registered_s: When the station's first state reached the train; None: never.
        closed_s: When the station first heard the train ask for closing; None: never.
        prediction_errors_m: The station's error in the train's position, m, once a second.
        prediction_std_m: The standard deviation it claimed.
    """

    plan: Plan
    collided: bool
    impact_mps: float
    passed_s: float | None
    braked_s: float | None
    brake_reason: str | None
    last_point_s: float
    occupied_s: float | None
    station_knew_s: float | None
    train_knew_s: float | None
    registered_s: float | None
    closed_s: float | None
    prediction_errors_m: tuple[float, ...]
    prediction_std_m: tuple[float, ...]

    @property
    def needless_stop(self) -> bool:
        """It braked although the crossing would have been free when it arrived."""
        return self.braked_s is not None and not self.plan.occupied(
            self.plan.start_m / self.plan.speed_mps
        )


@lru_cache(maxsize=1)
def _motion() -> Motion:
    return motion_of(with_valve(Train(0.0)), with_valve(Train(0.0)).emergency)


class _World:
    """The truth: where the train is, and what it does when its unit brakes."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.distance_m, self.speed_mps, self.time_s = plan.start_m, plan.speed_mps, 0.0
        self.braked_s: float | None = None
        self.passed_s: float | None = None
        self.impact_mps = 0.0
        self.collided = False

    def step(self) -> None:
        """Move the train by one control cycle."""
        speed, run = self.speed_mps, self.speed_mps * CYCLE_S
        if self.braked_s is not None:
            motion = _motion()
            since = self.time_s - self.braked_s
            share = build_up(since, motion.delay_s, motion.build_up_s)
            growth = build_up(since + CYCLE_S, motion.delay_s, motion.build_up_s) - share
            speed, run = runge_kutta(share, growth / CYCLE_S, self.speed_mps, 0.0, CYCLE_S, motion)
        self.time_s += CYCLE_S
        if speed <= 0.0:
            speed, run = 0.0, 0.5 * self.speed_mps * CYCLE_S
        before, self.distance_m, self.speed_mps = self.distance_m, self.distance_m - run, speed
        if before > 0.0 >= self.distance_m:
            self.passed_s = self.time_s
            self.collided = self.plan.occupied(self.time_s)
            self.impact_mps = speed if self.collided else 0.0

    @property
    def over(self) -> bool:
        """The train has passed the crossing, or stands."""
        return self.passed_s is not None or self.speed_mps == 0.0


def run(plan: Plan, link: Link, policy: Policy) -> tuple[Drive, tuple[Trace, ...]]:
    """Simulate one drive.

    Args:
        plan: What happens.
        link: What the radio does.
        policy: When the train unit brakes.

    Returns:
        The drive, and every message with its fate.

    Raises:
        MissingExtraError: if simpy is not installed.
    """
    env = extra("crossing", "simpy", "the exchange simulation").Environment()
    bus = Bus(env, link, generator(plan.seed, 1))
    world = _World(plan)

    def clock() -> float:
        return float(env.now)

    Centre("5", bus, (Area(ZONE, PLACE, 2400.0),), clock)
    graph = {"tracks": 1, "nodes": ["block 1", "crossing", "block 2"], "edges": [[0, 1], [1, 2]]}
    station = Station(ZONE, bus, graph, clock)
    car = CarUnit("100", bus, ZONE, clock)
    train = TrainUnit("10", bus, "5", policy, clock)
    rng = generator(plan.seed, 2)
    errors: list[float] = []
    claimed: list[float] = []

    def second() -> Any:
        while not world.over:
            noise = rng.normal(size=2)
            here = offset(PLACE, world.distance_m + 5.0 * noise[0], 0.0)
            train.report(here, world.distance_m + 5.0 * noise[0], world.speed_mps + 0.3 * noise[1])
            needed = stop(world.speed_mps, _motion(), 0.5)[0]
            train.ask_to_close(world.distance_m, world.speed_mps, needed)
            car.tick(plan.occupied(env.now))
            station.publish()
            try:
                estimate = station.predict("10")
            except (MeasurementError, ValueError):
                pass  # not registered, or nothing recent: the station has no prediction to judge
            else:
                errors.append(estimate.distance_m - world.distance_m)
                claimed.append(estimate.distance_std_m)
            yield env.timeout(PERIOD_S)

    last_point = [0.0]

    def control() -> Any:
        while not world.over:
            needed = stop(world.speed_mps, _motion(), 0.5)[0]
            if world.braked_s is None:
                if world.distance_m >= needed:
                    last_point[0] = world.time_s
                if train.must_brake(world.distance_m, needed):
                    world.braked_s = world.time_s
            yield env.timeout(CYCLE_S)
            world.step()

    env.process(second())
    driving = env.process(control())
    env.run(until=driving)
    return _summary(world, train, last_point[0], bus.log, errors, claimed), tuple(bus.log)


def _summary(
    world: _World,
    train: TrainUnit,
    last_point_s: float,
    log: Sequence[Trace],
    errors: Sequence[float],
    claimed: Sequence[float],
) -> Drive:
    """Collect what the world and the messages tell."""
    plan = world.plan

    def first(kind: str, receiver: str, key: str | None = None) -> float | None:
        times = [
            trace.arrived_s
            for trace in log
            if trace.arrived_s is not None
            and trace.message.kind == kind
            and trace.message.receiver == receiver
            and (key is None or trace.message.body[key])
        ]
        return min(times, default=None)

    last = last_point_s
    if world.braked_s is not None:  # as if it had gone on at its speed
        needed = stop(plan.speed_mps, _motion(), 0.5)[0]
        last = (plan.start_m - needed) / plan.speed_mps
    return Drive(
        plan,
        world.collided,
        world.impact_mps,
        world.passed_s,
        world.braked_s,
        train.brake_reason,
        last,
        plan.stalls_s if plan.stalls_s <= world.time_s else None,
        first("standing", ZONE, "standing"),
        first("state", "10", "busy"),
        first("state", "10"),
        first("close", ZONE),
        tuple(errors),
        tuple(claimed),
    )


def save(path: str | Path, drive: Drive, traces: Sequence[Trace]) -> None:
    """Keep the data of one drive in a SQLite file: its summary, and every message.

    Raises:
        FileError: if the file cannot be written as a database.
    """
    rows = [
        (
            trace.message.kind,
            trace.message.sender,
            trace.message.receiver,
            trace.message.sent_s,
            trace.arrived_s,
            json.dumps(dict(trace.message.body)),
        )
        for trace in traces
    ]
    try:
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("CREATE TABLE IF NOT EXISTS drive (seed INTEGER, summary TEXT)")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS message (seed INTEGER, kind TEXT, sender TEXT, "
                "receiver TEXT, sent_s REAL, arrived_s REAL, body TEXT)"
            )
            seed = drive.plan.seed
            connection.execute("INSERT INTO drive VALUES (?, ?)", (seed, json.dumps(asdict(drive))))
            connection.executemany(f"INSERT INTO message VALUES ({seed:d}, ?, ?, ?, ?, ?, ?)", rows)
    except sqlite3.Error as error:
        raise FileError(f"cannot keep the drive in {path}: {error}") from error
