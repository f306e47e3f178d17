"""What the coarse networks end with."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional


def resize_to_half(scores: Tensor, image: Tensor) -> Tensor:
    """Bilinear resize of coarse scores to stride 2, the grid that classes are decided on."""
    size = (image.shape[2] // 2, image.shape[3] // 2)
    return functional.interpolate(scores, size=size, mode="bilinear", align_corners=False)
