"""Exponential moving average of a network's weights; the average is what validates and ships."""

from __future__ import annotations

import copy

import torch
from torch import nn


class WeightAverage:
    """Keeps θ̄ ← d·θ̄ + (1 − d)·θ, with d rising from 0 so that the start is forgotten quickly.

    d at step t is min(decay, (1 + t) / (10 + t)). Batch-norm statistics are averages already and
    are copied.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self.decay = decay
        self.steps = 0

    @torch.no_grad()
    def update(self, network: nn.Module) -> None:
        """Take in the weights after one optimiser step."""
        decay = min(self.decay, (1 + self.steps) / (10 + self.steps))
        self.steps += 1
        averages, weights = list(self.network.parameters()), list(network.parameters())
        torch._foreach_lerp_(averages, [w.detach() for w in weights], 1 - decay)
        for average, value in zip(self.network.buffers(), network.buffers(), strict=True):
            average.copy_(value)
