"""The network of the close-ups (:mod:`railinspect.close_ups`): one window, one answer.

Residual blocks down to stride 16 and then a linear layer over every cell: what stands where
matters, the track lies in the same cells of every window.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from fscnn.models.blocks import Residual, conv_norm
from railinspect.close_ups import ANSWERS, WINDOW_WH

_MEAN, _SPREAD = 0.45, 0.25
"""Brightness taken off and divided by, of values 0…1."""

_STRIDE = 16


@dataclass(frozen=True)
class CloseUpConfig:
    """Sizes of the network.

    Attributes:
        channels: Channels at strides 2, 4, 8 and 16.
        narrow: Channels per cell that the linear layer sees.
        dropout: Share of them left out while training.
    """

    channels: tuple[int, int, int, int] = (16, 32, 64, 96)
    narrow: int = 32
    dropout: float = 0.2


class CloseUpNet(nn.Module):
    """Maps windows, uint8 RGB (N, 80, 128, 3), to a score for each answer, (N, 4)."""

    def __init__(self, config: CloseUpConfig | None = None) -> None:
        """Args: the ``config``."""
        super().__init__()
        self.config = config or CloseUpConfig()
        one, two, three, four = self.config.channels
        self.body = nn.Sequential(
            conv_norm(3, one, 3, 2),
            Residual(one, two, 2),
            Residual(two, two),
            Residual(two, three, 2),
            Residual(three, three),
            Residual(three, four, 2),
        )
        self.narrow = conv_norm(four, self.config.narrow, 1)
        self.drop = nn.Dropout(self.config.dropout)
        cells = (WINDOW_WH[0] // _STRIDE) * (WINDOW_WH[1] // _STRIDE)
        self.head = nn.Linear(self.config.narrow * cells, len(ANSWERS))

    def forward(self, windows: Tensor) -> Tensor:
        """Score of each answer for each window."""
        values = windows.permute(0, 3, 1, 2).float() / 255.0
        features = self.narrow(self.body((values - _MEAN) / _SPREAD))
        return self.head(self.drop(features.flatten(1)))
