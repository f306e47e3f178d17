"""Real-valued negative selection as published: detectors that move, overlap little, and breed.

A population of hyperspheres of random centre and radius is matured. In every step a detector that
reaches a safe sample moves away from it, and one that overlaps the others too much moves away from
its nearest neighbour; after a number of steps the detectors are ranked (large ones with little
overlap are the best), the worst are replaced by displaced clones of the best and by fresh random
ones, and the next generation begins. Only detectors that reach no safe sample ever leave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops.crossing.detectors import DetectorSet, Units, coordinates, distances, extent
from railops.crossing.situation import DIMENSIONS, Array, Situation, as_points
from railops.errors import DomainError, check_range
from railops.seeds import generator


@dataclass(frozen=True)
class Settings:
    """Settings of the published run (Fig. 4.2); lengths are in the coordinates of ``units``.

    The defaults are the printed ones, which only make sense in raw units: a radius of 300 spans
    distances in metres. Not printed, and chosen here: the step, the generations, the fresh ones.

    Attributes:
        detectors: Population size, 20.
        self_radius: r_s, variation allowed to a safe sample, 0.2.
        overlap: ξ, largest overlap W of a detector with all others that is left alone, 0.1.
        radius_max: Largest detector radius, 300.
        step: η, distance a detector moves at a time.
        steps: Steps per generation ("next generation after 5 tests").
        clones: How many of the best are cloned, 4.
        fresh: How many random ones join each generation.
        generations: How many generations mature.
        units: Raw as published, or the unit cube.
    """

    detectors: int = 20
    self_radius: float = 0.2
    overlap: float = 0.1
    radius_max: float = 300.0
    step: float = 30.0
    steps: int = 5
    clones: int = 4
    fresh: int = 2
    generations: int = 20
    units: Units = "raw"

    def __post_init__(self) -> None:
        check_range("detectors", self.detectors, 1, 100_000)
        check_range("self_radius", self.self_radius, 0.0, 1e4)
        check_range("overlap", self.overlap, 0.0, 1e6)
        check_range("radius_max", self.radius_max, 0.0, 1e4, above=True)
        check_range("step", self.step, 0.0, 1e4, above=True)
        check_range("steps", self.steps, 1, 10_000)
        check_range("generations", self.generations, 1, 10_000)
        replaced = self.clones + self.fresh
        if not 0 <= replaced <= self.detectors or self.clones < 0 or self.fresh < 0:
            raise DomainError("clones + fresh", replaced, f"0 to {self.detectors} detectors")


PUBLISHED = Settings()
SCALED = Settings(detectors=200, overlap=5.0, radius_max=1.0, step=0.1, units="scaled")
"""The same algorithm in the unit cube: a radius has to reach as far as 1, and because no axis is
negligible there, eight dimensions need ten times the detectors and room to overlap."""


def overlap_measure(apart: Array, radii: Array) -> Array:
    """w(d, d′) of every detector d with every other d′, shape (K, K); 0 on the diagonal.

    w = (e^δ − 1)^m   [eq. 4.4],   δ = (r_d + r_d′ − D) / (2·r_d), kept in [0, 1]   [eq. 4.5]

    Args:
        apart: D between the centres, shape (K, K).
        radii: r_d, shape (K,).
    """
    delta = np.clip((radii[:, None] + radii[None, :] - apart) / (2.0 * radii[:, None]), 0.0, 1.0)
    measure = np.expm1(delta) ** DIMENSIONS
    np.fill_diagonal(measure, 0.0)
    return measure


def away(centres: Array, origins: Array, length: Array | float) -> Array:
    """Centres moved by ``length`` along the unit vector from ``origins``   [eqs. 4.1, 4.2].

    Where a centre coincides with its origin there is no direction; it moves along the diagonal.
    """
    apart = centres - origins
    norm = np.linalg.norm(apart, axis=1, keepdims=True)
    diagonal = np.full_like(apart, 1.0 / np.sqrt(DIMENSIONS))
    unit = np.where(norm > 0.0, apart / np.where(norm > 0.0, norm, 1.0), diagonal)
    moved: Array = centres + np.reshape(length, (-1, 1)) * unit
    return moved


def _mature(centres: Array, radii: Array, safe: Array, settings: Settings) -> Array:
    """One generation's steps: away from safe samples first, then from the nearest neighbour."""
    far = extent(settings.units)
    for _ in range(settings.steps):
        to_self = distances(centres, safe)
        nearest = to_self.argmin(axis=1)
        reaches = to_self.min(axis=1) < radii + settings.self_radius
        apart = distances(centres, centres)
        crowded = overlap_measure(apart, radii).sum(axis=1) > settings.overlap  # [eq. 4.3]
        np.fill_diagonal(apart, np.inf)
        neighbour = apart.argmin(axis=1)
        origin = np.where(reaches[:, None], safe[nearest], centres[neighbour])
        moves = reaches | (crowded & (len(radii) > 1))
        if not moves.any():
            break
        moved = away(centres, origin, settings.step)
        centres = np.clip(np.where(moves[:, None], moved, centres), 0.0, far)
    return centres


