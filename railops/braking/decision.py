"""The brake decision: measured ranges, a train and a policy in, an advice out.

    brake when   S_stop(V) + ΔS_max = L_measured − ΔL_max        [SIL-4 paper, eq. 6]

The smallest lower bound over all usable measurements is what is *available*; the stopping distance
at the highest speed the train may have, plus the protective section's stopping part, is what is
*required*. Doubt (no usable measurement, unknown perception) resolves to the policy's cautious
branch, never to a milder advice than the measurements alone would give.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from railops.braking.channels import joint_exceedance
from railops.braking.protection import collision_bound
from railops.braking.stopping import STEP_S, cannot_stop, motion_of, stop
from railops.braking.train import Train
from railops.errors import CannotStopError, DomainError, MeasurementError, check_range
from railops.files import build, read_mapping

Action = Literal["none", "warn", "service", "emergency"]
SEVERITY: dict[str, int] = {"none": 0, "warn": 1, "service": 2, "emergency": 3}


@dataclass(frozen=True)
class RangeMeasurement:
    """One measured distance along the track from the train's front to an obstacle.

    Attributes:
        time_s: When it was measured, s.
        range_m: Measured range, metres, >= 0. May be NaN where ``valid`` is false.
        std_m: Its standard deviation, metres, >= 0.
        interval_m: Its 95 % interval, metres; only the lower end is used.
        channel: Which channel measured it ("onboard", "wayside", …).
        valid: False where an obstacle was seen but its range could not be measured.
    """

    time_s: float
    range_m: float
    std_m: float
    interval_m: tuple[float, float]
    channel: str = "onboard"
    valid: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_s", check_range("time_s", self.time_s, unit="s"))
        if not self.valid:
            return
        # Stored as plain floats: what comes in may be NumPy's, what goes out may become JSON.
        object.__setattr__(self, "range_m", check_range("range_m", self.range_m, 0.0, 1e5, "m"))
        object.__setattr__(self, "std_m", check_range("std_m", self.std_m, 0.0, 1e5, "m"))
        low, high = self.interval_m
        object.__setattr__(self, "interval_m", (float(low), float(high)))
        if not low <= self.range_m <= high:
            raise DomainError("interval_m", self.interval_m, f"to contain range_m = {self.range_m}")


@dataclass(frozen=True)
class Policy:
    """What the operator has decided beforehand. The defaults are cautious and stated.

    Attributes:
        range_error_m: ΔL_max, constant part, metres, as certified by a campaign.
        range_error_rel: ΔL_max, part proportional to the measured range, 0 … 1.
        range_sigmas: At least this many reported standard deviations are deducted as well.
        exceedance: Probability that one measurement's error exceeds its ΔL_max.
        common_cause: Share of exceedances that hit all measurements at once, 0 … 1.
        measurements: Measurements wanted for a decision (4 at 1e-2 for SIL-4); fewer are doubt.
        max_age_s: Older measurements are stale: they do not count, s.
        stop_error_m: ΔS_max, constant part, metres (paper: 3 m).
        stop_error_rel: ΔS_max, part proportional to the stopping distance, 0 … 1.
        stop_exceedance: Probability that the stopping distance's error exceeds ΔS_max.
        stand_off_m: Distance to keep from the obstacle, metres.
        reaction_s: Time from the measurement to the brake command beyond the brake's own delay, s.
        warn_s: The horn sounds this long before service braking has to start, s.
        when_unknown: The cautious branch: least action when perception is unknown or no
            measurement is usable.
        when_few: Least action when fewer than ``measurements`` are usable.
        mild_on_curves: Cap the advice at service braking on curves (pilot-vehicle paper, closing
            note 5: full emergency braking on a curve carries its own risk). Off by default.
        curve_radius_m: What counts as a curve for ``mild_on_curves``, metres.
        curve_ahead_m: Curves are looked for up to this far ahead, metres.
    """

    range_error_m: float = 0.0
    range_error_rel: float = 0.0
    range_sigmas: float = 3.0
    exceedance: float = 1e-2
    common_cause: float = 0.0
    measurements: int = 4
    max_age_s: float = 1.0
    stop_error_m: float = 3.0
    stop_error_rel: float = 0.05
    stop_exceedance: float = 1e-2
    stand_off_m: float = 5.0
    reaction_s: float = 0.5
    warn_s: float = 6.0
    when_unknown: Action = "service"
    when_few: Action = "warn"
    mild_on_curves: bool = False
    curve_radius_m: float = 600.0
    curve_ahead_m: float = 300.0

    def __post_init__(self) -> None:
        for name in ("range_error_m", "stop_error_m", "stand_off_m", "curve_ahead_m"):
            check_range(name, getattr(self, name), 0.0, 1e5, "m")
        for name in ("range_error_rel", "stop_error_rel"):
            check_range(name, getattr(self, name), 0.0, 1.0)
        for name in ("exceedance", "stop_exceedance", "common_cause"):
            check_range(name, getattr(self, name), 0.0, 1.0)
        for name in ("max_age_s", "reaction_s", "warn_s"):
            check_range(name, getattr(self, name), 0.0, 3600.0, "s")
        check_range("range_sigmas", self.range_sigmas, 0.0, 100.0)
        check_range("measurements", self.measurements, 1, 1000)
        check_range("curve_radius_m", self.curve_radius_m, 0.0, 1e6, "m")
        for name in ("when_unknown", "when_few"):
            if getattr(self, name) not in SEVERITY:
                raise DomainError(name, getattr(self, name), f"one of {list(SEVERITY)}")

    @staticmethod
    def load(path: str | Path) -> Policy:
        """Read a policy from YAML: the attributes above as keys, those left out by default.

        Raises:
            FileError: if the file cannot be read, or has unknown keys or mistyped values.
        """
        return build(Policy, read_mapping(path, "policy file"), f"policy file {path}")

    def range_lower_m(self, measurement: RangeMeasurement) -> float:
        """L_measured − ΔL_max: the range the obstacle is at least at, metres, >= 0."""
        certified = (1.0 - self.range_error_rel) * measurement.range_m - self.range_error_m
        reported = measurement.range_m - self.range_sigmas * measurement.std_m
        return max(0.0, min(certified, reported, measurement.interval_m[0]))

    def stop_upper_m(self, distance_m: float) -> float:
        """S_stop + ΔS_max plus the stand-off: what a stop of this nominal length needs, metres."""
        return (1.0 + self.stop_error_rel) * distance_m + self.stop_error_m + self.stand_off_m


@dataclass(frozen=True)
class Advice:
    """What to do, and everything needed to see why.

    Attributes:
        action: ``none``, ``warn`` (horn), ``service`` or ``emergency``.
        required_m: Distance at which service braking has to start; inf if it cannot stop.
        available_m: Range the obstacle is at least at, now; None where no measurement is usable.
        margin_m: available − required; negative when braking is already late. None as above.
        margin_s: The same as time at the highest possible speed: braking has to start in so many
            seconds. None as above, inf for a standing train.
        governed_by: The measurement that governed, or None.
        reason: One sentence.
        warn_at_m: Available distance at or below which the horn sounds.
        service_at_m: Available distance at or below which service braking starts.
        emergency_at_m: Available distance at or below which only emergency braking is left.
        used: Number of measurements that counted.
        exceedance: Probability that all of them overstate the range by more than ΔL_max.
        stop_error_m: ΔS_max of a service stop, the protective section's stopping part, metres.
        range_error_m: ΔL_max of the governing measurement with the distance run since, the
            section's range part, metres; None where no measurement is usable.
        collision_bound: Upper bound of the collision probability if braking starts where it has
            to (corrected eq. 7): as good as the policy's ``stop_exceedance`` and ``exceedance``.
        contradictions: One sentence per pair of channels whose intervals exclude each other.
    """

    action: Action
    required_m: float
    available_m: float | None
    margin_m: float | None
    margin_s: float | None
    governed_by: RangeMeasurement | None
    reason: str
    warn_at_m: float
    service_at_m: float
    emergency_at_m: float
    used: int = 0
    exceedance: float = 1.0
    stop_error_m: float = math.inf
    range_error_m: float | None = None
    collision_bound: float = 1.0
    contradictions: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The advice for JSON; infinite values become null."""
        document = asdict(self)
        if document["governed_by"] is not None:
            document["governed_by"]["interval_m"] = [
                _finite(end) for end in document["governed_by"]["interval_m"]
            ]
        return {key: _finite(value) for key, value in document.items()}

    @property
    def would_change(self) -> str:
        """What would change the answer: the distances at which another action begins."""
        warn, service, emergency = (
            f"{at_m:.1f} m" if math.isfinite(at_m) else "any distance"
            for at_m in (self.warn_at_m, self.service_at_m, self.emergency_at_m)
        )
        return (
            f"the horn sounds at {warn} available, service braking starts at {service}, "
            f"emergency braking at {emergency}"
        )


