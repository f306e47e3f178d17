"""On what a thing stands: on the bed between the rails, or on a surface level with them."""

from __future__ import annotations

import math

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

BED_M = -0.18
"""Height of sleepers and ballast against the rail tops, metres: a 60E1 rail is 172 mm high and lies
on a pad of 7 to 10 mm."""

BED_STD_M = 0.010
"""Rails of other sections: 49E1 is 149 mm high."""

SURFACE_STD_M = 0.012
UNSEEN = (-0.15, 0.06)
"""Height and standard deviation where what surrounds the foot is not known, metres."""

_BED, _SURFACE, _EMBEDDED, _RAISED = 1, 2, 3, 4
_KIND = np.zeros(256, np.uint8)
_KIND[[TRACKBED, TERRAIN, RAIL_TRACK]] = _BED
_KIND[[ROAD, SIDEWALK, TRAM_TRACK]] = _SURFACE
_KIND[RAIL_EMBEDDED], _KIND[RAIL_RAISED] = _EMBEDDED, _RAISED


def ground_level(
    labels: npt.NDArray[np.uint8] | None,
    foot_uv: tuple[float, float],
    metre_px: float,
    bed_std_m: float = BED_STD_M,
) -> tuple[float, float]:
    """Height of the ground at a foot against the rail tops, and its standard deviation, metres.

    Args:
        labels: Class ids, shape (H, W); None where there is no segmentation.
        foot_uv: Foot, input pixels.
        metre_px: Pixels per metre across the track at the foot.
        bed_std_m: Standard deviation of the bed's height, metres.
    """
    if labels is None:
        return UNSEEN
    level: tuple[float, float] = _level(labels, foot_uv, metre_px, bed_std_m)
    return level


def lying_level(
    labels: npt.NDArray[np.uint8],
    kind: int,
    box_xyxy: tuple[float, float, float, float],
    level_m: tuple[float, float],
) -> tuple[float, float]:
    """Height and deviation under a thing wider than the gauge: a trunk may lie across the rails.

    Args:
        labels: Class ids, shape (H, W).
        kind: Its class.
        box_xyxy: Its box, pixels, ends included.
        level_m: Height of the ground beside it against the rail tops and its deviation, metres.
    """
    left, top, right, bottom = (round(value) for value in box_xyxy)
    if right - left + 1 < 3.0 * thickness(labels, kind, (left, top, right, bottom)):
        return level_m
    return 0.5 * level_m[0], math.hypot(level_m[1], 0.3 * level_m[0])


@numba.njit(cache=True)
def _level(
    labels: npt.NDArray[np.uint8], foot_uv: tuple[float, float], metre_px: float, bed_std_m: float
) -> tuple[float, float]:
    height, width = labels.shape
    u, v = foot_uv[0], round(foot_uv[1])
    half = max(1.2 * metre_px, 3.0)
    first, last = max(0, round(u - half)), min(width, round(u + half) + 1)
    below = min(height, v + max(2, round(0.06 * metre_px)) + 1)
    count = np.zeros(5, np.int64)
    for row in range(max(0, min(v, height)), below):
        for column in range(first, last):
            count[_KIND[labels[row, column]]] += 1
    raised, embedded = count[_RAISED], count[_EMBEDDED]
    surface, bed = count[_SURFACE] + embedded, count[_BED] + raised
    if surface + bed < 4:
        return UNSEEN
    share = surface / (surface + bed)
    if raised + embedded >= 3 and (raised == 0 or embedded == 0):
        share = 1.0 if embedded else 0.0
    if share >= 0.75:
        return 0.0, SURFACE_STD_M
    if share <= 0.25:
        return BED_M, bed_std_m
    return 0.5 * BED_M, 0.5 * abs(BED_M)


@numba.njit(cache=True)
def thickness(
    labels: npt.NDArray[np.uint8], kind: int, box_xyxy: tuple[int, int, int, int]
) -> float:
    """How far a thing stands up from its lower edge, as a median over its columns, pixels.

    Branches that stand up from a trunk, or a wall that it joins in the picture, are not the trunk.

    Args:
        labels: Class ids, shape (H, W).
        kind: Its class.
        box_xyxy: Its box, pixels, ends included.
    """
    height, width = labels.shape
    left, top, right, bottom = box_xyxy
    runs = np.empty(max(0, right - left + 1))
    count = 0
    for u in range(max(0, left), min(width, right + 1)):
        v = min(height - 1, bottom)
        while v > max(0, top) and labels[v, u] != kind:
            v -= 1
        run = 0
        while v >= max(0, top) and labels[v, u] == kind:
            run, v = run + 1, v - 1
        if run > 0:
            runs[count] = run
            count += 1
    return np.median(runs[:count]) if count else np.inf
