"""Settling on one track: measured centres, the horizon learnt from them, a second growth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from railinspect.track.centres import Centres, measure_centres
from railinspect.track.geometry import Image
from railinspect.track.horizon import Horizon, Measured, fit_growth
from railinspect.track.search import Candidate, grow_from, view_of
from railinspect.track.settings import FollowerSettings


def settled_on(
    score: Image, best: Candidate, now: Horizon, calibrated: bool, settings: FollowerSettings
) -> tuple[Candidate, Centres, Measured | None]:
    """Measure a candidate's rails, learn the horizon from them, and grow again if it moved.

    Args:
        score: Soft rail probability, shape (H, W).
        best: The candidate.
        now: What is known of this frame's horizon beforehand.
        calibrated: Whether the camera was given.
        settings: Tuning.

    Returns:
        The candidate with its final view and growth, its centres, and what they say of the horizon.
    """
    scale = score.shape[1] / 640.0
    bottom = best.s_first + best.level.horizon_px
    centres = measure_centres(score, best.level, best.growth, best.s_first, settings)
    measured = None
    for _ in range(2):
        measured = _measured_horizon(best, centres, scale, settings)
        if measured is None:
            break
        # The frame's prior, not the pair's: the same rows must not count twice.
        horizon = now.updated(*measured)
        moved = abs(horizon.row_px - best.level.horizon_px)
        if moved < 0.4 * scale:
            best = replace(best, horizon=horizon)
            break
        level = view_of(best.level.camera, calibrated, horizon)
        growth = grow_from(score, level, best.pair, bottom, 0.0, settings)
        if growth.last < 3:
            break
        best = Candidate(best.pair, level, horizon, bottom - horizon.row_px, growth)
        centres = measure_centres(score, level, growth, best.s_first, settings)
    return best, centres, measured


def _measured_horizon(
    best: Candidate, centres: Centres, scale: float, settings: FollowerSettings
) -> Measured | None:
    """Horizon and growth from the nearer part of the measured rails."""
    level = best.level
    both = (centres.peak >= settings.low).all(axis=1)
    both &= (centres.other < 0.45).all(axis=1)
    rows = level.level_from_ground(centres.path[:, :2])[:, 1]
    s = rows - level.horizon_px
    near = both & (s > 0.25 * best.s_first)
    spacing = 2 * centres.path[:, 3] + centres.offset_m[:, 0] - centres.offset_m[:, 1]
    metre = s * math.cos(level.pitch_rad) / level.camera.height_m
    fit = fit_growth(rows[near], (spacing * metre)[near], 0.7 * scale)
    if fit is None:
        return None
    row, growth, covariance = fit
    # What a straight line cannot know: the plane's own slow bends near the camera.
    floor = np.diag([(0.4 * scale) ** 2, (0.004 * growth) ** 2])
    return row, growth, covariance + floor
