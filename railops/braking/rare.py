"""Probabilities down to 1e-8: subset simulation, and importance sampling beside it.

Both estimate P(g(z) > x) for z standard normal in d dimensions, g given as a vectorised function,
for instance :meth:`railops.braking.montecarlo.StopLaw.distances`.

Subset simulation (Au and Beck 2001) writes the small probability as a product of conditional ones
near 0.1 and samples each condition by a Markov chain that keeps the normal law (z′ = ρ·z +
√(1 − ρ²)·ξ, accepted if it stays beyond the level; Papaioannou et al. 2015). It assumes nothing
about g. Importance sampling draws from a normal law fitted to the failures the subset run found
and weights each draw by the ratio of densities; it is unbiased and tighter where one failure mode
dominates. Where the two disagree, neither should be believed, and :func:`tail` says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, EvidenceError, check_range

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]

_KEEP = 0.1  # conditional probability of each level
_SMALLEST = 1e-15


@dataclass(frozen=True)
class Tail:
    """An estimated tail probability.

    Attributes:
        probability: Estimate of P(g > threshold).
        threshold: x.
        cov: Its estimated coefficient of variation (standard deviation over value).
        evaluations: Number of evaluations of g.
        method: "subset simulation" or "importance sampling".
        agrees: Whether the two methods agree within four standard deviations; None where only one
            was run.
    """

    probability: float
    threshold: float
    cov: float
    evaluations: int
    method: str
    agrees: bool | None = None


@dataclass(frozen=True)
class _Levels:
    """A finished subset run: the last level's probability and its samples."""

    reached: float  # probability of the last level's condition
    z: Array  # samples given that condition, shape (N, d)
    g: Array  # their values, shape (N,)
    cov2: float  # squared coefficient of variation so far
    evaluations: int


def subset(
    g: Function,
    threshold: float,
    dimensions: int,
    rng: np.random.Generator,
    samples: int = 20_000,
) -> Tail:
    """P(g(z) > threshold) by subset simulation.

    Args:
        g: Vectorised function of standard normal rows (N, d), values (N,); inf is allowed.
        threshold: x.
        dimensions: d.
        rng: Source of randomness.
        samples: Samples per level; the coefficient of variation falls with their square root.

    Raises:
        EvidenceError: if the probability is below 1e-15.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> found = subset(lambda z: z[:, 0], 5.6120, 2, rng)    # 1e-8 of a normal variable
        >>> bool(0.8e-8 < found.probability < 1.2e-8)
        True
    """
    check_range("threshold", threshold)
    run = _descend(g, dimensions, rng, samples, lambda level, _: level >= threshold)
    share = float(np.mean(run.g > threshold))
    if share == 0.0:
        raise EvidenceError(f"P(g > {threshold:g}) is below {_SMALLEST:g}; nothing was found there")
    cov2 = run.cov2 + _level_cov2(run.g > threshold, run.reached)
    return Tail(
        run.reached * share, threshold, math.sqrt(cov2), run.evaluations, "subset simulation"
    )


def quantile(
    g: Function,
    probability: float,
    dimensions: int,
    rng: np.random.Generator,
    samples: int = 20_000,
) -> float:
    """The value that g exceeds with the given probability, by subset simulation."""
    check_range("probability", probability, _SMALLEST, 0.5)
    run = _descend(g, dimensions, rng, samples, lambda _, reached: reached * _KEEP < probability)
    return float(np.quantile(run.g, 1.0 - probability / run.reached, method="higher"))


def importance(
    g: Function,
    threshold: float,
    dimensions: int,
    rng: np.random.Generator,
    samples: int = 50_000,
    pilot: int = 5_000,
) -> Tail:
    """P(g(z) > threshold) by importance sampling around the failures a pilot subset run found.

    Args:
        g: As in :func:`subset`.
        threshold: x.
        dimensions: d.
        rng: Source of randomness.
        samples: Weighted samples.
        pilot: Samples per level of the pilot run that places the sampling density.

    Raises:
        EvidenceError: if the pilot run finds no failures down to 1e-15.
    """
    check_range("threshold", threshold)
    run = _descend(g, dimensions, rng, pilot, lambda level, _: level >= threshold)
    failures = run.z[run.g > threshold]
    if len(failures) < 2 * dimensions:
        raise EvidenceError(
            f"the pilot run found {len(failures)} failures beyond {threshold:g}; raise `pilot`"
        )
    centre = failures.mean(axis=0)
    # Widened a little: a density narrower than the failures' would hide some of them.
    spread = 1.2 * np.cov(failures.T).reshape(dimensions, dimensions) + 0.05 * np.eye(dimensions)
    root = np.linalg.cholesky(spread)
    xi = rng.standard_normal((samples, dimensions))
    z = centre + xi @ root.T
    log_weight = 0.5 * (xi**2).sum(1) - 0.5 * (z**2).sum(1) + np.log(np.diag(root)).sum()
    value = np.where(g(z) > threshold, np.exp(log_weight), 0.0)
    mean = float(value.mean())
    if mean == 0.0:
        raise EvidenceError(f"no weighted sample lies beyond {threshold:g}; raise `samples`")
    cov = float(value.std(ddof=1) / math.sqrt(samples) / mean)
    return Tail(mean, threshold, cov, run.evaluations + samples, "importance sampling")


