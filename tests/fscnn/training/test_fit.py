"""Training end to end on drawings: it learns, resumes, stops at NaN, and its files load safely."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from fscnn.data.datasets import FolderSource
from fscnn.models import build
from fscnn.training import checkpoint
from fscnn.training.config import TrainConfig, load, save
from fscnn.training.evaluation import evaluate, load_model
from fscnn.training.fit import fit
from fscnn.training.guard import DivergedError, explain_divergence
from fscnn.training.module import SegmentationModule
from fscnn.training.norms import recalibrated
from railinspect.errors import BadInputError
from tests.fscnn.drawing import write_set

ROOT = Path(__file__).parents[3]

TINY = (
    "settings={widths: [8, 12, 16, 24], blocks: [1, 1, 1], message_channels: 8, context: 16, "
    "dropout: 0}"
)


def tiny_run(folder: Path, *overrides: str) -> TrainConfig:
    if not (folder / "set").exists():
        write_set(folder / "set", 8, rail_px=16)
    return load(
        None,
        [
            TINY,
            f"data.train_folders=[{folder / 'set'}]",
            f"data.val_folders=[{folder / 'set'}]",
            "data.crop_wh=[96, 64]",
            "data.zoom=[1, 1]",
            "data.strength=0",
            "data.batch_size=4",
            "data.workers=0",
            "run.progress=false",
            "run.accelerator=cpu",
            f"run.out={folder / 'run'}",
            *overrides,
        ],
    )


@pytest.fixture(scope="module")
def overfitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, float]]:
    folder = tmp_path_factory.mktemp("overfit")
    config = tiny_run(
        folder,
        "schedule.max_steps=220",
        "run.validate_every=110",
        "optimiser.rate=0.01",
        "optimiser.average=0.9",
        "run.recalibrate=2",
    )
    return folder, fit(config)


def test_overfits_eight_images(overfitted: tuple[Path, dict[str, float]]) -> None:
    _, metrics = overfitted
    assert metrics["val/rail_iou"] >= 0.95


def test_shows_examples_and_what_measuring_the_norms_again_would_gain(
    overfitted: tuple[Path, dict[str, float]],
) -> None:
    folder, metrics = overfitted
    assert -1 <= metrics["norms/rail_iou_gain"] <= 1
    sheet = cv2.imread(str(folder / "run/examples.png"))
    assert sheet is not None
    assert sheet.shape == (4 * 182, 3 * 270, 3)
    truth, predicted = sheet[:, 270:540].astype(int), sheet[:, 540:].astype(int)
    assert (np.abs(truth - predicted).max(-1) < 30).mean() > 0.9


def test_norms_measured_again_are_those_of_the_batches() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(3, 4, 1), nn.BatchNorm2d(4)).eval()
    batches = [torch.rand(8, 3, 5, 6) for _ in range(3)]
    with torch.no_grad():
        maps = torch.stack([network[0](images) for images in batches])  # (3, 8, 4, 5, 6)
    found = recalibrated(network, batches)[1]
    torch.testing.assert_close(found.running_mean, maps.mean((0, 1, 3, 4)))
    each = maps.transpose(1, 2).flatten(2).var(2).mean(0)  # of each batch, then their mean
    torch.testing.assert_close(found.running_var, each)
    assert found.momentum == network[1].momentum
    assert not found.training
    assert network[1].running_mean.tolist() == [0] * 4


def test_stops_early_where_nothing_gets_better(tmp_path: Path) -> None:
    config = tiny_run(
        tmp_path,
        "schedule.max_steps=60",
        "schedule.patience=2",
        "run.validate_every=2",
        "run.examples=0",
        "optimiser.rate=1e-12",
    )
    fit(config)
    assert checkpoint.load(tmp_path / "run/last.ckpt").steps <= 8
    assert not (tmp_path / "run/examples.png").exists()


def test_tensorboard_shows_the_examples(tmp_path: Path) -> None:
    event_accumulator = pytest.importorskip(
        "tensorboard.backend.event_processing.event_accumulator", reason="needs tensorboard"
    )
    fit(tiny_run(tmp_path, "schedule.max_steps=2", "run.tensorboard=true", "run.examples=2"))
    (folder,) = {p.parent for p in (tmp_path / "run").rglob("events.out.tfevents.*")}
    found = event_accumulator.EventAccumulator(str(folder)).Reload()
    (picture, *_) = found.Images("val/examples")
    assert (picture.width, picture.height) == (3 * 270, 2 * 182)
    assert "val/rail_iou" in found.Tags()["scalars"]


def test_published_weights_need_a_published_backbone(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="network fscnn_s has no published backbone"):
        fit(tiny_run(tmp_path, "schedule.max_steps=1", "start_from=imagenet"))


def test_leaves_best_last_and_the_resolved_configuration(
    overfitted: tuple[Path, dict[str, float]],
) -> None:
    folder, _ = overfitted
    assert {"best.ckpt", "last.ckpt", "config.yaml"} <= {p.name for p in (folder / "run").iterdir()}
    assert load(folder / "run" / "config.yaml").schedule.max_steps == 220
    trained = checkpoint.load(folder / "run" / "last.ckpt")
    assert trained.steps == 220
    assert trained.name == "fscnn_s"
    assert len(trained.fingerprint) == 64
    assert not trained.network.training


class KilledError(Exception):
    """The process ends here."""


@pytest.mark.parametrize("killed_at", [2, 3])  # before and after the second epoch's first step
def test_resuming_after_a_kill_continues_exactly(
    killed_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropped = TINY.replace("dropout: 0", "dropout: 0.2")  # a draw of its own in every step
    more = (dropped, "schedule.max_epochs=2", "data.strength=1", "run.examples=0")
    straight = tiny_run(tmp_path, *more)
    fit(straight)
    whole = checkpoint.load(tmp_path / "run" / "last.ckpt")

    step = SegmentationModule.training_step

    def until_killed(module: SegmentationModule, *batch: object) -> torch.Tensor:
        if module.global_step == killed_at:
            raise KilledError
        return step(module, *batch)

    other = tiny_run(tmp_path, *more, f"run.out={tmp_path / 'killed'}")
    with monkeypatch.context() as patched:
        patched.setattr(SegmentationModule, "training_step", until_killed)
        with pytest.raises(KilledError):
            fit(other)
    left = tmp_path / "killed" / "last.ckpt"
    assert checkpoint.load(left).steps == 2  # of the end of the first epoch
    torch.rand(5)  # whatever a new process would have drawn
    fit(other, resume=left)
    resumed = checkpoint.load(left)
    assert resumed.steps == whole.steps == 4
    for name, weight in whole.network.state_dict().items():
        torch.testing.assert_close(resumed.network.state_dict()[name], weight, rtol=0, atol=0)


def test_two_processes_train_one_network_and_score_all_images(tmp_path: Path) -> None:
    more = ("schedule.max_epochs=2", "data.batch_size=2", "run.devices=2", "run.threads=1")
    save(tiny_run(tmp_path, *more), tmp_path / "two.yaml")
    command = [sys.executable, str(ROOT / "train.py"), "fit", "--json", "--config", "two.yaml"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    metrics = json.loads(done.stdout)  # one document, not one of each process
    trained = checkpoint.load(tmp_path / "run" / "last.ckpt")
    assert trained.steps == 4  # eight images, two at a time in two processes, twice
    segment = load_model(tmp_path / "run" / "last.ckpt", (96, 64))
    source = FolderSource(tmp_path / "set")
    alone = evaluate(segment, (source(i) for i in range(8))).summary()
    assert metrics["val/accuracy"] == pytest.approx(alone["accuracy"], abs=1e-6)
    assert metrics["val/mean_iou"] == pytest.approx(alone["mean_iou"], abs=1e-6)


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_file_stops_the_run_and_is_named(workers: int, tmp_path: Path) -> None:
    config = tiny_run(tmp_path, "schedule.max_epochs=1", f"data.workers={workers}")
    mask = tmp_path / "set/uint8/rs00005.png"
    cv2.imwrite(str(mask), np.full((64, 96), 77, np.uint8))
    with pytest.raises(BadInputError) as found:
        fit(config)
    assert str(found.value).startswith(f"mask {mask} holds class id 77; allowed are 0…18")
    assert "\n" not in str(found.value)


def test_training_goes_on_with_folded_norms(
    tmp_path: Path, overfitted: tuple[Path, dict[str, float]]
) -> None:
    folder, before = overfitted
    start = f"start_from={folder / 'run' / 'last.ckpt'}"
    steps = ("schedule.max_steps=3", "optimiser.rate=0.0001")
    metrics = fit(tiny_run(tmp_path, start, "fold_norms=true", *steps))
    assert metrics["val/rail_iou"] == pytest.approx(before["val/rail_iou"], abs=0.05)
    trained = checkpoint.load(tmp_path / "run" / "last.ckpt")
    assert trained.norms_folded
    names = [name for name, m in trained.network.named_modules() if isinstance(m, nn.BatchNorm2d)]
    assert names == ["messages_norm"]  # it follows no convolution
    fit(tiny_run(tmp_path / "on", f"start_from={tmp_path / 'run' / 'last.ckpt'}", *steps))
    assert checkpoint.load(tmp_path / "on" / "run" / "last.ckpt").norms_folded


def test_folding_needs_trained_norms(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="fold_norms needs trained norms: set start_from"):
        fit(tiny_run(tmp_path, "fold_norms=true", "schedule.max_steps=1"))


def test_starting_from_another_shape_is_refused(
    tmp_path: Path, overfitted: tuple[Path, dict[str, float]]
) -> None:
    start = f"start_from={overfitted[0] / 'run' / 'last.ckpt'}"
    with pytest.raises(BadInputError, match="cannot start one with"):
        fit(tiny_run(tmp_path, start, "settings={message_taps: 3}", "schedule.max_steps=1"))


def test_stops_at_the_time_limit(tmp_path: Path) -> None:
    fit(tiny_run(tmp_path, "schedule.max_minutes=0.02", "schedule.max_epochs=100000"))
    assert 0 < checkpoint.load(tmp_path / "run" / "last.ckpt").steps < 2000


def test_some_limit_is_needed(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"set schedule\.max_epochs"):
        fit(tiny_run(tmp_path))


def test_diverging_run_stops_and_says_why(tmp_path: Path) -> None:
    config = tiny_run(
        tmp_path, "schedule.max_steps=60", "optimiser.rate=1e30", "optimiser.clip=1e30"
    )
    with pytest.raises(
        DivergedError, match=r"not finite at step \d+: (weight|layer) .*lower optimiser"
    ):
        fit(config)


def test_a_gradient_that_is_not_finite_is_left_out() -> None:
    module = SegmentationModule(build("fscnn_s", {}), "fscnn_s")
    weights = list(module.network.parameters())
    for weight in weights:
        weight.grad = torch.ones_like(weight)
    module.on_before_optimizer_step(None)
    assert module.skipped == 0
    assert all((weight.grad == 1).all() for weight in weights)
    weights[0].grad[0, 0, 0, 0] = torch.inf
    module.on_before_optimizer_step(None)
    assert module.skipped == 1
    assert all((weight.grad == 0).all() for weight in weights)


def test_divergence_names_the_layer() -> None:
    network = build("fscnn_s")
    with torch.no_grad():
        network.messages_norm.weight.fill_(1e38)
        network.context.point[0].weight.fill_(1e38)
    error = explain_divergence(network, torch.rand(2, 3, 32, 32), step=12)
    assert "at step 12: layer context.point.0 is the first to give NaN or infinity" in str(error)
    with torch.no_grad():
        network.stem[0].weight[0] = float("nan")
    assert "weight stem.0.weight" in str(explain_divergence(network, torch.rand(2, 3, 32, 32), 1))
    images = torch.full((2, 3, 32, 32), torch.inf)
    assert "images themselves" in str(explain_divergence(network, images, 1))


class Bomb:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (exec, ("raise SystemExit('the pickle was run')",))


def test_pickle_pretending_to_be_a_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "evil.ckpt"
    path.write_bytes(pickle.dumps({"fscnn": Bomb()}))
    with pytest.raises(BadInputError, match="is not a checkpoint of this project"):
        checkpoint.load(path)
    torch.save({"fscnn": Bomb()}, path)
    with pytest.raises(BadInputError, match="is not a checkpoint of this project"):
        checkpoint.load(path)


def test_checkpoints_of_others(tmp_path: Path, overfitted: tuple[Path, dict[str, float]]) -> None:
    path = tmp_path / "other.ckpt"
    torch.save({"state_dict": {}}, path)
    with pytest.raises(BadInputError, match=r"was not written by train\.py"):
        checkpoint.load(path)
    held = torch.load(overfitted[0] / "run" / "last.ckpt", weights_only=True)
    held["fscnn"]["settings"]["message_channels"] = 16
    torch.save(held, path)
    with pytest.raises(BadInputError, match="do not fit the network it names"):
        checkpoint.load(path)
    path.write_bytes(b"")
    with pytest.raises(BadInputError, match="is not a checkpoint of this project"):
        checkpoint.load(path)
    with pytest.raises(BadInputError, match="cannot read checkpoint"):
        checkpoint.load(tmp_path / "none.ckpt")
