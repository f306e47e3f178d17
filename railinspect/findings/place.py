"""Where a pixel of the ground lies against the track."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.geometry import TrackGeometry, TrackPath

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


def place_on_track(track: TrackGeometry, uv: Array) -> tuple[Array, Array, Indices]:
    """Chainage, lateral position and nearest sample of ground pixels; NaN above the horizon."""
    path = track.path
    assert path is not None
    world = track.camera.ground(track.camera.undistort(uv))
    lost = ~(np.isfinite(world[:, 0]) & np.isfinite(world[:, 1]))
    chainage, lateral, at = track_coordinates(path, np.where(lost[:, None], 1.0, world))
    lateral[lost] = np.nan
    chainage[lost] = np.inf
    return chainage, lateral, at


def track_coordinates(path: TrackPath, world_xy: Array) -> tuple[Array, Array, Indices]:
    """Chainage and lateral position of ground points against the track.

    The lateral position is scaled so that the rails, as seen on the plane, lie where the nearest
    rails lie: a gradient or an error of the horizon then does not move things off the track.

    Args:
        path: The centre line.
        world_xy: Ground points, metres, shape (N, 2).

    Returns:
        Chainage (m), lateral position (m, positive left) and index of the nearest sample, (N,).
    """
    return _coordinates(path.xy_m, path.heading_rad, path.half_m, path.chainage_m, world_xy)


@numba.njit(cache=True)
def _coordinates(
    xy_m: Array, heading_rad: Array, half_m: Array, chainage_m: Array, world_xy: Array
) -> tuple[Array, Array, Indices]:
    last = len(chainage_m) - 1
    nearest = np.median(half_m[: max(3, len(half_m) // 4)])
    count = len(world_xy)
    chainage, lateral = np.empty(count), np.empty(count)
    at = np.empty(count, np.intp)
    for i in range(count):
        now = nxt = min(np.searchsorted(xy_m[:, 0], world_xy[i, 0]), last)
        place, across = 0.0, 0.0
        for _ in range(4):
            now = nxt
            cos, sin = math.cos(heading_rad[now]), math.sin(heading_rad[now])
            dx, dy = world_xy[i, 0] - xy_m[now, 0], world_xy[i, 1] - xy_m[now, 1]
            place, across = chainage_m[now] + dx * cos + dy * sin, dy * cos - dx * sin
            nxt = min(np.searchsorted(chainage_m, place), last)
        chainage[i], lateral[i], at[i] = place, across * nearest / half_m[now], now
    return chainage, lateral, at
