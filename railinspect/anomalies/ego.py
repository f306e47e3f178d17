"""The ego track of one picture in pixels and in metres: where things can be put, and how large.

The scale comes from the track itself. Two rails cut by one row of an upright camera lie at one
distance Z along the viewing direction, a spacing s apart at right angles to the track, so they are

    w = f · s / (Z · cos ψ)                                  (ψ: heading against the camera)

pixels apart. Read backwards, every row gives the distance and the place of the track's centre,
whatever its gradient and curve. The focal length f turns the direction of a pixel into an angle;
where no camera is known a usual one is assumed, and no range is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, RAIL_EMBEDDED, RAIL_RAISED, RAILS, VOID
from railinspect.scenes import Rendered
from railinspect.scenes.draft import World
from railinspect.scenes.rails import RAIL_HEIGHT_M
from railinspect.scenes.render import rail_points
from railinspect.segmenter import Segmentation
from railinspect.track import TrackFollower

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

ASSUMED_FOV_RAD: Final = math.radians(50.0)
"""Horizontal field of view assumed of an unknown camera, radians."""

LEAST_SPACING_PX: Final = 6.0
"""Rows in which the rails are nearer to each other are too far away to be measured, pixels."""

LEAST_ROWS: Final = 12
"""Fewest rows with both rails that make a track."""

_WORK_WIDTH_PX: Final = 640
_REACH_M: Final = 300.0


class NoTrackError(BadInputError):
    """A picture in which no ego track can be followed."""


@dataclass(frozen=True)
class EgoTrack:
    """The ego track, sampled from near to far; N samples.

    Attributes:
        camera: The camera, or the one assumed.
        calibrated: Whether the camera is known, so that distances along the track are true.
        along_m: Distance along the track from under the camera, rising, metres, shape (N,).
        centre_xyz: Centre line at the height of the rail tops, world metres, shape (N, 3).
        heading_rad: Heading against world x, positive left, shape (N,).
        rows_px: Row of each sample, falling, shape (N,).
        left_px: Column of the left rail in that row, shape (N,).
        right_px: Column of the right rail in that row, shape (N,).
        embedded: Whether the rails lie in the ground, level with it.
    """

    camera: Camera
    calibrated: bool
    along_m: Array
    centre_xyz: Array
    heading_rad: Array
    rows_px: Array
    left_px: Array
    right_px: Array
    embedded: bool = False

    @property
    def ground_m(self) -> float:
        """Height of the ground beside the rails against the rail tops, metres."""
        return 0.0 if self.embedded else -RAIL_HEIGHT_M

    @property
    def metre_px(self) -> Array:
        """Pixels per metre across the track along each sample's row, shape (N,)."""
        return (self.right_px - self.left_px) / self.camera.rail_spacing_m

    def points(self, along_m: npt.ArrayLike, left_m: npt.ArrayLike, up_m: npt.ArrayLike) -> Array:
        """World points of track coordinates, metres, shape (..., 3)."""
        along, left, up = np.broadcast_arrays(
            np.asarray(along_m, float), np.asarray(left_m, float), np.asarray(up_m, float)
        )
        heading = np.interp(along, self.along_m, self.heading_rad)
        centre = np.stack(
            [np.interp(along, self.along_m, self.centre_xyz[:, i]) for i in range(3)], axis=-1
        )
        out = np.stack([-left * np.sin(heading), left * np.cos(heading), up], axis=-1)
        return cast(Array, centre + out)

    def pixels(self, along_m: npt.ArrayLike, left_m: npt.ArrayLike, up_m: npt.ArrayLike) -> Array:
        """Pixels of track coordinates as the lens shows them, shape (..., 2)."""
        return self.camera.distort(self.camera.project(self.points(along_m, left_m, up_m)))

    def section(self, near_share: float, far_share: float) -> tuple[float, float]:
        """The part R′ of the track, equations 44 to 46, as distances along it.

        Args:
            near_share: τ₁, share of the way from the track's lowest row to its horizon, 0…1.
            far_share: τ₂, likewise.

        Returns:
            Distances along the track, metres: near and far end.

        Raises:
            NoTrackError: if the rails are not seen there.
        """
        middle = 0.5 * (self.left_px + self.right_px)
        bottom = self.rows_px[0]
        top = self.camera.horizon_v(float(middle[-1]))
        near_v = bottom - near_share * (bottom - top)
        far_v = bottom - far_share * (bottom - top)
        inside = (self.rows_px <= near_v) & (self.rows_px >= far_v)
        if inside.sum() < 2:
            raise NoTrackError(
                f"the rails are not seen between rows {far_v:.0f} and {near_v:.0f}, where the "
                "anomaly belongs; use another picture or other shares of the track"
            )
        along = self.along_m[inside]
        return float(along[0]), float(along[-1])


