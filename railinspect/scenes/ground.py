"""Shading of everything that lies on the ground: terrain, bed, sleepers, rails, roads.

Each pixel's ray is cut with the rail-top surface and with the surface of the bed below it; the
track coordinates of both points decide what is seen.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from railinspect.labels import (
    RAIL_EMBEDDED,
    RAIL_RAISED,
    RAIL_TRACK,
    ROAD,
    TRACKBED,
    TRAM_TRACK,
)
from railinspect.scenes.noise import sample
from railinspect.scenes.rails import (
    LABEL_MIN_GAP_PX,
    RAIL_HEIGHT_M,
    displacement,
    overlap,
    shade_rail,
)
from railinspect.scenes.tables import (
    CROSS_B,
    CROSS_FAR,
    CROSS_G,
    CROSS_MARK,
    CROSS_NEAR,
    CROSS_R,
    LOOK_BED_B,
    LOOK_BED_G,
    LOOK_BED_GRAIN,
    LOOK_BED_R,
    LOOK_DAPPLE,
    LOOK_OIL,
    LOOK_SHADE_FROM,
    LOOK_SHADE_TO,
    LOOK_SHADOW,
    LOOK_SKY,
    LOOK_WEEDS,
    LOOK_WET,
    TRACK_BED_HALF,
    TRACK_EMBEDDED,
    TRACK_SLEEPER_B,
    TRACK_SLEEPER_G,
    TRACK_SLEEPER_HALF,
    TRACK_SLEEPER_PITCH,
    TRACK_SLEEPER_R,
    TRACK_SLEEPER_WIDTH,
    ZONE_B,
    ZONE_G,
    ZONE_GRAIN,
    ZONE_HIGH,
    ZONE_KIND,
    ZONE_LABEL,
    ZONE_LOW,
    ZONE_MARK,
    ZONE_R,
)

SLOPE_STEP = 2e-4
"""Resolution of the ray-slope table (tangent of the angle below the horizontal)."""

FAR_M = 1500.0
"""Ground beyond this distance belongs to the backdrop, metres."""


@njit(cache=True, inline="always", error_model="numpy")
def _across(offsets, k, index, part, left):  # type: ignore[no-untyped-def]  # compiled
    """Distance of a place from a track, square to it, NaN where it has none; its slant, its lean.

    A track may run aslant of the ego track, and in a junction it turns within a few metres.
    """
    low, high = offsets[k, index], offsets[k, index + 1]
    aslant = high - low
    lean = 1.0 / np.sqrt(1.0 + aslant * aslant)
    return (left - low - part * aslant) * lean, aslant, lean


@njit(cache=True, inline="always", error_model="numpy")
def _comb(at, width, pitch, tooth):  # type: ignore[no-untyped-def]  # compiled
    """Share of [at ± width/2] covered by teeth [0, tooth) repeated every ``pitch``."""
    if width > 6 * pitch:
        return tooth / pitch
    low = at - width / 2
    high = at + width / 2
    k = np.floor(low / pitch)
    whole_low = k * tooth + min(tooth, low - k * pitch)
    k = np.floor(high / pitch)
    whole_high = k * tooth + min(tooth, high - k * pitch)
    return (whole_high - whole_low) / width


@njit(cache=True, error_model="numpy")
def shade_ground(  # type: ignore[no-untyped-def]  # compiled; types are those of the tables
    rgb,
    labels,
    depth,
    rotation,
    focal,
    centre_u,
    centre_v,
    height,
    offset,
    reach_of_slope,
    plan,
    plan_start,
    plan_step,
    offsets,
    offsets_start,
    tracks,
    spacing,
    waves,
    zones,
    crossings,
    light,
    look,
    stack,
    chainage,
):
    """Shade every pixel whose ray meets the ground nearer than ``FAR_M``.

    Args:
        rgb: Output colours 0…255, float32, shape (H, W, 3).
        labels: Output class ids, uint8, shape (H, W).
        depth: Output distance ahead (camera axis), float32, shape (H, W); left alone elsewhere.
        rotation: Rotation from world to camera axes, shape (3, 3).
        focal: Focal length, px.
        centre_u: Principal point, px.
        centre_v: Principal point, px.
        height: Camera height above the rail tops, m.
        offset: Lateral camera position, m.
        reach_of_slope: Distance x at which a ray of slope i·SLOPE_STEP meets the rail tops, m.
        plan: Rows (y, heading, along) over x; shape (N, 3).
        plan_start: First x of ``plan``, m.
        plan_step: Step of ``plan``, m.
        offsets: Lateral offset of each track along the way, NaN where absent, shape (K, M).
        offsets_start: First position of ``offsets``, m; its step is 1 m.
        tracks: Per-track table, shape (K, 12); the first is the ego track.
        spacing: Distance of the two head centre lines, m.
        waves: Distortions of the ego rails, shape (N, 6).
        zones: Strips of ground along the track, shape (Z, 9).
        crossings: Roads across the track, shape (C, 6).
        light: Illumination along the way, same positions as ``offsets``, shape (M,).
        look: The scene's look vector, shape (16,).
        stack: Noise pyramids.
        chainage: The observer's chainage, m; anchors texture to the world.
    """
    rows, cols = labels.shape
    half_gauge = spacing / 2
    count = tracks.shape[0]
    cells = plan.shape[0]
    span = offsets.shape[1]
    lower = (height + RAIL_HEIGHT_M) / height
    for v in range(rows):
        down = (v - centre_v) / focal
        for u in range(cols):
            right = (u - centre_u) / focal
            dx = rotation[0, 0] * right + rotation[1, 0] * down + rotation[2, 0]
            dz = rotation[0, 2] * right + rotation[1, 2] * down + rotation[2, 2]
            if dz >= 0 or dx <= 0.05:
                continue
            slope = -dz / dx
            cell = slope / SLOPE_STEP
            index = int(cell)
            if index + 1 >= reach_of_slope.shape[0]:
                index = reach_of_slope.shape[0] - 2
                cell = index + 1.0
            x = reach_of_slope[index] + (cell - index) * (
                reach_of_slope[index + 1] - reach_of_slope[index]
            )
            if not x < FAR_M:
                continue
            dy = rotation[0, 1] * right + rotation[1, 1] * down + rotation[2, 1]
            aside = dy / dx

            # The rail-top surface …
            place = (x - plan_start) / plan_step
            index = min(max(int(place), 0), cells - 2)
            part = min(max(place - index, 0.0), 1.0)
            beyond = max(place - (cells - 1), 0.0) * plan_step
            heading = plan[index, 1] + part * (plan[index + 1, 1] - plan[index, 1])
            lateral = (
                offset + aside * x - plan[index, 0] - part * (plan[index + 1, 0] - plan[index, 0])
            ) - beyond * np.tan(heading)
            cos = np.cos(heading)
            sin = np.sin(heading)
            top_left = lateral * cos
            top_along = (
                plan[index, 2]
                + part * (plan[index + 1, 2] - plan[index, 2])
                + beyond / cos
                + lateral * sin
            )
            # … and the bed below it, a little further along the same ray.
            further = x * (lower - 1.0)
            bed_left = top_left + (aside * cos - sin) * further
            bed_along = top_along + (cos + aside * sin) * further

            pixel_x = x / focal
            pixel_along = x * x / (focal * height)
            across = pixel_along * abs(aside * cos - sin)
            width = np.sqrt(pixel_x * pixel_x + across * across)
            grain_px = np.sqrt(pixel_x * pixel_along)

            index = int(bed_along - offsets_start)
            index = min(max(index, 0), span - 2)
            shine_light = light[index]
            part = min(max(bed_along - offsets_start - index, 0.0), 1.0)
            top_index = min(max(int(top_along - offsets_start), 0), span - 2)
            top_part = min(max(top_along - offsets_start - top_index, 0.0), 1.0)

            flush = False
            crossing = -1
            for i in range(crossings.shape[0]):
                if crossings[i, CROSS_NEAR] <= top_along < crossings[i, CROSS_FAR]:
                    crossing = i
                    flush = True

            # Which track is nearest, and is the point on a bed?
            nearest = -1
            distance = 1e9
            top_distance = 1e9
            bed_cover = 0.0
            for k in range(count):
                bed, _, _ = _across(offsets, k, index, part, bed_left)
                if abs(bed) < abs(distance):  # NaN compares False
                    distance = bed
                    top_distance, _, _ = _across(offsets, k, top_index, top_part, top_left)
                    nearest = k
            if nearest >= 0 and tracks[nearest, TRACK_EMBEDDED] > 0:
                flush = True
            left = top_left if flush else bed_left
            along = top_along if flush else bed_along
            if flush:
                distance = top_distance
            texel = 1.0 / 0.022
            ta = (along + chainage) * texel
            tl = left * texel

            # Terrain by zone.
            zone = 0
            for i in range(zones.shape[0]):
                if zones[i, ZONE_LOW] <= left < zones[i, ZONE_HIGH]:
                    zone = i
            coarse = sample(stack, 2, ta * 0.035, tl * 0.035, grain_px * texel * 0.035)
            fine_kind = int(zones[zone, ZONE_KIND])
            fine = sample(stack, fine_kind, ta, tl, grain_px * texel)
            gain = 1.0 + 0.13 * coarse + zones[zone, ZONE_GRAIN] * fine
            r = zones[zone, ZONE_R] * gain
            g = zones[zone, ZONE_G] * gain
            b = zones[zone, ZONE_B] * gain
            label = int(zones[zone, ZONE_LABEL])
            if zones[zone, ZONE_MARK] > 0:
                middle = (zones[zone, ZONE_LOW] + zones[zone, ZONE_HIGH]) / 2
                paint = overlap(left, width, middle - 0.07, middle + 0.07)
                if zones[zone, ZONE_MARK] > 1:
                    paint *= _comb(along + chainage, pixel_along, 9.0, 4.0)
                for edge in (zones[zone, ZONE_LOW] + 0.25, zones[zone, ZONE_HIGH] - 0.25):
                    paint = max(paint, overlap(left, width, edge - 0.06, edge + 0.06))
                paint *= 0.85
                r += paint * (225 - r)
                g += paint * (225 - g)
                b += paint * (220 - b)

            if crossing >= 0:
                gain = 1.0 + 0.08 * coarse + 0.07 * fine
                r = crossings[crossing, CROSS_R] * gain
                g = crossings[crossing, CROSS_G] * gain
                b = crossings[crossing, CROSS_B] * gain
                label = ROAD
                if crossings[crossing, CROSS_MARK] > 0 and abs(left) > 3.0:
                    middle = (crossings[crossing, CROSS_NEAR] + crossings[crossing, CROSS_FAR]) / 2
                    paint = overlap(along, pixel_along, middle - 0.07, middle + 0.07)
                    r += paint * (225 - r)
                    g += paint * (225 - g)
                    b += paint * (220 - b)
                if nearest >= 0 and abs(distance) < half_gauge:
                    label = RAIL_TRACK if crossings[crossing, CROSS_MARK] < 0 else ROAD
            elif nearest >= 0 and tracks[nearest, TRACK_EMBEDDED] > 0:
                inside = abs(distance) < half_gauge
                if inside:
                    label = TRAM_TRACK
                if tracks[nearest, TRACK_EMBEDDED] > 1 and abs(distance) < half_gauge + 0.5:
                    # paved or concrete strip along the rails, with joints
                    joint = _comb(along + chainage, pixel_along, 6.0, 0.05)
                    gain = (1.0 + 0.06 * coarse + 0.06 * fine) * (1.0 - 0.4 * joint)
                    r = tracks[nearest, TRACK_SLEEPER_R] * gain
                    g = tracks[nearest, TRACK_SLEEPER_G] * gain
                    b = tracks[nearest, TRACK_SLEEPER_B] * gain
            elif nearest >= 0:
                if abs(distance) < tracks[nearest, TRACK_BED_HALF]:
                    label = RAIL_TRACK if abs(distance) < half_gauge else TRACKBED
                edge = tracks[nearest, TRACK_BED_HALF] + 0.25 * fine + 0.2 * coarse
                bed_cover = min(max((edge - abs(distance)) / (0.15 + width) + 0.5, 0.0), 1.0)
                if bed_cover > 0:
                    stone = fine if fine_kind == 0 else sample(stack, 0, ta, tl, grain_px * texel)
                    gain = 1.0 + look[LOOK_BED_GRAIN] * stone + 0.10 * coarse
                    br = look[LOOK_BED_R] * gain
                    bg = look[LOOK_BED_G] * gain
                    bb = look[LOOK_BED_B] * gain
                    # oil and brake dust darken the middle of the track
                    dirt = 1.0 - look[LOOK_OIL] * np.exp(-((distance / 0.5) ** 2))
                    br *= dirt
                    bg *= dirt
                    bb *= dirt
                    weed = look[LOOK_WEEDS] * 2.2 + coarse * 0.9 + fine * 0.3 - 1.6
                    if weed > 0:
                        weed = min(weed, 0.9)
                        br += weed * (zones[0, ZONE_R] * (0.85 + 0.2 * fine) - br)
                        bg += weed * (zones[0, ZONE_G] * (0.85 + 0.2 * fine) - bg)
                        bb += weed * (zones[0, ZONE_B] * (0.85 + 0.2 * fine) - bb)
                    pitch = tracks[nearest, TRACK_SLEEPER_PITCH]
                    if pitch > 0:
                        cover = _comb(
                            along + chainage,
                            pixel_along,
                            pitch,
                            tracks[nearest, TRACK_SLEEPER_WIDTH],
                        ) * min(
                            max(
                                (tracks[nearest, TRACK_SLEEPER_HALF] - abs(distance))
                                / (0.02 + width)
                                + 0.5,
                                0.0,
                            ),
                            1.0,
                        )
                        if weed > 0:
                            cover *= 1.0 - weed
                        gain = 1.0 + 0.10 * stone + 0.08 * coarse
                        br += cover * (tracks[nearest, TRACK_SLEEPER_R] * gain * dirt - br)
                        bg += cover * (tracks[nearest, TRACK_SLEEPER_G] * gain * dirt - bg)
                        bb += cover * (tracks[nearest, TRACK_SLEEPER_B] * gain * dirt - bb)
                    r += bed_cover * (br - r)
                    g += bed_cover * (bg - g)
                    b += bed_cover * (bb - b)

            # Wet ground mirrors the sky, most at a grazing view and in puddles.
            if look[LOOK_WET] > 0:
                mirror = look[LOOK_WET] * min(1.0, 0.25 + x * 0.02)
                mirror *= min(max(0.35 + 0.5 * coarse, 0.0), 0.85)
                r += mirror * (look[LOOK_SKY] - r)
                g += mirror * (look[LOOK_SKY] - g)
                b += mirror * (look[LOOK_SKY] - b)

            # Rails: every track whose heads can show in this pixel.
            for k in range(count):
                # Where the ray meets both surfaces and its pixel's footprint, square to this track.
                bed, _, _ = _across(offsets, k, index, part, bed_left)
                top, aslant, lean = _across(offsets, k, top_index, top_part, top_left)
                if np.isnan(bed) or np.isnan(top):
                    continue
                over = pixel_along * abs(aside * cos - sin - aslant * (cos + aside * sin))
                wide = np.sqrt(pixel_x * pixel_x + over * over) * lean
                if abs(top) > spacing + 0.8 + 2 * wide:
                    continue
                for side in (1.0, -1.0):
                    rail = side * half_gauge
                    if k == 0:
                        rail += displacement(waves, top_along, side)
                    r, g, b, labelled = shade_rail(
                        r, g, b, side, rail, top, bed, wide, flush, k == 0, tracks[k], look
                    )
                    if labelled and spacing >= LABEL_MIN_GAP_PX * wide:
                        label = RAIL_EMBEDDED if flush else RAIL_RAISED

            # Illumination: tunnels and shadows.
            shade = shine_light
            if look[LOOK_DAPPLE] > 0:
                patch = (
                    sample(stack, 2, ta * 0.02 + 77.0, tl * 0.045 + 31.0, grain_px * texel * 0.045)
                    + 0.35 * fine
                )
                dark = min(max(patch * 2.0 + look[LOOK_DAPPLE] * 3.0 - 2.0, 0.0), 1.0)
                shade *= 1.0 - 0.55 * look[LOOK_SHADOW] * dark
            if look[LOOK_SHADE_FROM] < look[LOOK_SHADE_TO]:
                wobble = 0.25 * coarse
                inside = min(
                    max((left - look[LOOK_SHADE_FROM] + wobble) / (0.1 + width) + 0.5, 0.0), 1.0
                ) * min(max((look[LOOK_SHADE_TO] - left + wobble) / (0.1 + width) + 0.5, 0.0), 1.0)
                shade *= 1.0 - 0.6 * look[LOOK_SHADOW] * inside
            rgb[v, u, 0] = r * shade
            rgb[v, u, 1] = g * shade
            rgb[v, u, 2] = b * shade
            labels[v, u] = label
            lower_ground = not flush and label != RAIL_RAISED
            depth[v, u] = (x + further if lower_ground else x) * (
                rotation[2, 0] + rotation[2, 1] * aside - rotation[2, 2] * slope
            )
