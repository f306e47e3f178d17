"""Atrous spatial pyramid pooling with a plain global mean (Chen et al. 2017), full and light."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from fscnn.models.blocks import conv_norm


class Aspp(nn.Module):
    """A point-wise branch, atrous branches, and the image's mean, concatenated and projected.

    The mean is a reduction: adaptive pooling does not export with a free batch size.
    """

    def __init__(
        self, inputs: int, outputs: int, rates: tuple[int, ...] = (6, 12, 18), dropout: float = 0.1
    ) -> None:
        """Args: ``inputs`` and ``outputs`` channels, dilation ``rates``, ``dropout`` after it."""
        super().__init__()
        self.point = conv_norm(inputs, outputs, 1)
        self.atrous = nn.ModuleList(conv_norm(inputs, outputs, 3, dilation=r) for r in rates)
        # No norm: one value per image and channel has no spread in a batch of one.
        self.scene = nn.Sequential(nn.Conv2d(inputs, outputs, 1), nn.ReLU())
        self.project = conv_norm(outputs * (2 + len(rates)), outputs, 1)
        self.dropout = nn.Dropout(dropout)

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, inputs, H, W) to (N, outputs, H, W)."""
        branches = [self.point(features), *(branch(features) for branch in self.atrous)]
        scene = self.scene(features.mean((2, 3), keepdim=True))
        branches.append(scene.expand(-1, -1, *features.shape[2:]))
        return self.dropout(self.project(torch.cat(branches, 1)))


class LightAspp(nn.Module):
    """Atrous spatial pyramid with three rates, and the image's mean as a plain reduction.

    The branches are added, not concatenated: one projection less. A plain mean replaces adaptive
    pooling, which does not export with a free batch size.
    """

    def __init__(self, inputs: int, outputs: int, rates: tuple[int, ...] = (2, 5)) -> None:
        super().__init__()
        self.point = conv_norm(inputs, outputs, 1)
        self.atrous = nn.ModuleList(
            nn.Sequential(
                conv_norm(outputs, outputs, 3, dilation=rate, groups=outputs),
                conv_norm(outputs, outputs, 1, activate=False),
            )
            for rate in rates
        )
        self.scene = nn.Conv2d(outputs, outputs, 1)

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, inputs, H, W) to (N, outputs, H, W)."""
        point = self.point(features)
        total = point + self.scene(point.mean((2, 3), keepdim=True))
        for branch in self.atrous:
            total = total + branch(point)
        return functional.relu(total)
