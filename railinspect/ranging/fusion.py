"""Combining ranges that share some of their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

Z95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution."""

AGREE_STD = 3.0
"""An instrument agrees with the result if it lies within this many standard deviations of it."""


@dataclass(frozen=True)
class Reading:
    """What one instrument said.

    Attributes:
        method: Name of the instrument.
        range_m: Its range, metres.
        std_m: Its standard deviation, metres.
        agrees: Whether it lies within ``AGREE_STD`` of the combined range.
    """

    method: str
    range_m: float
    std_m: float
    agrees: bool


@dataclass(frozen=True)
class Range:
    """A range along the track with its error.

    Attributes:
        range_m: Best estimate, metres from under the camera along the track.
        std_m: Standard deviation, metres.
        interval_m: 95 % interval, metres; wider upwards, because errors are relative.
        method: Instruments that took part.
        noise_m: The part of ``std_m`` that differs from frame to frame and averages out.
        bias_m: The part that stays (sizes, focal length, height) and never averages out.
        readings: What each instrument said by itself.
    """

    range_m: float
    std_m: float
    interval_m: tuple[float, float]
    method: str
    noise_m: float = 0.0
    bias_m: float = 0.0
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True)
class Absent:
    """No range, and why."""

    reason: str


@dataclass(frozen=True)
class Estimate:
    """One instrument's range with named relative errors.

    Errors of the same name in two estimates are one and the same error (the same focal length,
    the same foot row) and fully correlated; others are independent.

    Attributes:
        method: Name of the instrument.
        range_m: Range, metres, > 0.
        errors: Noise: relative standard deviation by cause; the sign is that of its effect, so
            that a cause that lengthens one estimate and shortens another is counted as such.
        biases: The same for causes that stay the same from frame to frame.
        opinion: It rests on what such things usually are and not on this one: where it disagrees
            it says that this one is unusual, and neither moves nor widens the result.
    """

    method: str
    range_m: float
    errors: Mapping[str, float]
    biases: Mapping[str, float] = field(default_factory=dict)
    opinion: bool = False

    @property
    def rel(self) -> float:
        """Relative standard deviation of all causes together."""
        return math.hypot(*self.errors.values(), *self.biases.values())


def combine(estimates: Sequence[Estimate]) -> Range:
    """Minimum-variance combination of the logarithms of ranges with shared errors.

    With the covariance C of the log-ranges, weights are C⁻¹·1 / (1ᵀ·C⁻¹·1) and the variance is
    1 / (1ᵀ·C⁻¹·1). Weights are kept within 0 and 1: a negative weight would extrapolate beyond
    both instruments and lean on the error model being exact.

    Args:
        estimates: At least one.

    Example:
        >>> one = Estimate("a", 100.0, {"own a": 0.1}, {"shared": 0.05})
        >>> two = Estimate("b", 100.0, {"own b": 0.1}, {"shared": 0.05})
        >>> both = combine([one, two])
        >>> round(both.std_m, 3), round(both.bias_m, 3)  # √(0.1²/2 + 0.05²) of 100 m
        (8.66, 5.0)
    """
    log_range = np.array([math.log(e.range_m) for e in estimates])
    opinion = np.array([e.opinion for e in estimates])
    weight, mean, variance, noise_part, bias_part, agrees = _weighed(
        _loadings([e.errors for e in estimates]),
        _loadings([e.biases for e in estimates]),
        log_range,
        opinion,
    )
    sigma = math.sqrt(variance)
    range_m = math.exp(mean)
    return Range(
        range_m,
        range_m * sigma,
        interval(range_m, sigma),
        "+".join(e.method for e, w in zip(estimates, weight, strict=True) if w > 0.02),
        range_m * math.sqrt(noise_part),
        range_m * math.sqrt(bias_part),
        tuple(
            Reading(e.method, e.range_m, e.range_m * e.rel, bool(a))
            for e, a in zip(estimates, agrees, strict=True)
        ),
    )


def interval(range_m: float, rel: float) -> tuple[float, float]:
    """95 % interval of a range whose logarithm has the standard deviation ``rel``, metres."""
    return range_m * math.exp(-Z95 * rel), range_m * math.exp(Z95 * rel)


def _loadings(errors: Sequence[Mapping[str, float]]) -> Array:
    """Relative errors by estimate and cause, shape (N, causes)."""
    causes = dict.fromkeys(cause for one in errors for cause in one)
    return np.array([[one.get(cause, 0.0) for cause in causes] for one in errors], float)


@numba.njit(cache=True)
def _weighed(
    noise_by_cause: Array,
    bias_by_cause: Array,
    log_range: Array,
    opinion: npt.NDArray[np.bool_],
) -> tuple[Array, float, float, float, float, npt.NDArray[np.bool_]]:
    """Weights, mean, its variance, the shares of noise and bias in it, and which agree."""
    noise = noise_by_cause @ noise_by_cause.T
    bias = bias_by_cause @ bias_by_cause.T
    covariance = noise + bias
    own = np.diag(covariance)
    kept = np.flatnonzero(~opinion)
    if 0 < len(kept) < len(opinion):
        weight = _weights(covariance, kept)
        mean = (weight * log_range).sum()
        shared = (covariance * weight).sum(axis=1)
        apart = own - 2.0 * shared + (weight * shared).sum()
        near = np.abs(log_range - mean) <= AGREE_STD * np.sqrt(np.maximum(apart, 1e-12))
        kept = np.flatnonzero(~opinion | near)
    else:
        kept = np.arange(len(opinion))
    weight = _weights(covariance, kept)
    mean = (weight * log_range).sum()
    shared = (covariance * weight).sum(axis=1)
    variance = (weight * shared).sum()
    # Instruments that disagree by more than their errors allow: widen to cover it.
    spread = (weight * (log_range - mean) ** 2).sum()
    widened = max(0.0, spread - (weight * own).sum() + variance)
    noise_part = max(0.0, (weight * (noise * weight).sum(axis=1)).sum() + widened)
    bias_part = max(0.0, (weight * (bias * weight).sum(axis=1)).sum())
    apart = np.maximum(own - 2.0 * shared + variance, 1e-12)
    agrees = np.abs(log_range - mean) <= AGREE_STD * np.sqrt(apart)
    return weight, mean, variance + widened, noise_part, bias_part, agrees


@numba.njit(cache=True)
def _weights(covariance: Array, kept: npt.NDArray[np.intp]) -> Array:
    """Minimum-variance weights within 0 and 1 of those that are kept.

    The most negative is dropped until none is.
    """
    count = len(covariance)
    while True:
        size = len(kept)
        part = np.empty((size, size))
        for i in range(size):
            for j in range(size):
                part[i, j] = covariance[kept[i], kept[j]]
            part[i, i] += 1e-12
        solved = np.linalg.solve(part, np.ones(size))
        if solved.min() >= 0.0 or size == 1:
            weight = np.zeros(count)
            weight[kept] = np.maximum(solved, 0.0)
            shares: Array = weight / weight.sum()
            return shares
        kept = np.delete(kept, np.argmin(solved))