def track_of_rails(
    left_uv: npt.ArrayLike,
    right_uv: npt.ArrayLike,
    size_wh: tuple[int, int],
    camera: Camera | None = None,
    embedded: bool = False,
) -> EgoTrack:
    """The ego track of two rails given as polylines.

    Args:
        left_uv: Left rail, pixels, shape (M, 2), in any order along the rail.
        right_uv: Right rail, likewise.
        size_wh: Size of the picture.
        camera: The camera; None assumes one of standard gauge.
        embedded: Whether the rails lie level with the ground.

    Raises:
        NoTrackError: if the polylines are not two rails of one track.
    """
    given = None if camera is None else camera.resized(size_wh)
    guess = given or Camera.from_field_of_view(size_wh, ASSUMED_FOV_RAD, 2.6)
    left, right = (_upright(np.asarray(rail, float), guess) for rail in (left_uv, right_uv))
    low = min(left[:, 1].max(), right[:, 1].max())
    high = max(left[:, 1].min(), right[:, 1].min())
    rows = np.arange(math.floor(low), math.ceil(high) - 1, -1.0)
    if len(rows) < LEAST_ROWS:
        raise NoTrackError(
            f"the two rails share {max(0, len(rows))} rows; at least {LEAST_ROWS} are needed to "
            "measure a track"
        )
    ends = [np.interp(rows, rail[::-1, 1], rail[::-1, 0]) for rail in (left, right)]
    wide = ends[1] - ends[0]
    if (wide[: len(rows) // 4] <= 0).any():
        raise NoTrackError("the rails cross or change sides; no track lies between them")
    # nearer than the tightest row the spacing falls steadily; beyond it the rails cannot be told
    usable = int(np.argmax(wide < LEAST_SPACING_PX)) or len(rows)
    usable = 0 if wide[0] < LEAST_SPACING_PX else usable
    if usable < LEAST_ROWS:
        raise NoTrackError(
            f"the rails are {LEAST_SPACING_PX:.0f} pixels or more apart in {usable} rows only; at "
            f"least {LEAST_ROWS} are needed to measure a track"
        )
    rows, wide = rows[:usable], wide[:usable]
    ends = [end[:usable] for end in ends]
    if given is None:
        guess = _levelled(guess, rows, wide)
    centre = np.array(guess.principal_uv)
    across = (0.5 * (ends[0] + ends[1]) - centre[0]) / guess.focal_px
    depth = _depth(guess, wide, across)
    seen = np.stack([across * depth, (rows - centre[1]) / guess.focal_px * depth, depth], axis=-1)
    unrolled = replace(guess, roll_rad=0.0)
    world = seen @ unrolled.camera_from_world
    if given is None:
        guess = replace(guess, height_m=float(max(0.3, -np.median(world[:, 2]))))
    world += np.array([0.0, guess.offset_m, guess.height_m])
    world = _smooth(world)
    steps = np.linalg.norm(np.diff(world, axis=0), axis=1)
    along = math.hypot(world[0, 0], world[0, 1]) + np.concatenate([[0.0], np.cumsum(steps)])
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(along)) > 1e-6])
    # back to the picture's own rows: with roll and lens each rail has its own
    rails = [_as_seen(np.stack([end, rows], axis=-1), guess) for end in ends]
    own_rows = 0.5 * (rails[0][:, 1] + rails[1][:, 1])
    left_px, right_px = (np.interp(-own_rows, -rail[:, 1], rail[:, 0]) for rail in rails)
    slope = np.gradient(world[:, :2], axis=0)
    heading = np.arctan2(slope[:, 1], slope[:, 0])
    return EgoTrack(
        guess,
        given is not None,
        along[rising],
        world[rising],
        heading[rising],
        own_rows[rising],
        left_px[rising],
        right_px[rising],
        embedded,
    )


