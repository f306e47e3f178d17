"""The training loss: class-weighted cross entropy, and a term for rails at full resolution."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from fscnn.models.decision import rail_probability, split
from railinspect.labels import (
    CLASSES,
    HUMAN,
    ON_RAILS,
    POLE,
    RAIL_EMBEDDED,
    RAIL_RAISED,
    TRAFFIC_LIGHT,
    TRAFFIC_SIGN,
    VOID,
)

SMALL_CLASSES = (HUMAN, POLE, TRAFFIC_LIGHT, TRAFFIC_SIGN, ON_RAILS)
"""Classes of few pixels that findings depend on."""


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss.

    Attributes:
        rail_weight: Cross-entropy weight of the two rail classes.
        small_weight: Cross-entropy weight of people, poles, signals, signs and rail vehicles.
        dice: Weight of the soft Dice term on rails.
        rail_entropy: Weight of the binary cross entropy of rails at full resolution.
        label_smoothing: Label smoothing of the cross entropy.
    """

    rail_weight: float = 1.0
    small_weight: float = 3.0
    dice: float = 1.0
    rail_entropy: float = 2.0
    label_smoothing: float = 0.0


class RailLoss(nn.Module):
    """Cross entropy on the network's grid, plus Dice and binary cross entropy of rails on pixels.

    The network decides rails at full resolution and everything else on its own grid
    (:mod:`fscnn.models.decision`), so each is trained where it is decided. A thin structure's
    cross entropy is drowned by the ground around it; Dice counts overlap instead of pixels.
    """

    def __init__(self, config: LossConfig) -> None:
        super().__init__()
        self.config = config
        weights = torch.ones(len(CLASSES))
        weights[[RAIL_RAISED, RAIL_EMBEDDED]] = config.rail_weight
        weights[list(SMALL_CLASSES)] = config.small_weight
        self.register_buffer("weights", weights, persistent=False)

    def forward(self, scores: Tensor, masks: Tensor) -> dict[str, Tensor]:
        """Loss terms and their ``total``.

        Args:
            scores: Scores as :func:`fscnn.models.decide` takes them, shape (N, C, h, w).
            masks: Class ids, 255 for void, uint8 of shape (N, H, W) with H a multiple of h.
        """
        scores = scores.float()
        stride = masks.shape[1] // scores.shape[2]
        # A random one of each cell's pixels: any fixed one would shift labels against the image.
        row, column = (int(v) for v in torch.randint(stride, (2,)))
        cells = masks[:, row::stride, column::stride].long()
        classes = functional.cross_entropy(
            split(scores)[0],
            cells,
            self.weights,
            ignore_index=VOID,
            reduction="sum",
            label_smoothing=self.config.label_smoothing,
        )
        known_cells = self.weights[cells.clamp(max=len(CLASSES) - 1)] * (cells != VOID)
        classes = classes / known_cells.sum().clamp(min=1.0)

        rails = rail_probability(scores, stride)[:, 0]
        known = (masks != VOID).float()
        truth = ((masks == RAIL_RAISED) | (masks == RAIL_EMBEDDED)).float()
        # Written out: torch's own raises on NaN, and the guard could not name the layer any more.
        right = torch.where(truth > 0, rails, 1 - rails).clamp(min=1e-6)
        entropy = -(known * right.log()).sum() / known.sum().clamp(min=1.0)
        # Over the whole batch: a crop without rails then adds its false rails and nothing else.
        rails = rails * known
        overlap = (rails * truth).sum()
        dice = 1 - (2 * overlap + 1) / (rails.sum() + truth.sum() + 1)
        total = classes + self.config.rail_entropy * entropy + self.config.dice * dice
        return {"classes": classes, "rail_entropy": entropy, "dice": dice, "total": total}
