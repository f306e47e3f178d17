"""Closing speed from ranges: two of them, or a filter over many.

The filter is the textbook constant-acceleration Kalman filter, written out: three states need a
dozen lines. Of the kept libraries, filterpy 2.0.0 (MIT, October 2026) brings matplotlib into the
runtime, and stonesoup 1.9.1 (MIT, June 2026) matplotlib, plotly, rtree and five more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Speed:
    """A closing speed, positive when the object comes nearer.

    Attributes:
        speed_mps: m/s.
        std_mps: Standard deviation, m/s.
    """

    speed_mps: float
    std_mps: float


def finite_difference(
    first_m: float,
    second_m: float,
    interval_s: float,
    first_std_m: float = 0.0,
    second_std_m: float = 0.0,
    interval_std_s: float = 0.0,
) -> Speed:
    """V = (D₁ − D₂)/Δt, (1), with σ_v by (9); without a timing error that is (10).

    Only noise belongs in the standard deviations: a bias (a wrong size) changes both ranges alike
    and the speed by its own proportion, see :func:`speed_bias`.

    Args:
        first_m: Range D₁, metres.
        second_m: Range D₂ after ``interval_s``, metres.
        interval_s: Δt, s, > 0.
        first_std_m: Standard deviation of D₁.
        second_std_m: Standard deviation of D₂.
        interval_std_s: Standard deviation of Δt.

    Raises:
        BadInputError: if Δt is not positive.

    Example:
        >>> speed = finite_difference(20.0, 18.0, 1.0, 0.667, 0.607)
        >>> speed.speed_mps, round(speed.std_mps, 2)
        (2.0, 0.9)
    """
    if not (math.isfinite(interval_s) and interval_s > 0):
        raise BadInputError(
            f"interval_s is {interval_s}; a speed needs time to pass between ranges"
        )
    speed = (first_m - second_m) / interval_s
    return Speed(
        speed,
        math.hypot(first_std_m, second_std_m, speed * interval_std_s) / interval_s,
    )


def minimum_interval(range_std_m: float, speed_mps: float) -> float:
    """Δt ≥ σ_D/v, (13), s: shorter, and the object moves by less than the range's error.

    Example:
        >>> minimum_interval(0.08, 2.0)
        0.04
    """
    if not (math.isfinite(speed_mps) and speed_mps > 0):
        raise BadInputError(f"speed_mps is {speed_mps}; at a standstill no interval is long enough")
    if not range_std_m >= 0:
        raise BadInputError(f"range_std_m is {range_std_m}; a standard deviation is not negative")
    return range_std_m / speed_mps


def speed_bias(speed_mps: float, bias_rel: float) -> float:
    """What a relative bias of all ranges (a size, a focal length) does to the speed, m/s.

    Ranges that are all b too long in proportion give a speed b too high; no averaging helps.
    """
    return abs(speed_mps) * bias_rel


@dataclass(frozen=True)
class Motion:
    """State of a thing ahead at one time.

    Attributes:
        time_s: Media time, s.
        state: Range (m), its rate (m/s, negative when closing) and second rate (m/s²), shape (3,).
        covariance: From noise alone, shape (3, 3).
        bias_rel: Relative standard deviation of what is common to all ranges.
    """

    time_s: float
    state: Array
    covariance: Array
    bias_rel: float

    @property
    def range_m(self) -> float:
        """Filtered range, metres."""
        return float(self.state[0])

    @property
    def range_std_m(self) -> float:
        """Its standard deviation, noise and bias, metres."""
        return math.hypot(math.sqrt(self.covariance[0, 0]), self.bias_rel * self.range_m)

    @property
    def closing(self) -> Speed:
        """Closing speed with noise and bias."""
        speed = -float(self.state[1])
        noise = math.sqrt(self.covariance[1, 1])
        return Speed(speed, math.hypot(noise, speed_bias(speed, self.bias_rel)))

    @property
    def time_to_reach_s(self) -> float | None:
        """Time until the range is zero at the present closing speed, s.

        None where the thing is not known to come nearer: its closing speed is below one standard
        deviation.
        """
        closing = self.closing
        if closing.speed_mps <= max(closing.std_mps, 1e-6):
            return None
        return max(self.range_m, 0.0) / closing.speed_mps


@dataclass(frozen=True)
class MotionSettings:
    """What the filter expects.

    Attributes:
        jerk_std: Spectral density of the jerk, m/s³ per √Hz: service braking builds up over
            seconds.
        speed_std_mps: Standard deviation of the closing speed before anything is known, m/s.
        accel_std_mps2: The same of the acceleration, m/s².
        gate_std: A range farther from its prediction than this counts only with that distance as
            its error; it is not thrown away.
    """

    jerk_std: float = 0.3
    speed_std_mps: float = 30.0
    accel_std_mps2: float = 0.7
    gate_std: float = 4.0


class MotionFilter:
    """Constant-acceleration Kalman filter of one thing's range.

    Noise is filtered; the bias is kept out of the filter, which would otherwise average away what
    does not average out.

    Args:
        settings: What it expects.
    """

    def __init__(self, settings: MotionSettings | None = None) -> None:
        self._settings = settings or MotionSettings()
        self._motion: Motion | None = None

    @property
    def motion(self) -> Motion | None:
        """The latest state; None before the first range."""
        return self._motion

    def update(self, time_s: float, range_m: float, noise_m: float, bias_m: float = 0.0) -> Motion:
        """Take in one range.

        Args:
            time_s: Media time, s, not before the last one.
            range_m: Range, metres, > 0.
            noise_m: Standard deviation of its noise, metres, > 0.
            bias_m: Standard deviation of its bias, metres.

        Raises:
            BadInputError: if the time runs backwards or a number is out of range.

        Example:
            >>> motions = MotionFilter()
            >>> for step in range(26):
            ...     motion = motions.update(0.04 * step, 80.0 - 20.0 * 0.04 * step, 0.5)
            >>> round(motion.closing.speed_mps, 1), motion.closing.std_mps < 1.2
            (20.0, True)
        """
        if not (math.isfinite(range_m) and range_m > 0 and noise_m > 0 and bias_m >= 0):
            raise BadInputError(
                f"range {range_m} m with noise {noise_m} m and bias {bias_m} m: range and noise "
                "must be positive, the bias not negative"
            )
        settings = self._settings
        if self._motion is None:
            start = [noise_m**2, settings.speed_std_mps**2, settings.accel_std_mps2**2]
            self._motion = Motion(
                time_s, np.array([range_m, 0.0, 0.0]), np.diag(start), bias_m / range_m
            )
            return self._motion
        state, covariance = self._predicted(time_s)
        surprise = range_m - float(state[0])
        expected = float(covariance[0, 0]) + noise_m**2
        if surprise**2 > settings.gate_std**2 * expected:
            expected = surprise**2
        gain = covariance[:, 0] / expected
        state = state + gain * surprise
        covariance = covariance - np.outer(gain, covariance[0])
        bias_rel = max(self._motion.bias_rel, bias_m / range_m)
        self._motion = Motion(time_s, state, 0.5 * (covariance + covariance.T), bias_rel)
        return self._motion

    def _predicted(self, time_s: float) -> tuple[Array, Array]:
        assert self._motion is not None
        dt = time_s - self._motion.time_s
        if dt < 0:
            raise BadInputError(
                f"time {time_s} s lies before the last one, {self._motion.time_s} s; "
                "feed ranges in order"
            )
        move = np.array([[1.0, dt, 0.5 * dt**2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        # White jerk integrated over dt.
        grow = self._settings.jerk_std**2 * np.array(
            [
                [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                [dt**3 / 6, dt**2 / 2, dt],
            ]
        )
        return move @ self._motion.state, move @ self._motion.covariance @ move.T + grow
