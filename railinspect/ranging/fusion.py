"""Combining ranges that share some of their errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Z95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True)
class Range:
    """A range along the track with its error.

    Attributes:
        range_m: Best estimate, metres from under the camera along the track.
        std_m: Standard deviation, metres.
        interval_m: 95 % interval, metres; wider upwards, because errors are relative.
        method: Instruments that took part.
    """

    range_m: float
    std_m: float
    interval_m: tuple[float, float]
    method: str


@dataclass(frozen=True)
class Estimate:
    """One instrument's range with named relative errors.

    Errors of the same name in two estimates are one and the same error (the same focal length,
    the same foot row) and fully correlated; others are independent.

    Attributes:
        method: Name of the instrument.
        range_m: Range, metres, > 0.
        errors: Relative standard deviation by cause; the sign is that of its effect, so that a
            cause that lengthens one estimate and shortens another is counted as such.
    """

    method: str
    range_m: float
    errors: Mapping[str, float]


def combine(estimates: Sequence[Estimate]) -> Range:
    """Minimum-variance combination of the logarithms of ranges with shared errors.

    With the covariance C of the log-ranges, weights are C⁻¹·1 / (1ᵀ·C⁻¹·1) and the variance is
    1 / (1ᵀ·C⁻¹·1). Weights are kept within 0 and 1: a negative weight would extrapolate beyond
    both instruments and lean on the error model being exact.

    Args:
        estimates: At least one.

    Example:
        >>> one = Estimate("a", 100.0, {"own a": 0.1, "shared": 0.05})
        >>> two = Estimate("b", 100.0, {"own b": 0.1, "shared": 0.05})
        >>> round(combine([one, two]).std_m, 3)  # √(0.1²/2 + 0.05²) of 100 m
        8.66
    """
    causes = sorted({cause for e in estimates for cause in e.errors})
    loading = np.array([[e.errors.get(cause, 0.0) for cause in causes] for e in estimates])
    covariance = loading @ loading.T
    log_range = np.log([e.range_m for e in estimates])
    count = len(estimates)
    ridge = 1e-12 * np.eye(count)
    weight = np.linalg.solve(covariance + ridge, np.ones(count))
    weight = np.clip(weight / weight.sum(), 0.0, 1.0)
    weight /= weight.sum()
    mean = float(weight @ log_range)
    # Instruments that disagree by more than their errors allow: widen to cover it.
    spread = float(weight @ (log_range - mean) ** 2)
    expected = float(weight @ np.diag(covariance) - weight @ covariance @ weight)
    sigma = math.sqrt(float(weight @ covariance @ weight) + max(0.0, spread - expected))
    range_m = math.exp(mean)
    interval = (range_m * math.exp(-Z95 * sigma), range_m * math.exp(Z95 * sigma))
    used = [e.method for e, w in zip(estimates, weight, strict=True) if w > 0.02]
    return Range(range_m, range_m * sigma, interval, "+".join(used))
