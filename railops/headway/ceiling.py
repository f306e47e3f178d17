"""The speed a train may have at each place: limits over its whole length, braking before drops.

Between knots the *square* of the ceiling is linear in the position: constant on a limit, falling
at −2·b where the train brakes at b for a lower limit or a stop. Following the ceiling is then
motion with constant acceleration, which needs no integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from railops._compile import compiled

Array = npt.NDArray[np.float64]
Limits = Sequence[tuple[float, float]]


class Ceiling(NamedTuple):
    """Squared ceiling speed v²(s) = square + slope·(s − start) on each piece.

    Attributes:
        start_m: Where each piece starts, increasing, shape (P,). The first is −inf.
        square_m2ps2: v² at the start of the piece (anywhere on it where the slope is 0), m²/s².
        slope_mps2: dv²/ds on the piece, m/s²: 0, or −2·b.
    """

    start_m: Array
    square_m2ps2: Array
    slope_mps2: Array


def ceiling(
    limits: Limits,
    length_m: float,
    brake_mps2: float,
    stop_m: float = np.inf,
    front_limits: Limits = (),
) -> Ceiling:
    """Build the ceiling for one train.

    Args:
        limits: (position_m, speed_mps) pairs: the limit from each position to the next, holding
            for every part of the train; the first also holds before its position.
        length_m: Train length, m: a higher limit helps only when the rear has reached it.
        brake_mps2: Braking deceleration b, m/s².
        stop_m: Where the train stops, m; ``inf`` for none.
        front_limits: Limits that bind the train's front only, such as speed codes.

    Example:
        >>> ceiling([(0.0, 20.0)], 100.0, 1.0, stop_m=1000.0)
        Ceiling(start_m=array([-inf, 800.]), square_m2ps2=array([400., 400.]),
                slope_mps2=array([ 0., -2.]))
    """
    steps = _front_steps(limits, length_m, front_limits)
    steps = [(start, limit) for start, limit in steps if start < stop_m]
    pieces: list[tuple[float, float, float]] = []
    follows = 0.0 if stop_m < np.inf else steps[-1][1] ** 2  # v² allowed at the end of the piece
    end = stop_m
    for start, limit in reversed(steps):
        square = limit * limit
        if follows < square and end < np.inf:
            brake_at = end - (square - follows) / (2.0 * brake_mps2)
            first = max(brake_at, start)
            pieces.append((first, follows + 2.0 * brake_mps2 * (end - first), -2.0 * brake_mps2))
        if not (pieces and pieces[-1][0] <= start):
            pieces.append((start, square, 0.0))
        follows = pieces[-1][1]
        end = start
    start_m, square_m2ps2, slope_mps2 = np.array(pieces[::-1]).T.copy()
    return Ceiling(start_m, square_m2ps2, slope_mps2)


def _front_steps(
    limits: Limits, length_m: float, front_limits: Limits
) -> list[tuple[float, float]]:
    """The limit as a function of the train's front: (start, speed), neighbours different."""
    spans = []  # (from, to, speed) for the front; a limit holds until the rear has left it
    for pairs, trail in ((limits, length_m), (front_limits, 0.0)):
        for index, (start, speed) in enumerate(pairs):
            end = pairs[index + 1][0] if index + 1 < len(pairs) else np.inf
            spans.append((start if index else -np.inf, end + trail, speed))
    breaks = sorted({-np.inf, *(a for a, _, _ in spans), *(b for _, b, _ in spans)} - {np.inf})
    steps: list[tuple[float, float]] = []
    for start in breaks:
        speed = min(speed for a, b, speed in spans if a <= start < b)
        if not steps or steps[-1][1] != speed:
            steps.append((start, speed))
    return steps


def ceiling_speed(table: Ceiling, position_m: Array) -> Array:
    """Ceiling speed at positions before the stop, m/s, shape of ``position_m``."""
    index = np.searchsorted(table.start_m, position_m, side="right") - 1
    start = np.where(np.isfinite(table.start_m), table.start_m, 0.0)
    square = table.square_m2ps2[index] + table.slope_mps2[index] * (position_m - start[index])
    speed: Array = np.sqrt(np.maximum(square, 0.0))
    return speed


@compiled
def square_at(position_m: float, piece: int, table: Ceiling) -> float:
    """v² of the ceiling at a position on a piece, m²/s²."""
    slope = table.slope_mps2[piece]
    if slope == 0.0:
        return float(table.square_m2ps2[piece])
    return float(table.square_m2ps2[piece] + slope * (position_m - table.start_m[piece]))
