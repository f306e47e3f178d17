"""When braking had to start: the last moment at which a brake still stops short of an obstacle.

Looking back over a ride, the obstacle's place is known best from its best measurement. At a
moment of the ride the train had

    available = place − position,    place = position at the measurement + L_measured − ΔL_max

left, and a brake was enough while that was at least S_stop(V) + ΔS_max from the highest speed V
the train may have had   [SIL-4 paper, eq. 6]. The moment is where the one fell below the other for
the last time. The obstacle is taken to stand, and the way run to be what the measured speed says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from railops.braking.decision import Policy, brake_limits
from railops.braking.train import Train

State = Literal["due", "not due", "before", "cannot stop", "unknown"]


@dataclass(frozen=True)
class BrakeMoment:
    """The last moment at which a brake was still enough.

    Attributes:
        state: ``due``: it had to be applied at ``time_s``. ``not due``: it was still enough at the
            end of the ride looked at. ``before``: it was not enough from the ride's beginning.
            ``cannot stop``: it would not have been enough at any distance. ``unknown``: the speed
            was not known all the time since.
        time_s: The moment, s; None unless ``due``.
    """

    state: State
    time_s: float | None = None


@dataclass(frozen=True)
class BrakeMoments:
    """When service and emergency braking had to start for one obstacle."""

    service: BrakeMoment
    emergency: BrakeMoment


def brake_moments(
    ride: Sequence[tuple[float, Train | None]], place_m: float, policy: Policy
) -> BrakeMoments:
    """The last moments at which service and emergency brake still stopped short of a place.

    Args:
        ride: Times, s, rising, with the train as it was: its speed and position; None where its
            speed was not known. Ends with the last measurement of the obstacle.
        place_m: Position on the line that the obstacle is at least at, metres.
        policy: What the operator has decided: the protective section's stopping part.

    Returns:
        Both moments, interpolated between the ride's times. Where service braking is due,
        emergency braking is due later, if at all.

    Example:
        At 20 m/s service braking needs 20·1 + 20² / (2·0.5) = 420 m, so it is due 420 m before a
        place at 1000 m: after 29 s.

        >>> from railops.braking import Brake
        >>> from railops.traction import Davis
        >>> bare = Policy(stop_error_m=0.0, stop_error_rel=0.0, stand_off_m=0.0, reaction_s=0.0)
        >>> def at(position_m: float) -> Train:
        ...     return Train(20.0, position_m, davis=Davis(0.0, 0.0, 0.0), speed_error_rel=0.0,
        ...                  service=Brake(0.5, 1.0, 0.0), emergency=Brake(1.0, 0.0, 0.0))
        >>> ride = [(float(t), at(20.0 * t)) for t in range(46)]
        >>> both = brake_moments(ride, 1000.0, bare)
        >>> round(both.service.time_s, 6), round(both.emergency.time_s, 6)
        (29.0, 40.0)
    """
    return BrakeMoments(
        _moment(ride, place_m, lambda train: brake_limits(train, policy)[0]),
        _moment(ride, place_m, lambda train: brake_limits(train, policy)[1]),
    )


def _moment(
    ride: Sequence[tuple[float, Train | None]], place_m: float, needed_m: Callable[[Train], float]
) -> BrakeMoment:
    """One brake's moment, searched from the end of the ride backwards."""
    later: tuple[float, float] | None = None
    stops = False
    for time_s, train in reversed(ride):
        if train is None:
            return BrakeMoment("unknown")
        needed = needed_m(train)
        slack = place_m - train.position_m - needed
        if slack >= 0.0:
            return BrakeMoment("due", _zero(time_s, slack, *later)) if later else _NOT_DUE
        stops = stops or math.isfinite(needed)
        later = (time_s, slack)
    if later is None:
        return BrakeMoment("unknown")
    return BrakeMoment("before" if stops else "cannot stop")


_NOT_DUE = BrakeMoment("not due")


def _zero(before_s: float, slack: float, after_s: float, lack: float) -> float:
    """Where the slack, >= 0 before and < 0 after, passes through zero, s."""
    if not math.isfinite(lack):
        return before_s
    return before_s + (after_s - before_s) * slack / (slack - lack)
