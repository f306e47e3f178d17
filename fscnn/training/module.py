"""The Lightning module: one training step, one validation, the optimiser. The net is handed in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import lightning
import torch
from torch import Tensor, nn

from fscnn.models import decide, settings_of
from fscnn.training.average import WeightAverage
from fscnn.training.checkpoint import KEY
from fscnn.training.guard import explain_divergence
from fscnn.training.loss import LossConfig, RailLoss
from fscnn.training.metrics import Scores
from fscnn.training.schedule import Clock, ScheduleConfig, rate_factor


class SegmentationModule(lightning.LightningModule):
    """Trains any network that maps images (N, 3, H, W) in 0 … 1 to class scores.

    Args:
        network: The network.
        name: Its name in the registry, kept in checkpoints.
        loss: Loss settings.
        schedule: Limits and learning-rate shape.
        rate: Peak learning rate.
        weight_decay: Of kernels; norms and biases have none.
        average: Decay of the weight average.
        channels_last: Memory format of the maps.
        recipe: Resolved configuration, kept in checkpoints.
        fingerprint: Digest of the training data, kept in checkpoints.
        seed: Seed of dropout and of the loss's draws; each epoch starts from it afresh, so that a
            run resumed at an epoch's end goes on as if it had never stopped.
        norms_folded: Whether the network's batch norms were folded; kept in checkpoints.
    """

    def __init__(
        self,
        network: nn.Module,
        name: str,
        loss: LossConfig | None = None,
        schedule: ScheduleConfig | None = None,
        rate: float = 2e-3,
        weight_decay: float = 1e-2,
        average: float = 0.999,
        channels_last: bool = True,
        recipe: Mapping[str, Any] | None = None,
        fingerprint: str = "",
        seed: int = 0,
        norms_folded: bool = False,
    ) -> None:
        super().__init__()
        self.format = torch.channels_last if channels_last else torch.contiguous_format
        self.network = network.to(memory_format=self.format)
        self.name = name
        self.loss = RailLoss(loss or LossConfig())
        self.schedule = schedule or ScheduleConfig(max_epochs=1)
        self.rate = rate
        self.weight_decay = weight_decay
        self.average = WeightAverage(self.network, average)
        self.recipe = dict(recipe or {})
        self.fingerprint = fingerprint
        self.seed = seed
        self.norms_folded = norms_folded
        self.clock = Clock(self.schedule)
        self.scores = Scores()
        self._spent_s = 0.0
        self.skipped = 0

    def forward(self, images: Tensor) -> Tensor:
        """Class scores of uint8 images (N, 3, H, W)."""
        return self.network(self.scaled(images))

    def scaled(self, images: Tensor) -> Tensor:
        """What the network takes: uint8 images as 0 … 1 in its memory format."""
        return images.to(torch.float32).div_(255).contiguous(memory_format=self.format)

    def on_fit_start(self) -> None:
        """Start the clock, with the time spent before a resume."""
        self.clock = Clock(self.schedule, self._spent_s)
        self.average.network.to(self.device)

    def _progress(self) -> float:
        return self.clock.progress(self.global_step, int(self.trainer.num_training_batches))

    def on_train_batch_start(self, batch: Any, batch_idx: int) -> int | None:
        """Set the learning rate from the progress; stop at the end of the run."""
        if batch_idx == 0:  # not earlier: making a loader draws a number too
            own = self.global_rank * 1_000_000_007
            torch.manual_seed(self.seed * 1_000_003 + self.current_epoch + own)
        progress = self._progress()
        if self.trainer.world_size > 1:  # clocks differ, and all must stop at one step
            progress = self.trainer.strategy.broadcast(progress)
        if progress >= 1:
            self.trainer.should_stop = True
            return -1
        rate = self.rate * rate_factor(progress, self.schedule)
        for group in self.optimizers().param_groups:
            group["lr"] = rate
        return None

    def training_step(self, batch: tuple[Tensor, Tensor], batch_idx: int) -> Tensor:
        """Loss of one batch; raises DivergedError where it is not finite."""
        images, masks = batch
        terms = self.loss(self(images), masks)
        if not torch.isfinite(terms["total"]):
            raise explain_divergence(self.network, self.scaled(images), self.global_step)
        if batch_idx % 20 == 0:
            done = self._progress()
            for term, value in terms.items():
                self.log(f"train/{term}", value.detach(), prog_bar=term == "total")
            self.log("train/done", done, prog_bar=True)
            self.log("train/skipped", float(self.skipped))
        return terms["total"]

    def on_before_optimizer_step(self, optimizer: Any) -> None:
        """Take nothing from a gradient that is not finite: half precision overflows at times.

        Clipping would spread one infinite entry to all weights. Weights that stay broken are caught
        by the loss.
        """
        grads = [w.grad for w in self.network.parameters() if w.grad is not None]
        if grads and not torch.isfinite(torch.stack([g.float().sum() for g in grads])).all():
            self.network.zero_grad(set_to_none=False)
            self.skipped += 1

    def on_before_zero_grad(self, optimizer: Any) -> None:
        """Take the weights of the step just done into the average."""
        # Lightning zeroes the gradients before each step: the weights are then those of the last.
        if self.global_step > self.average.steps:
            self.average.update(self.network)

    def on_validation_start(self) -> None:
        """Bring the average up to date, the same one in all processes, and forget the scores."""
        if self.global_step > self.average.steps:
            self.average.update(self.network)
        self.scores = Scores()
        network = self.average.network.to(self.device)
        if self.trainer.world_size > 1:  # norms differ by what each saw; the first one's are saved
            network.load_state_dict(self.trainer.strategy.broadcast(network.state_dict()))

    def validation_step(self, batch: tuple[Tensor, Tensor], batch_idx: int) -> None:
        """Score the averaged network on one batch."""
        images, masks = batch
        # In half precision 255 would round to 256, and the surest pixels wrap to 0.
        scores = self.average.network(self.scaled(images)).float()
        labels, confidence, _ = decide(scores, images.shape[2] // scores.shape[2])
        for mask, label, sure in zip(masks, labels, confidence, strict=True):
            self.scores.add(mask.cpu().numpy(), label.cpu().numpy(), sure.cpu().numpy())

    def on_validation_epoch_end(self) -> None:
        """Log the scores of this validation, of all processes together."""
        if self.trainer.world_size > 1:
            for total in self.scores.totals():
                summed = self.trainer.strategy.reduce(
                    torch.from_numpy(total).to(self.device), reduce_op="sum"
                )
                total[...] = summed.cpu().numpy()
        summary = self.scores.summary()
        for metric in ("rail_iou", "mean_iou", "accuracy", "thin_f"):
            value = float(summary[metric])
            self.log(f"val/{metric}", value, prog_bar=metric == "rail_iou")

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """AdamW; weight decay on kernels alone."""
        kernels = [w for w in self.network.parameters() if w.ndim > 1]
        others = [w for w in self.network.parameters() if w.ndim <= 1]
        return torch.optim.AdamW(
            [
                {"params": kernels, "weight_decay": self.weight_decay},
                {"params": others, "weight_decay": 0.0},
            ],
            lr=self.rate,
        )

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Add what rebuilds and resumes the network, in plain values."""
        checkpoint[KEY] = {
            "network": self.name,
            "settings": settings_of(self.network),
            "norms_folded": self.norms_folded,
            "average": self.average.network.state_dict(),
            "average_steps": self.average.steps,
            "steps": self.global_step,
            "spent_s": self.clock.spent_s,
            "recipe": self.recipe,
            "fingerprint": self.fingerprint,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Bring back the average and the time spent."""
        held = checkpoint[KEY]
        self.average.network.load_state_dict(held["average"])
        self.average.steps = held["average_steps"]
        self._spent_s = held["spent_s"]