def track_of_mask(labels: Image, camera: Camera | None = None) -> EgoTrack:
    """Find the ego track in a class mask, with the package's own follower.

    Args:
        labels: RailSem19 class ids, shape (H, W).
        camera: The camera, if it is known.

    Raises:
        NoTrackError: if no track can be followed; the sentence says why.
        BadInputError: if the mask is no mask.
    """
    check_mask(labels)
    height, width = labels.shape
    scale = min(1.0, _WORK_WIDTH_PX / width)
    small = (max(1, round(width * scale)), max(1, round(height * scale)))
    rails = cv2.LUT(labels, _RAIL_TABLE)
    classes = labels
    if scale < 1:
        classes = cast(Image, cv2.resize(labels, small, interpolation=cv2.INTER_NEAREST))
        rails = cv2.resize(rails, small, interpolation=cv2.INTER_AREA)
    score = cast(Image, rails)
    known = None if camera is None else camera.resized(small)
    found = TrackFollower(known).update(
        Segmentation(classes, np.full_like(classes, 255), score), None
    )
    if not found.followed:
        raise NoTrackError(f"no ego track can be followed in the mask: {found.reason}")
    stretch = np.array([width / small[0], height / small[1]])
    left, right = (
        (np.asarray(rail) + 0.5) * stretch - 0.5 for rail in (found.left_uv, found.right_uv)
    )
    return track_of_rails(left, right, (width, height), camera, is_embedded(labels, left))


def track_of_world(world: World, picture: Rendered) -> EgoTrack:
    """The ego track of a rendered picture, from the world it was rendered from.

    Raises:
        NoTrackError: if the picture shows too little of it.
    """
    camera = picture.camera
    width, height = camera.size_wh
    local = world.alignment.local(picture.chainage_m, _REACH_M + 10.0)
    along = np.concatenate([np.arange(1.0, 30.0, 0.1), np.geomspace(30.0, _REACH_M, 400)])
    rails = []
    for side in (1.0, -1.0):
        points = rail_points(world, local, picture.chainage_m, along, side)
        rails.append(camera.distort(camera.project(points)))
    centre = local.to_world(along, 0.0, 0.0)
    uv = camera.distort(camera.project(centre))
    depth = (centre - [0.0, camera.offset_m, camera.height_m]) @ camera.camera_from_world[2]
    good = np.isfinite(uv).all(axis=1) & np.isfinite(np.concatenate(rails, axis=1)).all(axis=1)
    good &= (uv[:, 0] > 0) & (uv[:, 0] < width - 1) & (uv[:, 1] > 0) & (uv[:, 1] < height - 1)
    at = np.clip(np.nan_to_num(uv), 0, [width - 1, height - 1]).round().astype(int)
    good &= picture.depth_m[at[:, 1], at[:, 0]] > 0.93 * depth - 0.5
    good &= np.nan_to_num(rails[1][:, 0] - rails[0][:, 0]) >= LEAST_SPACING_PX
    rows = np.where(good, uv[:, 1], np.inf)
    good &= rows <= np.minimum.accumulate(rows)  # behind a crest rows rise again
    shown = np.isfinite(world.offsets[0]).any() and good.sum() >= LEAST_ROWS
    if not shown or np.ptp(uv[good, 1]) < LEAST_ROWS:
        raise NoTrackError("the rendered picture shows too little of the ego track")
    heading = np.interp(along, local.along_m, local.heading_rad)
    own = uv[:, 1]
    columns = []
    for rail in rails:
        order = np.argsort(rail[:, 1])
        columns.append(np.interp(own, rail[order, 1], rail[order, 0]))
    embedded = is_embedded(picture.labels, rails[0][good])
    return EgoTrack(
        camera,
        True,
        along[good],
        centre[good],
        heading[good],
        own[good],
        columns[0][good],
        columns[1][good],
        embedded,
    )


