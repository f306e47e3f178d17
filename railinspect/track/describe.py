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
from railinspect.track.level import Level
from railinspect.track.settings import FollowerSettings
from railinspect.track.smooth import SmoothTrack, fit_smooth

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
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
    doubtful = _doubtful(centres, seen, scale)
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
    off_px = np.abs(np.nan_to_num(residual)) * metre[:, None]
    # What lies off the smooth track beside another rail is that other rail.
    other = unsure & (off_px > 2.0 * scale) & (np.abs(np.nan_to_num(residual)) > _OTHER_RAIL_M)
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


def _probability(score: Image, places: Array) -> Array:
    """Rail probability at places (2, M, 2) of both rails; 0 outside the image. Shape (M, 2)."""
    height, width = score.shape
    u, v = np.nan_to_num(np.round(places), nan=-1.0).T  # (M, 2) each
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    at = np.where(inside, v * width + u, 0).astype(np.intp)
    return np.where(inside, score.ravel()[at] / 255.0, 0.0)


def _doubtful(centres: Centres, seen: Bools, scale: float) -> Bools:
    """Samples beside which something else looks like a rail, and their neighbours.

    A rail that runs aslant through the image, as in a curve or a ripple, is wide along the row:
    only what is wider than its own slant explains is doubtful.
    """
    return _beside_another(
        np.where(seen[:, :, None], centres.uv, np.nan),
        centres.metre_px,
        centres.other,
        centres.width_px,
        scale,
    )


@numba.njit(cache=True)
def _beside_another(
    uv: Array, metre_px: Array, other: Array, width_px: Array, scale: float
) -> Bools:
    rows = len(uv)
    doubtful = np.zeros((rows, 2), np.bool_)
    for i in range(rows):
        for rail in range(2):
            slant = 1.0
            for reach in (1, 2):  # a short wave's slant shows over one row, a jagged mask's over 2
                if reach <= i < rows - reach:
                    du = uv[i + reach, rail, 0] - uv[i - reach, rail, 0]
                    dv = uv[i + reach, rail, 1] - uv[i - reach, rail, 1]
                    if not math.isnan(du):
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
    x, y, heading, half = centres.path.T
    side = np.array([1.0, -1.0])
    across = side[None, :] * half[:, None] + centres.offset_m
    rail_x = x[:, None] - np.sin(heading)[:, None] * across
    rail_y = y[:, None] + np.cos(heading)[:, None] * across
    metre = centres.metre_px
    across_px = metre * upright(
        centres.uv.mean(axis=1)
    )  # pixels per metre at right angles to the rails
    sigma = np.hypot(0.7 * scale / metre, 0.004)[:, None] * np.where(doubtful, 4.0, 1.0)
    sides = np.broadcast_to(side, rail_x.shape)
    start = float(np.median(half[: max(4, len(half) // 3)]))
    # Near the camera rows lie closer than rails bend: one sample per _FIT_STEP_M says it all, with
    # the weight of those it stands for.
    place = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))]) // _FIT_STEP_M
    first = np.concatenate([[True], np.diff(place) > 0])
    counts = np.diff(np.append(np.flatnonzero(first), len(first)))
    sigma[first] /= np.sqrt(counts)[:, None]
    fitted = seen & first[:, None]

    def fit(sigma: Array) -> tuple[SmoothTrack, Array]:
        smooth = fit_smooth(
            rail_x[fitted], rail_y[fitted], sides[fitted], sigma[fitted], start, *stiffness
        )
        centre, slope, spread = smooth.along(rail_x.ravel())
        lean = np.sqrt(1.0 + slope**2)
        model = centre + sides.ravel() * spread * lean
        residual = ((rail_y.ravel() - model) / lean).reshape(rail_x.shape)
        return smooth, np.where(seen, residual, np.nan)

    smooth, residual = fit(sigma)
    sure: Bools = np.all(seen & ~doubtful, axis=1)
    common = residual.mean(axis=1)
    if not stands_out(common * across_px, sure, scale):
        return smooth, residual
    noise = _noise_px(residual * metre[:, None], seen & ~doubtful, 0.3 * scale) / (0.7 * scale)
    each = sigma.mean(axis=1) / math.sqrt(2.0)
    bent = bent_stretch(
        smooth, x[first], common[first], each[first], sure[first], *stiffness, noise
    )
    if bent is None:
        return smooth, residual
    inside = (x >= bent[0]) & (x <= bent[1])
    straight, left_over = fit(np.where(inside[:, None], _LEFT_OUT * sigma, sigma))
    if comes_back(left_over.mean(axis=1) * across_px, sure, inside, scale):
        return straight, left_over
    return smooth, residual


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
    beyond = far * np.exp(np.linspace(0.02, math.log(beyond_to / far), 24))
    x = np.concatenate([x_seen, beyond])
    y, slope, half = smooth.along(x)
    step = np.hypot(np.diff(x), np.diff(y))
    approach = np.linspace(0.0, float(x[0]), 9)
    before = float(np.hypot(np.diff(approach), np.diff(smooth.y(approach))).sum())
    chainage = before + np.concatenate([[0.0], np.cumsum(step)])
    heading = np.arctan(slope)
    normal = np.stack([-np.sin(heading), np.cos(heading)], axis=1) * half[:, None]
    centre = np.stack([x, y], axis=1)
    uv, left, right = level.pixels(np.stack([centre, centre + normal, centre - normal]))
    span = (left - right) / (2 * half)[:, None]
    metre = np.hypot(*span.T)
    run = np.gradient(uv, axis=0)
    run /= np.hypot(*run.T)[:, None] + 1e-12
    across = np.abs(span[:, 0] * run[:, 1] - span[:, 1] * run[:, 0])
    cos_h, sin_h = math.cos(heading0), math.sin(heading0)
    world = np.stack([cos_h * x + sin_h * y, -sin_h * x + cos_h * y + offset], axis=1)
    seen = np.arange(len(x)) < len(x_seen)
    path = TrackPath(world, heading - heading0, half, chainage, uv, metre, across, seen)
    return path, np.stack([left, right])


def _polylines(camera: Camera, centres: Centres, places: Array, seen: Bools) -> tuple[Array, Array]:
    """Rail polylines, top to bottom: measured where seen, the smooth track's in the holes."""
    width, height = camera.size_wh
    lines = []
    for rail in range(2):
        last = np.flatnonzero(seen[:, rail])[-1] + 1
        uv = np.where(seen[:last, rail, None], centres.uv[:last, rail], places[rail, :last])
        inside = (uv[:, 0] >= 0) & (uv[:, 0] <= width - 1) & (uv[:, 1] >= 0)
        inside &= uv[:, 1] <= height - 1
        lines.append(uv[inside][::-1].copy())
    return lines[0], lines[1]


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
