"""Closer looks: the network run again on the middle of the picture, and on the middle of that.

The shipped network sees a picture at 640 pixels. Of one 1920 pixels wide it sees a thing 50 m ahead
at a third of its resolution, and most things beyond 30 m not at all. The track ahead needs only the
middle of the picture. Each look is half as wide and as high as the one before, until the network
sees every pixel there is: half the picture around the horizon, a quarter of it where the track
runs on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.bundle import BundleMetadata
from railinspect.camera import Camera
from railinspect.segmenter import Segmentation, Segmenter
from railinspect.track import TrackFollower
from railinspect.track.geometry import SegmentationLike

Image = npt.NDArray[np.uint8]
SegmentFunction = Callable[[Image], SegmentationLike]

WIDEST_PX = 1000
"""Narrower pictures need no second look: the network sees nearly all of their pixels."""

BELOW = 0.65
"""How much of a look lies below the horizon: the track does."""

KEPT_RAIL = 0.4
"""Share of a rail's probability that stays where the closer look sees none: less than the half at
which a rail's width ends, so that a rail seen by both is as narrow as the closer look has it."""

AHEAD_M = 100.0
"""Where the track is here, or where it is last seen, is the middle of the looks after the first."""


class Network(Protocol):
    """Labels pictures of any size, seeing them at its own."""

    @property
    def metadata(self) -> BundleMetadata:
        """What the bundle says about itself."""

    @property
    def threads(self) -> int:
        """Processor threads of one picture."""

    def on_one_thread(self) -> Network:
        """The same for several pictures at once, each on a thread of its own."""

    def __call__(self, rgb: Image) -> Segmentation:
        """Label a picture."""


def for_stills(segment: SegmentFunction, camera: Camera | None) -> SegmentFunction:
    """A network with closer looks, as single pictures are seen: nothing hurries there.

    Args:
        segment: From picture to masks. What is no bundle's network stays as it is.
        camera: Where the horizon lies; None has the track say so.
    """
    return Fovea(segment, camera) if isinstance(segment, Segmenter) else segment


class Fovea:
    """A segmenter with closer looks; call it with RGB images of any size.

    Args:
        segmenter: The network.
        camera: Where the horizon lies; resized to the picture. None has the track of the first
            look say so, in each picture anew.
    """

    def __init__(self, segmenter: Network, camera: Camera | None = None) -> None:
        self._segmenter, self._camera = segmenter, camera

    @property
    def metadata(self) -> BundleMetadata:
        """What the bundle says about itself."""
        return self._segmenter.metadata

    @property
    def threads(self) -> int:
        """Processor threads of one look."""
        return self._segmenter.threads

    def on_one_thread(self) -> Fovea:
        """The same for several images at once, each on a thread of its own."""
        return Fovea(self._segmenter.on_one_thread(), self._camera)

    def __call__(self, rgb: Image) -> Segmentation:
        """Label an image, its middle by the closer looks.

        Args:
            rgb: uint8 (H, W, 3).
        """
        seen = self._segmenter(rgb)
        tall, wide = rgb.shape[:2]
        if wide < WIDEST_PX:
            return seen
        if self._camera is not None:
            camera = self._camera.resized((wide, tall))
        else:
            camera = TrackFollower().update(seen).camera
        middle = camera.principal_uv[0], camera.horizon_v()
        while wide > self.metadata.input_size_wh[0]:
            wide, tall = wide // 2, tall // 2
            left, top = _corner(middle, (wide, tall), (rgb.shape[1], rgb.shape[0]))
            part = np.ascontiguousarray(rgb[top : top + tall, left : left + wide])
            seen = looked_closer(seen, self._segmenter(part), (left, top))
            if wide > self.metadata.input_size_wh[0]:
                middle = _where_it_runs_on(seen, camera) or middle
        return seen


def looked_closer(
    seen: Segmentation, close: Segmentation, corner_uv: tuple[int, int]
) -> Segmentation:
    """What is seen of an image with a closer look at a part of it in place.

    The closer look has the say on every class. A rail that it does not see but the look before
    did is kept with less of its probability (``KEPT_RAIL``): where the picture is blurred the
    closer look has less to go by.

    Args:
        seen: The image as seen before.
        close: The part, as the closer look sees it.
        corner_uv: Left and top of the part.
    """
    left, top = corner_uv
    tall, wide = close.labels.shape
    part = np.s_[top : top + tall, left : left + wide]
    labels, confidence, rail_score = (
        plane.copy() for plane in (seen.labels, seen.confidence, seen.rail_score)
    )
    labels[part], confidence[part] = close.labels, close.confidence
    kept = cv2.convertScaleAbs(rail_score[part], alpha=KEPT_RAIL)
    rail_score[part] = np.maximum(close.rail_score, kept)
    box = (left, top, left + wide, top + tall)
    return Segmentation(labels, confidence, rail_score, box, seen, seen.close_ups)


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
