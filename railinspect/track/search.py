"""The search for the ego track's beginning: lines, pairs, and what grows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from railinspect.camera import Camera
from railinspect.track.begin import Line, Pair, Prior, find_lines, lone_pairs, pair_of, pairs_of
from railinspect.track.geometry import Image
from railinspect.track.growing import LOST, ONE_RAIL, Growth, grow
from railinspect.track.horizon import Horizon
from railinspect.track.level import Level
from railinspect.track.ridges import ridge_points
from railinspect.track.settings import FollowerSettings
from railinspect.track.state import FollowerState

_BAND_ROWS = 64
"""Rows sampled for the lines near the camera: more only costs time."""


_BAND_MIDDLE = 0.6
"""Middle of the rows in which rails begin, as a share of the rows below the horizon."""

_TYPICAL_RADIUS_M = 500.0
"""Of the curves a first picture may show, metres: one standard deviation of what is not known."""


@dataclass(frozen=True)
class Candidate:
    """A track that grew from one pair of beginning points.

    Attributes:
        pair: The two lines near the camera.
        level: The view it grew in.
        horizon: This frame's horizon and spacing growth.
        s_first: Rows between horizon and bottom, pixels.
        growth: The grown nodes.
    """

    pair: Pair
    level: Level
    horizon: Horizon
    s_first: float
    growth: Growth


def view_of(camera: Camera, calibrated: bool, horizon: Horizon) -> Level:
    """A frame's levelled view; an unknown camera gets the height that makes k fit the gauge."""
    level = Level(camera, horizon.row_px)
    if calibrated:
        return level
    height = camera.rail_spacing_m * math.cos(level.pitch_rad) / horizon.growth
    relative = math.hypot(horizon.growth_std, camera.std.gauge_m / camera.rail_spacing_m)
    std = replace(camera.std, height_m=relative * height)
    return Level(replace(camera, height_m=height, std=std), horizon.row_px)


def _prior(
    camera: Camera, calibrated: bool, now: Horizon, state: FollowerState, s_first: float
) -> Prior:
    """What the last frames, or else the camera, say of the pair to be found."""
    scale = camera.size_wh[0] / 640.0
    row_std = math.hypot(now.row_std_px, 1.5 * scale)
    growth_std = math.hypot(now.growth_std, 0.02)
    # Rails begin as straight lines where the picture does, far ahead of a long lens: in a curve
    # these are tangents, which meet aside of the heading and pass the camera aside of the track;
    # and each touches its rail where that lies longest along a line, which may be farther on.
    near_m = camera.focal_px * camera.height_m / (_BAND_MIDDLE * s_first)
    turned_rad = near_m / _TYPICAL_RADIUS_M
    if state.frames:
        aside, aside_std = state.aside, math.hypot(0.03, 0.1 / state.frames)
    else:
        aside = camera.offset_m * math.cos(camera.pitch_rad) / camera.height_m
        passed = near_m * turned_rad / (2.0 * camera.height_m)
        aside_std = math.hypot(0.10 if calibrated else 0.16, passed)
        row_std = math.hypot(row_std, s_first * turned_rad)
        growth_std = math.hypot(growth_std, 2.0 * turned_rad)
    if state.pair is not None:
        last = state.vanishing_px if state.vanishing_px else state.pair.vanishing_px
        heading, heading_std = last[0], 15.0 * scale
    else:
        heading = camera.focal_px * math.tan(camera.yaw_rad)
        heading_std = math.hypot(64.0 * scale, camera.focal_px * turned_rad)
    return Prior(
        now.row_px, row_std, now.growth, growth_std, aside, aside_std, heading, heading_std
    )


