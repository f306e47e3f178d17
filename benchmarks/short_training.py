"""Short trainings from random weights on small pictures: the budget two cores can pay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fscnn.data.datasets import FolderSource
from fscnn.training import config
from fscnn.training.evaluation import evaluate, load_model
from fscnn.training.fit import fit
from railinspect.scenes import SceneSettings, write_images

ROOT = Path(__file__).parents[1]
SMALL_WH, BATCH = (320, 192), 8
HELD_OUT_SEED, TRAIN_SEED = 900_000, 1_000_000


def settings(name: str, *overrides: str) -> config.TrainConfig:
    """A configuration of ``configs/``."""
    return config.load(ROOT / "configs" / f"{name}.yaml", list(overrides))


def rendered(
    folder: Path, first: int, count: int, workers: int, scenes: SceneSettings | None = None
) -> Path:
    """A folder of rendered scenes, made once."""
    for _ in write_images(folder, range(first, first + count), scenes or SceneSettings(), workers):
        pass
    return folder


def trained(name: str, seed: int, steps: int, train: Path, out: Path, *more: str) -> Path:
    """Checkpoint of a network of ``configs/`` trained from random weights.

    Args:
        name: The configuration.
        seed: Of weights, samples and their order.
        steps: Optimiser steps.
        train: Folder in RailSem19's layout.
        out: Folder of the training.
        more: Further settings, ``key=value``.
    """
    overrides = [
        f"seed={seed}",
        'start_from=""',
        'data.railsem=""',
        f"data.train_folders=[{train}]",
        f"data.val_folders=[{train}]",
        "data.val_limit=1",
        f"data.crop_wh={list(SMALL_WH)}",
        f"data.batch_size={BATCH}",
        "data.workers=1",
        "optimiser.rate=0.002",
        "optimiser.average=0.99",
        "schedule.max_epochs=-1",
        f"schedule.max_steps={steps}",
        "schedule.patience=0",
        "schedule.shape=cosine",
        "run.precision=32-true",
        "run.accumulate=1",
        "run.tensorboard=false",
        "run.validate_every=1000000",
        "run.progress=false",
        "run.examples=0",
        f"run.out={out}",
        *more,
    ]
    fit(settings(name, *overrides))
    return out / "last.ckpt"


def scored(
    checkpoint: Path,
    folder: Path,
    size_wh: tuple[int, int] | None = None,
    tolerance_px: float = 4.0,
) -> dict[str, Any]:
    """The figures of ``evaluate.py`` on every image of a folder in RailSem19's layout.

    Args:
        checkpoint: Of :func:`trained`.
        folder: The images.
        size_wh: Size the network sees them at, multiples of 16; by default their own.
        tolerance_px: Within which a rail pixel counts as met, pixels of the mask.
    """
    source = FolderSource(folder)
    width, height = size_wh or source(0)[0].shape[1::-1]
    segment = load_model(checkpoint, (width // 16 * 16, height // 16 * 16))
    pairs = (source(i) for i in range(len(source)))
    return dict(evaluate(segment, pairs, tolerance_px).summary())
