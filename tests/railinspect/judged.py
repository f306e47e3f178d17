"""Drawn masks judged whole: the track followed over two frames, and what is found on it."""

from __future__ import annotations

from functools import cache

import numpy as np

from railinspect.camera import Camera
from railinspect.evaluation.drawn_tracks import Masks, camera, draw
from railinspect.findings import Finding, find
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower, TrackGeometry


def judge(
    masks: Masks, cam: Camera | None, thresholds: Thresholds | None = None
) -> tuple[TrackGeometry, tuple[Finding, ...]]:
    follower = TrackFollower(cam)
    follower.update(masks)
    geometry = follower.update(masks)
    return geometry, find(masks, geometry, thresholds)


@cache
def clear(curvature: float) -> Masks:
    return draw(camera(), curvature)


def wave(at: float, length: float, amplitude: float, period: float = 0.0):
    """A bulge (period 0) or a ripple."""

    def bend(s: np.ndarray) -> np.ndarray:
        t = (s - at) / length
        inside = (t > 0) & (t < 1)
        if period == 0:
            return np.where(inside, amplitude * np.sin(np.pi * t) ** 2, 0.0)
        return np.where(inside, amplitude * np.sin(2 * np.pi * (s - at) / period), 0.0)

    return bend
