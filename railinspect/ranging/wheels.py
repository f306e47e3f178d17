"""Where a vehicle stands: its wheels reach lower than the body between them."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

_LONGEST_M = 5.0
"""So far to either side of the foot a vehicle's wheels are looked for, metres."""

_BODY_M = 0.15
"""So far above its lower edge the body is unbroken from end to end, metres."""

_CLEAR_M = 0.45
"""Bodies end no higher than this above what the wheels stand on, metres."""


def wheels_row(
    labels: npt.NDArray[np.uint8], kind: int, foot_uv: tuple[float, float], metre_px: float
) -> float:
    """Row of the lowest pixels of a vehicle part of which stands in the clearance envelope.

    Args:
        labels: Class ids, uint8 (H, W).
        kind: The vehicle's class.
        foot_uv: Where its body ends inside the envelope, pixels.
        metre_px: Pixels per metre across the track at the foot, > 0.

    Returns:
        The boundary below the wheels, in pixels as ``foot_uv`` counts; the foot's own row where
        nothing of the vehicle lies below it.
    """
    return float(_lowest(labels, kind, foot_uv[0], foot_uv[1], float(metre_px)))


@numba.njit(cache=True)
def _lowest(labels: npt.NDArray[np.uint8], kind: int, u: float, v: float, metre: float) -> float:
    height, width = labels.shape
    foot = min(int(v), height - 1)
    reach = round(_LONGEST_M * metre)
    middle = min(max(round(u), 0), width - 1)
    edge = foot
    while edge > max(0, foot - round(_CLEAR_M * metre)) and labels[edge, middle] != kind:
        edge -= 1
    body = max(0, edge - max(1, round(_BODY_M * metre)))
    left = right = middle
    while left > max(0, middle - reach) and labels[body, left - 1] == kind:
        left -= 1
    while right < min(width - 1, middle + reach) and labels[body, right + 1] == kind:
        right += 1
    last = min(height - 1, foot + round(_CLEAR_M * metre))
    lowest = v
    for row in range(foot + 1, last + 1):
        count = 0
        for column in range(left, right + 1):
            if labels[row, column] == kind:
                count += 1
        if count < 2:
            break
        lowest = row + 0.5
    return lowest
