"""Closer looks: the network run again on the middle of the picture, and on the middle of that.

The shipped network sees a picture at 640 pixels. Of one 1920 pixels wide it sees a thing 50 m ahead
at a third of its resolution, and most things beyond 30 m not at all. The track ahead needs only the
middle of the picture. Each look is half as wide and as high as the one before, until the network
sees every pixel there is: half the picture around the horizon, a quarter of it where the track
runs on.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from railinspect.bundle import BundleMetadata
from railinspect.camera import Camera
from railinspect.segmenter import Segmentation
from railinspect.track import TrackFollower

Image = npt.NDArray[np.uint8]

WIDEST_PX = 1000
"""Narrower pictures need no second look: the network sees nearly all of their pixels."""

BELOW = 0.65
"""How much of a look lies below the horizon: the track does."""

AHEAD_M = 100.0
"""Where the track is here, or where it is last seen, is the middle of the looks after the first."""


class Network(Protocol):
    """Labels pictures of any size, seeing them at its own."""

    @property
    def metadata(self) -> BundleMetadata:
        """What the bundle says about itself."""

    def __call__(self, rgb: Image) -> Segmentation:
        """Label a picture."""


class Fovea:
    """A segmenter with closer looks; call it with RGB images of any size.

    Args:
        segmenter: The network.
        camera: Where the horizon lies; resized to the picture.
    """

    def __init__(self, segmenter: Network, camera: Camera) -> None:
        self._segmenter, self._camera = segmenter, camera

    @property
    def metadata(self) -> BundleMetadata:
        """What the bundle says about itself."""
        return self._segmenter.metadata

    def __call__(self, rgb: Image) -> Segmentation:
        """Label an image, its middle by the closer looks.

        Args:
            rgb: uint8 (H, W, 3).
        """
        seen = self._segmenter(rgb)
        tall, wide = rgb.shape[:2]
        if wide < WIDEST_PX:
            return seen
        camera = self._camera.resized((wide, tall))
        middle = camera.principal_uv[0], camera.horizon_v()
        while wide > self.metadata.input_size_wh[0]:
            wide, tall = wide // 2, tall // 2
            left, top = _corner(middle, (wide, tall), (rgb.shape[1], rgb.shape[0]))
            part = np.s_[top : top + tall, left : left + wide]
            close = self._segmenter(np.ascontiguousarray(rgb[part]))
            planes = []
            for far, near in (
                (seen.labels, close.labels),
                (seen.confidence, close.confidence),
                (seen.rail_score, close.rail_score),
            ):
                plane = far.copy()
                plane[part] = near
                planes.append(plane)
            seen = Segmentation(*planes)
            if wide > self.metadata.input_size_wh[0]:
                middle = _where_it_runs_on(seen, camera) or middle
        return seen


def _corner(
    middle_uv: tuple[float, float], look_wh: tuple[int, int], image_wh: tuple[int, int]
) -> tuple[int, int]:
    """Left and top of a look around the horizon at ``middle_uv``, kept inside the image."""
    left = round(middle_uv[0] - 0.5 * look_wh[0])
    top = round(middle_uv[1] - (1.0 - BELOW) * look_wh[1])
    left = min(max(left, 0), image_wh[0] - look_wh[0])
    return left, min(max(top, 0), image_wh[1] - look_wh[1])


def _where_it_runs_on(seen: Segmentation, camera: Camera) -> tuple[float, float] | None:
    """Column of the track at ``AHEAD_M`` and the horizon's row there; None without a track."""
    track = TrackFollower(camera).update(seen)
    if track.path is None:
        return None
    at = min(AHEAD_M, float(track.path.chainage_m[track.path.seen][-1]))
    u = float(np.interp(at, track.path.chainage_m, track.path.uv[:, 0]))
    return u, track.camera.horizon_v(u)
