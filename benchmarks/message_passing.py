"""Folded message passing against SCNN's loops and against the bare matrix products.

python -m benchmarks.message_passing [--json] [--channels 128] [--size 64x128] [--taps 9]
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from benchmarks.common import Measure, alternating_medians, parser, publish
from fscnn.models import FoldedMessagePassing, SequentialMessagePassing


def bare_products(channels: int, height: int, width: int, taps: int) -> Callable[[], object]:
    """The matrix products of all four passes and nothing else: no windows, no addition, no ReLU."""
    weight = torch.randn(2, taps * channels, channels)
    row, column = (torch.randn(2, extent, taps * channels) for extent in (width, height))

    def work() -> None:
        for _ in range(height - 1):
            torch.bmm(row, weight)
        for _ in range(width - 1):
            torch.bmm(column, weight)

    return work


def forward(module: nn.Module, features: Tensor) -> Callable[[], object]:
    def work() -> None:
        with torch.no_grad():
            module(features)

    return work


def forward_backward(module: nn.Module, features: Tensor) -> Callable[[], object]:
    def work() -> None:
        result = module(features.clone().requires_grad_())
        result.backward(torch.ones_like(result))

    return work


def main() -> None:
    arguments = parser("Folded message passing against SCNN's loops.")
    arguments.add_argument("--channels", type=int, default=128, help="default 128")
    arguments.add_argument("--size", default="64x128", help="height x width (default 64x128)")
    arguments.add_argument("--taps", type=int, default=9, help="default 9")
    arguments.add_argument("--repeats", type=int, default=9, help="runs of each (default 9)")
    options = arguments.parse_args()
    height, width = (int(side) for side in options.size.split("x"))
    torch.manual_seed(0)
    features = torch.randn(1, options.channels, height, width)
    folded = FoldedMessagePassing(options.channels, options.taps)
    sequential = SequentialMessagePassing(options.channels, options.taps)
    export = FoldedMessagePassing(options.channels, options.taps)
    export.form = "export"
    works = [
        forward(folded, features),
        forward(sequential, features),
        forward(export, features),
        bare_products(options.channels, height, width, options.taps),
        forward_backward(folded, features),
        forward_backward(sequential, features),
    ]
    fold, scnn, exported, bare, fold_train, scnn_train = alternating_medians(works, options.repeats)
    shape = f"{options.channels} channels, {height}×{width}, k = {options.taps}"
    publish(
        "message_passing",
        [
            Measure(f"forward, folded ({shape})", fold * 1e3, "ms"),
            Measure("forward, SCNN's loops", scnn * 1e3, "ms"),
            Measure("forward, folded in the export form", exported * 1e3, "ms"),
            Measure("forward, bare matrix products", bare * 1e3, "ms"),
            Measure("forward, folded / SCNN's loops", fold / scnn, "", 0.5),
            Measure("forward, folded / bare matrix products", fold / bare, "", 1.35),
            Measure("forward + backward, folded", fold_train * 1e3, "ms"),
            Measure("forward + backward, SCNN's loops", scnn_train * 1e3, "ms"),
            Measure("forward + backward, folded / SCNN's loops", fold_train / scnn_train, "", 0.6),
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
