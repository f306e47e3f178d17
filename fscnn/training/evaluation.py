"""Metrics of a checkpoint or a bundle over labelled images, by one path for both."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fscnn.data.datasets import FolderSource, SceneSource
from fscnn.models import decide
from fscnn.training import checkpoint
from fscnn.training.bands import BandScores, ground_range_m
from fscnn.training.metrics import Scores, confusion_matrix, union_iou
from railinspect.camera import Camera
from railinspect.railsem import Image
from railinspect.segmenter import Segmentation, Segmenter, segment_at

Segment = Callable[[Image], Segmentation]


def load_model(path: Path, size_wh: tuple[int, int] = (640, 368)) -> Segment:
    """A function from RGB images of any size to segmentations of that size.

    Args:
        path: A bundle (``.onnx``) or a checkpoint.
        size_wh: Size a checkpoint's network works at; a bundle brings its own.

    Raises:
        BadInputError: if the file is neither.
    """
    if path.suffix == ".onnx":
        return Segmenter.load(path)
    network = checkpoint.load(path).network

    def run(rgb: Image) -> tuple[Image, Image, Image]:
        with torch.no_grad():
            scores = network(torch.from_numpy(rgb).permute(2, 0, 1)[None].float() / 255)
            labels, confidence, rail_score = decide(scores, rgb.shape[0] // scores.shape[2])
        return labels[0].numpy(), confidence[0].numpy(), rail_score[0].numpy()

    return lambda rgb: segment_at(rgb, size_wh, run)


def evaluate(
    segment: Segment, pairs: Iterable[tuple[Image, Image]], tolerance_px: float = 4.0
) -> Scores:
    """Compare segmentations with masks, at the masks' own size.

    Args:
        segment: The model.
        pairs: Images (H, W, 3) and masks (H, W).
        tolerance_px: Distance within which a rail pixel counts as met, pixels of the mask.
    """
    scores = Scores(tolerance_px)
    for image, mask in pairs:
        result = segment(image)
        scores.add(mask, result.labels, result.confidence)
    return scores


@dataclass(frozen=True)
class FrameScore:
    """How well one image went.

    Attributes:
        index: Its number in the source.
        name: Its name.
        rail_iou: IoU of both rail classes together; NaN where there is no rail.
        accuracy: Share of right pixels.
    """

    index: int
    name: str
    rail_iou: float
    accuracy: float


@dataclass(frozen=True)
class Evaluation:
    """A model over a labelled source.

    Attributes:
        model: Name of the model.
        scores: Over all images.
        bands: By range; None where the ranges are not known.
        frames: Each image's own.
    """

    model: str
    scores: Scores
    bands: BandScores | None
    frames: tuple[FrameScore, ...]

    def document(self) -> dict[str, Any]:
        """Everything as plain values."""
        return {
            "model": self.model,
            **self.scores.summary(),
            "confusion": self.scores.matrix.tolist(),
            "by_range": None if self.bands is None else self.bands.summary(),
            "frames": [asdict(frame) for frame in self.frames],
        }

    def extremes(self, count: int) -> tuple[tuple[FrameScore, ...], tuple[FrameScore, ...]]:
        """The ``count`` best and worst images by rail IoU, best and worst first; no image twice."""
        judged = sorted(
            (f for f in self.frames if not math.isnan(f.rail_iou)), key=lambda f: -f.rail_iou
        )
        best = judged[: min(count, (len(judged) + 1) // 2)]
        return tuple(best), tuple(judged[len(best) :][::-1][:count])


def evaluate_source(
    model: str,
    segment: Segment,
    source: FolderSource | SceneSource,
    count: int,
    tolerance_px: float = 4.0,
    camera: Camera | None = None,
) -> Evaluation:
    """Evaluate over the first ``count`` images of a source, image by image and by range.

    Args:
        model: Name of the model.
        segment: The model.
        source: Labelled images.
        count: Number of images.
        tolerance_px: As of :func:`evaluate`.
        camera: Calibration of the images' camera, from which ranges follow where the source itself
            does not know them; the ground is then taken as flat.
    """
    scores, bands = Scores(tolerance_px), BandScores(tolerance_px)
    frames, ranged = [], False
    for index in range(count):
        image, mask = source(index)
        result = segment(image)
        scores.add(mask, result.labels, result.confidence)
        matrix = confusion_matrix(mask, result.labels)
        accuracy = float(np.trace(matrix) / matrix.sum()) if matrix.sum() else float("nan")
        frames.append(FrameScore(index, source.name(index), union_iou(matrix), accuracy))
        range_m = source.range_m(index)
        if range_m is None and camera is not None:
            range_m = ground_range_m(camera, (mask.shape[1], mask.shape[0]))
        if range_m is not None:
            bands.add(mask, result.labels, range_m)
            ranged = True
    return Evaluation(model, scores, bands if ranged else None, tuple(frames))
