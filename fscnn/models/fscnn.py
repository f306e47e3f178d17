"""FSCNN on published backbones (Wang et al. 2023, IV-C and Fig. 15), with a decoder.

The paper's order of parts: backbone, folded message passing, ASPP, classifier. At stride 16 a rail
two pixels wide is gone, so skips lead back up to stride 2, as in FSCNN-S.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from fscnn.models.aspp import Aspp, LightAspp
from fscnn.models.backbones import Backbone
from fscnn.models.blocks import UpStep, conv_norm
from fscnn.models.heads import RAIL_PRIOR
from fscnn.models.message_passing import FoldedMessagePassing


@dataclass(frozen=True)
class FscnnConfig:
    """Shape of FSCNN. The defaults are those on a ResNet.

    Attributes:
        classes: Number of classes.
        backbone: See :data:`fscnn.models.backbones.BACKBONES`.
        stride: Stride of the backbone's last stage, 16 or (ResNet) 8.
        cut: Leave away the backbone's part trained at stride 32: messages cross the whole map, and
            give the context that part would give.
        message_channels: Channels c of the message passing.
        message_taps: Taps k of its kernels, odd.
        context: Channels of the ASPP.
        rates: Its dilations.
        light: Separable atrous branches that are added instead of concatenated.
        decoder: Channels of the decoder at strides 8, 4 and 2.
        dropout: Probability of dropping a context value while training.
    """

    classes: int = 19
    backbone: str = "resnet50"
    stride: int = 16
    cut: bool = False
    message_channels: int = 128
    message_taps: int = 9
    context: int = 256
    rates: tuple[int, ...] = (6, 12, 18)
    light: bool = False
    decoder: tuple[int, int, int] = (128, 64, 32)
    dropout: float = 0.1


class Fscnn(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to scores (N, classes + 4, H/2, W/2)."""

    stride = 2

    def __init__(self, config: FscnnConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or FscnnConfig()
        self.backbone = Backbone(config.backbone, config.stride, cut=config.cut)
        c2, c4, c8, deep = self.backbone.channels
        up8, up4, up2 = config.decoder
        self.to_messages = conv_norm(deep, config.message_channels, 1)
        self.messages = FoldedMessagePassing(config.message_channels, config.message_taps)
        self.messages_norm = nn.BatchNorm2d(4 * config.message_channels)
        width = deep + 4 * config.message_channels
        self.context: nn.Module = (
            nn.Sequential(
                LightAspp(width, config.context, config.rates), nn.Dropout(config.dropout)
            )
            if config.light
            else Aspp(width, config.context, config.rates, config.dropout)
        )
        self.up8 = UpStep(config.context, c8, up8, up8)
        self.up4 = UpStep(up8, c4, up4, up4)
        self.up2 = UpStep(up4, c2, up2, up2)
        self.classify = nn.Conv2d(up2, config.classes, 1)
        self.rails = nn.Conv2d(up2, self.stride**2, 3, padding=1)
        nn.init.constant_(self.rails.bias, RAIL_PRIOR)

    def forward(self, image: Tensor) -> Tensor:
        """Class and rail scores at stride 2; H and W must be even."""
        at2, at4, at8, deep = self.backbone(image)
        messages = self.messages_norm(self.messages(self.to_messages(deep)))
        context = self.context(torch.cat([deep, messages], 1))
        fine = self.up2(self.up4(self.up8(context, at8), at4), at2)
        return torch.cat([self.classify(fine), self.rails(fine)], 1)
