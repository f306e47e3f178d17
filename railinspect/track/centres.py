"""Where exactly each rail lies: sub-pixel centres along a grown track, row by row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.growing import HALF, PSI, Growth, X, Y
from railinspect.track.level import Level, bilinear, blend, inside, project, sample_line, x_at
from railinspect.track.settings import FollowerSettings

Array = npt.NDArray[np.float64]

_PROFILE = 161


@dataclass(frozen=True)
class Centres:
    """Rail centres measured along the path, bottom to top, one entry per sampled row.

    Attributes:
        path: x, y (m), heading (rad), half spacing (m) of the path, shape (M, 4).
        offset_m: Distance of each rail (left, right) from its place on the path, metres,
            positive to the left, shape (M, 2).
        peak: Rail probability at the centre, 0..1; −1 outside the image. Shape (M, 2).
        width_px: Width of the run at half its height, pixels, shape (M, 2).
        other: Height of a second run beside it, relative to the first, 0..1, shape (M, 2).
        between: Mean rail probability at three places between the rails, 0..1, shape (M,).
        beside: Highest rail probability close beside the rails, 0..1: another track's rail at a
            switch or crossing. Shape (M,).
        metre_px: Pixels per metre across the track, shape (M,).
        uv: Pixel of each rail's centre (of its place on the path where unseen), (M, 2, 2).
    """

    path: Array
    offset_m: Array
    peak: Array
    width_px: Array
    other: Array
    between: Array
    beside: Array
    metre_px: Array
    uv: Array


@numba.njit(cache=True)
def _nearest_run(profile: Array, size: int, expected: float, count: int) -> int:
    """The top of the run nearest to ``expected`` among those at least half as high as any."""
    most = 0.0
    for k in range(size):
        most = max(most, profile[k])
    at, nearest = count, 1e9
    for k in range(size):
        value = profile[k]
        if value < 0.5 * most:
            continue
        if (k > 0 and value < profile[k - 1]) or (k < size - 1 and value < profile[k + 1]):
            continue
        # The tie goes to the middle, the same for both hands; a higher run may lie a little off.
        away = abs(k - expected) + 1e-6 * abs(k - count) + 4.0 * (1.0 - value / (most + 1e-9))
        if away < nearest - 1e-9:
            at, nearest = k, away
    return at


@numba.njit(cache=True)
def _path(cam: Array, rows: Array, nodes: Array) -> Array:
    """Path between grown nodes, straight before the first, in rows below the horizon, (M, 4)."""
    path, near = np.empty((len(rows), 4)), nodes[0]
    for i in range(len(rows)):
        path[i, 0] = x_at(cam, rows[i])
    for to, column in ((1, Y), (2, PSI), (3, HALF)):
        path[:, to] = np.interp(path[:, 0], nodes[:, X], nodes[:, column])
    for i in range(len(rows)):
        if path[i, 0] < near[X]:
            path[i, 1] = near[Y] + (path[i, 0] - near[X]) * math.tan(near[PSI])
    return path


@numba.njit(cache=True)
def _beside(
    score: npt.NDArray[np.uint8],
    u: float,
    v: float,
    du: float,
    dv: float,
    spacing: float,
    keep_off: float,
    reach: float,
    apart: float,
) -> float:
    """Another rail: the highest probability up to ``reach`` beside one of ours, but not at it.

    Looked for every ``apart`` pixels to both sides of both rails, which lie half of ``spacing`` to
    either side of (u, v) along (du, dv).
    """
    rows, cols = score.shape
    highest, far = 0.0, 0.5 * spacing + reach
    for i in range(int(2.0 * far / apart) + 1):
        along = i * apart - far
        if not keep_off < abs(abs(along) - 0.5 * spacing) <= reach:
            continue
        at_u, at_v = u + along * du, v + along * dv
        if inside(rows, cols, at_u, at_v):  # written out: a call per place takes longer
            c, r = int(at_u), int(at_v)
            c1, r1 = min(c + 1, cols - 1), min(r + 1, rows - 1)
            highest = max(highest, blend(score, at_u, at_v, c, r, c1, r1))
    return highest / 255.0


@numba.njit(cache=True)
def _measure(
    score: npt.NDArray[np.uint8],
    cam: Array,
    path: Array,
    step: float,
    least_px: float,
    reach_m: float,
    low: float,
    aside_m: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """Everything of :class:`Centres` but the path, in its order."""
    rows = len(path)
    image_rows, image_cols = score.shape
    offset, peak, width, other = (
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
    )
    between, aside, metre_px = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    uv = np.zeros((rows, 2, 2))
    raw, profile = np.zeros(_PROFILE + 2), np.zeros(_PROFILE)
    before = np.zeros(2)  # each rail's offset one row nearer, metres
    for i in range(path.shape[0]):
        x, y, psi, half = path[i, 0], path[i, 1], path[i, 2], path[i, 3]
        nx, ny = -math.sin(psi), math.cos(psi)
        ul, vl = project(cam, x + half * nx, y + half * ny)
        ur, vr = project(cam, x - half * nx, y - half * ny)
        spacing = math.hypot(ul - ur, vl - vr)
        metre = spacing / (2.0 * half)
        metre_px[i] = metre
        for k in range(3):
            t = 0.25 + 0.25 * k
            ground = bilinear(score, ul + t * (ur - ul), vl + t * (vr - vl))
            between[i] += max(0.0, ground) / (3.0 * 255.0)
        du, dv = (ul - ur) / spacing, (vl - vr) / spacing  # towards the left
        if spacing > 40.0 * step:
            um, vm = 0.5 * (ul + ur), 0.5 * (vl + vr)
            keep_off = max(0.45 * metre, 8.0 * step)
            aside[i] = _beside(
                score, um, vm, du, dv, spacing, keep_off, aside_m * metre, 3.0 * step
            )
        for rail in range(2):
            u, v = (ul, vl) if rail == 0 else (ur, vr)
            reach = min(max(least_px, reach_m * metre), 0.4 * spacing)
            count = min(_PROFILE // 2, math.ceil(reach / step))
            uv[i, rail, 0], uv[i, rail, 1] = u, v
            if not inside(image_rows, image_cols, u, v):
                peak[i, rail] = -1.0
                continue
            size = 2 * count + 1
            sample_line(score, u, v, du, dv, -count, 1.0 / step, raw[1 : size + 1])
            raw[0], raw[size + 1] = raw[1], raw[size]
            for k in range(size):
                profile[k] = (raw[k] + 2 * raw[k + 1] + raw[k + 2]) / 4
            # At a switch two rails lie in reach and either may be the brighter one: take the run
            # nearest to where the rail is expected, half-way between path and last row.
            expected = count + 0.5 * before[rail] * metre / step
            at = _nearest_run(profile, size, expected, count)
            high = profile[at]
            before[rail] *= 0.8
            if high < low:
                peak[i, rail] = high
                continue
            first, last = at, at
            while first > 0 and profile[first - 1] >= 0.5 * high:
                first -= 1
            while last < size - 1 and profile[last + 1] >= 0.5 * high:
                last += 1
            total, moment = 0.0, 0.0
            for k in range(first, last + 1):
                weight = profile[k] - 0.45 * high
                total += weight
                moment += weight * (k - count)
            shift = moment / total * step
            beside = 0.0
            for k in range(size):
                if (k < first - 3 or k > last + 3) and profile[k] > beside:
                    beside = profile[k]
            offset[i, rail] = before[rail] = shift / metre
            peak[i, rail] = high
            width[i, rail] = (last - first + 1) * step
            other[i, rail] = beside / high
            uv[i, rail, 0], uv[i, rail, 1] = u + shift * du, v + shift * dv
    return offset, peak, width, other, between, aside, metre_px, uv


def measure_centres(
    score: npt.NDArray[np.uint8],
    level: Level,
    growth: Growth,
    s_first_px: float,
    settings: FollowerSettings,
) -> Centres:
    """Measure both rails' centres along a grown track, at least one sample per image row.

    Args:
        score: Soft rail probability, shape (H, W).
        level: Levelled view with this frame's horizon.
        growth: A growth with at least two nodes up to the last sight.
        s_first_px: Rows below the horizon of the image's bottom.
        settings: Tuning.
    """
    scale = score.shape[1] / 640.0
    nodes = growth.nodes[: growth.last]
    rows = np.arange(s_first_px, nodes[-1, 0] - 0.5, -max(1.0, score.shape[0] / 540.0))
    path = _path(level.vector, rows, nodes)
    measured = _measure(
        score,
        level.vector,
        path,
        0.5 * scale,
        3.0 * scale,
        settings.fine_reach_m,
        settings.low,
        settings.switch_m,
    )
    return Centres(path, *measured)
