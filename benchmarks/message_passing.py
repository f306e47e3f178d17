"""Folded message passing against SCNN's loops and against the bare matrix products.

SCNN runs twice: as its ports publish it, a 2-d convolution of a slice of the map per step, and as
this package writes the same passes, a 1-d convolution of a slice that lies contiguous. The
processor is compared by its own time too, which other programs on the machine change less.

python -m benchmarks.message_passing [--json] [--channels 128] [--size 64x128] [--taps 9]
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import torch
from torch import Tensor, nn

from benchmarks.common import Measure, parser, publish
from fscnn.models import FoldedMessagePassing, SequentialMessagePassing
from fscnn.models.message_passing import bounded


def bare_products(channels: int, height: int, width: int, taps: int) -> Callable[[], object]:
    """The matrix products of all four passes and nothing else: no windows, no addition, no ReLU.

    They are the plain ones, of every tap: what minimal filtering saves shows as a ratio below one.
    """
    weight = torch.randn(2, taps * channels, channels)
    row, column = (torch.randn(2, extent, taps * channels) for extent in (width, height))

    def work() -> None:
        for _ in range(height - 1):
            torch.bmm(row, weight)
        for _ in range(width - 1):
            torch.bmm(column, weight)

    return work


class PublishedScnn(nn.Module):
    """SCNN's four passes as its PyTorch ports write them; same kernels as ``scnn``."""

    def __init__(self, scnn: SequentialMessagePassing) -> None:
        super().__init__()
        taps = scnn.vertical.shape[3]
        self.passes = nn.ModuleList()
        for kernels, dim in ((scnn.vertical, 2), (scnn.horizontal, 3)):
            for kernel in bounded(kernels).detach():
                size = (1, taps) if dim == 2 else (taps, 1)
                padding = (0, taps // 2) if dim == 2 else (taps // 2, 0)
                layer = nn.Conv2d(*kernel.shape[:2], size, padding=padding, bias=False)
                layer.weight.data = kernel.unsqueeze(dim).contiguous()
                self.passes.append(layer)

    def forward(self, features: Tensor) -> Tensor:
        """Map features (N, C, H, W) to (N, C, H, W)."""
        for number, layer in enumerate(self.passes):
            dim = 2 + number // 2
            slices = list(features.split(1, dim))
            if number % 2:
                slices.reverse()
            for i in range(1, len(slices)):
                slices[i] = slices[i] + nn.functional.relu(layer(slices[i - 1]))
            if number % 2:
                slices.reverse()
            features = torch.cat(slices, dim)
        return features


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


def alternating(works: list[Callable[[], object]], repeats: int) -> tuple[list[float], list[float]]:
    """Median wall-clock and least processor time of each work, run in turn, seconds."""
    wall: list[list[float]] = [[] for _ in works]
    processor: list[list[float]] = [[] for _ in works]
    for turn in range(repeats + 1):
        for work, seen, spent in zip(works, wall, processor, strict=True):
            start, start_spent = time.perf_counter(), time.process_time()
            work()
            if turn:  # the first warms up
                seen.append(time.perf_counter() - start)
                spent.append(time.process_time() - start_spent)
    return [statistics.median(s) for s in wall], [min(s) for s in processor]


def on_gpu(channels: int, taps: int, repeats: int, device: str = "cuda") -> list[Measure]:
    """Folded passes against SCNN's published loops, forward, at the two shapes of the bar."""
    measures = []
    for height, width in ((36, 100), (64, 128)):
        features = torch.randn(1, channels, height, width, device=device)
        sequential = SequentialMessagePassing(channels, taps)
        times = []
        for module in (FoldedMessagePassing(channels, taps), PublishedScnn(sequential)):
            work = forward(module.to(device), features)
            seen = []
            for turn in range(repeats + 3):
                start = time.perf_counter()
                work()
                if device == "cuda":
                    torch.cuda.synchronize()
                if turn >= 3:
                    seen.append(time.perf_counter() - start)
            times.append(statistics.median(seen))
        shape = f"{height}×{width}×{channels} on {device}"
        measures += [
            Measure(f"forward, folded, {shape}", times[0] * 1e3, "ms"),
            Measure(f"forward, SCNN's loops as published, {shape}", times[1] * 1e3, "ms"),
            Measure(f"forward, folded / SCNN's loops, {shape}", times[0] / times[1], "", 0.25),
        ]
    return measures


def main() -> None:
    arguments = parser("Folded message passing against SCNN's loops.")
    arguments.add_argument("--channels", type=int, default=128, help="default 128")
    arguments.add_argument("--size", default="64x128", help="height x width (default 64x128)")
    arguments.add_argument("--taps", type=int, default=9, help="default 9")
    arguments.add_argument("--repeats", type=int, default=9, help="runs of each (default 9)")
    arguments.add_argument(
        "--threads", type=int, default=0, help="torch threads (default: torch's)"
    )
    options = arguments.parse_args()
    height, width = (int(side) for side in options.size.split("x"))
    if options.threads:
        torch.set_num_threads(options.threads)
    torch.manual_seed(0)
    features = torch.randn(1, options.channels, height, width)
    folded = FoldedMessagePassing(options.channels, options.taps)
    sequential = SequentialMessagePassing(options.channels, options.taps)
    export = FoldedMessagePassing(options.channels, options.taps)
    export.form = "export"
    published = PublishedScnn(sequential)
    with torch.no_grad():
        torch.testing.assert_close(published(features), sequential(features))
    works = {
        "forward, folded": forward(folded, features),
        "forward, SCNN's loops as published": forward(published, features),
        "forward, SCNN's loops as in this package": forward(sequential, features),
        "forward, folded in the export form": forward(export, features),
        "forward, bare matrix products": bare_products(
            options.channels, height, width, options.taps
        ),
        "forward + backward, folded": forward_backward(folded, features),
        "forward + backward, SCNN's loops as published": forward_backward(published, features),
        "forward + backward, SCNN's loops as in this package": forward_backward(
            sequential, features
        ),
    }
    wall, processor = alternating(list(works.values()), options.repeats)
    shape = f"{options.channels} channels, {height}×{width}, k = {options.taps}"
    measures = [Measure(f"threads ({shape})", torch.get_num_threads(), "")]
    for clock, seconds in (("", wall), (", processor time", processor)):
        times = dict(zip(works, seconds, strict=True))
        measures += [Measure(f"{name}{clock}", s * 1e3, "ms") for name, s in times.items()]
        for ours, rival, bar in (
            ("forward, folded", "forward, SCNN's loops as published", 0.5),
            ("forward, folded", "forward, SCNN's loops as in this package", 0.5),
            ("forward, folded", "forward, bare matrix products", 1.35),
            ("forward + backward, folded", "forward + backward, SCNN's loops as published", 0.6),
            (
                "forward + backward, folded",
                "forward + backward, SCNN's loops as in this package",
                0.6,
            ),
        ):
            ratio = times[ours] / times[rival]
            measures.append(Measure(f"{ours} / {rival.split(', ')[1]}{clock}", ratio, "", bar))
    if torch.cuda.is_available():
        measures += on_gpu(options.channels, options.taps, options.repeats)
    publish("message_passing", measures, options.json)


if __name__ == "__main__":
    main()
