"""One axis of message passing, both directions of travel at once, in three equal forms.

Wang et al. 2023, section IV-C. A feature map F is cut into slices along an axis. A pass visits the
slices in its direction of travel and adds to each slice the rectified convolution of the slice
visited just before it:

    F'_1 = F_1
    F'_i = F_i + [Conv(F'_{i-1}, K)]_+        i = 2, 3, …, L

so every slice but the first in the direction of travel is updated, and a message can cross the
whole map. (The paper prints ``F_{i-1}`` inside the convolution; with it no message would travel
further than one slice. SCNN, which the pass is taken from, uses the updated slice, as here.)

Shapes: features (N, C, H, W); kernels (2, C, C, k), first index 0 for travel towards growing
indices (down, right) and 1 for the opposite (up, left), then output channel, input channel and tap
across the slice. Results are a pair of maps (N, C, H, W): travel forwards, travel backwards.

- :func:`pass_reference` reads like the equation;
- :func:`pass_fast` advances both directions as one batched product per step and has a backward of
  its own, for training;
- :func:`pass_export` has no in-place write, so it becomes a plain chain of ONNX nodes.
"""

from __future__ import annotations

from typing import Any, Literal

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

Axis = Literal["vertical", "horizontal"]


def _require(features: Tensor, kernels: Tensor) -> None:
    channels = features.shape[1]
    if kernels.shape[:3] != (2, channels, channels) or kernels.shape[3] % 2 == 0:
        raise ValueError(
            f"kernels of shape {tuple(kernels.shape)} do not fit {channels} channels; "
            f"expected (2, {channels}, {channels}, k) with an odd k"
        )


def pass_reference(features: Tensor, kernels: Tensor, axis: Axis) -> tuple[Tensor, Tensor]:
    """Both passes of one axis, slice after slice, as the equation is written."""
    _require(features, kernels)
    dim = 2 if axis == "vertical" else 3
    padding = kernels.shape[3] // 2
    results = []
    for direction, kernel in enumerate(kernels):
        slices = list(features.unbind(dim))  # each (N, C, extent of the slice)
        order = range(len(slices)) if direction == 0 else range(len(slices) - 1, -1, -1)
        previous = None
        for i in order:
            if previous is not None:
                message = functional.conv1d(slices[previous], kernel, padding=padding)
                slices[i] = slices[i] + functional.relu(message)
            previous = i
        results.append(torch.stack(slices, dim))
    return results[0], results[1]


def pass_export(features: Tensor, kernels: Tensor, axis: Axis) -> tuple[Tensor, Tensor]:
    """Both passes of one axis as one grouped convolution per step, without in-place writes."""
    _require(features, kernels)
    if axis == "horizontal":  # slices then lie contiguous in memory
        forwards, backwards = pass_export(features.transpose(2, 3), kernels, "vertical")
        return forwards.transpose(2, 3), backwards.transpose(2, 3)
    channels, taps = features.shape[1], kernels.shape[3]
    weight = kernels.reshape(2 * channels, channels, 1, taps)
    facing = torch.cat([features, features.flip(2)], 1)  # (N, 2C, L, extent), travel order
    steps = list(facing.split(1, 2))
    for i in range(1, len(steps)):
        message = functional.conv2d(steps[i - 1], weight, padding=(0, taps // 2), groups=2)
        steps[i] = steps[i] + functional.relu(message)
    moved = torch.cat(steps, 2)
    return moved[:, :channels], moved[:, channels:].flip(2)


def pass_fast(features: Tensor, kernels: Tensor, axis: Axis) -> tuple[Tensor, Tensor]:
    """Both passes of one axis as one batched product per step; for training on CPU and GPU."""
    _require(features, kernels)
    # Slices first and channels last: a slice's k-tap windows are then contiguous runs of memory.
    to_slices = (2, 0, 3, 1) if axis == "vertical" else (3, 0, 2, 1)
    to_maps = (1, 3, 0, 2) if axis == "vertical" else (1, 3, 2, 0)
    moved = _BothWays.apply(features.permute(to_slices), kernels.to(features.dtype))
    return moved[:, 0].permute(to_maps), moved[:, 1].flip(0).permute(to_maps)


def _windows(padded: Tensor, taps: int) -> Tensor:
    """All k-tap windows of padded slices: (2, N, E + k − 1, C) → (2, N·E, k·C)."""
    two, batch, extent, channels = padded.shape
    stride = padded.stride()
    view = padded.as_strided(
        (two, batch, extent - taps + 1, taps * channels), stride, padded.storage_offset()
    )
    return view.reshape(two, -1, taps * channels)


class _BothWays(torch.autograd.Function):
    """Recurrence over slices (L, N, E, C) → (L, 2, N, E, C), each direction in travel order."""

    @staticmethod
    def forward(ctx: Any, slices: Tensor, kernels: Tensor) -> Tensor:
        length, batch, extent, channels = slices.shape
        taps = kernels.shape[3]
        pad = taps // 2
        state = slices.new_zeros(length, 2, batch, extent + 2 * pad, channels)
        inner = state[:, :, :, pad : pad + extent]
        inner[:, 0] = slices
        inner[:, 1] = slices.flip(0)
        weight = kernels.permute(0, 3, 2, 1).reshape(2, taps * channels, channels)
        messages = slices.new_zeros(length, 2, batch * extent, channels)
        for i in range(1, length):
            torch.bmm(_windows(state[i - 1], taps), weight, out=messages[i])
            messages[i].relu_()
            inner[i] += messages[i].view(2, batch, extent, channels)
        ctx.save_for_backward(state, messages, kernels)
        return inner

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, Tensor]:
        state, messages, kernels = ctx.saved_tensors
        length, _, batch, extent, channels = grad.shape
        taps = kernels.shape[3]
        pad = taps // 2
        total = grad.contiguous().clone()
        reached = torch.zeros_like(state)  # gradient at each convolution's result, padded
        inner = reached[:, :, :, pad : pad + extent]
        # The adjoint of a correlation: taps reversed, channels exchanged.
        adjoint = kernels.flip(3).permute(0, 3, 1, 2).reshape(2, taps * channels, channels)
        for i in range(length - 1, 0, -1):
            open_ = messages[i].view(2, batch, extent, channels) > 0
            torch.mul(total[i], open_, out=inner[i])
            total[i - 1] += torch.bmm(_windows(reached[i], taps), adjoint).view_as(total[i - 1])
        sent = inner[1:].permute(1, 4, 0, 2, 3).reshape(2, channels, -1)  # (2, C, P)
        grad_kernels = torch.empty_like(kernels)
        for tap in range(taps):
            read = state[:-1, :, :, tap : tap + extent]
            read = read.permute(1, 0, 2, 3, 4).reshape(2, -1, channels)  # (2, P, C)
            grad_kernels[..., tap] = torch.bmm(sent, read)
        return total[:, 0] + total[:, 1].flip(0), grad_kernels
