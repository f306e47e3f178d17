"""Where a vehicle is now, from reports that come late and out of order: a Kalman filter.

The state is (distance to the crossing, speed towards it), driven by white acceleration noise. The
last reports are kept sorted by the time they were *sent* and filtered anew for every estimate, so
that the order of arrival cannot matter.
"""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass

import numpy as np

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
        noise = self._noise
        measured = np.diag([noise.position_m**2, noise.speed_mps**2])
        first = self._reports[0]
        state = np.array([first.distance_m, first.speed_mps])
        spread = measured.copy()
        at = first.sent_s
        for report in self._reports[1:]:
            state, spread = _forward(state, spread, report.sent_s - at, noise.accel)
            gain = spread @ np.linalg.inv(spread + measured)
            state = state + gain @ (np.array([report.distance_m, report.speed_mps]) - state)
            spread = (np.eye(2) - gain) @ spread
            at = report.sent_s
        state, spread = _forward(state, spread, now_s - at, noise.accel)
        deviation = np.sqrt(np.diag(spread))
        return Estimate(
            float(state[0]), float(state[1]), float(deviation[0]), float(deviation[1]), age
        )


def _forward(
    state: np.ndarray[tuple[int], np.dtype[np.float64]],
    spread: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    step_s: float,
    accel: float,
) -> tuple[
    np.ndarray[tuple[int], np.dtype[np.float64]], np.ndarray[tuple[int, int], np.dtype[np.float64]]
]:
    """Predict over ``step_s``; distance to the crossing shrinks with speed."""
    move = np.array([[1.0, -step_s], [0.0, 1.0]])
    q = accel * accel
    grown = q * np.array([[step_s**3 / 3.0, -(step_s**2) / 2.0], [-(step_s**2) / 2.0, step_s]])
    return move @ state, move @ spread @ move.T + grown
