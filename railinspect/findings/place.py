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
    camera = track.camera
    seen = np.ascontiguousarray(camera.undistort(uv), float)
    turn = camera.camera_from_world
    over = camera.focal_px, *camera.principal_uv, camera.height_m, camera.offset_m
    world = _on_ground(turn, over, seen)
    chainage, lateral, at = track_coordinates(path, world)
    lost = np.isnan(world[:, 0])
    lateral[lost] = np.nan
    chainage[lost] = np.inf
    return chainage, lateral, at


@numba.njit(cache=True)
def _on_ground(
    camera_from_world: Array, camera: tuple[float, float, float, float, float], uv: Array
) -> Array:
    """:meth:`railinspect.camera.Camera.ground` for many small calls: NaN from the horizon up."""
    world = np.empty(uv.shape)
    for i in range(len(uv)):
        world[i, 0], world[i, 1] = ground_point(camera_from_world, camera, uv[i, 0], uv[i, 1])
    return world


@numba.njit(cache=True)
def ground_point(
    camera_from_world: Array, camera: tuple[float, float, float, float, float], u: float, v: float
) -> tuple[float, float]:
    """World x and y, metres, of one undistorted pixel, for the compiled loops; NaN likewise.

    Args:
        camera_from_world: The camera's rotation, shape (3, 3).
        camera: Its focal length and principal point (px), height and offset (m).
        u: Column, pixels.
        v: Row, pixels.
    """
    focal, centre_u, centre_v, height, offset = camera
    turn = camera_from_world
    a, b = (u - centre_u) / focal, (v - centre_v) / focal
    drop = a * turn[0, 2] + b * turn[1, 2] + turn[2, 2]
    if drop >= -1e-9:
        return np.nan, np.nan
    scale = -height / drop
    return (
        scale * (a * turn[0, 0] + b * turn[1, 0] + turn[2, 0]),
        scale * (a * turn[0, 1] + b * turn[1, 1] + turn[2, 1]) + offset,
    )


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
    nearest = np.median(half_m[: max(3, len(half_m) // 4)])
    count = len(world_xy)
    chainage, lateral = np.empty(count), np.empty(count)
    at = np.empty(count, np.intp)
    for i in range(count):
        place, across, now = beside(xy_m, heading_rad, chainage_m, world_xy[i, 0], world_xy[i, 1])
        chainage[i], lateral[i], at[i] = place, across * nearest / half_m[now], now
    return chainage, lateral, at


@numba.njit(cache=True)
def beside(
    xy_m: Array, heading_rad: Array, chainage_m: Array, x: float, y: float
) -> tuple[float, float, int]:
    """Chainage, metres to the left and nearest sample of one ground point, for compiled loops."""
    last = len(chainage_m) - 1
    now = nxt = min(int(np.searchsorted(xy_m[:, 0], x)), last)
    place, across = 0.0, 0.0
    for _ in range(4):
        now = nxt
        cos, sin = math.cos(heading_rad[now]), math.sin(heading_rad[now])
        dx, dy = x - xy_m[now, 0], y - xy_m[now, 1]
        place = float(chainage_m[now] + dx * cos + dy * sin)
        across = float(dy * cos - dx * sin)
        nxt = min(int(np.searchsorted(chainage_m, place)), last)
    return place, across, now
