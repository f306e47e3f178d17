"""Message passing along an axis, both directions of travel at once, in three equal forms.

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
  its own, for training; :func:`fold_fast` does so on both axes and writes the one map of all four;
- :func:`pass_export` has no in-place write, so it becomes a plain chain of ONNX nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

from fscnn.models.filtering import in_shares, steps_of

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
    ways = fold_fast(features, *((kernels, None) if axis == "vertical" else (None, kernels)))
    first, second = ways.chunk(2, 1)
    return (second, first) if axis == "vertical" else (first, second)


def fold_fast(features: Tensor, vertical: Tensor | None, horizontal: Tensor | None) -> Tensor:
    """The passes up, down, right and left of one input, concatenated; for training on CPU and GPU.

    Args:
        features: Shape (N, C, H, W).
        vertical: Kernels of the axis, down and up; None leaves its two passes out.
        horizontal: The same, right and left.

    Returns:
        Shape (N, 4C, H, W), or 2C channels without an axis; channels last in memory.
    """
    kernels = [k if k is None else k.to(features.dtype) for k in (vertical, horizontal)]
    for given in kernels:
        if given is not None:
            _require(features, given)
    # Channels last: a slice's k-tap windows are then contiguous runs of memory.
    rows = features.permute(0, 2, 3, 1).contiguous()
    return _Fold.apply(rows, *kernels).permute(0, 3, 1, 2)


_TO_SLICES = ((1, 0, 2, 3), (2, 0, 1, 3))
"""What makes slices (L, N, E, C) of rows (N, H, W, C), along the vertical and horizontal axis."""


def _ways(rows: Tensor, kernels: Sequence[Tensor | None]) -> Iterator[tuple[Tensor, Tensor]]:
    """Each given axis' slices of a map of all its passes: travel forwards, travel backwards.

    Args:
        rows: Shape (N, H, W, passes times C), the passes up, down, right, left.
        kernels: Of the vertical and the horizontal axis; None where its passes are left out.

    Yields:
        Two views (L, N, E, C), one slice of the map behind the other.
    """
    channels = next(k.shape[1] for k in kernels if k is not None)
    parts = iter(rows.split(channels, 3))
    if kernels[0] is not None:
        up, down = (next(parts).permute(_TO_SLICES[0]) for _ in range(2))
        yield down, up
    if kernels[1] is not None:
        right, left = (next(parts).permute(_TO_SLICES[1]) for _ in range(2))
        yield right, left


class _Fold(torch.autograd.Function):
    """Rows (N, H, W, C) to the rows of all passes, (N, H, W, 4C)."""

    @staticmethod
    def forward(
        ctx: Any, rows: Tensor, vertical: Tensor | None, horizontal: Tensor | None
    ) -> Tensor:
        kernels = (vertical, horizontal)
        given = [(k, order) for k, order in zip(kernels, _TO_SLICES, strict=True) if k is not None]
        out = rows.new_empty(*rows.shape[:3], 2 * len(given) * rows.shape[3])
        keep = any(ctx.needs_input_grad)
        kept = [
            _travel(rows.permute(order), kernel, ways, keep)
            for (kernel, order), ways in zip(given, _ways(out, kernels), strict=True)
        ]
        if keep:
            ctx.save_for_backward(vertical, horizontal, *(t for pair in kept for t in pair))
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        kernels, kept = ctx.saved_tensors[:2], iter(ctx.saved_tensors[2:])
        ways = _ways(gradient, kernels)
        of_rows: list[Tensor] = []
        of_kernels: list[Tensor | None] = [None, None]
        for axis, (kernel, order) in enumerate(zip(kernels, _TO_SLICES, strict=True)):
            if kernel is not None:
                slices, of_kernels[axis] = _travel_back(next(ways), kernel, next(kept), next(kept))
                of_rows.append(slices.permute([order.index(dim) for dim in range(4)]))
        return sum(of_rows[1:], of_rows[0]), *of_kernels


def _padded(slices: int, batch: int, extent: int, pad: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Room for slices of both directions with zeros around, and the view of the slices in it."""
    room = like.new_empty(2, slices, batch, extent + 2 * pad, like.shape[-1])
    room[..., :pad, :] = 0
    room[..., pad + extent :, :] = 0
    return room, room[..., pad : pad + extent, :]


