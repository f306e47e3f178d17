"""A world seen from a point on its track: picture, classes, depth, rails and objects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.labels import SKY
from railinspect.scenes import backdrop, planting, tables
from railinspect.scenes import ground as g
from railinspect.scenes.alignment import LocalTrack
from railinspect.scenes.draft import START_M, World
from railinspect.scenes.noise import pyramids
from railinspect.scenes.rails import displacement
from railinspect.scenes.raster import draw
from railinspect.scenes.settings import SceneSettings
from railinspect.scenes.weather import develop
from railinspect.scenes.world import begin, finish

Array = npt.NDArray[np.float64]

RAILS_REACH_M = 400.0
"""Distance to which the true ego rails are given, metres."""

_PLAN_STEP_M = 0.5
_DRAWN_REACH_M = 650.0


@dataclass(frozen=True)
class SceneObject:
    """An object in a picture, with its truth.

    Attributes:
        id: Identity within its world, > 0.
        type: ``obstruction``, ``trespasser``, ``distortion`` or a class name.
        label: Class id it is drawn with.
        box_xyxy: Extent of its visible pixels (for a distortion: of the distorted rails).
        visible_px: Number of visible pixels (0 for a distortion).
        range_m: Distance along the track to its near end, metres.
        height_m: Its height; for a distortion the lateral amplitude, metres.
        lateral_m: Lateral position against the ego track, metres, positive left.
        on_track: Whether it stands within the clearance of the ego track.
    """

    id: int
    type: str
    label: int
    box_xyxy: tuple[float, float, float, float]
    visible_px: int
    range_m: float
    height_m: float
    lateral_m: float
    on_track: bool


@dataclass(frozen=True)
class Rendered:
    """One rendered picture with its truth.

    Attributes:
        rgb: Picture, uint8, shape (H, W, 3).
        labels: RailSem19 class ids, uint8, shape (H, W).
        depth_m: Distance ahead (along the viewing direction), float32, +inf for the sky, (H, W).
        ego_rails: Centre lines of the left and right ego rail, pixels, top to bottom, (N, 2) each;
            empty where the scene has none. They run on behind what hides them.
        objects: Objects of interest that are in view.
        camera: The true camera.
        seed: Seed of the world.
        chainage_m: Where the observer stands.
        time_s: Time of the frame in its ride; 0 for a still.
    """

    rgb: npt.NDArray[np.uint8]
    labels: npt.NDArray[np.uint8]
    depth_m: npt.NDArray[np.float32]
    ego_rails: tuple[Array, Array]
    objects: tuple[SceneObject, ...]
    camera: Camera
    seed: int
    chainage_m: float = 0.0
    time_s: float = 0.0


def render(seed: int, settings: SceneSettings | None = None) -> Rendered:
    """Render one still picture; the same seed and settings give the same bytes.

    Args:
        seed: Seed of the world and everything in it.
        settings: Choices left to the caller.

    Example:
        >>> picture = render(7, SceneSettings(size_wh=(320, 180)))
        >>> picture.rgb.shape, picture.labels.shape
        ((180, 320, 3), (180, 320))
    """
    settings = settings or SceneSettings()
    draft, alignment, camera = begin(seed, settings)
    rng = np.random.default_rng([seed, 0xA402])
    if settings.occluders and draft.kind != "none":
        planting.sprinkle(draft, rng, camera.focal_px)
    world = finish(draft, seed, alignment, camera)
    return view(world, np.random.default_rng([seed, 0xF17E]))


def view(
    world: World,
    rng: np.random.Generator,
    chainage_m: float = 0.0,
    time_s: float = 0.0,
    camera: Camera | None = None,
) -> Rendered:
    """Render a world as seen from a place on its ego track.

    Args:
        world: The world.
        rng: Source of sensor noise, rain and drops: what differs from frame to frame.
        chainage_m: Where the observer stands, metres.
        time_s: Time to note in the result.
        camera: Camera to use instead of the world's own (vibration, a stereo partner).
    """
    camera = camera or world.camera
    looks = world.looks
    width, height = camera.size_wh
    rotation = camera.camera_from_world
    grid, shrink = _lens_grid(camera) if any(camera.distortion) else (None, 1.0)
    straight = replace(camera, focal_px=camera.focal_px * shrink)
    focal, (centre_u, centre_v) = straight.focal_px, camera.principal_uv
    track = world.alignment.local(chainage_m, g.FAR_M)
    rgb = np.zeros((height, width, 3), np.float32)
    labels = np.full((height, width), SKY, np.uint8)
    depth = np.full((height, width), np.inf, np.float32)
    things = np.zeros((height, width), np.int16)
    stack = pyramids()
    local = _shift(world, chainage_m)
    g.shade_ground(
        rgb,
        labels,
        depth,
        rotation,
        focal,
        centre_u,
        centre_v,
        camera.height_m,
        camera.offset_m,
        _reach_of_slope(track, camera.height_m),
        *_plan(track),
        world.offsets,
        START_M - chainage_m,
        world.tracks,
        world.spacing_m,
        local[0],
        world.zones,
        local[1],
        world.light,
        looks.look,
        stack,
        chainage_m,
    )
    heading = world.alignment.heading(chainage_m)
    backdrop.shade_backdrop(
        rgb,
        labels,
        depth,
        rotation,
        focal,
        centre_u,
        centre_v,
        heading,
        looks.skylines,
        looks.layers,
        looks.zenith,
        looks.horizon,
        looks.cloud,
        looks.sun_azimuth_rad,
        looks.sun_height,
        looks.sun_gain,
        stack,
    )
    geometry, attributes = _place(world, track, chainage_m, straight)
    sun = looks.sun_side
    draw(rgb, labels, depth, things, geometry, attributes, focal, centre_u, centre_v, sun, stack)
    if grid is not None:
        rgb = np.asarray(_bent(rgb, grid, cv2.INTER_LINEAR))
        labels = np.asarray(_bent(labels, grid, cv2.INTER_NEAREST))
        depth = np.asarray(_bent(depth, grid, cv2.INTER_NEAREST))
        things = np.asarray(_bent(things, grid, cv2.INTER_NEAREST))
    picture = develop(rgb, depth, looks.weather, rng)
    rails = _true_rails(world, track, chainage_m, camera)
    objects = _true_objects(world, things, track, chainage_m, camera)
    return Rendered(picture, labels, depth, rails, objects, camera, world.seed, chainage_m, time_s)


def _shift(world: World, chainage_m: float) -> tuple[Array, Array]:
    """Distortions and crossings with positions counted from the observer."""
    waves, crossings = world.waves.copy(), world.crossings.copy()
    waves[:, tables.WAVE_START] -= chainage_m
    crossings[:, [tables.CROSS_NEAR, tables.CROSS_FAR]] -= chainage_m
    return waves, crossings


def _reach_of_slope(track: LocalTrack, height_m: float) -> Array:
    """Distance x at which a ray of slope i·SLOPE_STEP first meets the rail-top surface.

    With a profile z(x) that is where (h − z(x)) / x first falls to the slope; what lies behind a
    crest never does, so the table jumps over it. Rays that meet nothing get +inf.
    """
    ahead = track.x_m > 0.2
    x, z = track.x_m[ahead], track.z_m[ahead]
    near = np.geomspace(0.2, 40, 400)
    distance = np.concatenate([near, np.geomspace(40.5, g.FAR_M, 600)])
    profile = np.interp(distance, x, z)
    beyond = distance > x[-1]
    profile[beyond] = z[-1]
    slope = np.minimum.accumulate((height_m - profile) / distance)
    table = np.arange(0, 4.0, g.SLOPE_STEP)
    order = np.arange(len(slope))
    index = np.searchsorted(-slope, -table, side="left")
    index = np.clip(index, 1, len(order) - 1)
    high, low = slope[index - 1], slope[index]
    part = np.where(high > low, (high - table) / np.maximum(high - low, 1e-12), 0.0)
    # (h − z)/x is linear in 1/x between the samples
    inverse = 1 / distance[index - 1] + np.clip(part, 0, 1) * (
        1 / distance[index] - 1 / distance[index - 1]
    )
    reach = 1 / inverse
    reach[table < slope[-1]] = np.inf
    return reach


def _plan(track: LocalTrack) -> tuple[Array, float, float]:
    """The centre line tabulated over x: rows (y, heading, along), first x, step."""
    start = float(track.x_m[0])
    x = np.arange(start, float(track.x_m[-1]), _PLAN_STEP_M)
    columns = [
        np.interp(x, track.x_m, values) for values in (track.y_m, track.heading_rad, track.along_m)
    ]
    return np.column_stack(columns), start, _PLAN_STEP_M


def _place(
    world: World, track: LocalTrack, chainage_m: float, camera: Camera
) -> tuple[Array, npt.NDArray[np.float32]]:
    """Primitives in camera coordinates, far to near, without those out of view."""
    along = world.geometry[:, 0] - chainage_m
    kept = np.flatnonzero((along > -12) & (along < _DRAWN_REACH_M))
    table = world.geometry[kept]
    corner = table[:, 0:3] - np.array([chainage_m, 0.0, 0.0])
    points = np.stack([corner, corner + table[:, 3:6], corner + table[:, 6:9]])
    scene = track.to_world(points[..., 0], points[..., 1], points[..., 2])
    scene -= np.array([0.0, camera.offset_m, camera.height_m])
    seen = scene @ camera.camera_from_world.T
    base, edge_u, edge_v = seen[0], seen[1] - seen[0], seen[2] - seen[0]
    corners = np.stack([base, seen[1], seen[2], seen[1] + edge_v])
    side = 1.15 * camera.size_wh[0] / 2 / camera.focal_px
    ahead = (corners[..., 2] > 0.25).any(axis=0)
    inside = (corners[..., 0] < side * np.abs(corners[..., 2]) + 0.5).any(axis=0) & (
        corners[..., 0] > -side * np.abs(corners[..., 2]) - 0.5
    ).any(axis=0)
    chosen = np.flatnonzero(ahead & inside)
    middle = corners[:, chosen, 2].mean(axis=0)
    chosen = chosen[np.argsort(-middle, kind="stable")]
    geometry = np.hstack([base[chosen], edge_u[chosen], edge_v[chosen]])
    attributes = world.attributes[kept[chosen]]
    lit = np.interp(
        along[kept[chosen]] + chainage_m, START_M + np.arange(world.light.size), world.light
    )
    attributes = attributes.copy()
    attributes[:, :6] *= (0.25 + 0.75 * lit)[:, None].astype(np.float32)
    return geometry, attributes


def _lens_grid(camera: Camera) -> tuple[npt.NDArray[np.float32], float]:
    """Where each pixel of a distorting lens finds its light in an undistorted picture.

    Returns:
        The source pixels, shape (H, W, 2), and the factor ≤ 1 by which the undistorted picture's
        focal length must be shortened so that none of them lies outside it.
    """
    width, height = camera.size_wh
    coarse_u = np.linspace(0, width - 1, 41)
    coarse_v = np.linspace(0, height - 1, 25)
    pixels = np.stack(np.meshgrid(coarse_u, coarse_v), axis=-1).reshape(-1, 1, 2)
    plane = cv2.undistortPoints(pixels, _matrix(camera), np.array(camera.distortion))
    offset = plane.reshape(25, 41, 2) * camera.focal_px
    room = np.array(camera.principal_uv) + 0.5
    shrink = float(min(1.0, (room / np.abs(offset).reshape(-1, 2).max(axis=0)).min()))
    source = offset * shrink + np.array(camera.principal_uv)
    # Written out: OpenCV interpolates at 32 places between two samples, half a pixel here.
    grid = np.einsum("va,abc,ub->vuc", _hats(height, 25), source, _hats(width, 41), optimize=True)
    return np.asarray(grid, np.float32), shrink


def _hats(pixels: int, samples: int) -> Array:
    """Weights (pixels, samples) that interpolate linearly between samples spread over an axis."""
    at = np.linspace(0, samples - 1, pixels)
    hats: Array = np.maximum(0.0, 1 - np.abs(at[:, None] - np.arange(samples)))
    return hats


_NO_SECOND_MAP: Any = None  # OpenCV's stubs do not know that it may be absent


def _bent(plane: Any, grid: npt.NDArray[np.float32], how: int) -> Any:
    """A plane of the undistorted picture as the lens shows it."""
    return cv2.remap(plane, grid, _NO_SECOND_MAP, how, borderMode=cv2.BORDER_REPLICATE)


def _matrix(camera: Camera) -> Array:
    u, v = camera.principal_uv
    return np.array([[camera.focal_px, 0, u], [0, camera.focal_px, v], [0, 0, 1.0]])


def to_picture(camera: Camera, points_xyz: Array) -> Array:
    """Project world points with the lens distortion, shape (..., 2); NaN behind the camera."""
    pixels = camera.project(points_xyz)
    if not any(camera.distortion):
        return pixels
    flat = pixels.reshape(-1, 2)
    plane = (flat - np.array(camera.principal_uv)) / camera.focal_px
    rays = np.column_stack([plane, np.ones(len(plane))])
    # past the radius where r·(1 + k1·r²) turns back, the model folds the world onto itself
    k1 = camera.distortion[0]
    limit = 1 / (-3 * k1) if k1 < 0 else np.inf
    good = np.isfinite(plane).all(axis=1) & (np.nan_to_num(plane**2).sum(axis=1) < limit)
    out = np.full_like(flat, np.nan)
    if good.any():
        zero = np.zeros(3)
        bent = cv2.projectPoints(
            rays[good], zero, zero, _matrix(camera), np.array(camera.distortion)
        )[0]
        out[good] = bent.reshape(-1, 2)
    return out.reshape(pixels.shape)


def rail_points(
    world: World, track: LocalTrack, chainage_m: float, along_m: Array, side: float
) -> Array:
    """World points of an ego rail's head at the given distances, shape (N, 3)."""
    waves = world.waves.copy()
    waves[:, tables.WAVE_START] -= chainage_m
    shift = np.array([displacement(waves, a, side) for a in along_m])
    return track.to_world(along_m, side * world.spacing_m / 2 + shift, 0.0)


