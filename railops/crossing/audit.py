"""Many drives, each also with a perfect radio; every unsafe outcome is listed with its cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from railops.crossing.bus import PERFECT, Link
from railops.crossing.drive import CYCLE_S, Drive, Plan, run
from railops.crossing.units import Policy
from railops.errors import check_range


@dataclass(frozen=True)
class Unsafe:
    """One unsafe outcome.

    Attributes:
        seed: The drive's seed.
        impact_mps: Speed of the collision, m/s.
        avoidable: A system without delay and loss avoids it.
        cause: Why it happened, in words; empty if the messages do not explain it, which is a
            defect of the exchange itself.
    """

    seed: int
    impact_mps: float
    avoidable: bool
    cause: str


@dataclass(frozen=True)
class Audit:
    """What came of a set of drives.

    Attributes:
        drives: How many.
        link: What the radio did.
        policy: When the train unit braked.
        collisions: Collisions in truth.
        avoidable: Those a perfect radio avoids.
        unsafe: One entry per collision.
        needless_stops: Stops although the crossing would have been free.
        needless_stops_perfect: The same with the perfect radio.
        prediction_error_m: Median absolute error of the station's late view of the train, m.
        prediction_within: Share of those errors within two claimed standard deviations.
        seed: First seed.
    """

    drives: int
    link: Link
    policy: Policy
    collisions: int
    avoidable: int
    unsafe: tuple[Unsafe, ...]
    needless_stops: int
    needless_stops_perfect: int
    prediction_error_m: float
    prediction_within: float
    seed: int

    @property
    def unreported(self) -> int:
        """Avoidable collisions without an entry that names a cause; has to be zero."""
        return self.avoidable - sum(1 for entry in self.unsafe if entry.avoidable and entry.cause)


def cause_of(drive: Drive, avoidable: bool) -> str:
    """Why this drive ended in a collision, by the chain car → station → train → brake.

    Every cause rests on a time that came too late; if none did, the cause is empty.

    Example:
        >>> plan = Plan(1, 20.0, 2500.0, 110.0, 60.0)
        >>> late = Drive(
        ...     plan, True, 20.0, 125.0, None, None, 101.0, 110.0, None, None, 5.0, None, (), ()
        ... )
        >>> cause_of(late, avoidable=False)
        'the car stalled 9.0 s after the last braking point; no radio could have helped'
    """
    last = drive.last_point_s
    stalled = drive.plan.stalls_s
    if not avoidable:
        if stalled > last:
            return (
                f"the car stalled {stalled - last:.1f} s after the last braking point; "
                "no radio could have helped"
            )
        return (
            f"the car stalled {last - stalled:.1f} s before the last braking point; even a "
            "perfect radio's one-second period used that up"
        )
    if drive.registered_s is None or drive.registered_s > last:
        when = "never" if drive.registered_s is None else f"at {drive.registered_s:.1f} s"
        return f"the train was not served before the last braking point: first state {when}"
    if drive.station_knew_s is None:
        return "no report of the standing car reached the station"
    if drive.station_knew_s > last:
        return (
            f"the car's report reached the station {drive.station_knew_s - stalled:.1f} s after "
            f"it stalled, {drive.station_knew_s - last:.1f} s after the last braking point"
        )
    if drive.train_knew_s is None:
        return "no busy signal reached the train, though the station knew in time"
    late = drive.train_knew_s - last
    if late <= -CYCLE_S:
        return ""
    return (
        f"the busy signal reached the train {drive.train_knew_s - drive.station_knew_s:.1f} s "
        f"after the station knew, {late:.1f} s after the last braking point"
    )


def audit(drives: int, seed: int, link: Link, policy: Policy) -> Audit:
    """Run drives with this radio and with a perfect one, and compare the truth.

    Args:
        drives: How many, with seeds ``seed``, ``seed + 1``, …
        seed: The first seed.
        link: What the radio does.
        policy: When the train unit brakes.
    """
    check_range("drives", drives, 1, 1e6)
    unsafe: list[Unsafe] = []
    collisions = avoidable = needless = needless_perfect = 0
    errors: list[float] = []
    claimed: list[float] = []
    for number in range(seed, seed + int(drives)):
        plan = Plan.random(number)
        real, _ = run(plan, link, policy)
        ideal, _ = run(plan, PERFECT, policy)
        needless += real.needless_stop
        needless_perfect += ideal.needless_stop
        errors.extend(real.prediction_errors_m)
        claimed.extend(real.prediction_std_m)
        if real.collided:
            could = not ideal.collided
            collisions += 1
            avoidable += could
            unsafe.append(Unsafe(number, real.impact_mps, could, cause_of(real, could)))
    off = np.abs(errors) if errors else np.array([np.nan])
    within = np.abs(errors) <= 2.0 * np.array(claimed) if errors else np.array([np.nan])
    return Audit(
        int(drives),
        link,
        policy,
        collisions,
        avoidable,
        tuple(unsafe),
        needless,
        needless_perfect,
        float(np.median(off)),
        float(np.mean(within)),
        seed,
    )
