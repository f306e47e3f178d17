"""Where a vehicle is now, from reports that come late and out of order: a Kalman filter.

The state is (distance to the crossing, speed towards it), driven by white acceleration noise. The
last reports are kept sorted by the time they were *sent* and filtered anew for every estimate, so
that the order of arrival cannot matter.
"""

from __future__ import annotations

import math
from bisect import insort
from dataclasses import dataclass
from typing import NamedTuple

from railops.errors import DomainError, MeasurementError, check_range


@dataclass(frozen=True, order=True)
class Report:
    """A vehicle's own report.

    Attributes:
        sent_s: When it was measured and sent, s.
        distance_m: Front to the crossing, m, negative beyond it.
        speed_mps: Speed towards the crossing, m/s.
    """

    sent_s: float
    distance_m: float
    speed_mps: float

    def __post_init__(self) -> None:
        check_range("sent_s", self.sent_s, 0.0, unit="s")
        check_range("distance_m", self.distance_m, -100_000.0, 100_000.0, "m")
        check_range("speed_mps", self.speed_mps, -100.0, 100.0, "m/s")


@dataclass(frozen=True)
class Estimate:
    """The predicted state; distances m, speeds m/s, standard deviations beside them.

    ``age_s`` is the age of the newest report it rests on.
    """

    distance_m: float
    speed_mps: float
    distance_std_m: float
    speed_std_mps: float
    age_s: float


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a reported position (m) and speed (m/s); acceleration, m/s² per √Hz.

    ``stale_s``: reports older than this are no basis for a prediction.
    """

    position_m: float = 5.0
    speed_mps: float = 0.3
    accel: float = 0.7
    stale_s: float = 60.0


class Predictor:
    """One vehicle's reports and what follows from them."""

    def __init__(self, noise: Noise | None = None, keep: int = 15) -> None:
        self._noise = noise or Noise()
        self._keep = int(check_range("keep", keep, 1, 10_000))
        self._reports: list[Report] = []

    def add(self, report: Report, now_s: float) -> None:
        """Take a report that arrived at ``now_s``.

        Raises:
            MeasurementError: if it is from the future or older than the stale limit.
            DomainError: if a report of that time is here already.
        """
        if report.sent_s > now_s:
            raise MeasurementError(
                "sent_s", f"{report.sent_s} s", f"at most the present {now_s} s", "future timestamp"
            )
        if now_s - report.sent_s > self._noise.stale_s:
            limit = f"at least {now_s - self._noise.stale_s} s"
            raise MeasurementError("sent_s", f"{report.sent_s} s", limit, "stale report")
        if any(known.sent_s == report.sent_s for known in self._reports):
            raise DomainError("sent_s", f"{report.sent_s} s", "a time not reported before")
        insort(self._reports, report)
        del self._reports[: -self._keep]

    def estimate(self, now_s: float) -> Estimate:
        """Predict the state at ``now_s``.

        Raises:
            MeasurementError: if there is no report, or the newest is stale or from the future.
        """
        if not self._reports:
            raise MeasurementError("reports", "empty", "at least one report")
        age = now_s - self._reports[-1].sent_s
        if not 0.0 <= age <= self._noise.stale_s:
            raise MeasurementError(
                "age of the newest report", f"{age} s", f"0 to {self._noise.stale_s} s"
            )
        noise, first = self._noise, self._reports[0]
        belief = _Belief(
            first.distance_m, first.speed_mps, noise.position_m**2, 0.0, noise.speed_mps**2
        )
        at_s = first.sent_s
        for report in self._reports[1:]:
            belief = belief.later(report.sent_s - at_s, noise.accel).told(report, noise)
            at_s = report.sent_s
        belief = belief.later(now_s - at_s, noise.accel)
        return Estimate(
            belief.distance_m,
            belief.speed_mps,
            math.sqrt(belief.distance_var),
            math.sqrt(belief.speed_var),
            age,
        )


class _Belief(NamedTuple):
    """The filter's state: mean and covariance of distance (m) and speed towards it (m/s)."""

    distance_m: float
    speed_mps: float
    distance_var: float
    covariance: float
    speed_var: float

    def later(self, step_s: float, accel: float) -> _Belief:
        """Predict: x ← F·x, P ← F·P·Fᵀ + Q with F = [1 −t; 0 1]; distance shrinks with speed."""
        t, q = step_s, accel * accel
        return _Belief(
            self.distance_m - t * self.speed_mps,
            self.speed_mps,
            self.distance_var - 2.0 * t * self.covariance + t * t * self.speed_var + q * t**3 / 3.0,
            self.covariance - t * self.speed_var - q * t * t / 2.0,
            self.speed_var + q * t,
        )

    def told(self, report: Report, noise: Noise) -> _Belief:
        """Update by the reported position, then by the speed; their errors are independent."""
        d, v, p_dd, p_dv, p_vv = self
        k_d, k_v = (part / (p_dd + noise.position_m**2) for part in (p_dd, p_dv))
        off = report.distance_m - d
        d, v = d + k_d * off, v + k_v * off
        p_dd, p_dv, p_vv = (1.0 - k_d) * p_dd, (1.0 - k_d) * p_dv, p_vv - k_v * p_dv
        k_d, k_v = (part / (p_vv + noise.speed_mps**2) for part in (p_dv, p_vv))
        off = report.speed_mps - v
        d, v = d + k_d * off, v + k_v * off
        return _Belief(d, v, p_dd - k_d * p_dv, (1.0 - k_v) * p_dv, (1.0 - k_v) * p_vv)