def _true_rails(
    world: World, track: LocalTrack, chainage_m: float, camera: Camera
) -> tuple[Array, Array]:
    width, height = camera.size_wh
    empty = np.zeros((0, 2))
    here = np.interp(chainage_m, START_M + np.arange(world.offsets.shape[1]), world.offsets[0])
    if np.isnan(here):
        return empty, empty
    along = np.concatenate([np.linspace(0.8, 40, 120), np.geomspace(40.5, RAILS_REACH_M, 160)])
    reach = _reach_of_slope(track, camera.height_m)
    rails = []
    for side in (1.0, -1.0):
        points = rail_points(world, track, chainage_m, along, side)
        pixels = to_picture(camera, points)
        slope = (camera.height_m - points[:, 2]) / np.maximum(points[:, 0], 0.1)
        index = np.clip(slope / g.SLOPE_STEP, 0, len(reach) - 1).astype(int)
        hidden = reach[index] < points[:, 0] * 0.93 - 0.5
        inside = (
            np.isfinite(pixels).all(axis=1)
            & (np.nan_to_num(pixels[:, 0], nan=-9) > -0.5)
            & (np.nan_to_num(pixels[:, 0], nan=-9) < width - 0.5)
            & (np.nan_to_num(pixels[:, 1], nan=-9) < height - 0.5)
            & (points[:, 0] > 0)
            & ~hidden
        )
        rails.append(pixels[inside][::-1].copy())
    return rails[0], rails[1]


