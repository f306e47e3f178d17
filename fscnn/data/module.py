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
from fscnn.data.splits import Split, of_folder
from fscnn.data.transforms import training_transform
from railinspect.errors import BadInputError
from railinspect.railsem import Pair


@dataclass(frozen=True)
class DataConfig:
    """Where pairs come from and how they are cut.

    Attributes:
        train_folders: RailSem19-layout folders to train on.
        train_scenes: Scenes rendered on the spot, ``[first seed, count]``, added to them.
        val_folders: Folders to validate on, at full size.
        val_scenes: Scenes rendered on the spot to validate on, ``[first seed, count]``.
        val_limit: Pairs used of each validation folder; 0 uses all.
        railsem: RailSem19's folder, cut by ``split`` and added to the folders above.
        split: ``paper`` (3000/500/500), ``full`` (6800/850/850), or a file of
            ``python -m fscnn.data.splits``. The list drawn is saved beside the checkpoints.
        crop_wh: Size of a training sample, pixels; both divisible by 16.
        zoom: Least and largest magnification of a training sample.
        aspect: Largest stretch of a training sample, sideways against upwards.
        rail_share: Fraction of training samples that must show a rail.
        strength: Strength of the photometric transforms, 0 … 1.
        anomalies: Share of the training pictures that get an anomaly on their track, 0 … 1.
        batch_size: Samples per step, of each process.
        workers: Loader processes.
    """

    train_folders: list[str] = field(default_factory=list)
    train_scenes: list[int] = field(default_factory=list)
    val_folders: list[str] = field(default_factory=list)
    val_scenes: list[int] = field(default_factory=list)
    val_limit: int = 0
    railsem: str = ""
    split: str = "paper"
    crop_wh: list[int] = field(default_factory=lambda: [480, 272])
    zoom: list[float] = field(default_factory=lambda: [0.75, 1.6])
    aspect: float = 1.15
    rail_share: float = 0.8
    strength: float = 1.0
    anomalies: float = 0.0
    batch_size: int = 8
    workers: int = 2


def _join(config: DataConfig, split: Split | None, part: str) -> JoinedSource:
    folders, scenes = (config.train_folders, config.train_scenes)
    limit = None
    if part == "val":
        folders, scenes, limit = config.val_folders, config.val_scenes, config.val_limit or None
    sources: list[FolderSource | SceneSource] = [FolderSource(Path(f), limit) for f in folders]
    if split is not None:
        sources.append(FolderSource(Path(config.railsem), limit, split, part))
    if scenes:
        if len(scenes) != 2 or scenes[1] < 1:
            raise BadInputError(f"data.{part}_scenes must be [first seed, count], got {scenes}")
        sources.append(SceneSource(*scenes))
    if not sources:
        raise BadInputError(
            f"no data to {part} on: set data.{part}_folders or data.{part}_scenes, or data.railsem"
        )
    return JoinedSource(sources)


class RailData(lightning.LightningDataModule):
    """Training and validation loaders built from a :class:`DataConfig`.

    Attributes:
        split: How RailSem19 is cut, where it is used.
    """

    def __init__(self, config: DataConfig, seed: int = 0) -> None:
        super().__init__()
        width, height = config.crop_wh
        if width % 16 or height % 16:
            raise BadInputError(f"data.crop_wh {config.crop_wh} must be divisible by 16")
        self.config = config
        self.seed = seed
        self.split = of_folder(Path(config.railsem), config.split, seed) if config.railsem else None
        self._train = _join(config, self.split, "train")
        self._val = _join(config, self.split, "val")

    @property
    def train_files(self) -> tuple[Pair, ...]:
        """All files trained on."""
        sources = [s for s in self._train.sources if isinstance(s, FolderSource)]
        return tuple(pair for source in sources for pair in source.pairs)

    @property
    def _place(self) -> tuple[int, int]:
        """Number of this process, and how many train together."""
        trainer = self.trainer
        return (trainer.global_rank, trainer.world_size) if trainer else (0, 1)

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
            config.anomalies,
        )
        dataset = SegmentationDataset(self._train, len(self._train), transform, self.seed)
        rank, processes = self._place
        sampler = DrawSampler(len(dataset), self.seed, rank, processes)
        if not len(sampler):
            raise BadInputError(
                f"{len(dataset)} images to train on cannot be shared by {processes} processes; "
                "lower run.devices"
            )
        size = min(config.batch_size, len(sampler))
        return self._loader(dataset, sampler=sampler, batch_size=size, drop_last=True)

    def val_dataloader(self) -> Any:
        """Whole images one by one, since their sizes may differ; each process takes its turn."""
        rank, processes = self._place
        turns = range(rank, len(self._val), processes)
        return self._loader(
            SegmentationDataset(self._val, len(self._val)), sampler=turns, batch_size=1
        )
