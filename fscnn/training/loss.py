"""The training loss: balanced cross entropy of classes, and terms for rails at full resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from fscnn.models.decision import rail_probability, split
from railinspect.errors import BadInputError
from railinspect.labels import (
    CAR,
    CLASSES,
    CONSTRUCTION,
    FENCE,
    HUMAN,
    ON_RAILS,
    POLE,
    RAIL_EMBEDDED,
    RAIL_RAISED,
    RAIL_TRACK,
    TRAFFIC_LIGHT,
    TRAFFIC_SIGN,
    TRAM_TRACK,
    TRUCK,
    VOID,
)

SMALL_CLASSES = (HUMAN, POLE, TRAFFIC_LIGHT, TRAFFIC_SIGN, ON_RAILS)
"""Classes of few pixels that findings depend on."""

OBSTACLE_CLASSES = (CONSTRUCTION, FENCE, CAR, TRUCK)
"""Classes of many pixels elsewhere, of few and the more important ones on the track."""

TRACK_CLASSES = (RAIL_TRACK, TRAM_TRACK, RAIL_RAISED, RAIL_EMBEDDED)

NEAR_TRACK_CELLS = 15
"""How far from a cell of the track an obstacle counts as on it."""


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss.

    Attributes:
        hardest: Share of the cells, those of the greatest cross entropy, that count, 0 … 1 (online
            hard example mining, Shrivastava et al. 2016). 1 counts all, weighted as below; less
            than 1 takes the place of ``rail_weight`` and ``small_weight``.
        rail_weight: Cross-entropy weight of the two rail classes.
        small_weight: Cross-entropy weight of people, poles, signals, signs and rail vehicles, and
            of every obstacle on or next to the track.
        dice: Weight of the soft Dice term on rails.
        rail_entropy: Weight of the binary cross entropy of rails at full resolution.
        label_smoothing: Label smoothing of the cross entropy.
    """

    hardest: float = 1.0
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
        if not 0 < config.hardest <= 1:
            raise BadInputError(
                f"loss.hardest is {config.hardest}; it is the share of cells that count, above 0 "
                "and at most 1, e.g. 0.25"
            )
        self.config = config
        weights = torch.ones(len(CLASSES))
        weights[[RAIL_RAISED, RAIL_EMBEDDED]] = config.rail_weight
        weights[list(SMALL_CLASSES)] = config.small_weight
        self.register_buffer("weights", weights, persistent=False)
        for name, members in (("obstacle", OBSTACLE_CLASSES), ("track", TRACK_CLASSES)):
            table = torch.zeros(256)
            table[list(members)] = 1.0
            self.register_buffer(name, table, persistent=False)

    def forward(self, scores: Tensor, masks: Tensor) -> dict[str, Tensor]:
        """Loss terms and their ``total``.

        Args:
            scores: Scores as :func:`fscnn.models.decide` takes them, shape (N, C, h, w).
            masks: Class ids, 255 for void, uint8 of shape (N, H, W) with H a multiple of h.
        """
        scores, fine = split(scores.float())
        stride = masks.shape[1] // scores.shape[2]
        # A random one of each cell's pixels: any fixed one would shift labels against the image.
        row, column = (int(v) for v in torch.randint(stride, (2,)))
        cells = masks[:, row::stride, column::stride].long()
        each = functional.cross_entropy(
            scores,
            cells,
            ignore_index=VOID,
            reduction="none",
            label_smoothing=self.config.label_smoothing,
        )
        if self.config.hardest < 1:
            classes = hardest_mean(each[cells != VOID], self.config.hardest)
        else:
            weights = self._weights(cells)
            classes = (each * weights).sum() / weights.sum().clamp(min=1.0)

        rails = rail_probability(scores, fine, stride)[:, 0]
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

    def _weights(self, cells: Tensor) -> Tensor:
        """Weight of each cell: its class's, more for an obstacle near the track, 0 for void."""
        # Every second cell will do for what is near.
        track = self.track[cells[:, None, ::2, ::2]]
        for size in ((NEAR_TRACK_CELLS, 1), (1, NEAR_TRACK_CELLS)):
            track = functional.max_pool2d(track, size, 1, (size[0] // 2, size[1] // 2))
        near = functional.interpolate(track, size=cells.shape[1:], mode="nearest")[:, 0]
        extra = near * self.obstacle[cells] * (self.config.small_weight - 1)
        known = (cells != VOID).float()
        return known * (self.weights[cells.clamp(max=len(CLASSES) - 1)] + extra)


def hardest_mean(losses: Tensor, share: float) -> Tensor:
    """Mean of the greatest ``share`` of ``losses``, one of them at least; 0 where there are none.

    >>> hardest_mean(torch.tensor([1.0, 5.0, 2.0, 3.0]), 0.5)
    tensor(4.)
    """
    if not len(losses):
        return losses.sum()
    return losses.topk(math.ceil(share * len(losses))).values.mean()
