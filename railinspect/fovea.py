"""A second, closer look: the network run once more on the middle of the picture.

The shipped network sees a picture at 640 pixels. Of one 1920 pixels wide it sees a thing 50 m ahead
at a third of its resolution, and most things beyond 30 m not at all. The track ahead needs only the
middle of the picture: half its width, around the horizon, is seen twice as sharp for the price of a
second run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.segmenter import Segmentation, Segmenter

Image = npt.NDArray[np.uint8]

WIDEST_PX = 1000
"""Narrower pictures need no second look: the network sees nearly all of their pixels."""

SHARE = 0.5
"""Width and height of the part seen twice, of the picture's."""

BELOW = 0.65
"""How much of it lies below the horizon: the track does."""


class Fovea:
    """A segmenter with a second look; call it with RGB images of any size.

    Args:
        segmenter: The network.
        camera: Where the horizon lies; resized to the picture.
    """

    def __init__(self, segmenter: Segmenter, camera: Camera) -> None:
        self._segmenter, self._camera = segmenter, camera

    @property
    def metadata(self) -> Any:
        """What the bundle says about itself."""
        return self._segmenter.metadata

    def __call__(self, rgb: Image) -> Segmentation:
        """Label an image, its middle by the closer look.

        Args:
            rgb: uint8 (H, W, 3).
        """
        whole = self._segmenter(rgb)
        if rgb.shape[1] < WIDEST_PX:
            return whole
        left, top, right, bottom = self.window(rgb.shape[1], rgb.shape[0])
        close = self._segmenter(np.ascontiguousarray(rgb[top:bottom, left:right]))
        planes = []
        for far, near in (
            (whole.labels, close.labels),
            (whole.confidence, close.confidence),
            (whole.rail_score, close.rail_score),
        ):
            plane = far.copy()
            plane[top:bottom, left:right] = near
            planes.append(plane)
        return Segmentation(*planes)

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the part seen twice, pixels, the last two excluded.

        Args:
            width: Of the picture.
            height: Likewise.
        """
        camera = self._camera.resized((width, height))
        wide, tall = round(SHARE * width), round(SHARE * height)
        left = round(camera.principal_uv[0] - 0.5 * wide)
        top = round(camera.horizon_v() - (1.0 - BELOW) * tall)
        left = min(max(left, 0), width - wide)
        top = min(max(top, 0), height - tall)
        return left, top, left + wide, top + tall