def _breed(
    centres: Array, radii: Array, safe: Array, settings: Settings, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Replace the worst by displaced clones of the best, and by fresh random detectors."""
    far = extent(settings.units)
    apart = distances(centres, centres)
    crowding = overlap_measure(apart, radii).sum(axis=1)
    score = radii / settings.radius_max - np.minimum(crowding, 1.0)
    score[distances(centres, safe).min(axis=1) < radii + settings.self_radius] -= 2.0
    order = np.argsort(score, kind="stable")
    clones, fresh = settings.clones, settings.fresh
    np.fill_diagonal(apart, np.inf)
    best = order[::-1][:clones]
    centres, radii = centres.copy(), radii.copy()
    if clones and len(radii) > 1:
        shifted = away(centres[best], centres[apart[best].argmin(axis=1)], radii[best])
        centres[order[:clones]] = np.clip(shifted, 0.0, far)
        radii[order[:clones]] = radii[best]
    replaced = order[clones : clones + fresh]
    centres[replaced], radii[replaced] = _random(len(replaced), settings, rng)
    return centres, radii


def _random(count: int, settings: Settings, rng: np.random.Generator) -> tuple[Array, Array]:
    """Detectors of random centre and radius."""
    centres = rng.random((count, DIMENSIONS)) * extent(settings.units)
    return centres, settings.radius_max * (1.0 - rng.random(count))


def train(
    safe: npt.ArrayLike | list[Situation], seed: int, settings: Settings = PUBLISHED
) -> DetectorSet:
    """Mature a detector set on safe situations.

    Args:
        safe: The safe situations ("self"), in their own units, shape (N, 8), N >= 1.
        seed: Seed of the random numbers, kept in the result.
        settings: The algorithm's settings.

    Returns:
        The detectors that reach no safe sample; usually a few fewer than the population.

    Raises:
        DomainError: if there is no safe situation, one leaves the space, or none survives.

    Example:
        >>> from railops.crossing.published import ANTIGENS, SELF
        >>> detectors = train(SELF, seed=1)
        >>> bool((detectors.judge(SELF, sample_radius=0.0) >= 0).any())
        False
    """
    points = as_points(safe)
    if len(points) == 0:
        raise DomainError("safe", "no situations", "at least one safe situation to learn from")
    kept = coordinates(points, settings.units)
    rng = generator(seed)
    centres, radii = _random(settings.detectors, settings, rng)
    for generation in range(settings.generations):
        if generation:
            centres, radii = _breed(centres, radii, kept, settings, rng)
        centres = _mature(centres, radii, kept, settings)
    clear = distances(centres, kept).min(axis=1) >= radii + settings.self_radius
    if not clear.any():
        raise DomainError(
            "detectors",
            "all reach a safe situation",
            "at least one that does not",
            "use a smaller radius or more generations",
        )
    return DetectorSet(
        centres[clear],
        radii[clear],
        settings.self_radius,
        "negative selection",
        seed,
        settings.units,
    )
