"""A flat track of known geometry as a camera sees it, with its picture and mask."""

import numpy as np

from railinspect.anomalies.ego import EgoTrack, track_of_rails
from railinspect.anomalies.sources import draw_mask
from railinspect.camera import Camera
from railinspect.labels import TERRAIN, VOID


def a_camera(size_wh=(960, 540), **rest) -> Camera:
    rest = {"pitch_rad": 0.03, **rest}
    return Camera.from_field_of_view(size_wh, np.radians(50.0), rest.pop("height_m", 2.6), **rest)


def rails(camera: Camera, radius_m: float = np.inf, reach_m: float = 150.0, grade: float = 0.0):
    """Both rails of an arc of given radius (positive bends left) on a plane, pixels."""
    along = np.geomspace(2.0, reach_m, 2000)
    angle = along / radius_m
    x = along * np.sinc(angle / np.pi)
    y = along * angle / 2 * np.sinc(angle / 2 / np.pi) ** 2
    out = []
    for side in (0.5, -0.5):
        left = side * camera.rail_spacing_m
        points = np.stack(
            [x - left * np.sin(angle), y + left * np.cos(angle), grade * along], axis=-1
        )
        uv = camera.distort(camera.project(points))
        inside = ((uv >= 0) & (uv <= np.array(camera.size_wh) - 1)).all(axis=1)
        out.append(uv[inside])
    return out[0], out[1]


def flat_picture(
    camera: Camera, radius_m: float = np.inf
) -> tuple[np.ndarray, np.ndarray, EgoTrack]:
    """Picture, mask and track: grainy ground, bright rails, terrain all over."""
    track = track_of_rails(*rails(camera, radius_m), camera.size_wh, camera)
    labels = draw_mask(track, camera.size_wh)
    labels[labels == VOID] = TERRAIN
    rng = np.random.default_rng(3)
    rgb = rng.normal(110, 12, (*labels.shape, 3)).clip(0, 255).astype(np.uint8)
    rgb[labels == 17] = (210, 210, 214)
    return rgb, labels, track
