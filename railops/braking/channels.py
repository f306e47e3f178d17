"""Several measurements, one or two channels: take the smallest range, and what that is worth.

The smallest of k ranges overstates the true one by more than ΔL_max only if all k do. With
independent errors that is p^k; with a share c of the exceedances that strike all of them at once
(fog, a wrong map, a wrong calibration) it is

    c·p + (1 − c)·p^k

so the common cause puts a floor of c·p under any number of measurements. Two channels multiply,
again down to the share that strikes both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy import special

from railops.errors import DomainError, EvidenceError, check_range
from railops.traction import Line

Probability = TypeVar("Probability", float, npt.NDArray[np.float64])

SIL4_TARGET = 1e-8
_ROUNDING = 1.0 + 1e-12  # 0.01**4 must count as 1e-8 whatever the last bit says


def joint_exceedance(exceedance: float, count: int, common_cause: float = 0.0) -> float:
    """Probability that all of ``count`` measurements exceed: c·p + (1 − c)·p^k.

    Example:
        >>> joint_exceedance(1e-2, 4)
        1e-08
        >>> f"{joint_exceedance(1e-4, 2, 0.01):.4g}"
        '1.01e-06'
    """
    if count == 0:
        return 1.0
    return float(_all_of(exceedance, count, common_cause))


def _all_of(exceedance: Probability, count: int, common_cause: float) -> Probability:
    """c·p + (1 − c)·p^k, of a probability or of an array of them."""
    return common_cause * exceedance + (1.0 - common_cause) * exceedance**count


def measurements_needed(target: float, exceedance: float, common_cause: float = 0.0) -> int:
    """Smallest number of measurements whose joint exceedance is at most ``target``.

    Raises:
        EvidenceError: if the common cause alone exceeds the target: no number suffices.

    Example:
        Four measurements at 1e-2 for SIL-4:

        >>> measurements_needed(SIL4_TARGET, 1e-2)
        4
    """
    check_range("target", target, 0.0, 1.0, above=True)
    check_range("exceedance", exceedance, 0.0, 1.0 - 1e-12, above=True)
    check_range("common_cause", common_cause, 0.0, 1.0)
    count = 1
    while joint_exceedance(exceedance, count, common_cause) > target * _ROUNDING:
        if common_cause * exceedance > target or count > 10_000:
            raise EvidenceError(
                f"no number of measurements reaches {target:g}: the common cause alone gives "
                f"{common_cause:g}·{exceedance:g} = {common_cause * exceedance:g}; lower it, lower "
                "the single exceedance, or add an independent channel"
            )
        count += 1
    return count


def tries_needed(count: int, missing: float, confidence: float = 0.99) -> int:
    """Attempts after which ``count`` measurements have succeeded with this confidence.

    Args:
        count: Measurements wanted, >= 1.
        missing: Probability that one attempt yields nothing, [0, 1).
        confidence: Probability that the attempts suffice.

    Example:
        >>> tries_needed(4, 0.0), tries_needed(4, 0.1)
        (4, 7)
    """
    check_range("count", count, 1, 10_000)
    check_range("missing", missing, 0.0, 0.999)
    check_range("confidence", confidence, 0.0, 1.0 - 1e-12, above=True)
    tries = count
    # P(at least count successes in tries) = I_q(count, tries − count + 1).
    while special.betainc(count, tries - count + 1.0, 1.0 - missing) < confidence:
        tries += 1
    return tries


@dataclass(frozen=True)
class Channel:
    """One way of measuring the range.

    Attributes:
        name: "onboard", "wayside", …
        exceedance: p of one measurement's ΔL_max.
        measurements: k, how many are taken.
        period_s: Time one measurement takes, s.
        missing: Probability that one attempt yields nothing.
        common_cause: Share of exceedances that strike all k at once.
        sees_round_curves: False for a channel whose view a curve blocks.
    """

    name: str
    exceedance: float
    measurements: int
    period_s: float = 0.1
    missing: float = 0.0
    common_cause: float = 0.0
    sees_round_curves: bool = False

    def __post_init__(self) -> None:
        check_range("exceedance", self.exceedance, 0.0, 1.0, above=True)
        check_range("measurements", self.measurements, 1, 10_000)
        check_range("period_s", self.period_s, 0.0, 3600.0, "s")
        check_range("missing", self.missing, 0.0, 0.999)
        check_range("common_cause", self.common_cause, 0.0, 1.0)

    @property
    def joint(self) -> float:
        """Exceedance probability of the smallest of its k measurements."""
        return joint_exceedance(self.exceedance, self.measurements, self.common_cause)

    def joint_of(self, exceedance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The same for other exceedances of one measurement, of a larger error than ΔL_max say."""
        return _all_of(exceedance, self.measurements, self.common_cause)

    @property
    def duration_s(self) -> float:
        """Time until its k measurements are there with probability 0.99, s."""
        return tries_needed(self.measurements, self.missing) * self.period_s


