"""Combining ranges that share some of their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np
import numpy.typing as npt

from railinspect.ranging.small_solve import factorise, substitute

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


def combine(
    estimates: Sequence[Estimate], tails: Mapping[str, tuple[float, float]] | None = None
) -> Range:
    """Minimum-variance combination of the logarithms of ranges with shared errors.

    With the covariance C of the log-ranges, weights are C⁻¹·1 / (1ᵀ·C⁻¹·1) and the variance is
    1 / (1ᵀ·C⁻¹·1). Weights are kept within 0 and 1: a negative weight would extrapolate beyond
    both instruments and lean on the error model being exact.

    Args:
        estimates: At least one.
        tails: Of errors that are not normal: how many of its standard deviations the range may be
            too long, and too short, by this cause in all but 2.5 % of cases each (1.96 if normal).

    Example:
        >>> one = Estimate("a", 100.0, {"own a": 0.1}, {"shared": 0.05})
        >>> two = Estimate("b", 100.0, {"own b": 0.1}, {"shared": 0.05})
        >>> both = combine([one, two])
        >>> round(both.std_m, 3), round(both.bias_m, 3)  # √(0.1²/2 + 0.05²) of 100 m
        (8.66, 5.0)
    """
    noises = dict.fromkeys(cause for e in estimates for cause in e.errors)
    biases = dict.fromkeys(cause for e in estimates for cause in e.biases)
    table = [
        [e.range_m, e.opinion]
        + [e.errors.get(cause, 0.0) for cause in noises]
        + [e.biases.get(cause, 0.0) for cause in biases]
        for e in estimates
    ]
    found = _weighed(np.array(table, float), len(noises)).tolist()
    mean, variance, noise_part, bias_part = found[:4]
    weight, agrees = found[4::2], found[5::2]
    sigma = math.sqrt(variance)
    range_m = math.exp(mean)
    longer, shorter = _reach(estimates, weight, variance, tails or {})
    return Range(
        range_m,
        range_m * sigma,
        (range_m * math.exp(-longer), range_m * math.exp(shorter)),
        "+".join(e.method for e, w in zip(estimates, weight, strict=True) if w > 0.02),
        range_m * math.sqrt(noise_part),
        range_m * math.sqrt(bias_part),
        tuple(
            Reading(e.method, e.range_m, e.range_m * e.rel, a > 0)
            for e, a in zip(estimates, agrees, strict=True)
        ),
    )


def _reach(
    estimates: Sequence[Estimate],
    weight: Sequence[float],
    variance: float,
    tails: Mapping[str, tuple[float, float]],
) -> tuple[float, float]:
    """How far down and up the 95 % interval of the log-range reaches.

    Of a sum of independent errors σ, what makes a cause's quantile q differ from the normal's z
    fades as its fourth cumulant does, with the fourth power of its share in σ (Cornish and Fisher
    1938): z_sum = z + (q − z)·(σ_cause / σ)⁴. Quantiles squared and added keep too much of it.
    """
    sigma = math.sqrt(variance)
    if sigma == 0.0:
        return 0.0, 0.0  # exact estimates: no cause has a share
    low = high = Z95
    for cause, (longer, shorter) in tails.items():
        own = sum(w * e.errors.get(cause, 0.0) for e, w in zip(estimates, weight, strict=True))
        share = min(1.0, abs(own) / sigma) ** 4
        low += (longer - Z95) * share
        high += (shorter - Z95) * share
    return low * sigma, high * sigma


def interval(range_m: float, rel: float) -> tuple[float, float]:
    """95 % interval of a range whose logarithm has the standard deviation ``rel``, metres."""
    return range_m * math.exp(-Z95 * rel), range_m * math.exp(Z95 * rel)


@numba.njit(cache=True)
def _weighed(table: Array, noises: int) -> Array:
    """Mean, its variance, the shares of noise and bias in it; of each its weight and agreement.

    Args:
        table: By estimate its range (m), whether it is an opinion, and its relative errors by
            cause, shape (N, 2 + causes).
        noises: So many of the causes are noise, the rest bias.

    Returns:
        Shape (4 + 2·N,).
    """
    count = len(table)
    log_range = np.empty(count)
    noise, bias = np.zeros((count, count)), np.zeros((count, count))
    firm = 0
    for i in range(count):
        log_range[i] = math.log(table[i, 0])
        firm += table[i, 1] == 0.0
        for j in range(count):
            for k in range(2, table.shape[1]):
                both = table[i, k] * table[j, k]
                if k < 2 + noises:
                    noise[i, j] += both
                else:
                    bias[i, j] += both
    covariance = noise + bias
    kept = np.ones(count, np.bool_)
    if 0 < firm < count:  # opinions count where they agree with the rest
        for i in range(count):
            kept[i] = table[i, 1] == 0.0
        weight = _weights(covariance, kept)
        mean, _, _, shared, variance = _moments(covariance, log_range, weight)
        for i in range(count):
            apart = covariance[i, i] - 2.0 * shared[i] + variance
            if abs(log_range[i] - mean) <= AGREE_STD * math.sqrt(max(apart, 1e-12)):
                kept[i] = True
    weight = _weights(covariance, kept)
    mean, own, spread, shared, variance = _moments(covariance, log_range, weight)
    # Instruments that disagree by more than their errors allow: widen to cover it.
    widened = max(0.0, spread - own + variance)
    noise_part, bias_part = widened, 0.0
    for i in range(count):
        for j in range(count):
            noise_part += weight[i] * weight[j] * noise[i, j]
            bias_part += weight[i] * weight[j] * bias[i, j]
    out = np.empty(4 + 2 * count)
    out[0], out[1] = mean, variance + widened
    out[2], out[3] = max(0.0, noise_part), max(0.0, bias_part)
    for i in range(count):
        apart = max(covariance[i, i] - 2.0 * shared[i] + variance, 1e-12)
        out[4 + 2 * i] = weight[i]
        out[5 + 2 * i] = abs(log_range[i] - mean) <= AGREE_STD * math.sqrt(apart)
    return out


@numba.njit(cache=True)
def _moments(
    covariance: Array, log_range: Array, weight: Array
) -> tuple[float, float, float, Array, float]:
    """Weighted mean, mean own variance, spread about the mean, covariances with it, variance."""
    count = len(weight)
    mean, own, spread, variance = 0.0, 0.0, 0.0, 0.0
    shared = np.zeros(count)
    for i in range(count):
        mean += weight[i] * log_range[i]
        own += weight[i] * covariance[i, i]
        for j in range(count):
            shared[i] += covariance[i, j] * weight[j]
        variance += weight[i] * shared[i]
    for i in range(count):
        spread += weight[i] * (log_range[i] - mean) ** 2
    return mean, own, spread, shared, variance


@numba.njit(cache=True)
def _weights(covariance: Array, keep: npt.NDArray[np.bool_]) -> Array:
    """Minimum-variance weights within 0 and 1 of those that are kept, 0 for the others.

    The most negative is dropped until none is.
    """
    kept = np.flatnonzero(keep)
    weight = np.zeros(len(covariance))
    while True:
        size = len(kept)
        part, solved = np.empty((size, size)), np.empty(size)
        for i in range(size):
            for j in range(size):
                part[i, j] = covariance[kept[i], kept[j]]
            part[i, i] += 1e-12
        factorise(part)
        substitute(part, np.ones(size), solved)
        worst = np.argmin(solved)
        if solved[worst] >= 0.0 or size == 1:
            total = max(solved.sum(), 1e-300)
            for i in range(size):
                weight[kept[i]] = max(solved[i], 0.0) / total
            return weight
        kept = np.delete(kept, worst)
