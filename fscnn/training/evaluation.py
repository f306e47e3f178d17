"""Metrics of a checkpoint or a bundle over labelled images, by one path for both."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import torch

from fscnn.models import decide
from fscnn.training import checkpoint
from fscnn.training.metrics import Scores
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
