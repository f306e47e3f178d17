"""Draws ``docs/pictures/inspector.jpg``: each step from a frame's masks to its findings.

The frames are rendered, the masks true. Run ``python docs/make_inspector_pictures.py``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.evaluation import true_segmentation
from railinspect.findings import Finding, find
from railinspect.labels import PALETTE
from railinspect.scenes import Ride, demo_settings
from railinspect.sinks.overlay import TYPE_RGB
from railinspect.track import TrackFollower, TrackGeometry

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]

RAIL, ROI, WINDOW = (60, 225, 235), (60, 150, 235), (250, 190, 60)
VIEW_M, PIXEL_M = (60.0, 7.2), 0.04
"""Length and width of the bird's-eye view and the size of its pixels, metres."""


def main() -> None:
    """Render, follow, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parent / "pictures" / "inspector.jpg"
    parser.add_argument("--out", type=Path, default=default, help=f"default: {default}")
    options = parser.parse_args()
    ride = Ride.plan(5, demo_settings(), duration_s=50.0, anomalies="demo")
    rows = []
    for kind in ("distortion", "trespasser"):
        thing = next(t for t in ride.planted if t.type == kind)
        index = round((thing.chainage_m - 24.0) / ride.speed_mps * ride.frame_rate)
        rows.append(_row(ride, index))
    picture = np.vstack(rows)
    cv2.imwrite(
        str(options.out),
        cv2.cvtColor(picture, cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, 80],
    )
    print(options.out)


def _row(ride: Ride, index: int) -> Image:
    """Four panels of one frame: segmentation, region of interest, bird's-eye view, findings."""
    follower = TrackFollower(ride.camera)
    for number in range(max(0, index - 2), index + 1):
        frame = ride.frame(number)
        masks = true_segmentation(frame.labels)
        track = follower.update(masks)
    found = find(masks, track)
    palette = np.vstack([PALETTE, np.zeros((256 - len(PALETTE), 3), np.uint8)]).astype(np.uint8)
    classes = cv2.addWeighted(frame.rgb, 0.35, palette[frame.labels], 0.65, 0.0)
    roi = frame.rgb.copy()
    _polyline(roi, track.roi_uv, ROI, closed=True)
    for rail in (track.left_uv, track.right_uv):
        _polyline(roi, rail, RAIL)
    if track.vanishing_uv is not None:
        u, v = np.round(track.vanishing_uv).astype(int).tolist()
        cv2.circle(roi, (u, v), 4, ROI, -1, cv2.LINE_AA)
    panels = [
        _titled(np.asarray(classes, np.uint8), "1 segmentation"),
        _titled(roi, "2 vanishing point, region of interest, rails"),
        _titled(_birds_eye(frame.rgb, track), "3 bird's-eye view with the smooth track"),
        _titled(_findings(frame.rgb, found), "4 findings"),
    ]
    return np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])


def _birds_eye(rgb: Image, track: TrackGeometry) -> Image:
    """The plane of the rails from above, the train at the left, fitted into the picture's size."""
    length, width = VIEW_M
    x = np.arange(4.0, length, PIXEL_M * 2.5)
    y = np.arange(width / 2, -width / 2, -PIXEL_M)
    places = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)
    uv = track.camera.distort(track.camera.project(places)).astype(np.float32)
    view = np.asarray(cv2.remap(rgb, uv, None, cv2.INTER_LINEAR), np.uint8)
    path = track.path
    if path is not None:
        for side, colour in ((1.0, RAIL), (-1.0, RAIL), (0.0, WINDOW)):
            normal = np.stack([-np.sin(path.heading_rad), np.cos(path.heading_rad)], axis=1)
            at = (path.xy_m + side * path.half_m[:, None] * normal)[path.seen]
            points = np.stack(
                [(at[:, 0] - 4.0) / (PIXEL_M * 2.5), (width / 2 - at[:, 1]) / PIXEL_M]
            )
            _polyline(view, points.T, colour)
    height = round(view.shape[0] * rgb.shape[1] / view.shape[1])
    resized = cv2.resize(view, (rgb.shape[1], height), interpolation=cv2.INTER_AREA)
    canvas = np.full_like(rgb, 24)
    top = (rgb.shape[0] - height) // 2
    canvas[max(0, top) : max(0, top) + min(height, rgb.shape[0])] = resized[: rgb.shape[0]]
    return canvas


def _findings(rgb: Image, found: tuple[Finding, ...]) -> Image:
    picture = rgb.copy()
    for number, finding in enumerate(found):
        colour = TYPE_RGB[finding.type]
        _polyline(picture, finding.polygon_uv, colour, closed=True)
        left, top, right, bottom = (round(v) for v in finding.box_xyxy)
        cv2.rectangle(picture, (left - 2, top - 2), (right + 2, bottom + 2), colour, 1)
        cv2.putText(
            picture,
            finding.type,
            (left, bottom + 16 if number % 2 == 0 else max(12, top - 6)),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            colour,
            1,
        )
    return picture


def _polyline(
    picture: Image, points: Array, colour: tuple[int, int, int], closed: bool = False
) -> None:
    if len(points) > 1:
        fixed = np.round(points * 8).astype(np.int32)
        cv2.polylines(picture, [fixed], closed, colour, 1, cv2.LINE_AA, 3)


def _titled(picture: Image, words: str) -> Image:
    picture = picture.copy()
    picture[:22] = picture[:22] // 4
    cv2.putText(
        picture, words, (8, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.48, (245, 247, 250), 1, cv2.LINE_AA
    )
    return picture


if __name__ == "__main__":
    main()
