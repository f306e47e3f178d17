"""Rival: FRRN-B, full-resolution residual network (Pohlen et al. 2017, Table 1)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from fscnn.models.blocks import Residual, conv_norm, resize_like

_DOWN = ((3, 2), (4, 4), (2, 8), (2, 8), (2, 8))
"""Units and width, in base widths, at scales 2, 4, 8, 16 and 32."""

_UP = ((2, 4), (2, 4), (2, 4), (2, 2))
"""Units and width at scales 16, 8, 4 and 2."""


@dataclass(frozen=True)
class FrrnConfig:
    """Shape of FRRN-B.

    Attributes:
        classes: Number of classes.
        width: Channels of the first units; the paper's 48.
        lane: Channels of the full-resolution residual stream.
    """

    classes: int = 19
    width: int = 48
    lane: int = 32


class _Unit(nn.Module):
    """Full-resolution residual unit: both streams in, both streams out."""

    def __init__(self, inputs: int, outputs: int, lane: int, scale: int) -> None:
        super().__init__()
        self.scale = scale
        self.filters = nn.Sequential(conv_norm(inputs + lane, outputs), conv_norm(outputs, outputs))
        self.to_lane = nn.Conv2d(outputs, lane, 1)

    def forward(self, pooled: Tensor, lane: Tensor) -> tuple[Tensor, Tensor]:
        seen = functional.max_pool2d(lane, self.scale)
        pooled = self.filters(torch.cat([pooled, seen], 1))
        raised = functional.interpolate(self.to_lane(pooled), size=lane.shape[2:], mode="nearest")
        return pooled, lane + raised


class Frrn(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to class scores (N, classes, H, W)."""

    stride = 1

    def __init__(self, config: FrrnConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or FrrnConfig()
        width = config.width
        self.stem = nn.Sequential(
            conv_norm(3, width, 5), *(Residual(width, width) for _ in range(3))
        )
        self.split = nn.Conv2d(width, config.lane, 1)
        channels, self.down, self.up = width, nn.ModuleList(), nn.ModuleList()
        for groups, table, scales in (
            (self.down, _DOWN, (2, 4, 8, 16, 32)),
            (self.up, _UP, (16, 8, 4, 2)),
        ):
            for (units, wide), scale in zip(table, scales, strict=True):
                group = nn.ModuleList()
                for _ in range(units):
                    group.append(_Unit(channels, wide * width, config.lane, scale))
                    channels = wide * width
                groups.append(group)
        self.merge = nn.Sequential(
            conv_norm(channels + config.lane, width, 1), *(Residual(width, width) for _ in range(3))
        )
        self.classify = nn.Conv2d(width, config.classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Class scores at full size; H and W at least 32."""
        pooled = self.stem(image)
        lane = self.split(pooled)
        for group in self.down:
            pooled = functional.max_pool2d(pooled, 2)
            for unit in group:
                pooled, lane = unit(pooled, lane)
        for group in self.up:
            scale = group[0].scale
            size = [side // scale for side in lane.shape[2:]]
            pooled = functional.interpolate(pooled, size=size, mode="nearest")
            for unit in group:
                pooled, lane = unit(pooled, lane)
        merged = self.merge(torch.cat([resize_like(pooled, lane), lane], 1))
        return self.classify(merged)
