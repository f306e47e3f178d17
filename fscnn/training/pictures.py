"""Example predictions while training: image, truth and prediction side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import lightning
import numpy as np
import torch
from lightning.pytorch.loggers import TensorBoardLogger

from fscnn.models import decide
from railinspect.labels import colourise
from railinspect.railsem import Image


def strip(image: Image, truth: Image, predicted: Image, height_px: int = 180) -> Image:
    """One row: the image, its mask and the prediction, ``height_px`` high, RGB."""
    width = round(height_px * image.shape[1] / image.shape[0])
    parts = (image, colourise(truth), colourise(predicted))
    ways = (cv2.INTER_AREA, cv2.INTER_NEAREST, cv2.INTER_NEAREST)
    return np.concatenate(
        [
            cv2.resize(p, (width, height_px), interpolation=w)
            for p, w in zip(parts, ways, strict=True)
        ],
        1,
    )


class Examples(lightning.Callback):
    """After each validation, writes ``examples.png`` and, with TensorBoard, the same as an image.

    Args:
        folder: The run's folder.
        count: Pictures shown, the first of the validation set.
    """

    def __init__(self, folder: Path, count: int = 4) -> None:
        self.folder = folder
        self.count = count
        self._rows: list[Image] = []

    def on_validation_start(self, trainer: Any, pl_module: Any) -> None:
        """Forget the last rows."""
        self._rows = []

    def on_validation_batch_end(
        self, trainer: Any, pl_module: Any, outputs: Any, batch: Any, *_: Any
    ) -> None:
        """Keep a row of each of the first pictures."""
        images, masks = batch
        for image, mask in zip(images, masks, strict=True):
            if len(self._rows) == self.count:
                return
            with torch.no_grad():
                scores = pl_module.average.network(image[None].float() / 255)
                labels, _, _ = decide(scores, image.shape[1] // scores.shape[2])
            rgb = image.permute(1, 2, 0).cpu().numpy()
            self._rows.append(strip(rgb, mask.cpu().numpy(), labels[0].cpu().numpy()))

    def on_validation_end(self, trainer: Any, pl_module: Any) -> None:
        """Write the rows."""
        if not self._rows or not trainer.is_global_zero:
            return
        width = max(row.shape[1] for row in self._rows)
        rows = [np.pad(r, ((0, 2), (0, width - r.shape[1]), (0, 0))) for r in self._rows]
        sheet = np.concatenate(rows)
        cv2.imwrite(str(self.folder / "examples.png"), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        if isinstance(trainer.logger, TensorBoardLogger):
            trainer.logger.experiment.add_image(
                "val/examples", sheet, trainer.global_step, dataformats="HWC"
            )
