"""A trained network's weights in a wider network of the same kind, which then gives its numbers."""

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
    training can begin to use them.

    Args:
        narrow: Network to take the weights of.
        wide: Network of as many or more channels everywhere, and the same layers.

    Raises:
        BadInputError: if the layers do not match, or where old channels do not lie in front of the
            new ones (where maps are stacked), so that the result would not give the same numbers.
    """
    held, weights = narrow.state_dict(), wide.state_dict()
    fits = held.keys() == weights.keys() and all(
        own.ndim == old.ndim and all(a <= b for a, b in zip(old.shape, own.shape, strict=True))
        for own, old in zip(weights.values(), held.values(), strict=True)
    )
    if not fits:
        raise _unlike(narrow, wide)
    with torch.no_grad():
        for name, own in weights.items():
            old = held[name]
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
        f"{settings_of(wide)}: it must be the same or wider, where no maps are stacked"
    )