def _true_objects(
    world: World,
    things: npt.NDArray[np.int16],
    track: LocalTrack,
    chainage_m: float,
    camera: Camera,
) -> tuple[SceneObject, ...]:
    found = []
    width, height = camera.size_wh
    for thing in world.things:
        distance = thing.chainage_m - chainage_m
        if not -thing.length_m < distance < _DRAWN_REACH_M:
            continue
        count = 0
        if thing.type == "distortion":
            along = np.linspace(max(distance, 1.0), max(distance + thing.length_m, 1.5), 30)
            pixels = np.concatenate(
                [
                    to_picture(camera, rail_points(world, track, chainage_m, along, side))
                    for side in (1.0, -1.0)
                ]
            )
            pixels = pixels[np.isfinite(pixels).all(axis=1)]
            if not len(pixels):
                continue
            low, high = pixels.min(axis=0), pixels.max(axis=0)
        else:
            rows, cols = np.nonzero(things == thing.id)
            count = len(rows)
            if not count:
                continue
            low = np.array([cols.min(), rows.min()])
            high = np.array([cols.max(), rows.max()])
        low = np.maximum(low, 0)
        high = np.minimum(high, (width - 1, height - 1))
        if (high < low).any():
            continue
        found.append(
            SceneObject(
                thing.id,
                thing.type,
                thing.label,
                (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
                count,
                float(distance),
                thing.height_m,
                thing.lateral_m,
                thing.on_track,
            )
        )
    return tuple(found)


def render_stereo(
    seed: int, baseline_m: float, settings: SceneSettings | None = None
) -> tuple[Rendered, Rendered]:
    """Render a rectified stereo pair; the second camera stands ``baseline_m`` to the right."""
    settings = settings or SceneSettings()
    draft, alignment, camera = begin(seed, settings)
    camera = replace(camera, distortion=(0.0, 0.0, 0.0, 0.0, 0.0), roll_rad=0.0, yaw_rad=0.0)
    rng = np.random.default_rng([seed, 0xA402])
    if settings.occluders and draft.kind != "none":
        planting.sprinkle(draft, rng, camera.focal_px)
    world = finish(draft, seed, alignment, camera)
    left = view(world, np.random.default_rng([seed, 1]))
    partner = replace(camera, offset_m=camera.offset_m - baseline_m)
    right = view(world, np.random.default_rng([seed, 2]), camera=partner)
    return left, right


__all__ = ["Rendered", "SceneObject", "render", "render_stereo", "view"]
