"""Rails as they are drawn and labelled in one pixel: shadow, foot, web, head, running band.

Thin things are filtered analytically over the pixel's footprint, so a rail 0.1 px wide darkens or
brightens its pixel by a tenth.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from railinspect.labels import RAIL_HEAD_WIDTH_M
from railinspect.scenes.tables import (
    LOOK_RUST_B,
    LOOK_RUST_G,
    LOOK_RUST_R,
    LOOK_SHADOW,
    LOOK_SUN_SIDE,
    TRACK_HEAD_B,
    TRACK_HEAD_G,
    TRACK_HEAD_R,
    TRACK_SHINE,
    WAVE_AMPLITUDE,
    WAVE_LEFT,
    WAVE_LENGTH,
    WAVE_PERIOD,
    WAVE_RIGHT,
    WAVE_START,
)

RAIL_HEIGHT_M = 0.17
"""Height of the rail tops above the sleepers, metres."""

RAIL_SIDE_M = 0.045
"""Height of the head's side face, metres: below it the web lies back in the head's shadow."""

RAIL_FOOT_M = 0.14
"""Depth below the rail top at which the foot begins, metres."""

RAIL_WEB_HALF_M, RAIL_FOOT_HALF_M = 0.009, 0.072
"""Half the width of the web and of the foot, metres."""

LABEL_MIN_HALF_PX = 1.0
"""Half the least width at which a rail is labelled, pixels (the head's own width when wider)."""

LABEL_MIN_GAP_PX = 1.0
"""Least distance of a track's two rails, pixels, at which they are labelled: beyond it nobody sees
that there are two, as where a curve's far end lies along the horizon."""


@njit(cache=True, error_model="numpy")
def displacement(waves, along, side):  # type: ignore[no-untyped-def]  # compiled for each type
    """Lateral displacement of an ego rail by the planted distortions, metres.

    A distortion of ``WAVE_PERIOD`` > 0 is a ripple A·sin(2π s/λ) under a sin² window; one of
    period 0 is a single bulge A·sin²(π s/L) (a buckle).

    Args:
        waves: Table of distortions, shape (N, 6); chainages as in ``along``.
        along: Position along the track, metres.
        side: +1 for the left rail, -1 for the right.
    """
    total = 0.0
    for i in range(waves.shape[0]):
        into = along - waves[i, WAVE_START]
        length = waves[i, WAVE_LENGTH]
        if 0.0 < into < length:
            window = np.sin(np.pi * into / length)
            share = waves[i, WAVE_LEFT] if side > 0 else waves[i, WAVE_RIGHT]
            period = waves[i, WAVE_PERIOD]
            if period > 0:
                total += (
                    share * waves[i, WAVE_AMPLITUDE] * window * np.sin(2 * np.pi * into / period)
                )
            else:
                total += share * waves[i, WAVE_AMPLITUDE] * window * window
    return total


@njit(cache=True, inline="always", error_model="numpy")
def overlap(centre, width, low, high):  # type: ignore[no-untyped-def]  # compiled
    """Share of [centre ± width/2] that lies within [low, high]."""
    left = max(centre - width / 2, low)
    right = min(centre + width / 2, high)
    return max(0.0, right - left) / width


@njit(cache=True, inline="always", error_model="numpy")
def _flank(top, bed, width, low, high, middle, half):  # type: ignore[no-untyped-def]  # compiled
    """Share of a pixel in which a ray meets a bar ``middle`` ± ``half`` at depths low … high.

    The ray crosses the rail-top surface at ``top`` and the bed, ``RAIL_HEIGHT_M`` below, at
    ``bed``. Sideways it sweeps what lies between, widened by the pixel's footprint.
    """
    start = top + (bed - top) * (low / RAIL_HEIGHT_M)
    end = top + (bed - top) * (high / RAIL_HEIGHT_M)
    left = min(start, end) - width / 2
    right = max(start, end) + width / 2
    seen = min(right, middle + half) - max(left, middle - half)
    if seen <= 0:
        return 0.0
    cover = min(1.0, seen / min(2 * half, right - left))
    return cover * min(1.0, 2 * half / width + 0.15)


@njit(cache=True, inline="always", error_model="numpy")
def shade_rail(  # type: ignore[no-untyped-def]  # compiled
    r, g, b, side, rail, top, bed, wide, embedded, ego, track, look
):
    """Colour of a pixel once one rail is drawn into it, and whether the pixel is labelled rail.

    Args:
        r: Colour of the ground there.
        g: The same.
        b: The same.
        side: +1 for the left rail of its track, -1 for the right.
        rail: Place of the rail across its track, metres.
        top: Where the pixel's ray crosses the rail-top surface, across the track, metres.
        bed: Where it crosses the bed.
        wide: Width of the pixel's footprint across the track, metres.
        embedded: Whether the rail lies flush in a surface.
        ego: Whether it is one of our own.
        track: The track's row of its table.
        look: The scene's look vector.
    """
    half_head = RAIL_HEAD_WIDTH_M / 2
    if not embedded:
        # cast shadow on the bed, away from the sun
        sun = look[LOOK_SUN_SIDE]
        near = rail - sun * half_head
        far = near - sun * RAIL_HEIGHT_M * 1.2
        cover = overlap(bed, wide, min(near, far), max(near, far))
        cover *= look[LOOK_SHADOW] * 0.6
        r *= 1 - cover
        g *= 1 - cover
        b *= 1 - cover
        # the flank, from the foot up: what lies higher hides what lies lower
        side_light = 0.75 if sun * (rail - bed) > 0 else 0.5
        for deep, deeper, half, gain in (
            (RAIL_FOOT_M, RAIL_HEIGHT_M, RAIL_FOOT_HALF_M, 1.15),
            (RAIL_SIDE_M, RAIL_FOOT_M, RAIL_WEB_HALF_M, 0.55),
            (0.0, RAIL_SIDE_M, half_head, 1.25),
        ):
            cover = _flank(top, bed, wide, deep, deeper, rail, half)
            if cover > 0:
                gain *= side_light
                r += cover * (look[LOOK_RUST_R] * gain - r)
                g += cover * (look[LOOK_RUST_G] * gain - g)
                b += cover * (look[LOOK_RUST_B] * gain - b)
    else:
        # flange groove on the inside of an embedded rail
        groove = rail - side * (half_head + 0.03)
        cover = 0.75 * overlap(top, wide, groove - 0.03, groove + 0.03)
        r *= 1 - cover
        g *= 1 - cover
        b *= 1 - cover
    cover = overlap(top, wide, rail - half_head, rail + half_head)
    if cover > 0:
        r += cover * (track[TRACK_HEAD_R] * 0.62 - r)
        g += cover * (track[TRACK_HEAD_G] * 0.62 - g)
        b += cover * (track[TRACK_HEAD_B] * 0.62 - b)
        inner = rail - side * 0.008
        cover = overlap(top, wide, inner - 0.024, inner + 0.024)
        cover *= track[TRACK_SHINE]
        r += cover * (track[TRACK_HEAD_R] - r)
        g += cover * (track[TRACK_HEAD_G] - g)
        b += cover * (track[TRACK_HEAD_B] - b)
    # The label is the head as it is seen: of other tracks its side face too. The ego rails are seen
    # from above; theirs is the top alone, which gauge and range are measured on.
    side_seen = 0.0
    if not ego and not embedded:
        side_seen = (bed - top) * (RAIL_SIDE_M / RAIL_HEIGHT_M)
    half_label = max(half_head + abs(side_seen) / 2, LABEL_MIN_HALF_PX * wide)
    return r, g, b, abs(top - rail + side_seen / 2) <= half_label
