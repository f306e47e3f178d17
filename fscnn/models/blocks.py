"""Building blocks shared by the networks. All maps are (N, C, H, W)."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval


def conv_norm(
    inputs: int,
    outputs: int,
    kernel: int = 3,
    stride: int = 1,
    dilation: int = 1,
    groups: int = 1,
    activate: bool = True,
) -> nn.Sequential:
    """Convolution of unchanged extent, batch norm (folded into it at export), and ReLU."""
    padding = dilation * (kernel // 2)
    layers: list[nn.Module] = [
        nn.Conv2d(
            inputs, outputs, kernel, stride, padding, dilation=dilation, groups=groups, bias=False
        ),
        nn.BatchNorm2d(outputs),
    ]
    if activate:
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers)


class Residual(nn.Module):
    """Two 3 × 3 convolutions around a skip; the shape that runs nearest to a CPU's peak."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.branch = nn.Sequential(
            conv_norm(inputs, outputs, stride=stride), conv_norm(outputs, outputs, activate=False)
        )
        same = inputs == outputs and stride == 1
        self.skip = nn.Identity() if same else conv_norm(inputs, outputs, 1, stride, activate=False)

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, inputs, H, W) to (N, outputs, H / stride, W / stride)."""
        return functional.relu(self.skip(features) + self.branch(features))


class InvertedResidual(nn.Module):
    """MobileNetV2's block: widen, filter each channel alone, narrow; skip where shapes allow."""

    def __init__(
        self, inputs: int, outputs: int, stride: int = 1, expansion: int = 3, dilation: int = 1
    ) -> None:
        super().__init__()
        middle = inputs * expansion
        self.branch = nn.Sequential(
            conv_norm(inputs, middle, 1),
            conv_norm(middle, middle, 3, stride, dilation, groups=middle),
            conv_norm(middle, outputs, 1, activate=False),
        )
        self.keeps_shape = inputs == outputs and stride == 1

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, inputs, H, W) to (N, outputs, H / stride, W / stride)."""
        result = self.branch(features)
        return features + result if self.keeps_shape else result


def resize_like(features: Tensor, other: Tensor) -> Tensor:
    """Bilinear resize of ``features`` to the extent of ``other``."""
    return functional.interpolate(
        features, size=other.shape[2:], mode="bilinear", align_corners=False
    )


class UpStep(nn.Module):
    """Narrow, upsample, add the skip, filter."""

    def __init__(self, inputs: int, skip: int, middle: int, outputs: int) -> None:
        super().__init__()
        self.narrow = nn.Conv2d(inputs, middle, 1)
        self.skip = conv_norm(skip, middle, 1, activate=False)
        self.filter = conv_norm(middle, outputs)

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """Map (N, inputs, h, w) and (N, skip, H, W) to (N, outputs, H, W)."""
        raised = resize_like(self.narrow(coarse), fine)
        return self.filter(functional.relu(raised + self.skip(fine)))


def fold_norms(network: nn.Module) -> nn.Module:
    """Fold each batch norm that directly follows a convolution in a sequence, in place.

    The result gives the same numbers as the network in evaluation mode, whose running statistics
    it keeps for good. It can be trained on, without batch norm's cost of two passes over each map.
    """
    network.eval()
    for module in network.modules():
        if isinstance(module, nn.Sequential):
            parts = list(module)
            for i in range(len(parts) - 1):
                convolution, norm = parts[i], parts[i + 1]
                if isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                    # The fused bias would stay as it is: torch makes it of a constant.
                    module[i] = fuse_conv_bn_eval(convolution, norm).requires_grad_()
                    module[i + 1] = nn.Identity()
    return network