@dataclass(frozen=True)
class Plan:
    """What a set of channels achieves at one place and speed.

    Attributes:
        exceedance: Probability that the smallest range overstates by more than ΔL_max.
        usable: Names of the channels that count here.
        blind: Names of those whose view a curve blocks before the distance required.
        duration_s: Time the measurements take (channels work at the same time), s.
        growth_m: Distance run meanwhile: what ΔL_max grows by, metres.
        meets_target: Whether the exceedance is at most the target.
    """

    exceedance: float
    usable: tuple[str, ...]
    blind: tuple[str, ...]
    duration_s: float
    growth_m: float
    meets_target: bool


def plan(
    channels: Sequence[Channel],
    speed_mps: float,
    *,
    required_m: float = 0.0,
    sight_m: float = math.inf,
    common_cause: float = 0.0,
    target: float = SIL4_TARGET,
) -> Plan:
    """Combine one or two channels: P = c·min(P₁, P₂) + (1 − c)·P₁·P₂ over those that can see.

    Args:
        channels: One or two channels.
        speed_mps: Train speed, m/s.
        required_m: Distance at which the obstacle has to be measured, metres.
        sight_m: How far the on-board view reaches along the track, metres.
        common_cause: Share of the better channel's exceedances that strike both.
        target: Probability to reach.

    Example:
        Two measurements at 1e-2 through each of two channels (the paper's example):

        >>> onboard = Channel("onboard", 1e-2, 2)
        >>> wayside = Channel("wayside", 1e-2, 2, sees_round_curves=True)
        >>> both = plan([onboard, wayside], 20.0)
        >>> both.exceedance, both.growth_m
        (1e-08, 4.0)
    """
    if not 1 <= len(channels) <= 2:
        raise DomainError("channels", f"{len(channels)} channels", "one or two channels")
    check_range("speed_mps", speed_mps, 0.0, 150.0, "m/s")
    check_range("common_cause", common_cause, 0.0, 1.0)
    usable = [c for c in channels if c.sees_round_curves or sight_m >= required_m]
    blind = tuple(c.name for c in channels if c not in usable)
    if not usable:
        return Plan(1.0, (), blind, 0.0, 0.0, False)
    joint = usable[0].joint
    if len(usable) == 2:
        joint = float(together(joint, usable[1].joint, common_cause))
    duration = max(channel.duration_s for channel in usable)
    return Plan(
        joint,
        tuple(channel.name for channel in usable),
        blind,
        duration,
        duration * speed_mps,
        joint <= target * _ROUNDING,
    )


def together(first: Probability, second: Probability, common_cause: float) -> Probability:
    """Both channels exceed: c·min(P₁, P₂) + (1 − c)·P₁·P₂, of probabilities or arrays of them."""
    smaller: Probability = np.minimum(first, second)
    return common_cause * smaller + (1.0 - common_cause) * first * second


def sight_distance_m(
    line: Line, position_m: float, clearance_m: float = 3.0, longest_m: float = 3000.0
) -> float:
    """How far an on-board camera sees along the track before a curve's inside blocks the view.

    The line of sight is the chord from the camera to the point seen; the view is free while the
    track's largest offset from that chord stays within the lateral clearance. In one long curve
    that is the classical √(8·R·clearance). Successive curves are taken as turning the same way.

    Args:
        line: The line.
        position_m: Where the camera is, metres.
        clearance_m: Free width beside the track's centre line on the inside, metres, > 0.
        longest_m: Where to stop looking, metres.

    Returns:
        Distance along the track, metres, at most ``longest_m``.

    Example:
        >>> round(sight_distance_m(Line.uniform(radius_m=400.0), 0.0), 0)
        98.0
    """
    check_range("clearance_m", clearance_m, 0.0, 1000.0, "m", above=True)
    check_range("longest_m", longest_m, 0.0, 1e5, "m", above=True)
    s = np.arange(0.0, longest_m + 1.0, 1.0)
    starts, radii = np.array(line.curves).T
    index = np.clip(np.searchsorted(starts, position_m + s + 0.5, "right") - 1, 0, None)
    heading = np.concatenate([[0.0], np.cumsum(1.0 / radii[index])[:-1]])
    middle = heading + 0.5 / radii[index]  # heading at the middle of each metre
    x = np.concatenate([[0.0], np.cumsum(np.cos(middle))[:-1]])
    y = np.concatenate([[0.0], np.cumsum(np.sin(middle))[:-1]])

    def blocked(end: int) -> bool:
        offset = np.abs(x[: end + 1] * y[end] - y[: end + 1] * x[end])
        return bool(offset.max() > clearance_m * math.hypot(x[end], y[end]))

    if not blocked(s.size - 1):
        return float(longest_m)
    low, high = 1, s.size - 1
    while high - low > 1:
        centre = (low + high) // 2
        low, high = (low, centre) if blocked(centre) else (centre, high)
    return float(s[low])
