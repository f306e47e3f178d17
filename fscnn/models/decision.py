"""From class scores to what the runtime hands out; the one definition training and export share.

Rails are a pixel or two wide, so they are decided at full resolution: a pixel is rail where the
two rail classes together hold at least half of the probability, interpolated to full size. The
other classes are decided on the network's own grid (stride 2) and repeated, which costs a quarter
of the arithmetic and moves their borders by at most one pixel.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from railinspect.labels import RAIL_EMBEDDED, RAIL_RAISED

RAIL_FROM = 128
"""Rail score, 0 … 255, from which on a pixel is labelled rail."""


def rail_probability(scores: Tensor) -> Tensor:
    """P(rail-raised) + P(rail-embedded) per cell: (N, classes, h, w) → (N, 1, h, w)."""
    return scores.softmax(1)[:, RAIL_RAISED : RAIL_EMBEDDED + 1].sum(1, keepdim=True)


def decide(scores: Tensor, stride: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Labels, confidence and rail score of every pixel.

    Written for export: reductions over the class axis instead of a softmax, which ONNX Runtime
    would transpose for, and no class axis at full size.

    Args:
        scores: Class scores on the network's grid, shape (N, 19, h, w).
        stride: Pixels per cell of that grid.

    Returns:
        ``labels`` (class ids), ``confidence`` (probability of the cell's likeliest class, 0 … 255)
        and ``rail_score`` (probability of the two rail classes, 0 … 255), each uint8 of shape
        (N, h·stride, w·stride).
    """
    others, rails = scores[:, :RAIL_RAISED], scores[:, RAIL_RAISED:]
    best = torch.maximum(others.amax(1, keepdim=True), rails.amax(1, keepdim=True))
    weight_rails = (rails - best).exp().sum(1, keepdim=True)
    share = 1 / ((others - best).exp().sum(1, keepdim=True) + weight_rails)
    maps = torch.cat([share, weight_rails * share], 1)
    maps = functional.interpolate(maps, scale_factor=float(stride), mode="bilinear")
    confidence, rail_score = (maps * 255 + 0.5).to(torch.uint8).unbind(1)

    background = others.argmax(1, keepdim=True)
    rail = RAIL_RAISED + (rails[:, 1:] > rails[:, :1]).to(torch.uint8)
    grid = torch.cat([background.to(torch.uint8), rail], 1).to(torch.float32)
    grid = functional.interpolate(grid, scale_factor=float(stride), mode="nearest")
    labels = torch.where(rail_score >= RAIL_FROM, grid[:, 1], grid[:, 0])
    return labels.to(torch.uint8), confidence, rail_score