def tail(
    g: Function,
    threshold: float,
    dimensions: int,
    rng: np.random.Generator,
    samples: int = 50_000,
) -> Tail:
    """Both methods; returns the tighter estimate and whether they agree within four deviations."""
    first = subset(g, threshold, dimensions, rng, samples)
    second = importance(g, threshold, dimensions, rng, samples)
    apart = abs(first.probability - second.probability)
    allowed = 4.0 * math.hypot(first.cov * first.probability, second.cov * second.probability)
    best = min(first, second, key=lambda estimate: estimate.cov)
    return Tail(
        best.probability,
        threshold,
        best.cov,
        first.evaluations + second.evaluations,
        best.method,
        bool(apart <= allowed),
    )


def _descend(
    g: Function,
    dimensions: int,
    rng: np.random.Generator,
    samples: int,
    done: Callable[[float, float], bool],
) -> _Levels:
    """Walk down the levels until ``done(next level's threshold, probability reached)``."""
    check_range("dimensions", dimensions, 1, 1000)
    check_range("samples", samples, 100, 1e9)
    z = rng.standard_normal((samples, dimensions))
    values = g(z)
    if values.shape != (samples,) or np.isnan(values).any():
        raise DomainError("g", f"values of shape {values.shape}", "one number per row, no NaN")
    reached, cov2, evaluations, step = 1.0, 0.0, samples, 0.6
    while True:
        level = float(np.quantile(values, 1.0 - _KEEP, method="lower"))
        if done(level, reached) or reached * _KEEP < _SMALLEST or not math.isfinite(level):
            return _Levels(reached, z, values, cov2, evaluations)
        above = values > level
        if not above.any():  # a plateau at the top: nothing lies beyond it
            return _Levels(reached, z, values, cov2, evaluations)
        cov2 += _level_cov2(above, reached)
        reached *= float(above.mean())
        z, values, step, used = _refill(g, z[above], values[above], level, samples, step, rng)
        evaluations += used


def _refill(
    g: Function,
    seeds: Array,
    seed_values: Array,
    level: float,
    samples: int,
    step: float,
    rng: np.random.Generator,
) -> tuple[Array, Array, float, int]:
    """Grow the seeds to ``samples`` rows given g > level by parallel Markov chains.

    The step adapts to an acceptance near 0.44 from one move to the next; it is small against the
    number of chains, so the adaptation leaves the law practically untouched.
    """
    order = rng.permutation(np.resize(np.arange(len(seeds)), samples))
    z, values = seeds[order].copy(), seed_values[order].copy()
    used = 0
    for _ in range(_MOVES):
        keep = math.sqrt(1.0 - step * step)
        proposed = keep * z + step * rng.standard_normal(z.shape)
        proposed_values = g(proposed)
        used += samples
        accepted = proposed_values > level
        z[accepted], values[accepted] = proposed[accepted], proposed_values[accepted]
        step = float(np.clip(step * math.exp(float(accepted.mean()) - 0.44), 0.05, 0.99))
    return z, values, step, used


_MOVES = 6  # moves per level; afterwards copies of one seed are nearly independent
_CORRELATION = 0.5  # inflates a level's variance for dependent chains; measured: below 0.2


def _level_cov2(above: npt.NDArray[np.bool_], reached: float) -> float:
    """Squared coefficient of variation of one level's share."""
    share = float(above.mean())
    factor = 1.0 if reached == 1.0 else 1.0 + _CORRELATION
    return factor * (1.0 - share) / (share * above.size) if share > 0.0 else math.inf
