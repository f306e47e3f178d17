"""The published baseline as a judge: a linear support vector machine on the network's features.

The paper trains it on clear and synthesized pictures with features of an intermediate layer of its
network. A bundle hands out no layer but its last, so the features here are that one, pooled: per
cell of a grid the share of each class and the mean rail score. The machine is the usual one: L2
regularisation, squared hinge loss, solved in the primal, anomalous against clear.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.evaluation.answers import Answer
from railinspect.evaluation.run import masks_of
from railinspect.evaluation.samples import Sample
from railinspect.fovea import Network
from railinspect.labels import CLASSES
from railinspect.track.geometry import SegmentationLike

Array = npt.NDArray[np.float64]

GRID_WH: Final = (16, 12)
"""Cells the picture is pooled into."""


def features(segmentation: SegmentationLike) -> Array:
    """Share of each class and mean rail score per cell, shape (20 · 12 · 16,), each 0 to 1."""
    planes = [
        cv2.resize(
            (segmentation.labels == label).astype(np.float32), GRID_WH, interpolation=cv2.INTER_AREA
        )
        for label in range(len(CLASSES))
    ]
    score = segmentation.rail_score.astype(np.float32) / 255.0
    planes.append(cv2.resize(score, GRID_WH, interpolation=cv2.INTER_AREA))
    return np.stack(planes).astype(float).ravel()


@dataclass(frozen=True)
class LinearSvm:
    """A trained machine; called like any judge. It names no type and no place.

    Attributes:
        mean: Mean of the training features, shape (F,).
        scale: Their standard deviation, at least 0.01, shape (F,).
        weights: Weights of the scaled features, shape (F,).
        bias: Added to their product.
    """

    mean: Array
    scale: Array
    weights: Array
    bias: float

    def __call__(self, segmentation: SegmentationLike, camera: Camera | None = None) -> Answer:
        """Judge one picture; an alarm is told as an obstruction, for want of a type."""
        began = time.process_time()
        margin = self.margin(features(segmentation))
        time_ms = 1e3 * (time.process_time() - began)
        if margin > 0:
            return Answer("obstruction", (), f"margin {margin:.2f}", time_ms)
        return Answer("clear", (), "", time_ms)

    def margin(self, feature: Array) -> float:
        """Signed distance from the separating plane; positive is anomalous."""
        return float((feature - self.mean) / self.scale @ self.weights + self.bias)


def fit(feature: Array, anomalous: npt.NDArray[np.bool_], softness: float = 0.01) -> LinearSvm:
    """Minimise ½|w|² + C·Σ max(0, 1 − y·(w·x + b))² with each class weighed alike.

    Args:
        feature: Features, shape (N, F).
        anomalous: Which of them are anomalous, shape (N,).
        softness: C.

    Raises:
        BadInputError: if one of the two kinds is missing.
    """
    if anomalous.all() or not anomalous.any():
        raise BadInputError(
            f"the training set holds {int(anomalous.sum())} anomalous of {len(anomalous)} "
            "pictures; a support vector machine needs both kinds"
        )
    mean, scale = feature.mean(axis=0), np.maximum(feature.std(axis=0), 0.01)
    x, y = (feature - mean) / scale, np.where(anomalous, 1.0, -1.0)
    share = np.where(anomalous, anomalous.mean(), 1 - anomalous.mean())
    cost = softness / (2 * share)

    def objective(solution: Array) -> tuple[float, Array]:
        w, b = solution[:-1], solution[-1]
        short = np.maximum(0.0, 1.0 - y * (x @ w + b))
        pull = -2.0 * cost * y * short
        value = 0.5 * float(w @ w) + float(cost @ short**2)
        return value, np.append(w + x.T @ pull, pull.sum())

    start = np.zeros(x.shape[1] + 1)
    solved: Any = minimize(objective, start, jac=True, method="L-BFGS-B")
    return LinearSvm(mean, scale, solved.x[:-1], float(solved.x[-1]))


def train_svm(
    samples: Sequence[Sample],
    segmenter: Network | None,
    use_camera: bool = True,
    progress: Callable[[int, float], None] | None = None,
) -> LinearSvm:
    """Train on a data set.

    Args:
        samples: Pictures with and without anomalies.
        segmenter: The network; None takes the true masks.
        use_camera: Whether its closer looks are told the camera where the set knows it.
        progress: Called with pictures done and their share of all.

    Raises:
        BadInputError: if one of the two kinds is missing.
    """
    rows = []
    for done, sample in enumerate(samples, 1):
        camera = sample.camera if use_camera else None
        rows.append(features(masks_of(sample, segmenter, camera)))
        if progress is not None:
            progress(done, done / len(samples))
    return fit(np.stack(rows), np.array([sample.anomaly is not None for sample in samples]))
