"""Stopping at the first NaN, with the name of the layer it came from."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from railinspect.errors import RailInspectError


class DivergedError(RailInspectError, ArithmeticError):
    """Training produced a number that is not finite."""


def explain_divergence(network: nn.Module, images: Tensor, step: int) -> DivergedError:
    """Find the first weight, or else the first layer output, that is not finite.

    Args:
        network: The network as it was when the loss stopped being finite.
        images: The batch that did it.
        step: Optimiser step, for the message.
    """
    remedy = "lower optimiser.rate or optimiser.clip, or lengthen schedule.warmup"
    start = f"the loss is not finite at step {step}: "
    if not torch.isfinite(images).all():
        return DivergedError(start + "the images themselves hold NaN or infinity; check the data")
    for name, weight in network.named_parameters():
        if not torch.isfinite(weight).all():
            return DivergedError(f"{start}weight {name} holds NaN or infinity; {remedy}")
    found: list[str] = []

    def watch(name: str) -> object:
        def hook(_module: nn.Module, _inputs: object, output: object) -> None:
            if isinstance(output, Tensor) and not torch.isfinite(output).all():
                found.append(name)

        return hook

    handles = [
        module.register_forward_hook(watch(name))
        for name, module in network.named_modules()
        if not list(module.children())
    ]
    with torch.no_grad():
        network(images)
    for handle in handles:
        handle.remove()
    where = f"layer {found[0]} is the first to give NaN or infinity" if found else "in the loss"
    return DivergedError(f"{start}{where}; {remedy}")
