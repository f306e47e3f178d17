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

from fscnn.models.filtering import steps_of

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
    forwards, backwards = _BothWays.apply(features.permute(to_slices), kernels.to(features.dtype))
    return forwards.permute(to_maps), backwards.permute(to_maps)


def _facing(slices: Tensor, step: int) -> Tensor:
    """The slices both directions are at in one step, as one view without a copy.

    Args:
        slices: Contiguous maps of both directions, slices in the map's order, (2, L, N, E, C).
        step: 0 … L − 1; slice ``step`` of travel forwards, slice L − 1 − ``step`` backwards.

    Returns:
        Shape (2, N, E, C).
    """
    _, length, batch, extent, channels = slices.shape
    one = batch * extent * channels  # elements of a slice
    apart = one * (2 * length - 1 - 2 * step)
    shape = (2, batch, extent, channels)
    return slices.as_strided(shape, (apart, extent * channels, channels, 1), step * one)


def _padded(length: int, batch: int, extent: int, pad: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Room for both directions' slices with zeros around, and the view of the slices in it."""
    room = like.new_empty(2, length, batch, extent + 2 * pad, like.shape[-1])
    room[..., :pad, :] = 0
    room[..., pad + extent :, :] = 0
    return room, room[..., pad : pad + extent, :]


class _BothWays(torch.autograd.Function):
    """Recurrence over slices (L, N, E, C); both directions' results, each of that shape."""

    @staticmethod
    def forward(ctx: Any, slices: Tensor, kernels: Tensor) -> tuple[Tensor, Tensor]:
        length, batch, extent, channels = slices.shape
        taps = kernels.shape[3]
        pad = taps // 2
        state, inner = _padded(length, batch, extent, pad, slices)
        inner[0] = slices
        inner[1] = inner[0]
        filtered = steps_of(kernels.permute(0, 3, 2, 1), batch, extent)
        keep = any(ctx.needs_input_grad)
        messages = slices.new_empty(2, length if keep else 1, batch, extent, channels)
        for i in range(1, length):
            message = _facing(messages, i if keep else 0)
            filtered(_facing(state, i - 1), message)
            _facing(state, i)[:, :, pad : pad + extent] += message.relu_()
        if keep:
            ctx.save_for_backward(state, messages, kernels)
        return inner[0], inner[1]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        state, messages, kernels = ctx.saved_tensors
        _, length, batch, extent, channels = messages.shape
        taps = kernels.shape[3]
        pad = taps // 2
        total = torch.stack(gradients)
        # Gradient at each convolution's result, padded; the first slices in travel have none.
        reached, _ = _padded(length, batch, extent, pad, total)
        _facing(reached, 0).zero_()
        # The adjoint of a correlation: taps reversed, channels exchanged.
        filtered = steps_of(kernels.flip(3).permute(0, 3, 1, 2), batch, extent)
        back = total.new_empty(2, batch, extent, channels)
        for i in range(length - 1, 0, -1):
            here = _facing(reached, i)
            torch.ops.aten.threshold_backward.grad_input(  # ReLU's, without a copy
                _facing(total, i),
                _facing(messages, i),
                0,
                grad_input=here[:, :, pad : pad + extent],
            )
            filtered(here, back)
            _facing(total, i - 1).add_(back)
        return total[0] + total[1], _kernel_gradient(state, reached, taps)


def _kernel_gradient(state: Tensor, reached: Tensor, taps: int) -> Tensor:
    """Gradient of the kernels: one product per tap over all places of all slices at once.

    ∂/∂K[o, c, t] = Σ G_{i+1}[e, o] · F'_i[e + t, c], with slice i + 1 the next in travel. All rows
    of a direction lie one behind the other, so a tap and a slice are both an offset; what then
    runs over a row's end meets the zeros G is padded with.

    Args:
        state: Padded results F', shape (2, L, N, E + k − 1, C).
        reached: Padded gradient G at the convolutions' results, same shape.
        taps: k.
    """
    _, length, batch, rows, channels = state.shape
    pad, slice_, direction = taps // 2, batch * rows, length * batch * rows
    shape = (2, (length - 1) * slice_ - 2 * pad, channels)
    if length == 1:
        return state.new_zeros(2, channels, channels, taps)
    strides = ((direction - slice_) * channels, channels, 1)
    sent = reached.as_strided(shape, strides, (slice_ + pad) * channels).transpose(1, 2)
    strides = ((direction + slice_) * channels, channels, 1)
    each = [torch.bmm(sent, state.as_strided(shape, strides, t * channels)) for t in range(taps)]
    return torch.stack(each, 3)
