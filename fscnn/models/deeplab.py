"""Rival: DeepLabV3 (Chen et al. 2017)."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from fscnn.models.aspp import Aspp
from fscnn.models.backbones import Backbone
from fscnn.models.blocks import conv_norm
from fscnn.models.heads import resize_to_half


@dataclass(frozen=True)
class DeepLabConfig:
    """Shape of DeepLabV3.

    Attributes:
        classes: Number of classes.
        backbone: See :data:`fscnn.models.backbones.BACKBONES`.
        stride: Stride of its last stage, 16 or (ResNet) 8.
        context: Channels of the ASPP.
        rates: Its dilations; (6, 12, 18) belong to stride 16.
        dropout: Probability of dropping a context value while training.
    """

    classes: int = 19
    backbone: str = "resnet50"
    stride: int = 8
    context: int = 256
    rates: tuple[int, ...] = (12, 24, 36)
    dropout: float = 0.5


class DeepLab(nn.Module):
    """The network: RGB (N, 3, H, W) in 0 … 1 to class scores (N, classes, H/2, W/2)."""

    stride = 2

    def __init__(self, config: DeepLabConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or DeepLabConfig()
        self.backbone = Backbone(config.backbone, config.stride, head=True)
        deep = self.backbone.channels[-1]
        self.context = Aspp(deep, config.context, config.rates, config.dropout)
        self.filter = conv_norm(config.context, config.context)
        self.classify = nn.Conv2d(config.context, config.classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Class scores at stride 2; H and W must be even."""
        context = self.context(self.backbone(image)[-1])
        return resize_to_half(self.classify(self.filter(context)), image)
