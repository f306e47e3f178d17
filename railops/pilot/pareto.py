"""What length, energy and jerk cost each other: a sweep over λ₁ and λ₂."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from railops.errors import DomainError
from railops.pilot._transcription import Mesh, Transcription
from railops.pilot.leg import Leg
from railops.pilot.plan import DEFAULT_MESH, _first_guess


@dataclass(frozen=True)
class Compromise:
    """One optimum of the sweep.

    Attributes:
        energy_weight: λ₁.
        jerk_weight: λ₂.
        length_m: Length of the leg, metres.
        energy: The energy term, before weighting.
        jerk: The jerk term, before weighting.
        efficient: Whether no other point of the sweep is at least as good in all three.
    """

    energy_weight: float
    jerk_weight: float
    length_m: float
    energy: float
    jerk: float
    efficient: bool


def pareto_sweep(
    leg: Leg,
    energy_weights: Sequence[float],
    jerk_weights: Sequence[float],
    mesh: Mesh = DEFAULT_MESH,
) -> list[Compromise]:
    """Solve the leg for every pair of weights, each from its neighbour's solution.

    Weights for which the solver finds nothing are left out. The mesh is not refined: the points
    are for choosing weights, and the choice is then planned with :func:`~railops.pilot.plan_leg`.
    """
    if not energy_weights or not jerk_weights:
        raise DomainError("weights", "empty", "at least one λ₁ and one λ₂")
    programme = Transcription(leg, mesh)
    found: list[tuple[float, float, float, float, float]] = []
    row_start = guess = _first_guess(leg, mesh, 1.25)
    for jerk_weight in sorted(jerk_weights, reverse=True):
        guess = row_start
        for column, energy_weight in enumerate(sorted(energy_weights)):
            raw = programme.solve(guess, (energy_weight, jerk_weight))
            if not raw.solved:
                raw = programme.solve(_first_guess(leg, mesh, 1.25), (energy_weight, jerk_weight))
            if not raw.solved:
                continue
            guess = raw.guess
            row_start = raw.guess if column == 0 else row_start
            found.append((energy_weight, jerk_weight, raw.guess.length_m, raw.energy, raw.jerk))
    points = [row[2:] for row in found]
    return [Compromise(*row, efficient=not _beaten(row[2:], points)) for row in found]


def _beaten(point: tuple[float, ...], points: Sequence[tuple[float, ...]]) -> bool:
    """Whether some other point is at least as good in everything and better in something."""

    def better(other: tuple[float, ...]) -> bool:
        pairs = list(zip(other, point, strict=True))
        no_worse = all(a <= b + 1e-6 * abs(b) for a, b in pairs)
        return no_worse and any(a < b - 1e-3 * abs(b) for a, b in pairs)

    return any(better(other) for other in points)