def decide(
    ranges: Sequence[RangeMeasurement],
    train: Train,
    policy: Policy | None = None,
    perception_unknown: bool = False,
    time_s: float | None = None,
    speed_unknown: bool = False,
) -> Advice:
    """Decide whether the train must brake for the obstacle these ranges measure.

    Args:
        ranges: Measurements of one obstacle, oldest first. May be empty only with
            ``perception_unknown``.
        train: The train now: its speed, place, brakes and line.
        policy: What the operator has decided beforehand; default: ``Policy()``.
        perception_unknown: True if the track could not be inspected; then the advice is at least
            the policy's cautious branch.
        time_s: Now; default: the time of the newest measurement.
        speed_unknown: True if the train's speed is only supposed; then likewise.

    Returns:
        The advice. A nearer obstacle, a higher speed, a worse brake or a wider interval never
        yields a milder one.

    Raises:
        MeasurementError: if ``ranges`` is empty (without ``perception_unknown``), unsorted, or
            later than ``time_s``.
        CannotStopError: if not even the emergency brake stops the train; its ``advice`` is the
            emergency advice to act on.

    Example:
        >>> seen = RangeMeasurement(0.0, 250.0, 2.0, (246.0, 254.0))
        >>> decide([seen], Train(speed_mps=20.0)).action
        'emergency'
        >>> decide([seen], Train(speed_mps=5.0)).action
        'warn'
    """
    policy = policy if policy is not None else _DEFAULT
    now = _check_times(ranges, perception_unknown, time_s)
    fastest = train.fastest_mps
    service_m, emergency_m = brake_limits(train, policy)
    warn_m = service_m + fastest * policy.warn_s

    valid = [m for m in ranges if m.valid]
    fresh = [m for m in valid if now - m.time_s <= policy.max_age_s]
    governing, available = None, math.inf
    for measurement in fresh or valid:
        lower = policy.range_lower_m(measurement) - fastest * (now - measurement.time_s)
        if lower < available:
            governing, available = measurement, lower
    available = max(0.0, available)

    action, why = _act(available, warn_m, service_m, emergency_m, fastest)
    used = len(fresh)
    if perception_unknown or speed_unknown or used == 0:
        doubt = (
            "perception is unknown"
            if perception_unknown
            else "the train's speed is unknown"
            if speed_unknown
            else "no measurement is usable"
        )
        action, why = _at_least(action, why, policy.when_unknown, doubt)
    elif used < policy.measurements:
        doubt = f"only {used} of {policy.measurements} measurements are usable"
        action, why = _at_least(action, why, policy.when_few, doubt)
    if (
        policy.mild_on_curves
        and action == "emergency"
        and train.line.radius_m(train.position_m, policy.curve_ahead_m) <= policy.curve_radius_m
    ):
        action, why = "service", why + "; capped at service braking on the curve ahead"
    contradictions = _contradictions(fresh, now, fastest)
    if contradictions:
        why += "; channels contradict each other, the nearer one governs"

    known = governing is not None
    margin = available - service_m if known else None
    exceedance = joint_exceedance(policy.exceedance, used, policy.common_cause)
    advice = Advice(
        action=action,
        required_m=service_m,
        available_m=available if known else None,
        margin_m=margin,
        margin_s=None if margin is None else (margin / fastest if fastest > 0 else math.inf),
        governed_by=governing,
        reason=why,
        warn_at_m=warn_m,
        service_at_m=service_m,
        emergency_at_m=emergency_m,
        used=used,
        exceedance=exceedance,
        stop_error_m=_stop_error_m(service_m, fastest, policy),
        range_error_m=governing.range_m - available if governing is not None else None,
        collision_bound=collision_bound(policy.stop_exceedance, exceedance),
        contradictions=contradictions,
    )
    if math.isinf(emergency_m):
        message = cannot_stop(train, train.emergency)
        raise CannotStopError(message, replace(advice, action="emergency", reason=message))
    return advice