def _travel(
    slices: Tensor, kernels: Tensor, ways: tuple[Tensor, Tensor], keep: bool
) -> tuple[Tensor, Tensor]:
    """Both passes of one axis, results written to ``ways``.

    Args:
        slices: Shape (L, N, E, C).
        kernels: Shape (2, C, C, k).
        ways: Where the results go, travel forwards and backwards, of the slices' shape.
        keep: Whether every step's state is kept, for the way back; else the last one alone.

    Returns:
        In the order of travel, the padded state, (2, L, N, E + k − 1, C), and the rectified
        messages, (L, 2, s, N, E / s, C) for the s of :mod:`fscnn.models.filtering`; both with one
        in place of L unless kept.
    """
    length, batch, extent, channels = slices.shape
    pad = kernels.shape[3] // 2
    rooms = length if keep else 1
    state, inner = _padded(rooms, batch, extent, pad, slices)
    filtered = steps_of(kernels.permute(0, 3, 2, 1), batch, extent)
    shares = filtered.shares
    messages = slices.new_empty(rooms, 2, shares, batch, extent // shares, channels)
    # Views, made once: a step takes a few hundred microseconds, a view one or two.
    padded = [filtered.reads(room) for room in state.unbind(1)]
    sent = [(both, *both.unbind()) for both in messages.unbind()]
    reached = [in_shares(way, shares).unbind() for way in inner.unbind()]
    read = in_shares(slices, shares).unbind()
    written = [in_shares(way, shares).unbind() for way in ways]
    for i in range(length):
        room = i % rooms
        if i > 0:
            filtered(padded[room - 1], sent[room][0])
            sent[room][0].relu_()
        for way, place in ((0, i), (1, length - 1 - i)):
            here = reached[way][room]
            if i == 0:
                here.copy_(read[place])
            else:
                torch.add(read[place], sent[room][1 + way], out=here)
            written[way][place].copy_(here)
    return state, messages


def _travel_back(
    gradients: tuple[Tensor, Tensor], kernels: Tensor, state: Tensor, messages: Tensor
) -> tuple[Tensor, Tensor]:
    """Gradients of the slices, (L, N, E, C), and of the kernels, from those of both results."""
    length, batch, extent, _ = gradients[0].shape
    taps, shares = kernels.shape[3], messages.shape[2]
    pad = taps // 2
    forwards, backwards = (in_shares(gradient, shares) for gradient in gradients)
    total = torch.stack([forwards, backwards.flip(0)], 1)  # in the order of travel
    # Gradient at each convolution's result, padded; the first slices in travel have none: unread.
    reached, inner = _padded(length, batch, extent, pad, total)
    at = in_shares(inner.flatten(0, 1), shares).unflatten(0, (2, length)).unbind(1)
    # The adjoint of a correlation: taps reversed, channels exchanged.
    filtered = steps_of(kernels.flip(3).permute(0, 3, 1, 2), batch, extent)
    back = torch.empty_like(total[0])
    for i in range(length - 1, 0, -1):
        torch.ops.aten.threshold_backward.grad_input(  # ReLU's, without a copy
            total[i], messages[i], 0, grad_input=at[i]
        )
        filtered(filtered.reads(reached[:, i]), back)
        total[i - 1].add_(back)
    slices = (total[:, 0] + total[:, 1].flip(0)).movedim(1, 3).reshape(gradients[0].shape)
    return slices, _kernel_gradient(state, reached, taps)


def _kernel_gradient(state: Tensor, reached: Tensor, taps: int) -> Tensor:
    """Gradient of the kernels: one product per tap over all places of all slices at once.

    ∂/∂K[o, c, t] = Σ G_{i+1}[e, o] · F'_i[e + t, c], with slice i + 1 the next in travel. All rows
    of a direction lie one behind the other, so a tap and a slice are both an offset; what then
    runs over a row's end meets the zeros G is padded with.

    Args:
        state: Padded results F' in the order of travel, shape (2, L, N, E + k − 1, C).
        reached: Padded gradient G at the convolutions' results, same shape and order.
        taps: k.
    """
    _, length, batch, rows, channels = state.shape
    if length == 1:
        return state.new_zeros(2, channels, channels, taps)
    pad, slice_ = taps // 2, batch * rows
    shape = (2, (length - 1) * slice_ - 2 * pad, channels)
    strides = (length * slice_ * channels, channels, 1)
    sent = reached.as_strided(shape, strides, (slice_ + pad) * channels).transpose(1, 2)
    each = [torch.bmm(sent, state.as_strided(shape, strides, t * channels)) for t in range(taps)]
    return torch.stack(each, 3)
