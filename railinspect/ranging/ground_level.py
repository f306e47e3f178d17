"""On what a thing stands: on the bed between the rails, or on a surface level with them."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from railinspect.labels import (
    RAIL_EMBEDDED,
    RAIL_RAISED,
    RAIL_TRACK,
    ROAD,
    SIDEWALK,
    TERRAIN,
    TRACKBED,
    TRAM_TRACK,
)

BED_M = -0.17
"""Height of sleepers and ballast against the rail tops, metres: a 60E1 rail is 172 mm high."""

BED_STD_M = 0.010
SURFACE_STD_M = 0.012
UNSEEN = (-0.15, 0.06)
"""Height and standard deviation where what surrounds the foot is not known, metres."""

_SURFACE = np.array([ROAD, SIDEWALK, TRAM_TRACK, RAIL_EMBEDDED])
_BED = np.array([TRACKBED, TERRAIN, RAIL_RAISED, RAIL_TRACK])


def ground_level(
    labels: npt.NDArray[np.uint8] | None, foot_uv: npt.NDArray[np.float64], metre_px: float
) -> tuple[float, float]:
    """Height of the ground at a foot against the rail tops, and its standard deviation, metres.

    Args:
        labels: Class ids, shape (H, W); None where there is no segmentation.
        foot_uv: Foot, input pixels, shape (2,).
        metre_px: Pixels per metre across the track at the foot.
    """
    if labels is None:
        return UNSEEN
    height, width = labels.shape
    u, v = float(foot_uv[0]), round(float(foot_uv[1]))
    half = max(1.2 * metre_px, 3.0)
    first, last = max(0, round(u - half)), min(width, round(u + half) + 1)
    below = min(height, v + max(2, round(0.06 * metre_px)) + 1)
    count = class_counts(labels, max(0, min(v, height)), below, first, last)
    raised, embedded = int(count[RAIL_RAISED]), int(count[RAIL_EMBEDDED])
    surface, bed = int(count[_SURFACE].sum()), int(count[_BED].sum())
    if surface + bed < 4:
        return UNSEEN
    share = surface / (surface + bed)
    if raised + embedded >= 3 and (raised == 0 or embedded == 0):
        share = 1.0 if embedded else 0.0
    if share >= 0.75:
        return 0.0, SURFACE_STD_M
    if share <= 0.25:
        return BED_M, BED_STD_M
    return 0.5 * BED_M, 0.5 * abs(BED_M)


@numba.njit(cache=True)
def class_counts(
    labels: npt.NDArray[np.uint8], top: int, bottom: int, left: int, right: int
) -> npt.NDArray[np.int64]:
    """Pixels of each class in rows top … bottom and columns left … right, ends excluded; (256,)."""
    count = np.zeros(256, np.int64)
    for v in range(top, bottom):
        for u in range(left, right):
            count[labels[v, u]] += 1
    return count