def search(
    score: Image,
    camera: Camera,
    calibrated: bool,
    horizon: Horizon,
    state: FollowerState,
    settings: FollowerSettings,
) -> tuple[list[Candidate], list[Line]]:
    """Pairs of beginning points and what grows from each.

    Args:
        score: Soft rail probability, shape (H, W).
        camera: Camera of this image size.
        calibrated: Whether it was given.
        horizon: What is known of this frame's horizon and spacing growth beforehand.
        state: Follower's state.
        settings: Tuning.

    Returns:
        Candidates with a track of at least three windows, and all lines found.
    """
    width, height = camera.size_wh
    scale = width / 640.0
    level = Level(camera, horizon.row_px)
    bottom = level.bottom_px
    s_first = bottom - horizon.row_px
    if s_first < 12:
        return [], []
    stride = max(1, int(settings.band * s_first / _BAND_ROWS))
    top = bottom - settings.band * s_first
    tilt = abs(math.sin(camera.roll_rad)) * width / 2
    first_row = int(max(0.0, height - 1 - settings.band * s_first - tilt))
    points = ridge_points(score, first_row, stride, settings.low, max(4, int(0.12 * width)))
    points = np.hstack([level.from_pixels(points[:, :2]), points[:, 2:], points[:, 1:2]])
    points = points[points[:, 1] >= top]
    rows = max(1, int(settings.band * s_first / stride))
    prior = _prior(camera, calibrated, horizon, state, s_first)
    lines = find_lines(
        points,
        bottom,
        top,
        width / 2,
        rows,
        2.5 * scale,
        (prior.heading_px, prior.horizon_px),
        3.0 * prior.heading_std_px + 1.2 * prior.horizon_std_px,
    )
    pairs = [
        pair
        for pair in pairs_of(lines, bottom, prior, limit=6)
        if state.pair is not None or not _crosses(score, level, pair, bottom, settings.low)
    ][:3]
    if state.pair is not None:
        # Beginning points move by at most Δ_b; where none is found that near, the last stay.
        reach = settings.begin_px * scale
        old = state.pair
        pairs = [
            p
            for p in pairs
            if abs(p.left.bottom_px - old.left.bottom_px) <= reach
            and abs(p.right.bottom_px - old.right.bottom_px) <= reach
        ]
        if not pairs:
            kept = pair_of(
                replace(old.left, votes=0.1), replace(old.right, votes=0.1), bottom, prior
            )
            pairs = [] if kept is None else [kept]

    def grown(pairs: list[Pair], settings: FollowerSettings) -> list[Candidate]:
        every = (
            _grown(score, camera, calibrated, horizon, pair, state, bottom, settings)
            for pair in pairs
        )
        return [candidate for candidate in every if candidate is not None]

    candidates = grown(pairs, settings)
    if calibrated and state.pair is None:
        sure = [line for line in lines if line.votes >= settings.lone_votes]
        candidates += grown(lone_pairs(sure, bottom, prior), settings.for_lone_rails())
    return candidates, lines


def _grown(
    score: Image,
    camera: Camera,
    calibrated: bool,
    horizon: Horizon,
    pair: Pair,
    state: FollowerState,
    bottom: float,
    settings: FollowerSettings,
) -> Candidate | None:
    """Let a track grow from one pair of beginning points."""
    scale = camera.size_wh[0] / 640.0
    row_std, growth_std = 4.0 * scale, 0.04 * pair.growth
    # A pair that is too steep is also too high: both errors stem from the same two lines.
    cross = 0.7 * row_std * growth_std
    horizon = horizon.updated(
        pair.vanishing_px[1],
        pair.growth,
        np.array([[row_std**2, cross], [cross, growth_std**2]]),
    )
    level = view_of(camera, calibrated, horizon)
    s_first = bottom - horizon.row_px
    if s_first < 12:
        return None
    growth = grow_from(score, level, pair, bottom, state.curvature, settings)
    if growth.last < 3:
        return None
    return Candidate(pair, level, horizon, s_first, growth)


def grow_from(
    score: Image,
    level: Level,
    pair: Pair,
    bottom: float,
    curvature: float,
    settings: FollowerSettings,
) -> Growth:
    """Let a track grow from a pair of lines, starting at the bottom row with a curvature, 1/m."""
    camera = level.camera
    s_first = bottom - level.horizon_px
    centre_x = (pair.left.bottom_px + pair.right.bottom_px) / 2
    x, y = level.ground_from_level(np.array([centre_x, bottom]))
    spread = (pair.right.bottom_px - pair.left.bottom_px) / 2
    cos_pitch = math.cos(level.pitch_rad)
    half = spread * camera.height_m / (s_first * cos_pitch)
    heading = math.atan(-pair.vanishing_px[0] * cos_pitch / camera.focal_px)
    metre = s_first * cos_pitch / camera.height_m
    scale = camera.size_wh[0] / 640.0
    start = (float(x), float(y), heading, curvature)
    std = (3.0 * scale / metre, 0.03, 1 / 250)
    growth = grow(score, level, start, std, half, s_first, settings)
    if growth.stop not in (LOST, ONE_RAIL):
        return growth
    # A bend sharper than any track's carries the growing away from the rails that come back.
    bent = grow(score, level, start, std, half, s_first, settings.for_bends())
    better = bent.last > growth.last and bent.support > growth.support + settings.bend_gain
    return bent if better else growth


def _crosses(score: Image, level: Level, pair: Pair, bottom: float, low: float) -> bool:
    """Whether both lines go on as rails above the point where they meet: no vanishing point."""
    x, y = pair.vanishing_px
    above = np.linspace(0.1, 0.45, 24) * (bottom - y)
    for line in (pair.left, pair.right):
        uv = level.to_pixels(np.stack([x - line.slope * above, y - above], axis=1))
        c, r = np.round(uv).astype(int).T
        inside = (c >= 0) & (c < score.shape[1]) & (r >= 0) & (r < score.shape[0])
        if np.count_nonzero(inside) < 8:
            return False
        if np.mean(score[r[inside], c[inside]] >= 255 * low) < 0.6:
            return False
    return True
