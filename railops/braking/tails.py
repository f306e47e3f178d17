"""Laws fitted to observed errors: Pearson type I as in the paper, and what it may not be used for.

The paper fits Pearson type I (a beta law on [low, high]) to some 200 simulated errors and finds by
the χ² test that it does not contradict them. Its support is bounded, so beyond ``high`` it says
"impossible" where the data say nothing: fitted to 5000 Gaussian samples it passes χ² and puts the
1 − 1e-9 quantile at 5.6 instead of 6.0 standard deviations. A fit like that never certifies a
tail; every result carries :data:`CAUTION`. Beside it stands the generalised Pareto law of the
peaks over a threshold, the limit law of tails, with an interval that admits its ignorance.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, special, stats

from railops.errors import DomainError, EvidenceError, check_range

Array = npt.NDArray[np.float64]

CAUTION = (
    "a Pearson type I fit has bounded support and was checked only where there are data; it cannot "
    "certify a tail: use a zero-exceedance bound or rare-event simulation for small probabilities"
)


@dataclass(frozen=True)
class PearsonI:
    """A beta law with shapes a, b on [low, high], and how well it fits.

    Attributes:
        a: First shape, > 0.
        b: Second shape, > 0.
        low: Lower end of the support.
        high: Upper end of the support.
        method: "moments" or "likelihood".
        chi2_p: p-value of the χ² test with four fitted parameters; NaN below 30 samples.
        caution: Why this is not a certificate.
    """

    a: float
    b: float
    low: float
    high: float
    method: str
    chi2_p: float
    caution: str = CAUTION

    def quantile(self, q: npt.ArrayLike) -> Array:
        """Quantiles of the fitted law."""
        share = special.betaincinv(self.a, self.b, np.asarray(q, float))
        return np.asarray(self.low + (self.high - self.low) * share)

    def cdf(self, x: npt.ArrayLike) -> Array:
        """Distribution function of the fitted law."""
        share = (np.asarray(x, float) - self.low) / (self.high - self.low)
        return np.asarray(special.betainc(self.a, self.b, np.clip(share, 0.0, 1.0)))


def _checked(sample: npt.ArrayLike, least: int) -> Array:
    x = np.asarray(sample, float).ravel()
    if x.size < least:
        raise DomainError("sample", f"{x.size} values", f"at least {least} values")
    if not np.isfinite(x).all() or np.ptp(x) == 0.0:
        raise DomainError("sample", "constant or not finite", "finite values that vary")
    return x


def pearson_moments(sample: npt.ArrayLike) -> PearsonI:
    """Fit by the first four moments.

    With skewness γ and kurtosis κ, r = 6(κ − γ² − 1) / (6 + 3γ² − 2κ) is a + b; type I needs
    r > 0, that is κ below 3 + 1.5·γ².   [Pearson 1895; Johnson, Kotz, Balakrishnan, ch. 25]

    Raises:
        EvidenceError: if the sample's moments are not those of a type I law.
    """
    x = _checked(sample, 8)
    mean, std = float(x.mean()), float(x.std())
    skew, kurtosis = float(stats.skew(x)), float(stats.kurtosis(x, fisher=False))
    if kurtosis >= 3.0 + 1.5 * skew**2:
        raise EvidenceError(
            f"kurtosis {kurtosis:.3f} with skewness {skew:.3f} is not that of a Pearson type I law "
            f"(needs less than {3 + 1.5 * skew**2:.3f}): the tails are too heavy for a bounded fit"
        )
    r = 6.0 * (kurtosis - skew**2 - 1.0) / (6.0 + 3.0 * skew**2 - 2.0 * kurtosis)
    tilt = skew * (r + 2.0)
    root = math.sqrt(tilt**2 + 16.0 * (r + 1.0))
    smaller, larger = 0.5 * r * (1.0 - abs(tilt) / root), 0.5 * r * (1.0 + abs(tilt) / root)
    a, b = (smaller, larger) if skew >= 0.0 else (larger, smaller)
    width = std * root / 2.0
    low = mean - width * a / r
    return _tested(x, a, b, low, low + width, "moments")


def pearson_likelihood(sample: npt.ArrayLike) -> PearsonI:
    """Fit by maximum likelihood over both shapes and both ends of the support.

    Shapes are kept above one: below, the likelihood grows without bound as an end approaches the
    extreme sample.
    """
    x = _checked(sample, 8)
    low, high, spread = float(x.min()), float(x.max()), float(x.std())

    def unpack(u: Array) -> tuple[float, float, float, float]:
        return (
            1.0 + math.exp(u[0]),
            1.0 + math.exp(u[1]),
            low - spread * math.exp(u[2]),
            high + spread * math.exp(u[3]),
        )

    def loss(u: Array) -> float:
        if np.abs(u).max() > 12.0:
            return math.inf
        a, b, start, end = unpack(u)
        y = (x - start) / (end - start)
        log_density = (a - 1.0) * np.log(y) + (b - 1.0) * np.log1p(-y)
        return float(x.size * (special.betaln(a, b) + math.log(end - start)) - log_density.sum())

    starts = [[0.5, 0.5, -2.0, -2.0], [2.0, 2.0, 0.5, 0.5]]
    with contextlib.suppress(EvidenceError):  # heavy tails have no start from the moments
        m = pearson_moments(x)
        shapes = [math.log(max(m.a - 1.0, 0.05)), math.log(max(m.b - 1.0, 0.05))]
        ends = [math.log(max(gap / spread, 1e-3)) for gap in (low - m.low, m.high - high)]
        starts.append(shapes + ends)
    fits = [
        optimize.minimize(
            loss,
            start,
            method="Nelder-Mead",
            options={"maxiter": 4000, "maxfev": 4000, "xatol": 1e-5, "fatol": 1e-6},
        )
        for start in starts
    ]
    best = min(fits, key=lambda fit: float(fit.fun))
    return _tested(x, *unpack(best.x), "likelihood")


def _tested(x: Array, a: float, b: float, low: float, high: float, method: str) -> PearsonI:
    fit = PearsonI(a, b, low, high, method, math.nan)
    return PearsonI(a, b, low, high, method, chi_square(x, fit, parameters=4))


def chi_square(sample: npt.ArrayLike, fit: PearsonI, parameters: int) -> float:
    """p-value of Pearson's χ² test over equally probable bins (about 2·n^0.4 of them).

    Returns:
        The p-value; NaN below 30 samples.
    """
    x = np.asarray(sample, float).ravel()
    bins = max(int(2.0 * x.size**0.4), parameters + 2)
    if x.size < 30:
        return math.nan
    index = np.clip((fit.cdf(x) * bins).astype(int), 0, bins - 1)
    counts = np.bincount(index, minlength=bins)
    expected = x.size / bins
    statistic = float(((counts - expected) ** 2 / expected).sum())
    return float(stats.chi2.sf(statistic, bins - 1 - parameters))


@dataclass(frozen=True)
class Peaks:
    """A generalised Pareto law of the excesses over a threshold.

    Attributes:
        shape: ξ; negative: bounded tail, zero: exponential, positive: heavy.
        scale: σ, in the sample's unit.
        threshold: u, in the sample's unit.
        share: Share of the sample above the threshold.
        covariance: Of (ξ, ln σ), shape (2, 2), from the observed information.
    """

    shape: float
    scale: float
    threshold: float
    share: float
    covariance: tuple[tuple[float, float], tuple[float, float]]

    def quantile(self, probability: float) -> float:
        """The value exceeded with this probability: u + σ/ξ·((ζ/p)^ξ − 1)."""
        check_range("probability", probability, 0.0, self.share, above=True)
        return self.threshold + _excess(self.shape, self.scale, self.share / probability)

    def interval(self, probability: float, confidence: float = 0.95) -> tuple[float, float]:
        """Delta-method interval of :meth:`quantile`, on the logarithm of the excess."""
        centre = self.quantile(probability) - self.threshold
        ratio, h = self.share / probability, 1e-5
        slope = np.array(
            [
                math.log(_excess(self.shape + h, self.scale, ratio))
                - math.log(_excess(self.shape - h, self.scale, ratio)),
                2.0 * h,
            ]
        ) / (2.0 * h)
        deviation = math.sqrt(float(slope @ np.array(self.covariance) @ slope))
        reach = float(stats.norm.ppf(0.5 + confidence / 2.0)) * deviation
        return (
            self.threshold + centre * math.exp(-reach),
            self.threshold + centre * math.exp(reach),
        )


def _excess(shape: float, scale: float, ratio: float) -> float:
    """σ/ξ·(ratio^ξ − 1), continuous at ξ = 0."""
    return scale * float(special.boxcox(ratio, shape))


def peaks_over_threshold(sample: npt.ArrayLike, keep: float = 0.05) -> Peaks:
    """Fit the upper tail by maximum likelihood.

    Args:
        sample: Values, shape (N,); the dangerous side must be the upper one.
        keep: Share of the sample to treat as tail, (0, 0.5]; at least 30 values.

    Raises:
        EvidenceError: if fewer than 30 values exceed the threshold.
    """
    x = _checked(sample, 40)
    check_range("keep", keep, 0.0, 0.5, above=True)
    threshold = float(np.quantile(x, 1.0 - keep))
    y = x[x > threshold] - threshold
    if y.size < 30:
        raise EvidenceError(
            f"{y.size} of {x.size} values exceed the threshold; a tail fit needs 30: "
            "give more samples or a larger `keep`"
        )

    def loss(u: Array) -> float:
        shape, log_scale = float(u[0]), float(u[1])
        inside = 1.0 + shape * y / math.exp(log_scale)
        if inside.min() <= 0.0 or not -0.5 < shape < 2.0:
            return math.inf
        if abs(shape) < 1e-6:
            return y.size * log_scale + float(y.sum()) / math.exp(log_scale)
        return y.size * log_scale + (1.0 + 1.0 / shape) * float(np.log(inside).sum())

    start = np.array([0.0, math.log(float(y.mean()))])
    fit = optimize.minimize(loss, start, method="Nelder-Mead", options={"xatol": 1e-7})
    shape, scale = float(fit.x[0]), math.exp(float(fit.x[1]))
    # Asymptotic covariance of (ξ, σ) for ξ > −1/2 (Smith 1987), carried over to (ξ, ln σ).
    n = float(y.size)
    var_shape, var_log, cross = (1 + shape) ** 2 / n, 2 * (1 + shape) / n, -(1 + shape) / n
    covariance = ((var_shape, cross), (cross, var_log))
    return Peaks(shape, scale, threshold, y.size / x.size, covariance)
