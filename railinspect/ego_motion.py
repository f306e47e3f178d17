"""How fast the train runs, as far as the picture shows it.

Points of the ground beside the track are followed from frame to frame; each one's way towards the
camera on the plane of the rails, per second, is a speed. The sleepers between the rails are left
out, because one looks like the next. Scale and camera are the track's: with a guessed camera the
speed is wrong by the same factor as the ranges it is compared with.
"""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.track.geometry import TrackGeometry
from railinspect.video import Frame

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

NEAR_M: Final = 6.0
FAR_M: Final = 22.0
"""Points are looked for between these distances, metres: nearer ones leave too soon, a pixel's
error of farther ones is too many metres."""

ASIDE_M: Final = (1.7, 7.0)
"""Distance of the points from the centre line, metres."""

LEAST_POINTS: Final = 12
"""Fewer points that agree are no measurement."""

REMEMBERED_S: Final = 1.0
"""The speed is the median of the measurements of this last time, seconds,"""

LEAST_MEASUREMENTS: Final = 3
"""of which there must be so many."""

_WIDTH: Final = 640
_LONGEST_S: Final = 0.25


class EgoMotion:
    """Measures the train's speed from successive frames; see the module's docstring."""

    def __init__(self) -> None:
        self._last: tuple[float, Image, TrackGeometry] | None = None
        self._measured: deque[tuple[float, float]] = deque(maxlen=60)

    def update(self, frame: Frame, track: TrackGeometry) -> float | None:
        """Take in a frame with its track.

        Args:
            frame: The frame, later than the one before.
            track: Its track; without one followed nothing is measured.

        Returns:
            Speed, m/s, ≥ 0; None while it cannot be told.
        """
        if not track.followed or frame.damaged:
            self._last = None
            return None
        grey = _grey(frame.rgb)
        last, self._last = self._last, (frame.time_s, grey, track)
        while self._measured and frame.time_s - self._measured[0][0] > REMEMBERED_S:
            self._measured.popleft()
        if last is not None and 0 < frame.time_s - last[0] <= _LONGEST_S:
            speed = _speed(last, (frame.time_s, grey, track))
            if speed is not None:
                self._measured.append((frame.time_s, speed))
        if len(self._measured) < LEAST_MEASUREMENTS:
            return None
        return max(0.0, median(speed for _, speed in self._measured))

    def forget(self) -> None:
        """Start anew: frames were left out."""
        self._last = None
        self._measured.clear()


def _grey(rgb: Image) -> Image:
    grey = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
    if grey.shape[1] <= _WIDTH:
        return grey
    size = (_WIDTH, round(grey.shape[0] * _WIDTH / grey.shape[1]))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _speed(
    one: tuple[float, Image, TrackGeometry], two: tuple[float, Image, TrackGeometry]
) -> float | None:
    """Speed between two frames, m/s; None where too few points agree on one."""
    (time, before, track), (later, after, track_after) = one, two
    scale = track.camera.size_wh[0] / before.shape[1]
    mask = _beside(track, before.shape, scale)
    points = cv2.goodFeaturesToTrack(before, 80, 0.02, 6, mask=mask)
    if points is None or len(points) < LEAST_POINTS:
        return None
    there, found = _followed(before, after, points)
    back, again = _followed(after, before, there)
    error = np.linalg.norm((back - points).reshape(-1, 2), axis=1)
    sure = (found.ravel() > 0) & (again.ravel() > 0) & (error < 0.7)
    start = track.camera.ground(track.camera.undistort(scale * points.reshape(-1, 2)[sure]))
    camera = track_after.camera
    end = camera.ground(camera.undistort(scale * there.reshape(-1, 2)[sure]))
    way = start[:, 0] - end[:, 0]
    speeds = (way / (later - time))[np.isfinite(way)]
    if len(speeds) < LEAST_POINTS:
        return None
    middle = float(np.median(speeds))
    agree = np.abs(speeds - middle) < 0.25 * abs(middle) + 1.0
    if np.count_nonzero(agree) < max(LEAST_POINTS, 0.5 * len(speeds)):
        return None
    return float(np.median(speeds[agree]))


def _followed(before: Image, after: Image, points: Any) -> tuple[Any, Any]:
    """Where points of one picture lie in another, and which were found (Lucas and Kanade)."""
    none: Any = None
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, none, winSize=(21, 21), maxLevel=3
    )
    return there, found


def _beside(track: TrackGeometry, shape: tuple[int, ...], scale: float) -> Image:
    """Mask of the ground beside the track where points are looked for."""
    path = track.path
    mask = np.zeros(shape, np.uint8)
    if path is None:
        return mask
    used = (path.chainage_m >= NEAR_M) & (path.chainage_m <= FAR_M)
    if np.count_nonzero(used) < 2:
        return mask
    normal = np.stack([-np.sin(path.heading_rad), np.cos(path.heading_rad)], axis=1)[used]
    for side in (1.0, -1.0):
        edges = []
        for aside in ASIDE_M:
            place = path.xy_m[used] + side * aside * normal
            uv = track.camera.project(np.hstack([place, np.zeros((len(place), 1))]))
            edges.append(track.camera.distort(uv) / scale)
        outline = np.concatenate([edges[0], edges[1][::-1]])
        outline = np.clip(outline, -4 * shape[1], 4 * shape[1])
        if np.isfinite(outline).all():
            cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 255)
    return mask
