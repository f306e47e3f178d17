"""What the networks share at their end."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional

RAIL_PRIOR = -3.0
"""Logit of the share of rail pixels in a picture, about 5 %: where the rail scores start."""


def resize_to_half(scores: Tensor, image: Tensor) -> Tensor:
    """Bilinear resize of coarse scores to stride 2, the grid that classes are decided on."""
    size = (image.shape[2] // 2, image.shape[3] // 2)
    return functional.interpolate(scores, size=size, mode="bilinear", align_corners=False)
