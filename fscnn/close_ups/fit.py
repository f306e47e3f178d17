"""Train the close-ups' network on cached windows.

    python -m fscnn.close_ups.fit --data DIR --out close_up.ckpt --minutes 30

The learning rate falls along half a cosine over the time given, whatever the machine.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from fscnn.close_ups.dataset import WindowSet, read
from fscnn.models.close_up import CloseUpConfig, CloseUpNet
from fscnn.training import checkpoint
from fscnn.training.average import WeightAverage
from fscnn.training.quiet import only_what_matters
from fscnn.training.schedule import Clock, ScheduleConfig, rate_factor
from railinspect.close_ups import ANSWERS
from railinspect.errors import BadInputError, RailInspectError

NAME = "close_up"

FALSE_SHARES = (0.01, 0.003, 0.001)
"""Shares of clear windows called something, at which the share of anomalies found is told."""

_WEIGHTS = (1.0, 1.3, 1.2, 1.2)
_CLIP = 2.0


class CloseUpModule(lightning.LightningModule):
    """Cross entropy over the answers, AdamW, and an average of the weights that validates.

    Args:
        network: The network, trained in place.
        rate: Largest learning rate.
        schedule: When training ends.
        decay: Decay of the weight average.
    """

    def __init__(
        self, network: CloseUpNet, rate: float, schedule: ScheduleConfig, decay: float = 0.998
    ) -> None:
        super().__init__()
        self.network, self.rate, self.schedule = network, rate, schedule
        self.average = WeightAverage(network, decay)
        self.register_buffer("weights", torch.tensor(_WEIGHTS))
        self.clock = Clock(self.schedule)
        self._seen: list[tuple[Tensor, Tensor]] = []

    def on_train_start(self) -> None:
        """Start the clock."""
        self.clock = Clock(self.schedule)

    def on_train_batch_start(self, batch: tuple[Tensor, Tensor], batch_idx: int) -> int | None:
        """Set the learning rate; −1 ends the epoch, and with it the run, when the time is up."""
        done = self.clock.progress(self.global_step, 1)
        if done >= 1.0:
            self.trainer.should_stop = True
            return -1
        for group in self.optimizers().param_groups:
            group["lr"] = self.rate * rate_factor(done, self.schedule)
        return None

    def training_step(self, batch: tuple[Tensor, Tensor], batch_idx: int) -> Tensor:
        """Loss of one batch; raises BadInputError where it is not finite."""
        windows, answers = batch
        loss = nn.functional.cross_entropy(self.network(windows).float(), answers, self.weights)
        if not torch.isfinite(loss):
            raise BadInputError(
                f"the loss is not finite at step {self.global_step}; lower --rate {self.rate}"
            )
        self.log("loss", loss.detach(), prog_bar=True)
        return loss

    def on_before_zero_grad(self, optimizer: torch.optim.Optimizer) -> None:
        """Take the weights of the step just done into the average."""
        if self.global_step > self.average.steps:
            self.average.update(self.network)

    def validation_step(self, batch: tuple[Tensor, Tensor], batch_idx: int) -> None:
        """Keep what the averaged network says of one batch."""
        windows, answers = batch
        self._seen.append((self.average.network(windows).float().softmax(1), answers))

    def on_validation_epoch_end(self) -> None:
        """Say what share of the anomalies is told at small shares of false ones."""
        chances, answers = (torch.cat(parts).numpy() for parts in zip(*self._seen, strict=True))
        self._seen = []
        for name, value in told_at(chances, answers).items():
            self.log(name, value)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """AdamW."""
        return torch.optim.AdamW(self.network.parameters(), self.rate, weight_decay=0.02)


def told_at(chances: np.ndarray, answers: np.ndarray) -> dict[str, float]:
    """By type and share of false alarms, what share of the anomalies is told from clear windows.

    Args:
        chances: Probabilities, shape (N, 4).
        answers: Truth, shape (N,).

    Example:
        >>> sure = np.eye(4)[[0, 0, 1, 2, 3]]
        >>> told_at(sure, np.array([0, 0, 1, 2, 3]))["trespasser at 0.1 %"]
        1.0
    """
    said = 1.0 - chances[:, 0]
    told = {}
    for share in FALSE_SHARES:
        least = float(np.quantile(said[answers == 0], 1.0 - share))
        for code, name in enumerate(ANSWERS[1:], 1):
            if (answers == code).any():
                told[f"{name} at {100 * share:g} %"] = float((said[answers == code] > least).mean())
    return told


@only_what_matters()
def fit(
    data: Path,
    out: Path,
    minutes: float,
    rate: float = 2e-3,
    batch: int = 64,
    seed: int = 0,
    start: Path | None = None,
    steps: int = 0,
) -> dict[str, float]:
    """Train and write a checkpoint.

    Args:
        data: Folder of cached windows.
        out: Checkpoint to write.
        minutes: Time to train, minutes; 0 is no limit.
        rate: Largest learning rate.
        batch: Windows in a batch.
        seed: Seed of weights, order and variations.
        start: Checkpoint whose weights to start from; None takes random ones.
        steps: Batches to train on; 0 is no limit.

    Returns:
        What the average tells of held-out windows, see :func:`told_at`.

    Raises:
        BadInputError: if the data cannot be used or the file not be written.
    """
    if not (minutes > 0 or steps > 0) or not rate > 0 or batch < 2:
        raise BadInputError(
            f"minutes {minutes} or steps {steps} must be > 0, rate {rate} too, and batch {batch} "
            "at least 2"
        )
    if not out.parent.is_dir():
        raise BadInputError(f"{out.parent} is no folder; make it, or name another file than {out}")
    lightning.seed_everything(seed, verbose=False)
    training, held_out = read(data)
    network, before = (CloseUpNet(), {}) if start is None else load(start)
    network = network.train().to(memory_format=torch.channels_last)
    schedule = ScheduleConfig(max_minutes=minutes, max_steps=steps or -1)
    module = CloseUpModule(network, rate, schedule)
    trainer = lightning.Trainer(
        max_epochs=-1,
        precision="bf16-mixed",
        gradient_clip_val=_CLIP,
        logger=False,
        enable_checkpointing=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
    )
    order = torch.Generator().manual_seed(seed)
    batches = DataLoader(
        WindowSet(training, seed), batch, shuffle=True, drop_last=True, generator=order
    )
    validation = DataLoader(WindowSet(held_out), 4 * batch)
    trainer.fit(module, batches, validation)
    told = {
        k: round(float(v), 4)
        for k, v in trainer.validate(module, validation, verbose=False)[0].items()
    }
    digest = hashlib.sha256(training.answers.tobytes() + training.images[::97].tobytes())
    recipe = {
        "minutes": minutes,
        "steps": steps,
        "rate": rate,
        "batch": batch,
        "seed": seed,
        "windows": np.bincount(training.answers, minlength=len(ANSWERS)).tolist(),
        "held_out": told,
        "start": before.get("recipe"),
    }
    held = {
        "network": NAME,
        "settings": {
            k: list(v) if isinstance(v, tuple) else v for k, v in asdict(network.config).items()
        },
        "average": module.average.network.state_dict(),
        "recipe": recipe,
        "fingerprint": digest.hexdigest(),
        "steps": module.average.steps + int(before.get("steps", 0)),
    }
    try:
        torch.save({checkpoint.KEY: held}, out)
    except (OSError, RuntimeError) as error:
        raise BadInputError(f"cannot write {out}: {error}") from error
    return told


def load(path: Path) -> tuple[CloseUpNet, dict[str, Any]]:
    """The averaged network of a checkpoint, in evaluation mode, and what the file says of it.

    Raises:
        BadInputError: if the file is no such checkpoint.
    """
    held = checkpoint.read(path)[checkpoint.KEY]
    if held.get("network") != NAME:
        raise BadInputError(
            f"{path} holds a network {held.get('network')!r}, not {NAME!r}; pass a file written by "
            "python -m fscnn.close_ups.fit"
        )
    try:
        settings = {k: tuple(v) if isinstance(v, list) else v for k, v in held["settings"].items()}
        network = CloseUpNet(CloseUpConfig(**settings))
        network.load_state_dict(held["average"])
    except (KeyError, RuntimeError, TypeError) as error:
        raise BadInputError(
            f"the weights in {path} do not fit the network; it comes from another version "
            f"({str(error).splitlines()[0]})"
        ) from error
    return network.eval(), {k: held[k] for k in ("recipe", "fingerprint", "steps")}


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fscnn.close_ups.fit", description="Train the close-ups' network."
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of cached windows")
    parser.add_argument("--out", type=Path, required=True, help="checkpoint to write")
    parser.add_argument("--minutes", type=float, default=30.0, help="time to train (default 30)")
    parser.add_argument("--rate", type=float, default=2e-3, help="learning rate (default 0.002)")
    parser.add_argument("--batch", type=int, default=64, help="windows in a batch (default 64)")
    parser.add_argument("--seed", type=int, default=0, help="seed (default 0)")
    parser.add_argument("--steps", type=int, default=0, help="or batches (default: no limit)")
    parser.add_argument("--start", type=Path, help="checkpoint to start from (default: none)")
    options = parser.parse_args(arguments)
    try:
        told = fit(
            options.data,
            options.out,
            options.minutes,
            options.rate,
            options.batch,
            options.seed,
            options.start,
            options.steps,
        )
    except RailInspectError as error:
        print(f"fscnn.close_ups.fit: {error}", file=sys.stderr)
        return 2
    for name, value in told.items():
        print(f"{name} false: {value:.3f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