def check_mask(labels: npt.NDArray[np.generic]) -> None:
    """Refuse what is no mask of RailSem19 class ids.

    Raises:
        BadInputError: if the array is not (H, W) uint8 or holds an unknown id.
    """
    if labels.ndim != 2 or labels.dtype != np.uint8 or labels.size == 0:
        raise BadInputError(
            f"a mask must be a non-empty uint8 array (H, W), not {labels.dtype} of shape "
            f"{labels.shape}"
        )
    bad = cv2.LUT(np.asarray(labels, np.uint8), _BAD_TABLE)
    if cv2.countNonZero(bad):
        wrong = int(np.asarray(labels)[np.asarray(bad) > 0][0])
        raise BadInputError(
            f"the mask holds class id {wrong}; allowed are 0…{len(CLASSES) - 1} and {VOID} for void"
        )


def is_embedded(labels: Image, rail_uv: Array) -> bool:
    """Whether most labelled points of a rail are ``rail-embedded``."""
    height, width = labels.shape
    at = np.clip(np.nan_to_num(rail_uv), 0, [width - 1, height - 1]).round().astype(int)
    seen = labels[at[:, 1], at[:, 0]]
    return bool((seen == RAIL_EMBEDDED).sum() > (seen == RAIL_RAISED).sum())


_RAIL_TABLE = np.zeros(256, np.uint8)
_RAIL_TABLE[list(RAILS)] = 255
_BAD_TABLE = np.ones(256, np.uint8)
_BAD_TABLE[[*range(len(CLASSES)), VOID]] = 0


def _upright(rail_uv: Array, camera: Camera) -> Array:
    """A rail from low to high as an ideal camera without lens distortion and roll shows it."""
    if rail_uv.ndim != 2 or rail_uv.shape[1:] != (2,) or len(rail_uv) < 2:
        raise NoTrackError(
            f"a rail is a polyline of two points (u, v) or more, got shape {rail_uv.shape}"
        )
    if not np.isfinite(rail_uv).all() or np.abs(rail_uv).max() > 1e5:
        raise NoTrackError("a rail holds points that are no pixels (not finite or beyond 100 000)")
    ordered = rail_uv[np.argsort(-rail_uv[:, 1], kind="stable")]
    ideal = _rolled(camera.undistort(ordered), camera, -camera.roll_rad)
    ideal = ideal[np.argsort(-ideal[:, 1], kind="stable")]
    keep = np.concatenate([[True], np.diff(ideal[:, 1]) < -1e-9])
    return cast(Array, ideal[keep])


def _as_seen(pixels_uv: Array, camera: Camera) -> Array:
    return camera.distort(_rolled(pixels_uv, camera, camera.roll_rad))


def _rolled(pixels_uv: Array, camera: Camera, angle_rad: float) -> Array:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    centre = np.array(camera.principal_uv)
    return cast(Array, (pixels_uv - centre) @ np.array([[cos, -sin], [sin, cos]]) + centre)


def _levelled(camera: Camera, rows: Array, wide: Array) -> Camera:
    """The assumed camera, pitched so that its horizon lies where the rails meet."""
    slope, start = np.polyfit(rows, wide, 1, w=np.sqrt(wide))
    horizon = -start / slope if slope > 1e-6 else camera.principal_uv[1]
    height = camera.size_wh[1]
    horizon = min(max(horizon, -0.5 * height), float(rows[-1]) - 1.0)
    return replace(
        camera, pitch_rad=math.atan((camera.principal_uv[1] - horizon) / camera.focal_px)
    )


def _depth(camera: Camera, wide: Array, across: Array) -> Array:
    """Distance along the viewing direction, w = f·s/(Z·cos ψ) solved for Z, shape (N,)."""
    straight = camera.focal_px * camera.rail_spacing_m / wide
    depth = straight
    for _ in range(3):
        place = _smooth(np.stack([across * depth, depth], axis=-1))
        step = np.gradient(place, axis=0)
        heading = np.arctan2(step[:, 0], np.maximum(np.abs(step[:, 1]), 1e-9))
        depth = straight / np.cos(np.clip(heading, -0.9, 0.9))
    return depth


def _smooth(points: Array) -> Array:
    """Points averaged with their neighbours over a thirtieth of the length; the ends stay."""
    half = max(1, len(points) // 60)
    padded = np.concatenate(
        [2 * points[:1] - points[half:0:-1], points, 2 * points[-1:] - points[-2 : -half - 2 : -1]]
    )
    total = np.cumsum(np.concatenate([np.zeros((1, points.shape[1])), padded]), axis=0)
    return cast(Array, (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1))
