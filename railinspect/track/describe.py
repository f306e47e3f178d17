"""From grown nodes and measured centres to the geometry that leaves the room."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numba
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.track import growing
from railinspect.track.bends import bent_stretch, comes_back, stands_out, upright
from railinspect.track.centres import Centres
from railinspect.track.geometry import Gap, RailProfile, TrackPath
from railinspect.track.growing import Growth
from railinspect.track.level import Level, pixel
from railinspect.track.settings import FollowerSettings
from railinspect.track.smooth import SmoothTrack, fit_smooth

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]
Image = npt.NDArray[np.uint8]

STOPS = {
    growing.NO_BEGIN: "no pair of rails begins at the bottom of the image",
    growing.LOST: "both rails end",
    growing.ONE_RAIL: "one rail ends",
    growing.MERGED: "the rails can no longer be told apart",
    growing.HORIZON: "the horizon is reached",
    growing.TURNED: "the track turns out of the view",
    growing.OUTSIDE: "the track leaves the image",
    growing.FAR: "the farthest range looked at is reached",
    growing.FULL: "the growing took too many steps",
}


_FIT_STEP_M = 0.3

_BEFORE = np.linspace(0.0, 1.0, 9)[:-1]
"""Samples of the stretch from the camera to the first sight, as shares of it."""

_BEYOND = np.linspace(0.0, 1.0, 24)
"""Samples of the stretch beyond the last sight, as shares of its logarithm."""

_SIDES = np.array([1.0, -1.0])
"""Sign of the left and the right rail's distance from the centre line."""

_LEFT_OUT = 20.0
"""Factor on the standard deviation of what is left out of a fit."""

_OTHER_RAIL_M = 0.08
"""What a measured place may be off at a switch before the smooth track's is drawn instead."""


@dataclass(frozen=True)
class Description:
    """Everything measured along one track.

    Attributes:
        camera: Camera whose world frame the path is in.
        path: Centre line.
        profile: Rails against the smooth track.
        left_uv: Left polyline, top to bottom.
        right_uv: Right polyline, top to bottom.
        gaps: Missing stretches.
        reach_m: Chainage of the last sight.
        rows: Share of the rows between bottom and horizon the track spans.
        cover: Share of those rows in which each rail was seen, the poorer rail's.
        contrast: Mean rail probability on the rails less that between them.
        at_switch: Another track's rail lies close beside one of ours somewhere.
    """

    camera: Camera
    path: TrackPath
    profile: RailProfile
    left_uv: Array
    right_uv: Array
    gaps: tuple[Gap, ...]
    reach_m: float
    rows: float
    cover: float
    contrast: float
    at_switch: bool


def describe(
    score: Image,
    level: Level,
    growth: Growth,
    centres: Centres,
    s_first_px: float,
    settings: FollowerSettings,
    calibrated: bool,
) -> Description | None:
    """Fit the smooth track to the measured centres and put everything in the world frame.

    Args:
        score: Soft rail probability, shape (H, W).
        level: Levelled view of this frame.
        growth: Grown nodes.
        centres: Rail centres along them.
        s_first_px: Rows below the horizon of the image's bottom.
        settings: Tuning.
        calibrated: Whether the focal length is known.

    Returns:
        The description, or None where too few centres were seen to fit a track.
    """
    scale = level.camera.size_wh[0] / 640.0
    seen = centres.peak >= settings.low
    if min(np.count_nonzero(seen[:, 0]), np.count_nonzero(seen[:, 1])) < 6:
        return None
    doubtful = _doubtful(centres.uv, seen, centres.metre_px, centres.other, centres.width_px, scale)
    switch = _switch(centres, settings)
    unsure = doubtful | switch[:, None]
    smooth, residual = _smooth(level, centres, seen, unsure, scale, settings.stiffness(calibrated))
    path_x = centres.path[:, 0]
    # World frame: along the track under the camera, continued there with its nearest curvature.
    y_under, slope_under, _ = smooth.along(np.zeros(1))
    heading0, y0 = math.atan(float(slope_under[0])), float(y_under[0])
    offset = -y0 * math.cos(heading0)
    camera = replace(level.camera, pitch_rad=level.pitch_rad, yaw_rad=-heading0, offset_m=offset)
    path, places = _path(level, growth, smooth, path_x, heading0, offset)
    m = len(path_x)
    metre = centres.metre_px
    noise = _noise_px(residual * metre[:, None], seen & ~unsure, 0.3 * scale)
    profile = RailProfile(
        path.chainage_m[:m],
        residual,
        metre,
        centres.peak,
        _probability(score, places[:, :m]),
        doubtful,
        switch,
        centres.uv,
        noise,
    )
    off = np.abs(residual)  # NaN compares False
    # What lies off the smooth track beside another rail is that other rail.
    other = unsure & (off * metre[:, None] > 2.0 * scale) & (off > _OTHER_RAIL_M)
    left, right = _polylines(level.camera, centres, places, seen & ~other)
    rows = float((s_first_px - growth.nodes[growth.last - 1, 0]) / s_first_px)
    inside = centres.peak >= 0
    cover = min(
        float(np.count_nonzero(seen[:, i])) / max(1, int(np.count_nonzero(inside[:, i])))
        for i in range(2)
    )
    gaps = _gaps(path, seen, inside, centres, growth, scale)
    reach = float(path.chainage_m[:m][seen.any(axis=1)].max())
    return Description(
        camera,
        path,
        profile,
        left,
        right,
        gaps,
        reach,
        rows,
        cover,
        _contrast(growth, centres),
        bool(switch.any()),
    )


