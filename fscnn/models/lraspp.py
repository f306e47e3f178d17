"""Rival: LR-ASPP, the light head of MobileNetV3 (Howard et al. 2019, section 6.4)."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from fscnn.models.backbones import Backbone
from fscnn.models.blocks import conv_norm, resize_like
from fscnn.models.heads import resize_to_half


@dataclass(frozen=True)
class LrasppConfig:
    """Shape of LR-ASPP.

    Attributes:
        classes: Number of classes.
        backbone: See :data:`fscnn.models.backbones.BACKBONES`.
        context: Channels of the head.
    """

    classes: int = 19
    backbone: str = "mobilenet_v3_large"
    context: int = 128


class Lraspp(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to class scores (N, classes, H/2, W/2)."""

    stride = 2

    def __init__(self, config: LrasppConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LrasppConfig()
        self.backbone = Backbone(config.backbone, head=True)
        _, _, c8, deep = self.backbone.channels
        self.point = conv_norm(deep, config.context, 1)
        self.gate = nn.Sequential(nn.Conv2d(deep, config.context, 1, bias=False), nn.Sigmoid())
        self.classify_fine = nn.Conv2d(c8, config.classes, 1)
        self.classify = nn.Conv2d(config.context, config.classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Class scores at stride 2; H and W must be even."""
        _, _, fine, deep = self.backbone(image)
        context = self.point(deep) * self.gate(deep.mean((2, 3), keepdim=True))
        scores = self.classify(resize_like(context, fine)) + self.classify_fine(fine)
        return resize_to_half(scores, image)
