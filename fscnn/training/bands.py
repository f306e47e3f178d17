"""Scores by range: what the camera sees of rails near and far."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from fscnn.training.metrics import Labels, Scores
from railinspect.camera import Camera
from railinspect.labels import VOID

EDGES_M = (0.0, 20.0, 50.0, 100.0, 200.0, np.inf)
"""Limits of the bands, metres along the track."""


def ground_range_m(camera: Camera, size_wh: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Range along the track of the ground seen by each pixel; NaN at and above the horizon.

    Args:
        camera: Calibrated at any size.
        size_wh: Width and height of the map, pixels.

    Returns:
        Metres, shape (H, W).
    """
    width, height = size_wh
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    seen = camera.resized(size_wh)
    return seen.ground(seen.undistort(np.stack([u, v], -1)))[..., 0].astype(np.float32)


@dataclass
class BandScores:
    """Scores of each band; pixels of no band (sky) count in none.

    Attributes:
        tolerance_px: As of :class:`fscnn.training.metrics.Scores`.
    """

    tolerance_px: float = 4.0
    bands: list[Scores] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.bands = [Scores(self.tolerance_px) for _ in EDGES_M[1:]]

    def add(self, truth: Labels, predicted: Labels, range_m: npt.NDArray[np.float32]) -> None:
        """Count one image.

        Args:
            truth: Class ids, void 255, shape (H, W).
            predicted: Class ids, shape (H, W).
            range_m: Range along the track of each pixel, metres, shape (H, W); NaN or infinite
                where it has none.
        """
        finite = np.where(np.isfinite(range_m), range_m, -1.0)
        for scores, low, high in zip(self.bands, EDGES_M, EDGES_M[1:], strict=False):
            inside = (finite >= low) & (finite < high)
            if inside.any():
                scores.add(np.where(inside, truth, VOID).astype(np.uint8), predicted)

    def summary(self) -> dict[str, dict[str, float]]:
        """Rail IoU, thin-structure scores, mean IoU and pixels by name of the band."""
        kept = ("rail_iou", "thin_precision", "thin_recall", "thin_f", "mean_iou", "pixels")
        result = {}
        for scores, low, high in zip(self.bands, EDGES_M, EDGES_M[1:], strict=False):
            summary = scores.summary()
            name = f"{low:.0f}–{high:.0f} m" if np.isfinite(high) else f"from {low:.0f} m"
            result[name] = {key: float(summary[key]) for key in kept}
        return result
