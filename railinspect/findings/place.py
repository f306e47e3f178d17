"""Where a pixel of the ground lies against the track."""

from __future__ import annotations

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
    x = world_xy[:, 0]
    at = np.clip(np.searchsorted(path.xy_m[:, 0], x), 0, len(path.xy_m) - 1)
    now, chainage, across = at, x, np.zeros(len(x))
    for _ in range(4):
        cos, sin = np.cos(path.heading_rad[at]), np.sin(path.heading_rad[at])
        d = world_xy - path.xy_m[at]
        along = d[:, 0] * cos + d[:, 1] * sin
        across = -d[:, 0] * sin + d[:, 1] * cos
        chainage, now = path.chainage_m[at] + along, at
        at = np.clip(np.searchsorted(path.chainage_m, chainage), 0, len(path.xy_m) - 1)
    nearest = float(np.median(path.half_m[: max(3, len(path.half_m) // 4)]))
    return chainage, across * nearest / path.half_m[now], now
