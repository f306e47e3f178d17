"""The network as it is shipped: bytes in, bytes out."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from fscnn.models import decide
from fscnn.models.blocks import fold_norms
from fscnn.models.message_passing import FourDirections


class Deployed(nn.Module):
    """Maps uint8 RGB (N, H, W, 3) to labels, confidence and rail score, each uint8 (N, H, W).

    Batch norms are folded into the convolutions before them, the division by 255 into the first
    convolution and the bound on the message-passing kernels into these, so none costs anything.
    """

    def __init__(self, network: nn.Module, dtype: torch.dtype = torch.float32) -> None:
        """Args: the trained ``network``; ``dtype`` of its weights and maps, not of the decision."""
        super().__init__()
        self.network = fold_norms(copy.deepcopy(network)).requires_grad_(False)
        for module in self.network.modules():
            if isinstance(module, FourDirections):
                module.freeze()
        first = next(m for m in self.network.modules() if isinstance(m, nn.Conv2d))
        first.weight.data /= 255
        self.network.to(dtype)
        self.dtype = dtype

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Labels, confidence and rail score of each image."""
        scores = self.network(image.permute(0, 3, 1, 2).to(self.dtype))
        return decide(scores.to(torch.float32), image.shape[1] // scores.shape[2])
