"""The Lightning data module: which pairs train, which validate, and how they are batched."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lightning
from torch.utils.data import DataLoader

from fscnn.data.datasets import (
    DrawSampler,
    FolderSource,
    JoinedSource,
    SceneSource,
    SegmentationDataset,
    quiet_worker,
)
from fscnn.data.transforms import training_transform
from railinspect.errors import BadInputError


@dataclass(frozen=True)
class DataConfig:
    """Where pairs come from and how they are cut.

    Attributes:
        train_folders: RailSem19-layout folders to train on.
        train_scenes: Scenes rendered on the spot, ``[first seed, count]``, added to them.
        val_folders: Folders to validate on, at full size.
        val_scenes: Scenes rendered on the spot to validate on, ``[first seed, count]``.
        val_limit: Pairs used of each validation folder; 0 uses all.
        crop_wh: Size of a training sample, pixels; both divisible by 16.
        zoom: Least and largest magnification of a training sample.
        aspect: Largest stretch of a training sample, sideways against upwards.
        rail_share: Fraction of training samples that must show a rail.
        strength: Strength of the photometric transforms, 0 … 1.
        batch_size: Samples per step.
        workers: Loader processes.
    """

    train_folders: list[str] = field(default_factory=list)
    train_scenes: list[int] = field(default_factory=list)
    val_folders: list[str] = field(default_factory=list)
    val_scenes: list[int] = field(default_factory=list)
    val_limit: int = 0
    crop_wh: list[int] = field(default_factory=lambda: [480, 272])
    zoom: list[float] = field(default_factory=lambda: [0.75, 1.6])
    aspect: float = 1.15
    rail_share: float = 0.8
    strength: float = 1.0
    batch_size: int = 8
    workers: int = 2


def _join(folders: list[str], scenes: list[int], limit: int, what: str) -> JoinedSource:
    sources: list[FolderSource | SceneSource] = [
        FolderSource(Path(f), limit or None) for f in folders
    ]
    if scenes:
        if len(scenes) != 2 or scenes[1] < 1:
            raise BadInputError(f"data.{what}_scenes must be [first seed, count], got {scenes}")
        sources.append(SceneSource(*scenes))
    if not sources:
        raise BadInputError(f"no data to {what} on: set data.{what}_folders or data.{what}_scenes")
    return JoinedSource(sources)


class RailData(lightning.LightningDataModule):
    """Training and validation loaders built from a :class:`DataConfig`."""

    def __init__(self, config: DataConfig, seed: int = 0) -> None:
        super().__init__()
        width, height = config.crop_wh
        if width % 16 or height % 16:
            raise BadInputError(f"data.crop_wh {config.crop_wh} must be divisible by 16")
        self.config = config
        self.seed = seed
        self._train = _join(config.train_folders, config.train_scenes, 0, "train")
        self._val = _join(config.val_folders, config.val_scenes, config.val_limit, "val")

    def _loader(self, dataset: SegmentationDataset, **options: Any) -> Any:
        workers = self.config.workers
        return DataLoader(
            dataset,
            num_workers=workers,
            persistent_workers=workers > 0,
            worker_init_fn=quiet_worker,
            prefetch_factor=4 if workers else None,
            **options,
        )

    def train_dataloader(self) -> Any:
        """Batches of transformed crops, in a fresh order every epoch."""
        config = self.config
        transform = training_transform(
            (config.crop_wh[0], config.crop_wh[1]),
            (config.zoom[0], config.zoom[1]),
            config.rail_share,
            config.strength,
            config.aspect,
        )
        dataset = SegmentationDataset(self._train, len(self._train), transform, self.seed)
        sampler = DrawSampler(len(dataset), self.seed)
        size = min(config.batch_size, len(dataset))
        return self._loader(dataset, sampler=sampler, batch_size=size, drop_last=True)

    def val_dataloader(self) -> Any:
        """Whole images one by one, since their sizes may differ."""
        return self._loader(SegmentationDataset(self._val, len(self._val)), batch_size=1)
