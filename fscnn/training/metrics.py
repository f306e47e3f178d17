"""Segmentation metrics from a confusion matrix; NumPy only, so bundle and checkpoint share them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.labels import CLASSES, RAILS, VOID

Labels = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

_RELIABILITY_BINS = 15


def confusion_matrix(truth: Labels, predicted: Labels) -> npt.NDArray[np.int64]:
    """Count pixels by true class (rows) and predicted class (columns); void is left out.

    Returns:
        Shape (19, 19).
    """
    n = len(CLASSES)
    known = truth != VOID
    code = truth[known].astype(np.int64) * n + predicted[known]
    return np.bincount(code, minlength=n * n).reshape(n, n)


def intersection_over_union(matrix: npt.NDArray[np.int64]) -> Floats:
    """IoU of each class, TP / (TP + FP + FN); NaN for classes neither present nor predicted."""
    hits = np.diag(matrix).astype(float)
    union = matrix.sum(0) + matrix.sum(1) - hits
    return np.divide(hits, union, out=np.full(len(hits), np.nan), where=union > 0)


def union_iou(matrix: npt.NDArray[np.int64], members: tuple[int, ...] = RAILS) -> float:
    """IoU of several classes taken as one; by default rail-raised ∪ rail-embedded."""
    chosen = np.zeros(len(matrix), bool)
    chosen[list(members)] = True
    hits = matrix[np.ix_(chosen, chosen)].sum()
    union = matrix[chosen].sum() + matrix[:, chosen].sum() - hits
    return float(hits / union) if union else float("nan")


def _within(mask: npt.NDArray[np.bool_], pixels: float) -> npt.NDArray[np.bool_]:
    """Pixels whose distance to ``mask`` is at most ``pixels``."""
    if not mask.any():
        return np.zeros_like(mask)
    distance = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return distance <= pixels + 1e-3


@dataclass
class Scores:
    """Running totals over images, and the metrics they give.

    Attributes:
        tolerance_px: Distance within which a rail pixel counts as met, at the mask's own size.
    """

    tolerance_px: float = 4.0
    matrix: npt.NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((len(CLASSES), len(CLASSES)), np.int64)
    )
    images: int = 0
    _met: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    _reliability: Floats = field(default_factory=lambda: np.zeros((3, _RELIABILITY_BINS)))

    def add(self, truth: Labels, predicted: Labels, confidence: Labels | None = None) -> None:
        """Count one image.

        Args:
            truth: Class ids, void 255, shape (H, W).
            predicted: Class ids, shape (H, W).
            confidence: Confidence of the prediction, 0 … 255, shape (H, W).
        """
        self.images += 1
        self.matrix += confusion_matrix(truth, predicted)
        known = truth != VOID
        real, found = np.isin(truth, RAILS), np.isin(predicted, RAILS) & known
        self._met += (
            (found & _within(real, self.tolerance_px)).sum(),
            found.sum(),
            (real & _within(found, self.tolerance_px)).sum(),
            real.sum(),
        )
        if confidence is not None:
            sure = confidence[known] / 255
            right = truth[known] == predicted[known]
            place = np.minimum((sure * _RELIABILITY_BINS).astype(int), _RELIABILITY_BINS - 1)
            for row, weights in enumerate((None, sure, right)):
                self._reliability[row] += np.bincount(place, weights, _RELIABILITY_BINS)

    def totals(self) -> list[npt.NDArray[Any]]:
        """The running totals, for processes that each judged a part to add up in place."""
        return [self.matrix, self._met, self._reliability]

    def summary(self) -> dict[str, float | int | dict[str, float]]:
        """All metrics by name; NaN where there was nothing to judge."""
        each = intersection_over_union(self.matrix)
        present = self.matrix.sum(1) > 0
        total = int(self.matrix.sum())
        near_found, found, near_real, real = (int(v) for v in self._met)
        precision = near_found / found if found else float("nan")
        recall = near_real / real if real else float("nan")
        both = precision + recall
        return {
            "images": self.images,
            "pixels": total,
            "mean_iou": float(each[present].mean()) if present.any() else float("nan"),
            "accuracy": float(np.trace(self.matrix) / total) if total else float("nan"),
            "rail_iou": union_iou(self.matrix),
            "thin_tolerance_px": self.tolerance_px,
            "thin_precision": precision,
            "thin_recall": recall,
            "thin_f": 2 * precision * recall / both if both > 0 else both * 0.0,
            "ece": self._calibration_error(),
            "iou": {name: float(value) for name, value in zip(CLASSES, each, strict=True)},
        }

    def _calibration_error(self) -> float:
        """Expected calibration error: mean gap between confidence and accuracy, by pixels."""
        count, sure, right = self._reliability
        return float(np.abs(sure - right).sum() / count.sum()) if count.sum() else float("nan")
