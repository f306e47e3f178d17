"""What the train should do about the confirmed events, and when it had to begin.

Each event's last independent ranges go to the decision library; the most severe answer counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from railinspect.events import Event, EventTracker
from railinspect.journey import Journey
from railinspect.ranging.independent import last_independent
from railops.braking import Advice, BrakeMoment, BrakeMoments, Policy, RangeMeasurement
from railops.errors import CannotStopError

ACTIONS: Final = ("none", "warn", "service", "emergency")
"""Advised actions from the mildest to the most severe."""

DECISION_S: Final = 1.0
"""A confirmed event counts in the decision with its ranges of this last time, seconds."""


class Adviser:
    """Advises over one recording; keeps where on the line each event lies.

    Args:
        policy: Margins and thresholds of the decision.
        decision: The decision itself, :func:`railops.braking.decide` or one that replaces it.
    """

    def __init__(self, policy: Policy, decision: Callable[..., Advice]) -> None:
        self._policy, self._decision = policy, decision
        self._places: dict[int, tuple[float, float, float]] = {}

    def advise(
        self,
        journey: Journey,
        events: EventTracker,
        live: tuple[Event, ...],
        time_s: float,
        unknown: bool,
    ) -> Advice | None:
        """The most severe advice over all confirmed events; None if there is nothing to decide.

        Args:
            journey: The train where it is now.
            events: Keeps the events' ranges, and notes the advice.
            live: The confirmed events.
            time_s: Media time, seconds.
            unknown: Whether the track ahead is in doubt.
        """
        advised: list[Advice] = []
        for event in live:
            if time_s - event.last_time_s > DECISION_S:
                continue
            if event.doubt:  # no thing to stop for, but no clear track either
                unknown = True
                continue
            measured = self._measurements(events, event, time_s)
            self._note_place(journey, event.id, measured[-1], time_s)
            advice = self._decide(journey, measured, unknown, time_s)
            events.note_advice(
                event.id, advice.action, ACTIONS.index(advice.action), advice.reason, time_s
            )
            advised.append(advice)
        if not advised and unknown:
            advised = [self._decide(journey, [], unknown, time_s)]
        return max(advised, key=_severity, default=None)

    def _measurements(
        self, events: EventTracker, event: Event, time_s: float
    ) -> list[RangeMeasurement]:
        """The event's last independent ranges of this second, or that it has none."""
        seen = events.ranges_since(event.id, time_s - DECISION_S)
        if not seen:
            nothing = (math.nan, math.nan)
            return [RangeMeasurement(time_s, math.nan, math.nan, nothing, valid=False)]
        taken = last_independent(seen, max(self._policy.measurements, 1))
        return [RangeMeasurement(r.time_s, r.range_m, r.std_m, r.interval_m) for r in taken]

    def _note_place(
        self, journey: Journey, event_id: int, measured: RangeMeasurement, time_s: float
    ) -> None:
        """Keep where on the line the best of an event's measurements so far puts it.

        The best is the one from which least has to be deducted. Only those made where the train's
        own place was known say anything about the event's.
        """
        if not measured.valid or measured.time_s != time_s:
            return
        place_m = journey.place_m(measured, self._policy)
        if place_m is None:
            return
        deducted_m = measured.range_m - self._policy.range_lower_m(measured)
        if event_id in self._places and self._places[event_id][0] <= deducted_m:
            deducted_m, place_m, _ = self._places[event_id]
        self._places[event_id] = (deducted_m, place_m, time_s)

    def looked_back(self, journey: Journey, event: Event) -> Event:
        """An ended event with the moments at which braking for it had to start."""
        if event.id not in self._places:
            unknown = BrakeMoment("unknown")
            return replace(event, brake=BrakeMoments(unknown, unknown))
        _, place_m, last_s = self._places.pop(event.id)
        return replace(event, brake=journey.moments(last_s, place_m, self._policy))

    def _decide(
        self, journey: Journey, measured: list[RangeMeasurement], unknown: bool, time_s: float
    ) -> Advice:
        try:
            return self._decision(
                measured,
                journey.train,
                self._policy,
                perception_unknown=unknown,
                time_s=time_s,
                speed_unknown=journey.in_doubt,
            )
        except CannotStopError as error:
            if error.advice is None:
                raise
            advice: Advice = error.advice
            return advice


def _severity(advice: Advice) -> tuple[int, float]:
    margin_m = advice.margin_m if advice.margin_m is not None else math.inf
    return ACTIONS.index(advice.action), -margin_m
