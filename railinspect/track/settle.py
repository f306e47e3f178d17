"""Settling on one track: measured centres, the horizon learnt from them, a second growth."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.centres import Centres, measure_centres
from railinspect.track.geometry import Image
from railinspect.track.horizon import Horizon, Measured, fit_growth
from railinspect.track.level import FOCAL, HEIGHT, HORIZON
from railinspect.track.search import Candidate, grow_from, view_of
from railinspect.track.settings import FollowerSettings

Array = npt.NDArray[np.float64]


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
    rows, spacing_px = _spacings(
        best.level.vector,
        centres.path,
        centres.offset_m,
        centres.peak,
        centres.other,
        settings.low,
        0.25 * best.s_first,
    )
    fit = fit_growth(rows, spacing_px, 0.7 * scale)
    if fit is None:
        return None
    row, growth, covariance = fit
    # What a straight line cannot know: the plane's own slow bends near the camera.
    floor = np.array([[(0.4 * scale) ** 2, 0.0], [0.0, (0.004 * growth) ** 2]])
    return row, growth, covariance + floor


@numba.njit(cache=True)
def _spacings(
    cam: Array, path: Array, offset_m: Array, peak: Array, other: Array, low: float, least_s: float
) -> tuple[Array, Array]:
    """Levelled row and spacing, pixels, where both rails are surely seen, ``least_s`` or lower."""
    f, h, horizon = cam[FOCAL], cam[HEIGHT], cam[HORIZON]
    pitch = -math.atan(horizon / f)
    rows, spacing_px = np.empty(len(path)), np.empty(len(path))
    count = 0
    for i in range(len(path)):
        row = f * h / (math.cos(pitch) ** 2 * (path[i, 0] + h * math.tan(pitch))) + horizon
        sure = min(peak[i, 0], peak[i, 1]) >= low and max(other[i, 0], other[i, 1]) < 0.45
        if not sure or row - horizon <= least_s:
            continue
        apart_m = 2.0 * path[i, 3] + offset_m[i, 0] - offset_m[i, 1]
        rows[count] = row
        spacing_px[count] = apart_m * ((row - horizon) * math.cos(pitch) / h)
        count += 1
    return rows[:count], spacing_px[:count]