@numba.njit(cache=True)
def _probability(score: Image, places: Array) -> Array:
    """Rail probability at places (2, M, 2) of both rails; 0 outside the image. Shape (M, 2)."""
    height, width = score.shape
    found = np.zeros((places.shape[1], 2))
    for i in range(len(found)):
        for rail in range(2):
            u, v = places[rail, i, 0], places[rail, i, 1]
            if -0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5:
                found[i, rail] = score[round(v), round(u)] / 255.0
    return found


@numba.njit(cache=True)
def _doubtful(
    uv: Array, seen: Bools, metre_px: Array, other: Array, width_px: Array, scale: float
) -> Bools:
    """Samples beside which something else looks like a rail, and their neighbours.

    A rail that runs aslant through the image, as in a curve or a ripple, is wide along the row:
    only what is wider than its own slant explains is doubtful.
    """
    rows = len(uv)
    doubtful = np.zeros((rows, 2), np.bool_)
    for i in range(rows):
        for rail in range(2):
            slant = 1.0
            for reach in (1, 2):  # a short wave's slant shows over one row, a jagged mask's over 2
                before, after = i - reach, i + reach
                if before >= 0 and after < rows and seen[before, rail] and seen[after, rail]:
                    du = uv[after, rail, 0] - uv[before, rail, 0]
                    dv = uv[after, rail, 1] - uv[before, rail, 1]
                    slant = max(slant, math.hypot(du, dv) / (abs(dv) + 0.1))
            expected = max(2.5 * scale, 0.11 * metre_px[i]) * min(slant, 12.0)
            if other[i, rail] > 0.45 or width_px[i, rail] > 2.0 * expected + 1.5 * scale:
                doubtful[max(0, i - 2) : i + 3, rail] = True
    return doubtful


def _switch(centres: Centres, settings: FollowerSettings) -> Bools:
    """Samples at or near a place where another track's rail lies close beside one of ours."""
    other = centres.beside >= settings.switch_score
    kept = other[2:] & other[1:-1] & other[:-2]
    x = centres.path[:, 0]
    near = np.zeros(len(x), bool)
    for place in x[1:-1][kept][::3]:
        near |= np.abs(x - place) <= settings.switch_reach_m
    return near


def _contrast(growth: Growth, centres: Centres) -> float:
    """Mean probability of the windows' rails, less that of the ground between them.

    Window means and not single rows' peaks: in pure noise every row has a peak somewhere.
    """
    rails = growth.nodes[: growth.last, [growing.LEFT, growing.RIGHT]]
    return float(rails[rails > 0].mean() - centres.between.mean())


def _smooth(
    level: Level,
    centres: Centres,
    seen: Bools,
    doubtful: Bools,
    scale: float,
    stiffness: tuple[float, float],
) -> tuple[SmoothTrack, Array]:
    """The smooth track through the seen centres, and each rail's residual across it, metres."""
    x = centres.path[:, 0]
    rail_x, rail_y, (x_m, y_m, side, sigma_m), of_row, sigma, start = _samples(
        centres.path, centres.offset_m, centres.metre_px, seen, doubtful, scale
    )

    def fit(sigma_m: Array) -> tuple[SmoothTrack, Array]:
        smooth = fit_smooth(x_m, y_m, side, sigma_m, start, *stiffness)
        centre, slope, spread = (at.reshape(rail_x.shape) for at in smooth.along(rail_x.ravel()))
        lean = np.sqrt(1.0 + slope**2)
        model = centre + _SIDES * spread * lean
        return smooth, np.where(seen, (rail_y - model) / lean, np.nan)

    smooth, residual = fit(sigma_m)
    sure: Bools = np.all(seen & ~doubtful, axis=1)
    common = 0.5 * (residual[:, 0] + residual[:, 1])
    middle = 0.5 * (centres.uv[:, 0] + centres.uv[:, 1])
    across_px = centres.metre_px * upright(middle)  # pixels per metre across
    if not stands_out(common * across_px, sure, scale):
        return smooth, residual
    noise = _noise_px(residual * centres.metre_px[:, None], seen & ~doubtful, 0.3 * scale)
    noise /= 0.7 * scale
    first = np.flatnonzero(np.isfinite(sigma))
    bent = bent_stretch(
        smooth, x[first], common[first], sigma[first], sure[first], *stiffness, noise
    )
    if bent is None:
        return smooth, residual
    inside = (x >= bent[0]) & (x <= bent[1])
    straight, left_over = fit(np.where(inside[of_row], _LEFT_OUT, 1.0) * sigma_m)
    if comes_back(left_over.mean(axis=1) * across_px, sure, inside, scale):
        return straight, left_over
    return smooth, residual


