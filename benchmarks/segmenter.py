"""Time of one frame through the shipped bundle (or another one).

python -m benchmarks.segmenter [--json] [--bundle FILE] [--threads 2]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.common import Measure, alternating_medians, parser, publish
from railinspect.bundle import golden_image
from railinspect.segmenter import Segmenter


def main() -> None:
    arguments = parser("Time of one frame through a bundle.")
    arguments.add_argument("--bundle", type=Path, help="default: the shipped one")
    arguments.add_argument("--threads", type=int, default=2, help="default 2")
    arguments.add_argument("--repeats", type=int, default=60, help="runs of each (default 60)")
    options = arguments.parse_args()

    def load(threads: int) -> Segmenter:
        if options.bundle:
            return Segmenter.load(options.bundle, threads)
        return Segmenter.default(threads)

    many, one = load(options.threads), load(1)
    own = golden_image(many.metadata.input_size_wh)
    large = np.ascontiguousarray(golden_image((1920, 1080)))
    at_own, at_large, alone = alternating_medians(
        [lambda: many(own), lambda: many(large), lambda: one(own)], options.repeats, warm_up=3
    )
    width, height = many.metadata.input_size_wh
    publish(
        "segmenter",
        [
            Measure(
                f"frame of {width}×{height}, {options.threads} threads", at_own * 1e3, "ms", 20
            ),
            Measure(f"frame of 1920×1080, {options.threads} threads", at_large * 1e3, "ms"),
            Measure(f"frame of {width}×{height}, 1 thread", alone * 1e3, "ms"),
            Measure("graph nodes", sum(many.metadata.nodes.values()), ""),
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
