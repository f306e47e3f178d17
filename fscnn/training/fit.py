"""One training run from a configuration; importable, and what ``train.py fit`` calls."""

from __future__ import annotations

import hashlib
import itertools
import math
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from fscnn.data.datasets import first_hand
from fscnn.data.module import RailData
from fscnn.models import build, settings_of
from fscnn.models.blocks import fold_norms
from fscnn.models.widen import widen
from fscnn.training import checkpoint as checkpoints
from fscnn.training.config import TrainConfig, save
from fscnn.training.from_bundle import load_bundle
from fscnn.training.module import SegmentationModule
from fscnn.training.norms import recalibrated
from fscnn.training.pictures import Examples
from fscnn.training.quiet import only_what_matters
from railinspect.errors import BadInputError


def data_fingerprint(data: RailData) -> str:
    """SHA-256 over the names and sizes of all training files, and the rendered seeds."""
    digest = hashlib.sha256(repr(data.config.train_scenes).encode())
    for pair in data.train_files:
        for path in (pair.image, pair.mask):
            digest.update(f"{path.name} {path.stat().st_size}\n".encode())
    return digest.hexdigest()


@only_what_matters()
def fit(config: TrainConfig, resume: Path | None = None) -> dict[str, float]:
    """Train, and leave ``best.ckpt``, ``last.ckpt`` and ``config.yaml`` in the run's folder.

    Args:
        config: The run.
        resume: Checkpoint to go on from; counters, optimiser and averages continue from it.

    Returns:
        Metrics of the last validation, by name.

    Raises:
        BadInputError: if the configuration, the data or a checkpoint cannot be used.
    """
    schedule = config.schedule
    if not (schedule.max_epochs > 0 or schedule.max_steps > 0 or schedule.max_minutes > 0):
        raise BadInputError("set schedule.max_epochs, schedule.max_steps or schedule.max_minutes")
    if schedule.shape not in ("cosine", "poly"):
        raise BadInputError(f"schedule.shape must be cosine or poly, got {schedule.shape!r}")
    run = config.run
    if run.threads:
        torch.set_num_threads(run.threads)
    lightning.seed_everything(config.seed, verbose=False)
    data = RailData(config.data, config.seed)
    network = build(config.network, config.settings)
    folded = config.fold_norms
    if folded and config.start_from in ("", "imagenet"):
        raise BadInputError("fold_norms needs trained norms: set start_from to a checkpoint")
    if config.start_from == "imagenet":
        backbone = getattr(network, "backbone", None)
        if backbone is None:
            raise BadInputError(f"network {config.network} has no published backbone to start from")
        backbone.load_imagenet()
    elif config.start_from:
        given = Path(config.start_from)
        started = load_bundle(given) if given.suffix == ".onnx" else checkpoints.load(given)
        if started.name != config.network:
            raise BadInputError(
                f"{config.start_from} holds a network {started.name}, not {config.network}"
            )
        weights = fold_norms(started.network) if folded else started.network
        folded = folded or started.norms_folded
        if not config.settings or started.settings == settings_of(network):
            config, network = replace(config, settings=dict(started.settings)), weights
        else:
            network = fold_norms(network) if folded else network
            widen(weights, network)
        network.train()
    module = SegmentationModule(
        network,
        config.network,
        config.loss,
        schedule,
        config.optimiser.rate,
        config.optimiser.weight_decay,
        config.optimiser.average,
        run.channels_last,
        asdict(config),
        data_fingerprint(data),
        config.seed,
        folded,
    )
    if resume is not None:
        checkpoints.read(resume)  # one clear sentence, where Lightning would give a traceback

    out = Path(run.out)
    out.mkdir(parents=True, exist_ok=True)
    save(config, out / "config.yaml")
    if data.split is not None:
        data.split.save(out / "split.json")
    keep = ModelCheckpoint(
        out,
        "best",
        monitor="val/rail_iou",
        mode="max",
        save_last=True,
        save_on_train_epoch_end=False,
        enable_version_counter=False,
    )
    callbacks: list[Any] = [keep, Examples(out, run.examples)]
    if schedule.patience > 0:
        callbacks.append(EarlyStopping("val/rail_iou", mode="max", patience=schedule.patience))
    logger = TensorBoardLogger(out, "") if run.tensorboard else CSVLogger(out, "")
    trainer = lightning.Trainer(
        accelerator=run.accelerator,
        devices=run.devices,
        precision=run.precision,
        max_epochs=-1,
        accumulate_grad_batches=run.accumulate,
        gradient_clip_val=config.optimiser.clip,
        val_check_interval=run.validate_every or 1.0,
        check_val_every_n_epoch=None if run.validate_every else 1,
        num_sanity_val_steps=0,
        log_every_n_steps=20,
        callbacks=callbacks,
        logger=logger,
        default_root_dir=out,
        enable_progress_bar=run.progress,
        enable_model_summary=False,
        use_distributed_sampler=False,  # Lightning's never hears of the epoch; the data share out
    )
    try:
        trainer.fit(module, data, ckpt_path=resume, weights_only=True)
        metrics = _validated(trainer, module, data)
    except BadInputError as error:
        raise first_hand(error) from error
    if run.recalibrate > 0:
        metrics = _try_recalibrated(trainer, module, data, run.recalibrate, metrics)
    # The run may end between two validations, and its last weights are often the best.
    # Saved with the optimiser's state, so that a run can go on from it; it is read safely.
    trainer.save_checkpoint(out / "last.ckpt", weights_only=False)
    best = float("nan") if keep.best_model_score is None else float(keep.best_model_score)
    if trainer.is_global_zero and (math.isnan(best) or metrics["val/rail_iou"] >= best):
        shutil.copyfile(out / "last.ckpt", out / "best.ckpt")
    return metrics


def _validated(
    trainer: lightning.Trainer, module: SegmentationModule, data: RailData
) -> dict[str, float]:
    return {k: float(v) for k, v in trainer.validate(module, data, verbose=False)[0].items()}


def _try_recalibrated(
    trainer: lightning.Trainer,
    module: SegmentationModule,
    data: RailData,
    batches: int,
    before: dict[str, float],
) -> dict[str, float]:
    """Measure the norms of the averaged weights again, and keep that if rails get no worse."""
    average = module.average
    loader = itertools.islice(data.train_dataloader(), batches)
    images = (module.scaled(batch[0].to(module.device)) for batch in loader)
    kept, average.network = average.network, recalibrated(average.network, images)
    after = _validated(trainer, module, data)
    better = after["val/rail_iou"] >= before["val/rail_iou"]
    if not better:
        average.network = kept
    gain = {"norms/rail_iou_gain": after["val/rail_iou"] - before["val/rail_iou"]}
    return (after if better else before) | gain
