"""What track and masks say at a finding's foot, in one compiled look each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from railinspect.findings.place import beside, ground_point
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_LOOKED_AT = 500
"""Pixels of a thing that tell its class."""


class FootPlace(NamedTuple):
    """Where a foot stands on the plane of the rails.

    Attributes:
        plane_m: Along the track, metres; NaN from the horizon up.
        spacing_px: The rails' distance from each other there, pixels.
        metre_px: Pixels per metre across the track there.
    """

    plane_m: float
    spacing_px: float
    metre_px: float


def foot_place(track: TrackGeometry, u: float, v: float) -> FootPlace:
    """Where a pixel of the ground lies by the track seen.

    Args:
        track: With a path.
        u: Column, pixels.
        v: Row, pixels.
    """
    path, camera = track.path, track.camera
    assert path is not None
    if any(camera.distortion):
        u, v = (float(value) for value in camera.undistort([u, v]))
    over = (camera.focal_px, *camera.principal_uv, camera.height_m, camera.offset_m)
    return FootPlace(
        *_place(
            (u, v),
            camera.camera_from_world,
            over,
            path.xy_m,
            path.heading_rad,
            path.chainage_m,
            path.half_m,
            path.across_px,
            path.metre_px,
        )
    )


@numba.njit(cache=True)
def _place(
    foot_uv: tuple[float, float],
    camera_from_world: Array,
    camera: tuple[float, float, float, float, float],
    xy_m: Array,
    heading_rad: Array,
    chainage_m: Array,
    half_m: Array,
    across_px: Array,
    metre_px: Array,
) -> tuple[float, float, float]:
    x, y = ground_point(camera_from_world, camera, foot_uv[0], foot_uv[1])
    if np.isnan(x):
        return np.nan, np.nan, np.nan
    place, _, _ = beside(xy_m, heading_rad, chainage_m, x, y)
    last = len(chainage_m) - 1
    i = int(np.searchsorted(chainage_m, place, side="right")) - 1
    i = min(max(i, 0), max(0, last - 1))
    j = min(i + 1, last)
    width = chainage_m[j] - chainage_m[i]
    share = min(1.0, max(0.0, (place - chainage_m[i]) / width)) if width > 0.0 else 0.0
    half = half_m[i] + share * (half_m[j] - half_m[i])
    across = across_px[i] + share * (across_px[j] - across_px[i])
    return place, 2.0 * half * across, metre_px[i] + share * (metre_px[j] - metre_px[i])


@numba.njit(cache=True)
def commonest_class(labels: Image, box_xyxy: tuple[float, float, float, float]) -> int:
    """Commonest class in the lower half of a box; −1 where it lies outside the image.

    Args:
        labels: Class ids, shape (H, W).
        box_xyxy: The box, pixels, ends included.
    """
    height, width = labels.shape
    left, right = max(0, round(box_xyxy[0])), min(width, round(box_xyxy[2]) + 1)
    top, bottom = round(box_xyxy[1]), round(box_xyxy[3])
    first, last = max(0, (top + bottom) // 2), min(height, bottom + 1)
    area = max(0, (last - first) * (right - left))
    step = max(1, int(math.sqrt(area // _LOOKED_AT)))
    count = np.zeros(256, np.int64)
    best, most = -1, 0
    for v in range(first, last, step):
        for u in range(left, right, step):
            count[labels[v, u]] += 1
    for label in range(256):
        if count[label] > most:
            best, most = label, count[label]
    return best
