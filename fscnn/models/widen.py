"""A trained network's weights in a larger one of the same kind, which then gives its numbers."""

from __future__ import annotations

import torch
from torch import nn

from fscnn.models.registry import settings_of
from railinspect.errors import BadInputError

_TOLERANCE = 1e-4
"""Largest difference of the two networks' scores, in standard deviations of them."""


def widen(narrow: nn.Module, wide: nn.Module) -> None:
    """Copy the weights of ``narrow`` into ``wide``, in place.

    Each map keeps its old channels in front (Net2Net's widening, Chen et al. 2016). The old
    channels take nothing from the new ones, whose own weights stay as they were drawn, so that
    training can begin to use them. Layers that only ``wide`` has keep their weights too, and must
    add nothing to begin with, as a residual block does whose last norm starts at zero.

    Args:
        narrow: Network to take the weights of.
        wide: Network of as many or more channels everywhere, and at least the same layers.

    Raises:
        BadInputError: if the layers do not match, or where the result would not give the same
            numbers: old channels that do not lie in front of the new ones (where maps are stacked),
            or a new layer that changes its input.
    """
    held, weights = narrow.state_dict(), wide.state_dict()
    fits = held.keys() <= weights.keys() and all(
        weights[name].ndim == old.ndim
        and all(a <= b for a, b in zip(old.shape, weights[name].shape, strict=True))
        for name, old in held.items()
    )
    if not fits:
        raise _unlike(narrow, wide)
    with torch.no_grad():
        for name, old in held.items():
            own = weights[name]
            if own.ndim > 1:
                own[: old.shape[0]] = 0
            own[tuple(slice(extent) for extent in old.shape)] = old
        image = torch.rand(1, 3, 64, 96, generator=torch.Generator().manual_seed(0))
        modes = narrow.training, wide.training
        before, after = narrow.eval()(image), wide.eval()(image)
        narrow.train(modes[0])
        wide.train(modes[1])
    if before.shape != after.shape or (after - before).abs().max() > _TOLERANCE * before.std():
        raise _unlike(narrow, wide)


def _unlike(narrow: nn.Module, wide: nn.Module) -> BadInputError:
    return BadInputError(
        f"weights of a network with {settings_of(narrow)} cannot start one with "
        f"{settings_of(wide)}: it must be the same or larger, where no maps are stacked"
    )
