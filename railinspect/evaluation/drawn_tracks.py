"""Segmentations of a known track, drawn through the camera: no renderer, no network."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from railinspect import labels
from railinspect.camera import Camera

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Masks:
    """A segmentation, as :class:`railinspect.track.geometry.SegmentationLike` asks for it."""

    labels: npt.NDArray[np.uint8]
    confidence: npt.NDArray[np.uint8]
    rail_score: npt.NDArray[np.uint8]

    def mirrored(self) -> Masks:
        """Left and right exchanged."""
        return Masks(
            *(
                np.ascontiguousarray(p[:, ::-1])
                for p in (self.labels, self.confidence, self.rail_score)
            )
        )


@dataclass(frozen=True)
class Thing:
    """An upright block on the track: class, chainage, lateral position, width, height (m)."""

    label: int
    range_m: float
    lateral_m: float
    width_m: float
    height_m: float


def centre_line(curvature: Callable[[Array], Array] | float, length_m: float = 320.0) -> Array:
    """x, y, heading by chainage steps of 0.25 m, shape (N, 4) with chainage first."""
    s = np.arange(0.0, length_m, 0.25)
    kappa = curvature(s) if callable(curvature) else np.full_like(s, curvature)
    heading = np.concatenate([[0.0], np.cumsum(kappa[:-1] * 0.25)])
    x = np.concatenate([[0.0], np.cumsum(np.cos(heading[:-1]) * 0.25)])
    y = np.concatenate([[0.0], np.cumsum(np.sin(heading[:-1]) * 0.25)])
    return np.stack([s, x, y, heading], axis=1)


def rail_points(line: Array, across_m: Array | float) -> Array:
    """Ground points at a lateral distance from the centre line, positive left, (N, 3)."""
    _, x, y, heading = line.T
    return np.stack([x - across_m * np.sin(heading), y + across_m * np.cos(heading), 0 * x], 1)


def draw_rail(score: npt.NDArray[np.uint8], camera: Camera, line: Array, across: Array) -> None:
    """Paint one rail head, at least 2 px wide, antialiased."""
    centre = camera.distort(camera.project(rail_points(line, across)))
    edge = camera.distort(camera.project(rail_points(line, across + labels.RAIL_HEAD_WIDTH_M / 2)))
    half = np.maximum(np.hypot(*(edge - centre).T), 1.0 * camera.size_wh[0] / 640)
    normal = np.stack([np.ones(len(centre)), np.zeros(len(centre))], 1)
    step = np.gradient(centre, axis=0)
    length = np.hypot(*step.T)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.stack([-step[:, 1], step[:, 0]], 1) / length[:, None]
    ends = np.stack([centre - normal * half[:, None], centre + normal * half[:, None]], 1)
    usable = np.isfinite(ends).all(axis=(1, 2)) & (np.abs(ends) < 30000).all(axis=(1, 2))
    height, width = score.shape
    inside = (centre[:, 0] > -40) & (centre[:, 0] < width + 40) & (centre[:, 1] < height + 40)
    usable &= inside
    for i in np.flatnonzero(usable[:-1] & usable[1:]):
        quad = np.array([ends[i, 0], ends[i, 1], ends[i + 1, 1], ends[i + 1, 0]])
        cv2.fillConvexPoly(score, np.round(quad * 16).astype(np.int32), 255, cv2.LINE_AA, 4)


def draw(
    camera: Camera,
    curvature: Callable[[Array], Array] | float = 0.0,
    *,
    bend: Callable[[Array], Array] | None = None,
    things: Sequence[Thing] = (),
    others_m: Sequence[float] = (),
    length_m: float = 320.0,
    from_m: float = 2.0,
) -> Masks:
    """Masks of a track.

    Args:
        camera: The camera.
        curvature: Curvature by chainage, 1/m, positive to the left.
        bend: Lateral displacement of both rails by chainage, metres: a distortion.
        things: Blocks standing on the ground.
        others_m: Lateral positions of parallel tracks' centre lines, metres.
        length_m: Length of the track drawn.
        from_m: Chainage where it starts.
    """
    width, height = camera.size_wh
    masks = np.full((height, width), labels.TERRAIN, np.uint8)
    rows = np.arange(height, dtype=float)
    cols = np.arange(width, dtype=float)
    grid = np.stack(np.meshgrid(cols, rows), axis=-1)
    ray = camera.ray(camera.undistort(grid))
    masks[ray[..., 2] >= 0] = labels.SKY
    line = centre_line(curvature, length_m)
    line = line[line[:, 0] >= from_m]
    if bend is None:  # far away, short steps are less than a pixel
        steps = np.maximum(1, (line[:, 0] / 12).astype(int))
        line = line[np.concatenate([[True], np.diff(np.cumsum(1.0 / steps).astype(int)) > 0])]
    score = np.zeros((height, width), np.uint8)
    shift = bend(line[:, 0]) if bend is not None else np.zeros(len(line))
    for track in (0.0, *others_m):
        bed = np.zeros_like(score)
        left = camera.distort(camera.project(rail_points(line, track + 1.6)))
        right = camera.distort(camera.project(rail_points(line, track - 1.6)))
        outline = np.concatenate([left, right[::-1]])
        outline = outline[np.isfinite(outline).all(axis=1) & (np.abs(outline) < 30000).all(axis=1)]
        cv2.fillPoly(bed, [np.round(outline * 16).astype(np.int32)], 255, cv2.LINE_8, 4)
        masks[(bed > 0) & (masks != labels.SKY)] = labels.TRACKBED
        half = camera.rail_spacing_m / 2
        displaced = shift if track == 0.0 else 0 * shift
        draw_rail(score, camera, line, track + half + displaced)
        draw_rail(score, camera, line, track - half + displaced)
    masks[(score >= 128) & (masks != labels.SKY)] = labels.RAIL_RAISED
    for thing in sorted(things, key=lambda t: -t.range_m):
        at = int(np.argmin(np.abs(line[:, 0] - thing.range_m)))
        foot = line[at : at + 1]
        corners = []
        for across in (thing.lateral_m + thing.width_m / 2, thing.lateral_m - thing.width_m / 2):
            base = rail_points(foot, across)[0]
            corners += [base, base + np.array([0.0, 0.0, thing.height_m])]
        quad = camera.distort(camera.project(np.array(corners)))[[0, 1, 3, 2]]
        block = np.zeros_like(score)
        cv2.fillConvexPoly(block, np.round(quad * 16).astype(np.int32), 255, cv2.LINE_8, 4)
        masks[block > 0] = thing.label
        score[block > 0] = 0
    return Masks(masks, np.full_like(masks, 230), score)


def camera(
    size_wh: tuple[int, int] = (640, 360),
    fov_deg: float = 55.0,
    height_m: float = 2.8,
    pitch_deg: float = 2.0,
    roll_deg: float = 0.0,
    **rest: object,
) -> Camera:
    """A cab camera in degrees."""
    return Camera.from_field_of_view(
        size_wh,
        np.radians(fov_deg),
        height_m,
        pitch_rad=float(np.radians(pitch_deg)),
        roll_rad=float(np.radians(roll_deg)),
        **rest,
    )
