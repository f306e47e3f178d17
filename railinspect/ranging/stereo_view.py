"""The stereo pair of one frame: ranges of its findings, matched only where they stand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.findings import Finding
from railinspect.ranging.fusion import Absent
from railinspect.ranging.stereo import RegionRange, StereoSettings, match_rows, region_range
from railinspect.ranging.stereo_camera import StereoCamera

Image = npt.NDArray[np.uint8]

_ROWS_PX = 24
"""Rows matched above and below a thing: semi-global matching leans on its surroundings."""

_NEAREST_M = 6.0
"""Nearer than this nothing is looked for; it sets how far a pair is searched."""


@dataclass(frozen=True)
class StereoView:
    """A rectified pair whose sides :func:`railinspect.ranging.stereo.check_sides` has passed.

    Attributes:
        left: Left picture, RGB uint8 (H, W, 3): the frame itself.
        right: Right picture of the same size.
        camera: Calibration of the pair.
        settings: How to match; the disparities searched follow from the camera.
    """

    left: Image
    right: Image
    camera: StereoCamera
    settings: StereoSettings = field(default_factory=StereoSettings)

    def range_of(self, finding: Finding) -> RegionRange | Absent:
        """Range of a finding's outline along the viewing axis.

        Raises:
            BadInputError: if the pictures differ in size or kind.
        """
        height, width = self.left.shape[:2]
        outline = np.round(finding.polygon_uv).astype(np.int32)
        if len(outline) < 3:
            return Absent("its outline encloses nothing that could be matched")
        first = max(0, int(outline[:, 1].min()) - _ROWS_PX)
        last = min(height, int(outline[:, 1].max()) + _ROWS_PX + 1)
        region = np.zeros((last - first, width), np.uint8)
        cv2.fillPoly(region, [outline - np.array([0, first], np.int32)], 1)
        most = self.camera.focal_px * self.camera.baseline_m / _NEAREST_M - self.camera.offset_px
        settings = replace(self.settings, most_px=int(np.clip(most, 16, width // 3)))
        disparity = match_rows(self.left[first:last], self.right[first:last], settings)
        return region_range(disparity, region > 0, self.camera, settings)
