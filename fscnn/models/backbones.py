"""Published backbones as four stages (strides 2, 4, 8 and 8 or 16) and their ImageNet weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
import torchvision
from torch import Tensor, nn

from railinspect.errors import BadInputError

BACKBONES = ("resnet50", "resnet101", "mobilenet_v3_large", "mobilenet_v3_small")

IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and spread of RGB in 0 … 1 that the published weights were trained with."""

_MOBILE_ENDS = {"mobilenet_v3_large": (2, 4, 7, 13), "mobilenet_v3_small": (1, 2, 4, 9)}
"""Blocks up to which MobileNetV3 has strides 2, 4, 8 and 16; what follows has 32, or is dilated."""


class Backbone(nn.Module):
    """A torchvision backbone cut into stages; the last keeps its resolution by dilation.

    Attributes:
        name: One of :data:`BACKBONES`.
        channels: Channels of the four stages' maps.
    """

    def __init__(self, name: str, stride: int = 16, head: bool = False, cut: bool = False) -> None:
        """Build with random weights.

        Args:
            name: One of :data:`BACKBONES`.
            stride: Stride of the last stage, 16, or 8 for a ResNet.
            head: Keep MobileNetV3's last, widest 1 × 1 convolution.
            cut: Leave away what was trained at stride 32, a third of MobileNetV3's time.

        Raises:
            BadInputError: if there is no such backbone or stride.
        """
        super().__init__()
        if name not in BACKBONES:
            raise BadInputError(f"unknown backbone {name!r}; known: {', '.join(BACKBONES)}")
        if stride != 16 and not (stride == 8 and name.startswith("resnet")):
            raise BadInputError(
                f"backbone {name} cannot have stride {stride}; 16 fits all, 8 a ResNet"
            )
        self.name = name
        self._which = {"head": head, "cut": cut}
        if name.startswith("resnet"):
            net = torchvision.models.get_model(
                name, weights=None, replace_stride_with_dilation=[False, stride == 8, True]
            )
            self.channels = (64, 256, 512, 1024 if cut else 2048)
        else:
            net = torchvision.models.get_model(name, weights=None, dilated=True)
        self.stages = _stages(net, name, head, cut)
        if not name.startswith("resnet"):
            self.channels = tuple(list(stage.children())[-1].out_channels for stage in self.stages)

    def forward(self, image: Tensor) -> list[Tensor]:
        """Maps of the four stages, finest first, of RGB (N, 3, H, W) in 0 … 1."""
        maps = []
        for stage in self.stages:
            image = stage(image)
            maps.append(image)
        return maps

    def load_imagenet(self) -> None:
        """Take over the published ImageNet weights.

        They expect (x − mean) / std. The scale goes into the first convolution and the shift into
        the batch norm behind it, so that the graph does not pay for either; only the outermost
        pixel, where the padding's zeros meet the shift, differs.

        Raises:
            BadInputError: if the weights are neither on this machine nor can be fetched.
        """
        weights = torchvision.models.get_model_weights(self.name).DEFAULT
        try:
            net = torchvision.models.get_model(self.name, weights=weights)
        except (OSError, RuntimeError) as error:
            folder = Path(torch.hub.get_dir()) / "checkpoints"
            raise BadInputError(
                f"cannot get the ImageNet weights of {self.name} ({error}); download {weights.url} "
                f"elsewhere and put it into {folder}, or start from random weights with start_from="
            ) from error
        self.stages.load_state_dict(_stages(net, self.name, **self._which).state_dict())
        first, norm = _first_layers(self.stages)
        absorb_standardisation(first, norm)


def absorb_standardisation(first: nn.Conv2d, norm: nn.BatchNorm2d) -> None:
    """Make a convolution and its norm take RGB in 0 … 1 instead of standardised RGB."""
    with torch.no_grad():
        std, mean = torch.tensor(IMAGENET_STD), torch.tensor(IMAGENET_MEAN)
        first.weight /= std.view(1, 3, 1, 1)
        assert norm.running_mean is not None
        norm.running_mean += (first.weight * mean.view(1, 3, 1, 1)).sum((1, 2, 3))


def _first_layers(stages: nn.Module) -> tuple[nn.Conv2d, nn.BatchNorm2d]:
    first = next(m for m in stages.modules() if isinstance(m, nn.Conv2d))
    norm = next(m for m in stages.modules() if isinstance(m, nn.BatchNorm2d))
    return first, norm


def _stages(net: nn.Module, name: str, head: bool, cut: bool) -> nn.ModuleList:
    if name.startswith("resnet"):
        parts: Sequence[Sequence[nn.Module]] = (
            (net.conv1, net.bn1, net.relu),
            (net.maxpool, net.layer1),
            (net.layer2,),
            (net.layer3,) if cut else (net.layer3, net.layer4),
        )
    else:
        blocks = list(net.features.children())
        a, b, c, d = _MOBILE_ENDS[name]
        end = d if cut else len(blocks) if head else -1
        parts = (blocks[:a], blocks[a:b], blocks[b:c], blocks[c:end])
    return nn.ModuleList(nn.Sequential(*part) for part in parts)
