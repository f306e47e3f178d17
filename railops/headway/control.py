"""The upper control loop: choose the run time that makes up a delay and is still feasible.

The step of the paper's worked example: a train leaves late, so its run time is shortened by the
delay; the interval that this run time requires (for the planned dwell of the train in front plus
its predicted delay) is compared with the actual one; while it does not fit, the run time is
lengthened to the next one allowed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from railops.errors import DomainError, check_range
from railops.headway.characteristic import Characteristic


@dataclass(frozen=True)
class Trial:
    """One run time that was tried.

    Attributes:
        run_s: The run time, s.
        required_s: The interval it requires, s; NaN where the characteristic has none.
        feasible: Whether the actual interval is at least that long.
    """

    run_s: float
    required_s: float
    feasible: bool


@dataclass(frozen=True)
class Order:
    """What the upper loop orders for one train on one section.

    Attributes:
        run_s: The run time to order, s: the first feasible, or after a hold the first to arrive.
        interval_s: The actual departure interval, s.
        required_s: What the ordered run time requires, s.
        feasible: Whether it fits; False means that no allowed run time does.
        hold_s: How much later the train would have to leave for the ordered run time to fit, s.
        delay_left_s: Delay on arrival at the next station that remains with this order, s.
        trials: Every run time tried, in order.
    """

    run_s: float
    interval_s: float
    required_s: float
    feasible: bool
    hold_s: float
    delay_left_s: float
    trials: tuple[Trial, ...]


def choose_run_time(
    table: Characteristic,
    front_run_s: float,
    planned_run_s: float,
    interval_s: float,
    late_s: float = 0.0,
    front_dwell_s: float | None = None,
    front_delay_s: float = 0.0,
) -> Order:
    """One step of the upper control loop.

    Args:
        table: The section's characteristic. Only its run times are ordered.
        front_run_s: Run time ordered for the train in front, T(n−1), s.
        planned_run_s: Run time of our train by the timetable, s.
        interval_s: Actual departure interval behind the train in front, s.
        late_s: How late our train leaves, s, >= 0.
        front_dwell_s: Planned dwell of the train in front at the next station, s; default: the
            dwell of the table.
        front_delay_s: Its predicted delay there, s, >= 0; the interval grows second for second.

    Returns:
        The order; where nothing fits, the run time that arrives first after the hold it needs.

    Raises:
        DomainError: if a run time lies outside the table, or a time is negative.

    Example:
        The paper's worked example: 106 s > 105 s, then 104 s < 105 s.

        >>> from railops.headway.published import ZHENGZHOU
        >>> order = choose_run_time(ZHENGZHOU, 120, 120, 105, late_s=5, front_delay_s=3)
        >>> [(t.run_s, t.required_s, t.feasible) for t in order.trials]
        [(115.0, 106.0, False), (120.0, 104.0, True)]
        >>> order.run_s, order.feasible, order.delay_left_s
        (120.0, True, 5.0)
    """
    check_range("planned_run_s", planned_run_s, 0.0, 3600.0, "s", above=True)
    check_range("interval_s", interval_s, 0.0, 86_400.0, "s")
    check_range("late_s", late_s, 0.0, 86_400.0, "s", hint="an early train needs no making up")
    check_range("front_delay_s", front_delay_s, 0.0, 86_400.0, "s")
    dwell = (table.dwell_s if front_dwell_s is None else front_dwell_s) + front_delay_s
    wanted = planned_run_s - late_s
    candidates = [float(run) for run in table.second_s if run >= wanted - 1e-6]
    if not candidates:
        raise DomainError(
            "planned run time", f"{planned_run_s:g} s", f"at most {table.second_s[-1]:g} s"
        )
    trials: list[Trial] = []
    for run in candidates:
        required = table.required_s(run, front_run_s, dwell)
        trials.append(Trial(run, required, interval_s >= required - 1e-9))
        if trials[-1].feasible:
            break
    last = trials[-1]
    if not last.feasible:  # held until it fits: the run time that then arrives first
        known = [trial for trial in trials if math.isfinite(trial.required_s)]
        last = min(known, key=lambda trial: trial.required_s + trial.run_s, default=last)
        if not known:
            raise DomainError(
                "run time of the train in front",
                f"{front_run_s:g} s",
                f"one behind which {table.name} has an interval for {last.run_s:g} s or less",
            )
    hold = 0.0 if last.feasible else last.required_s - interval_s
    left = max(0.0, late_s + hold + last.run_s - planned_run_s)
    return Order(last.run_s, interval_s, last.required_s, last.feasible, hold, left, tuple(trials))


@dataclass(frozen=True)
class Plan:
    """The timetable of one train over a line of S sections.

    Attributes:
        depart_s: Planned departure from the first station, s.
        run_s: Planned run time of each section, s, S values.
        dwell_s: Planned dwell at each station after a section, s, S values.
        late_s: How late it leaves the first station, s.
        dwell_delay_s: Predicted extra dwell at each of those stations, s, S values; empty for none.
        name: For people.
    """

    depart_s: float
    run_s: tuple[float, ...]
    dwell_s: tuple[float, ...]
    late_s: float = 0.0
    dwell_delay_s: tuple[float, ...] = ()
    name: str = ""


@dataclass(frozen=True)
class Passage:
    """One train over one section, as ordered.

    Attributes:
        train: Which train of the plan, from 0.
        section: Which section, from 0.
        depart_s: Departure, s; after a hold where one was needed.
        arrive_s: Arrival at the next station, s.
        late_s: Delay on arrival against the timetable, s; negative is early.
        order: The order; None for the first train, which nobody is in front of.
    """

    train: int
    section: int
    depart_s: float
    arrive_s: float
    late_s: float
    order: Order | None


def regulate_line(tables: Sequence[Characteristic], trains: Sequence[Plan]) -> list[Passage]:
    """Run the upper loop over a whole line: every train, every section, with predicted delays.

    Trains keep their sequence. A train for which no run time is feasible is held at its station
    until the one is that arrives first. It leaves no earlier than planned.

    Args:
        tables: The characteristic of each section, in order.
        trains: The timetable of each train, in the order in which they run.

    Raises:
        DomainError: if a train's plan does not have one value per section.
    """
    passages: list[Passage] = []
    front: list[Passage] = []
    for number, train in enumerate(trains):
        _check_plan(train, number, len(tables))
        mine: list[Passage] = []
        planned = train.depart_s
        ready = planned + train.late_s
        for index, table in enumerate(tables):
            extra = train.dwell_delay_s[index] if train.dwell_delay_s else 0.0
            late = max(0.0, ready - planned)
            if front:
                ahead, plan = front[index], trains[number - 1]
                order = choose_run_time(
                    table,
                    ahead.arrive_s - ahead.depart_s,
                    train.run_s[index],
                    max(0.0, ready - ahead.depart_s),
                    late,
                    plan.dwell_s[index],
                    plan.dwell_delay_s[index] if plan.dwell_delay_s else 0.0,
                )
                depart, run = ready + order.hold_s, order.run_s
            else:
                order = None
                depart, run = ready, _alone(table, train.run_s[index] - late)
            arrive = depart + run
            planned_arrival = planned + train.run_s[index]
            mine.append(Passage(number, index, depart, arrive, arrive - planned_arrival, order))
            planned = planned_arrival + train.dwell_s[index]
            ready = max(planned, arrive + train.dwell_s[index] + extra)
        passages += mine
        front = mine
    return passages


def _alone(table: Characteristic, wanted_s: float) -> float:
    """The first allowed run time that is not shorter than wanted."""
    longer = [float(run) for run in table.second_s if run >= wanted_s - 1e-6]
    return longer[0] if longer else float(table.second_s[-1])


def _check_plan(train: Plan, number: int, sections: int) -> None:
    for name in ("run_s", "dwell_s", "dwell_delay_s"):
        values = getattr(train, name)
        if len(values) != sections and not (name == "dwell_delay_s" and not values):
            raise DomainError(
                f"trains[{number}].{name}", f"{len(values)} values", f"one per section: {sections}"
            )
        for index, value in enumerate(values):
            check_range(f"trains[{number}].{name}[{index}]", value, 0.0, 36_000.0, "s")
    check_range(f"trains[{number}].late_s", train.late_s, 0.0, 86_400.0, "s")
