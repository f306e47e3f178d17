"""FSCNN-S: folded message passing in a network small enough for two embedded cores.

The paper's order of parts (backbone, folded message passing, ASPP, classifier; Wang et al. 2023,
Fig. 15) with a backbone of its own, trained from scratch, and a decoder: at stride 16 a rail two
pixels wide is gone, so skips lead back up to stride 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from fscnn.models.aspp import LightAspp
from fscnn.models.blocks import InvertedResidual, Residual, UpStep, conv_norm
from fscnn.models.heads import RAIL_PRIOR
from fscnn.models.message_passing import FoldedMessagePassing


@dataclass(frozen=True)
class FscnnSConfig:
    """Shape of FSCNN-S.

    The shipped bundle is wider at strides 2 and 4 and refines (``configs/fscnn_s_more.yaml``).
    Widths are multiples of eight, the number of channels CPU kernels take at a time.

    Attributes:
        classes: Number of classes.
        widths: Channels at strides 2, 4, 8 and 16.
        blocks: Blocks at strides 4, 8 and 16.
        expansion: Widening inside the inverted residual blocks.
        message_channels: Channels c of the message passing.
        message_taps: Taps k of its kernels, odd.
        context: Channels of the context stage at stride 16.
        decoder: Channels of the decoder at strides 8, 4 and 2.
        detail: Channels kept of the stride-2 skip.
        refine: Residual blocks at stride 2 behind the decoder.
        dropout: Probability of dropping a context channel while training.
    """

    classes: int = 19
    widths: tuple[int, int, int, int] = (16, 32, 48, 96)
    blocks: tuple[int, int, int] = (1, 2, 4)
    expansion: int = 3
    message_channels: int = 32
    message_taps: int = 7
    context: int = 64
    decoder: tuple[int, int, int] = (32, 16, 16)
    detail: int = 16
    refine: int = 0
    dropout: float = 0.05


class FscnnS(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to scores (N, classes + 4, H/2, W/2).

    The four scores behind the classes' are those of a rail at each of the cell's four pixels
    (:mod:`fscnn.models.decision`): a rail two pixels wide needs a finer answer than its class.
    """

    stride = 2

    def __init__(self, config: FscnnSConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or FscnnSConfig()
        w2, w4, w8, w16 = config.widths
        n4, n8, n16 = config.blocks
        up8, up4, up2 = config.decoder
        thin = config.expansion
        self.stem = conv_norm(3, w2, 3, 2)
        self.stage4 = nn.Sequential(Residual(w2, w4, 2), *(Residual(w4, w4) for _ in range(n4 - 1)))
        self.stage8 = nn.Sequential(
            Residual(w4, w8, 2), *(InvertedResidual(w8, w8, 1, thin) for _ in range(n8 - 1))
        )
        self.stage16 = nn.Sequential(
            InvertedResidual(w8, w16, 2, thin + 1),
            *(InvertedResidual(w16, w16, 1, thin) for _ in range(n16 - 1)),
        )
        self.to_messages = conv_norm(w16, config.message_channels, 1)
        self.messages = FoldedMessagePassing(config.message_channels, config.message_taps)
        self.messages_norm = nn.BatchNorm2d(4 * config.message_channels)
        self.context = LightAspp(w16 + 4 * config.message_channels, config.context)
        self.dropout = nn.Dropout2d(config.dropout)
        self.up8 = UpStep(config.context, w8, up8, up8)
        self.up4 = UpStep(up8, w4, up4, up4)
        self.up2 = UpStep(up4, w2, config.detail, up2)
        self.refine = nn.Sequential(*(Residual(up2, up2) for _ in range(config.refine)))
        for block in self.refine:
            nn.init.zeros_(block.branch[1][1].weight)  # nothing at first, so that any can be added
        self.classify = nn.Conv2d(up2, config.classes, 1)
        self.rails = nn.Conv2d(up2, self.stride**2, 3, padding=1)
        nn.init.constant_(self.rails.bias, RAIL_PRIOR)

    def forward(self, image: Tensor) -> Tensor:
        """Class and rail scores at stride 2; H and W must be even."""
        at2 = self.stem(image)
        at4 = self.stage4(at2)
        at8 = self.stage8(at4)
        at16 = self.stage16(at8)
        messages = self.messages_norm(self.messages(self.to_messages(at16)))
        context = self.dropout(self.context(torch.cat([at16, messages], 1)))
        fine = self.refine(self.up2(self.up4(self.up8(context, at8), at4), at2))
        return torch.cat([self.classify(fine), self.rails(fine)], 1)