@numba.njit(cache=True)
def _samples(
    path: Array, offset_m: Array, metre_px: Array, seen: Bools, doubtful: Bools, scale: float
) -> tuple[Array, Array, Array, Indices, Array, float]:
    """Places of all centres, each (M, 2); x, y, side and deviation of those to fit, (4, N).

    And the row of each of those, (N,); the deviation of both rails' mean in the rows they are
    taken from, NaN in others, (M,); and the half spacing expected, that of the nearer third.

    Near the camera rows lie closer than rails bend: one sample per _FIT_STEP_M says it all, with
    the weight of those it stands for.
    """
    rows = len(path)
    rail_x, rail_y, samples = np.empty((rows, 2)), np.empty((rows, 2)), np.empty((4, 2 * rows))
    of_row, mean_sigma = np.empty(2 * rows, np.intp), np.full(rows, np.nan)
    used, along, first = 0, 0.0, 0
    for i in range(rows):
        sin, cos = math.sin(path[i, 2]), math.cos(path[i, 2])
        for rail in range(2):
            across = _SIDES[rail] * path[i, 3] + offset_m[i, rail]
            rail_x[i, rail], rail_y[i, rail] = path[i, 0] - sin * across, path[i, 1] + cos * across
    while first < rows:
        step, after = along // _FIT_STEP_M, first
        while after < rows and along // _FIT_STEP_M == step:
            after += 1
            if after < rows:
                dx, dy = path[after, 0] - path[after - 1, 0], path[after, 1] - path[after - 1, 1]
                along += math.hypot(dx, dy)
        sigma = math.hypot(0.7 * scale / metre_px[first], 0.004) / math.sqrt(after - first)
        mean_sigma[first] = 0.0
        for rail in range(2):
            own = sigma * (4.0 if doubtful[first, rail] else 1.0)
            mean_sigma[first] += 0.5 * own / math.sqrt(2.0)
            if seen[first, rail]:
                samples[0, used], samples[1, used] = rail_x[first, rail], rail_y[first, rail]
                samples[2, used], samples[3, used] = _SIDES[rail], own
                of_row[used] = first
                used += 1
        first = after
    start = np.median(path[: max(4, rows // 3), 3])
    return rail_x, rail_y, samples[:, :used], of_row[:used], mean_sigma, start


def _noise_px(residual_px: Array, usable: Bools, least: float) -> float:
    """Robust scatter of the residuals' second differences, as one sample's deviation."""
    return _scatter(np.where(usable, residual_px, np.nan), least)


@numba.njit(cache=True)
def _scatter(residual_px: Array, least: float) -> float:
    bends = np.empty(residual_px.size)
    count = 0
    for rail in range(2):
        for i in range(2, len(residual_px) - 2):
            r = residual_px[i - 2 : i + 3, rail]
            bend = abs(r[4] - 2 * r[2] + r[0])
            if not math.isnan(bend):
                bends[count] = bend
                count += 1
    if count < 10:
        return 2.0 * least
    return max(least, 1.4826 * np.median(bends[:count]) / math.sqrt(6.0))


def _path(
    level: Level, growth: Growth, smooth: SmoothTrack, x_seen: Array, heading0: float, offset: float
) -> tuple[TrackPath, Array]:
    """Sample the smooth track, continued beyond the last sight with its last curvature.

    Returns:
        The path, and the pixels of its left and right rail, shape (2, M, 2).
    """
    far = float(x_seen[-1])
    nodes = growth.nodes[growth.last - 1 :]
    beyond_to = max(1.6 * far, float(nodes[-1, growing.X]))
    beyond = far * np.exp(0.02 + _BEYOND * (math.log(beyond_to / far) - 0.02))
    x = np.concatenate([_BEFORE * x_seen[0], x_seen, beyond])
    y, slope, half = smooth.along(x)
    first = len(_BEFORE)
    world, chainage, uv, metre, across = _laid(
        level.vector, x, y, slope, half, first, heading0, offset
    )
    seen = np.arange(len(chainage)) < len(x_seen)
    heading = np.arctan(slope[first:]) - heading0
    path = TrackPath(world, heading, half[first:], chainage, uv[0], metre, across, seen)
    return path, uv[1:]


@numba.njit(cache=True)
def _laid(
    cam: Array,
    x: Array,
    y: Array,
    slope: Array,
    half: Array,
    first: int,
    heading0: float,
    offset: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """A track on the ground as seen: all from sample ``first`` on, chainage from the one at 0.

    Places in the world (M, 2), chainage, pixels of centre and rails (3, M, 2), and both scales.
    """
    count = len(x) - first
    world, chainage, uv = np.empty((count, 2)), np.empty(count), np.empty((3, count, 2))
    metre, across = np.empty(count), np.empty(count)
    cos_h, sin_h = math.cos(heading0), math.sin(heading0)
    along = 0.0
    for i in range(1, first):
        along += math.hypot(x[i] - x[i - 1], y[i] - y[i - 1])
    for i in range(count):
        j = first + i
        along += math.hypot(x[j] - x[j - 1], y[j] - y[j - 1])
        chainage[i] = along
        world[i, 0] = cos_h * x[j] + sin_h * y[j]
        world[i, 1] = -sin_h * x[j] + cos_h * y[j] + offset
        cos = 1.0 / math.sqrt(1.0 + slope[j] ** 2)
        aside_x, aside_y = -slope[j] * cos * half[j], cos * half[j]
        for line, side in enumerate((0.0, 1.0, -1.0)):
            place = pixel(cam, x[j] + side * aside_x, y[j] + side * aside_y)
            uv[line, i, 0], uv[line, i, 1] = place
    for i in range(count):
        spread = 2.0 * half[first + i]
        span_u = (uv[1, i, 0] - uv[2, i, 0]) / spread
        span_v = (uv[1, i, 1] - uv[2, i, 1]) / spread
        metre[i] = math.hypot(span_u, span_v)
        before, after = max(i - 1, 0), min(i + 1, count - 1)
        run_u, run_v = uv[0, after, 0] - uv[0, before, 0], uv[0, after, 1] - uv[0, before, 1]
        run = math.hypot(run_u, run_v) + 1e-12
        across[i] = abs(span_u * run_v - span_v * run_u) / run
    return world, chainage, uv, metre, across


def _polylines(camera: Camera, centres: Centres, places: Array, seen: Bools) -> tuple[Array, Array]:
    """Rail polylines, top to bottom: measured where seen, the smooth track's in the holes."""
    width, height = camera.size_wh
    left, right = (
        _polyline(centres.uv[:, rail], places[rail], seen[:, rail], width, height)
        for rail in range(2)
    )
    return left, right


@numba.njit(cache=True)
def _polyline(measured: Array, smooth: Array, seen: Bools, width: int, height: int) -> Array:
    line, count, begun = np.empty((len(seen), 2)), 0, False
    for i in range(len(seen) - 1, -1, -1):
        begun = begun or seen[i]
        uv = measured[i] if seen[i] else smooth[i]
        if begun and 0 <= uv[0] <= width - 1 and 0 <= uv[1] <= height - 1:
            line[count] = uv
            count += 1
    return line[:count]


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """(first, one past last) of each run of True."""
    padded = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _gaps(
    path: TrackPath, seen: Bools, inside: Bools, centres: Centres, growth: Growth, scale: float
) -> tuple[Gap, ...]:
    """Stretches of at least three rows where a rail is missing, and the end of the track."""
    missing = inside & ~seen
    if growth.stop != growing.LOST and not missing.any():
        return ()
    gaps: list[Gap] = []
    m = len(seen)
    least = 3 * scale
    kinds: tuple[tuple[Literal["left", "right", "both"], Bools], ...] = (
        ("both", missing[:, 0] & missing[:, 1]),
        ("left", missing[:, 0] & ~missing[:, 1]),
        ("right", missing[:, 1] & ~missing[:, 0]),
    )
    v = centres.uv[:, :, 1].mean(axis=1)
    for rail, flags in kinds:
        for first, last in _runs(flags):
            if v[first] - v[last - 1] + 1 < least or first == 0:
                continue
            end = min(last, m - 1)
            gaps.append(
                Gap(
                    rail,
                    float(path.chainage_m[first]),
                    float(path.chainage_m[end]),
                    float(v[first]),
                    float(v[end]),
                    last < m,
                )
            )
    if growth.stop == growing.LOST:
        gaps.append(
            Gap(
                "both",
                float(path.chainage_m[m - 1]),
                float(path.chainage_m[-1]),
                float(path.uv[m - 1, 1]),
                float(path.uv[-1, 1]),
                False,
            )
        )
    return tuple(sorted(gaps, key=lambda g: g.from_m))
