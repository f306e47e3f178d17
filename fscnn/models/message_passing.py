"""Message passing in four directions: FSCNN's folded form and SCNN's sequential one.

A pass along one axis, its equation and its three equal forms are in :mod:`fscnn.models.passing`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from fscnn.models.passing import fold_fast, pass_export, pass_reference

ONE_AXIS = {"reference": pass_reference, "export": pass_export}

INITIAL_GAIN = 0.3
"""Root-mean-square size of a message against the slice that sends it, at initialisation."""


def bounded(kernels: Tensor) -> Tensor:
    """Kernels whose rows' absolute sums are at most one, so that no pass can diverge.

    A row is all weights that lead to one output channel, Σ|K[o, ·, ·]|. With every row at most one,
    a message is nowhere larger than the largest feature it was made of, so features grow at most by
    max |F| per slice: linearly, where free kernels grow as gain^L. Batch norm hides that explosion
    while training, as it divides by the batch's own spread, and evaluation then fails on it.

    Args:
        kernels: Shape (2, C, C, k): direction, output channel, input channel, tap.

    Returns:
        The kernels with every row that exceeds one scaled back to it; same shape.
    """
    return kernels / kernels.abs().sum((2, 3), keepdim=True).clamp(min=1.0)


class FourDirections(nn.Module):
    """The four kernels, and which form of the passes runs them.

    SCNN is known to diverge, because a gain g above one per step grows as g^L over the L slices.
    The kernels are therefore used :func:`bounded`. At initialisation they are small besides: for
    zero-mean weights of variance s² the mean square of a rectified message is k·C·s²/2 that of its
    sender, so s = g·√(2/(k·C)) makes g the gain.

    Attributes:
        vertical: Kernels of the down and up pass, shape (2, C, C, k).
        horizontal: Kernels of the right and left pass, shape (2, C, C, k).
        form: ``"fast"`` (training), ``"export"`` (no in-place writes) or ``"reference"``.
    """

    def __init__(self, channels: int, taps: int = 9) -> None:
        """Args: ``channels`` C of the input; ``taps`` k of each kernel, odd."""
        super().__init__()
        if channels < 1 or taps < 1 or taps % 2 == 0:
            raise ValueError(
                f"message passing needs channels >= 1 and odd taps, got {channels}, {taps}"
            )
        self.vertical = nn.Parameter(torch.empty(2, channels, channels, taps))
        self.horizontal = nn.Parameter(torch.empty(2, channels, channels, taps))
        self.form = "fast"
        self._bounds = True
        for kernel in (self.vertical, self.horizontal):
            nn.init.normal_(kernel, std=INITIAL_GAIN * math.sqrt(2 / (taps * channels)))

    def freeze(self) -> None:
        """Bound the kernels once and for all and use the export form; for inference only."""
        with torch.no_grad():
            for kernels in (self.vertical, self.horizontal):
                kernels.copy_(bounded(kernels))
        self.form, self._bounds = "export", False


class FoldedMessagePassing(FourDirections):
    """FSCNN: four passes that read the same input, concatenated (Wang et al. 2023, IV-C).

    F' = [F^U, F^D, F^R, F^L]
    """

    def forward(self, features: Tensor) -> Tensor:
        """Map features (N, C, H, W) to (N, 4C, H, W), in the order up, down, right, left."""
        vertical, horizontal = (
            bounded(kernels) if self._bounds else kernels
            for kernels in (self.vertical, self.horizontal)
        )
        if self.form == "fast":
            return fold_fast(features, vertical, horizontal)
        one_axis = ONE_AXIS[self.form]
        down, up = one_axis(features, vertical, "vertical")
        right, left = one_axis(features, horizontal, "horizontal")
        return torch.cat([up, down, right, left], 1)


class SequentialMessagePassing(FourDirections):
    """SCNN: down, up, right, left, each reading the last one's output (Pan et al. 2018).

    The two directions of an axis cannot advance together here, so only the reference form exists;
    each pass runs alone.
    """

    def forward(self, features: Tensor) -> Tensor:
        """Map features (N, C, H, W) to (N, C, H, W)."""
        for kernels, dim in ((self.vertical, 2), (self.horizontal, 3)):
            for direction, kernel in enumerate(bounded(kernels) if self._bounds else kernels):
                features = _single_pass(features, kernel, dim, reverse=direction == 1)
        return features


def _single_pass(features: Tensor, kernel: Tensor, dim: int, reverse: bool) -> Tensor:
    """One pass of SCNN, as plain as its published loops."""
    slices = list(features.unbind(dim))
    if reverse:
        slices.reverse()
    for i in range(1, len(slices)):
        message = nn.functional.conv1d(slices[i - 1], kernel, padding=kernel.shape[2] // 2)
        slices[i] = slices[i] + message.relu()
    if reverse:
        slices.reverse()
    return torch.stack(slices, dim)
