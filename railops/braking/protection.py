"""The protective section ΔS_max + ΔL_max and the collision probability behind it.

A collision needs the overrun x = −ΔS (the train runs x further than calculated) and the
overstatement y = ΔL (the obstacle is y nearer than measured) to use up the section together:
x + y > ΔS_max + ΔL_max. For independent errors that probability is the convolution

    P_col = ∫ f_y(y) · P(x > ΔS_max + ΔL_max − y) dy                 [SIL-4 paper, eq. 5]

The paper bounds it "from above" by the product P(x > ΔS_max)·P(y > ΔL_max) (its eq. 7). That is
the probability that *both* exceed, which is contained in the collision, so the product is a bound
from **below**. What does bound it from above: a collision needs x > ΔS_max or y > ΔL_max, hence

    P_col <= p_S + p_L − p_S·p_L   (independent),      P_col <= p_S + p_L   (in any case).

:func:`collision_bound` returns that; the printed product is kept as :func:`product_as_printed`.
The consequence: for 1e-8 both errors must be bounded to about 5e-9, not one to 1e-8 and the other
to anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import special

from railops.errors import DomainError, EvidenceError, check_range

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Section:
    """A protective section and what it achieves.

    Attributes:
        stop_error_m: ΔS_max, metres.
        range_error_m: ΔL_max, metres.
        stop_exceedance: Probability that the overrun exceeds ΔS_max.
        range_exceedance: Probability that the overstatement exceeds ΔL_max (of all measurements
            together, where the smallest of several decides).
        independent: Whether the two errors are taken as independent.
    """

    stop_error_m: float
    range_error_m: float
    stop_exceedance: float
    range_exceedance: float
    independent: bool = True

    def __post_init__(self) -> None:
        check_range("stop_error_m", self.stop_error_m, 0.0, 1e5, "m")
        check_range("range_error_m", self.range_error_m, 0.0, 1e5, "m")
        check_range("stop_exceedance", self.stop_exceedance, 0.0, 1.0)
        check_range("range_exceedance", self.range_exceedance, 0.0, 1.0)

    @property
    def length_m(self) -> float:
        """ΔS_max + ΔL_max, metres."""
        return self.stop_error_m + self.range_error_m

    @property
    def collision_bound(self) -> float:
        """Upper bound of the collision probability."""
        return collision_bound(self.stop_exceedance, self.range_exceedance, self.independent)

    def require(self, target: float) -> None:
        """Raise unless the bound is at most ``target``.

        Raises:
            EvidenceError: if it is not; says which of the two errors is short.
        """
        if self.collision_bound > target * (1.0 + 1e-12):
            worse = "stopping" if self.stop_exceedance >= self.range_exceedance else "range"
            raise EvidenceError(
                f"the section bounds the collision probability by {self.collision_bound:.3g}, not "
                f"{target:g}; the {worse} error governs (stopping {self.stop_exceedance:.3g}, "
                f"range {self.range_exceedance:.3g})"
            )


def collision_bound(
    stop_exceedance: float, range_exceedance: float, independent: bool = True
) -> float:
    """Upper bound of the collision probability from the two exceedance probabilities.

    Example:
        >>> collision_bound(1e-4, 1e-4, independent=False)
        0.0002
    """
    check_range("stop_exceedance", stop_exceedance, 0.0, 1.0)
    check_range("range_exceedance", range_exceedance, 0.0, 1.0)
    both = stop_exceedance * range_exceedance if independent else 0.0
    return min(1.0, stop_exceedance + range_exceedance - both)


def product_as_printed(stop_exceedance: float, range_exceedance: float) -> float:
    """Eq. 7 as the paper prints it. It is a lower bound; do not use it to claim safety."""
    check_range("stop_exceedance", stop_exceedance, 0.0, 1.0)
    check_range("range_exceedance", range_exceedance, 0.0, 1.0)
    return stop_exceedance * range_exceedance


def collision_probability(
    overrun_sf: Callable[[Array], Array],
    overstatement_ppf: Callable[[Array], Array],
    section_m: float,
    nodes: int = 64,
) -> float:
    """Eq. 5: P(x + y > section) for independent x and y, by quadrature over y's quantiles.

    P = ∫₀¹ P(x > section − y(u)) du. Small u′ = 1 − u is where the tail sits, so the integral runs
    over decades of u′ and of u down to 1e-30, with Gauss–Legendre nodes in each; smooth laws are
    integrated to about 1e-10 relative.

    Args:
        overrun_sf: Survival function of the overrun x = −ΔS, vectorised, metres.
        overstatement_ppf: *Inverse survival* function of y = ΔL: the value exceeded with the given
            probability, vectorised, metres.
        section_m: ΔS_max + ΔL_max, metres (0 gives the paper's unprotected case).
        nodes: Quadrature nodes per decade.

    Example:
        Two standard normal errors and a section of 6 m: P(N(0, 2) > 6) = 1.1045e-5.

        >>> from scipy.stats import norm
        >>> f"{collision_probability(norm.sf, norm.isf, 6.0):.4e}"
        '1.1045e-05'
    """
    check_range("section_m", section_m, -1e6, 1e6, "m")
    check_range("nodes", nodes, 4, 4096)
    x, weight = np.polynomial.legendre.leggauss(nodes)
    edges = np.concatenate([[0.0], np.logspace(-30, -1, 30), [0.25, 0.5, 0.75]])
    # The upper end is refined the same way, in the distance from one.
    upper = 1.0 - np.concatenate([np.logspace(-1, -15, 15), [0.0]])
    edges = np.concatenate([edges, upper])
    half, centre = np.diff(edges) / 2.0, (edges[1:] + edges[:-1]) / 2.0
    u = np.clip(centre[:, None] + half[:, None] * x, 1e-300, 1.0 - 1e-16)
    beyond = np.asarray(overrun_sf(section_m - np.asarray(overstatement_ppf(u), float)), float)
    if np.isnan(beyond).any():
        raise DomainError("overrun_sf", "NaN", "a probability for every distance")
    return float((half[:, None] * weight * beyond).sum())


def normal_collision_probability(
    stop_error_m: float,
    stop_exceedance: float,
    range_error_m: float,
    range_exceedance: float,
    smallest: Callable[[Array], Array] = lambda exceedance: exceedance,
) -> float:
    """Eq. 5 for normal errors of mean 0 that exceed their bounds with the given probabilities.

    An example law to hold against :func:`collision_bound`, not evidence: nobody has measured that
    errors are normal out to 1e-8.

    Args:
        stop_error_m: ΔS_max, metres.
        stop_exceedance: Probability that the overrun exceeds it, in (0, 0.5).
        range_error_m: ΔL_max of one measurement, metres.
        range_exceedance: Probability that one measurement's overstatement exceeds it, (0, 0.5).
        smallest: From the probability that one measurement overstates by more than some distance
            to the probability that the smallest of all does; default: there is only one.

    Example:
        For one measurement the sum is normal too: with both bounds at 2.326 σ and σ = 3 and 4 m,
        the section of 16.28 m is 3.257 standard deviations of 5 m.

        >>> f"{normal_collision_probability(6.97904, 0.01, 9.30539, 0.01):.3e}"
        '5.632e-04'
    """
    check_range("stop_exceedance", stop_exceedance, 0.0, 0.5, above=True)
    check_range("range_exceedance", range_exceedance, 0.0, 0.5, above=True)
    stop_std = stop_error_m / -special.ndtri(stop_exceedance)
    range_std = max(range_error_m / -special.ndtri(range_exceedance), 1e-12)
    # x and y enter the sum alike: here the overstatement has the survival function.
    return collision_probability(
        lambda beyond: smallest(special.ndtr(-beyond / range_std)),
        lambda exceedance: -stop_std * special.ndtri(exceedance),
        stop_error_m + range_error_m,
    )