_DEFAULT = Policy()


def _finite(value: Any) -> Any:
    """None in place of an infinite or undefined number."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _check_times(
    ranges: Sequence[RangeMeasurement], perception_unknown: bool, time_s: float | None
) -> float:
    """Refuse measurements that cannot be a time series, and return the present time."""
    if not ranges and not perception_unknown:
        raise MeasurementError(
            "ranges", "empty", "at least one measurement", "pass perception_unknown=True if blind"
        )
    for before, after in pairwise(ranges):
        if after.time_s < before.time_s:
            raise MeasurementError(
                "ranges", f"{after.time_s} s after {before.time_s} s", "times in rising order, in s"
            )
    if time_s is None:
        return ranges[-1].time_s if ranges else 0.0
    check_range("time_s", time_s, unit="s")
    if ranges and ranges[-1].time_s > time_s:
        raise MeasurementError(
            "time_s", f"{time_s} s", f"not before the newest measurement at {ranges[-1].time_s} s"
        )
    return time_s


def brake_limits(train: Train, policy: Policy) -> tuple[float, float]:
    """Available distances at which service and emergency braking have to start, metres.

    S_stop + ΔS_max from the highest speed the train may have, the reaction and the stand-off;
    inf where the brake does not stop the train. The service brake's is never the smaller one.
    """
    fastest = train.fastest_mps
    if fastest == 0.0:
        return 0.0, 0.0
    run = fastest * policy.reaction_s
    service, _ = stop(fastest, motion_of(train, train.service), STEP_S)
    emergency, _ = stop(fastest, motion_of(train, train.emergency), STEP_S)
    emergency_at = policy.stop_upper_m(emergency) + run
    return max(policy.stop_upper_m(service) + run, emergency_at), emergency_at


def _stop_error_m(limit_m: float, fastest: float, policy: Policy) -> float:
    """ΔS_max within a limit of :func:`brake_limits`, metres; inf where that is."""
    if fastest == 0.0 or not math.isfinite(limit_m):
        return limit_m
    upper_m = limit_m - fastest * policy.reaction_s - policy.stand_off_m
    return upper_m - (upper_m - policy.stop_error_m) / (1.0 + policy.stop_error_rel)


def _act(
    available: float, warn_m: float, service_m: float, emergency_m: float, fastest: float
) -> tuple[Action, str]:
    """The action the distances alone ask for, and its sentence."""
    if math.isinf(available):
        return "none", "no range"
    if fastest == 0.0:
        return "none", "the train stands"
    if available <= emergency_m:
        return "emergency", f"{available:.1f} m available, emergency stop needs {emergency_m:.1f} m"
    if available <= service_m:
        return "service", f"{available:.1f} m available, service stop needs {service_m:.1f} m"
    if available <= warn_m:
        return "warn", f"{available:.1f} m available, braking has to start at {service_m:.1f} m"
    return "none", f"{available:.1f} m available, {service_m:.1f} m needed"


def _at_least(action: Action, why: str, least: Action, doubt: str) -> tuple[Action, str]:
    """Raise the action to the cautious branch and say why."""
    if SEVERITY[action] >= SEVERITY[least]:
        return action, f"{why}; {doubt}"
    return least, f"{doubt}: at least {least}; {why}"


def _contradictions(
    fresh: Sequence[RangeMeasurement], now: float, fastest: float
) -> tuple[str, ...]:
    """Pairs of channels whose newest intervals, carried to the present, exclude each other."""
    newest = {m.channel: m for m in fresh}
    if len(newest) < 2:
        return ()
    found = []
    channels = sorted(newest)
    for index, first in enumerate(channels):
        for second in channels[index + 1 :]:
            a, b = newest[first], newest[second]
            # A measurement may have run up to fastest·age closer, or not at all.
            low_a, high_a = a.interval_m[0] - fastest * (now - a.time_s), a.interval_m[1]
            low_b, high_b = b.interval_m[0] - fastest * (now - b.time_s), b.interval_m[1]
            if low_a > high_b or low_b > high_a:
                found.append(
                    f"{first} says {a.interval_m[0]:.1f}–{a.interval_m[1]:.1f} m, "
                    f"{second} says {b.interval_m[0]:.1f}–{b.interval_m[1]:.1f} m"
                )
    return tuple(found)
