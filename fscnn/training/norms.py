"""Batch norms whose statistics fit the averaged weights.

The weight average takes over the statistics of the weights it averages, which are not those its
own maps have. Measuring them again on some batches costs seconds; whether it helps is checked, not
assumed.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable

import torch
from torch import Tensor, nn


def recalibrated(network: nn.Module, batches: Iterable[Tensor]) -> nn.Module:
    """A copy of ``network`` with batch-norm statistics measured on ``batches``.

    Args:
        network: The network; it is left alone.
        batches: Images (N, 3, H, W) in 0 … 1, as it was trained on.

    Returns:
        The copy in evaluation mode; without batches or norms it is an exact one.
    """
    result = copy.deepcopy(network).eval()
    norms = [m for m in result.modules() if isinstance(m, nn.BatchNorm2d)]
    kept = [norm.momentum for norm in norms]
    with torch.no_grad():
        for number, images in enumerate(batches):
            for norm in norms:
                norm.momentum = 1 / (number + 1)  # a plain mean over the batches
                norm.train()
            result(images)
    for norm, momentum in zip(norms, kept, strict=True):
        norm.momentum = momentum
    return result.eval()
