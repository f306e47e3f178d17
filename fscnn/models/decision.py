"""From scores to what the runtime hands out; the one definition training and export share.

Rails are a few pixels wide, so they are decided at full resolution: a pixel is rail where its rail
probability is at least one half. A network may give a rail score for each of a cell's pixels,
behind the class scores; from one that does not, the two rail classes' probability is interpolated.
The other classes are decided on the network's own grid and repeated, which costs a quarter of the
arithmetic and moves their borders by at most one pixel.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from railinspect.labels import CLASSES, RAIL_EMBEDDED, RAIL_RAISED

RAIL_FROM = 128
"""Rail score, 0 … 255, from which on a pixel is labelled rail."""


def split(scores: Tensor) -> tuple[Tensor, Tensor | None]:
    """Class scores (N, 19, h, w), and the rail scores (N, s², h, w) of a cell's pixels if any."""
    if scores.shape[1] == len(CLASSES):
        return scores, None
    # Not two slices, whose gradients would each be as large as the scores.
    classes, rails = scores.split([len(CLASSES), scores.shape[1] - len(CLASSES)], 1)
    return classes, rails


def rail_probability(classes: Tensor, rails: Tensor | None, stride: int = 2) -> Tensor:
    """Probability of rail at every pixel, (N, 1, h·s, w·s), of what :func:`split` gives."""
    if rails is not None:
        return functional.pixel_shuffle(rails, stride).sigmoid()
    both = classes.softmax(1)[:, RAIL_RAISED : RAIL_EMBEDDED + 1].sum(1, keepdim=True)
    return functional.interpolate(both, scale_factor=float(stride), mode="bilinear")


def decide(scores: Tensor, stride: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    """Labels, confidence and rail score of every pixel.

    Written for export: reductions over the class axis instead of a softmax, which ONNX Runtime
    would transpose for, and no class axis at full size.

    Args:
        scores: Scores on the network's grid, shape (N, 19, h, w), or (N, 19 + stride², h, w).
        stride: Pixels per cell of that grid.

    Returns:
        ``labels`` (class ids), ``confidence`` (probability of the cell's likeliest class, 0 … 255)
        and ``rail_score`` (probability of rail, 0 … 255), each uint8 of shape
        (N, h·stride, w·stride).
    """
    classes, fine = split(scores)
    others, rails = classes[:, :RAIL_RAISED], classes[:, RAIL_RAISED:]
    best = torch.maximum(others.amax(1, keepdim=True), rails.amax(1, keepdim=True))
    weight_rails = (rails - best).exp().sum(1, keepdim=True)
    share = 1 / ((others - best).exp().sum(1, keepdim=True) + weight_rails)
    if fine is None:
        maps = torch.cat([share, weight_rails * share], 1)
        maps = functional.interpolate(maps, scale_factor=float(stride), mode="bilinear")
    else:
        share = functional.interpolate(share, scale_factor=float(stride), mode="bilinear")
        maps = torch.cat([share, functional.pixel_shuffle(fine, stride).sigmoid()], 1)
    confidence, rail_score = (maps * 255 + 0.5).to(torch.uint8).unbind(1)

    background = others.argmax(1, keepdim=True)
    rail = RAIL_RAISED + (rails[:, 1:] > rails[:, :1]).to(torch.uint8)
    grid = torch.cat([background.to(torch.uint8), rail], 1).to(torch.float32)
    grid = functional.interpolate(grid, scale_factor=float(stride), mode="nearest")
    labels = torch.where(rail_score >= RAIL_FROM, grid[:, 1], grid[:, 0])
    return labels.to(torch.uint8), confidence, rail_score
