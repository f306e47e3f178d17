"""Rival: SCNN, message passing from pass to pass (Pan et al. 2018)."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from fscnn.models.backbones import Backbone
from fscnn.models.blocks import conv_norm
from fscnn.models.heads import resize_to_half
from fscnn.models.message_passing import SequentialMessagePassing


@dataclass(frozen=True)
class ScnnConfig:
    """Shape of SCNN.

    Attributes:
        classes: Number of classes.
        backbone: See :data:`fscnn.models.backbones.BACKBONES`.
        stride: Stride of its last stage, 16 or (ResNet) 8.
        message_channels: Channels c of the message passing.
        message_taps: Taps k of its kernels, odd.
        dropout: Probability of dropping a channel while training.
    """

    classes: int = 19
    backbone: str = "resnet50"
    stride: int = 8
    message_channels: int = 128
    message_taps: int = 9
    dropout: float = 0.1


class Scnn(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to class scores (N, classes, H/2, W/2)."""

    stride = 2

    def __init__(self, config: ScnnConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or ScnnConfig()
        self.backbone = Backbone(config.backbone, config.stride)
        self.reduce = conv_norm(self.backbone.channels[-1], config.message_channels, 1)
        self.messages = SequentialMessagePassing(config.message_channels, config.message_taps)
        self.dropout = nn.Dropout2d(config.dropout)
        self.classify = nn.Conv2d(config.message_channels, config.classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Class scores at stride 2; H and W must be even."""
        messages = self.messages(self.reduce(self.backbone(image)[-1]))
        return resize_to_half(self.classify(self.dropout(messages)), image)
