"""Time of one frame through the shipped bundle (or another one), and its IoU of rails.

python -m benchmarks.segmenter [--json] [--bundle FILE] [--threads 2] [--scenes 40]
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from benchmarks.common import Measure, alternating_medians, parser, publish
from railinspect import scenes
from railinspect.bundle import golden_image
from railinspect.labels import RAILS, VOID
from railinspect.segmenter import Segmenter

HELD_OUT = 900_000
"""Seed of the first scene; no network was trained on it or on those after it."""

ASIDE_PX = (0.5, 1.0)


def rail_iou(segmenter: Segmenter, count: int) -> list[Measure]:
    """IoU of rails on held-out scenes: of the bundle, and of the truth moved a little aside."""
    shared, either = np.zeros(1 + len(ASIDE_PX)), np.zeros(1 + len(ASIDE_PX))
    for seed in range(HELD_OUT, HELD_OUT + count):
        scene = scenes.render(seed)
        known, truth = scene.labels != VOID, np.isin(scene.labels, RAILS)
        answers = [np.isin(segmenter(scene.rgb).labels, RAILS)]
        for aside_px in ASIDE_PX:
            move = np.array([[1.0, 0.0, aside_px], [0.0, 1.0, 0.0]])
            size_wh = (truth.shape[1], truth.shape[0])
            answers.append(cv2.warpAffine(truth.astype(np.float32), move, size_wh) > 0.5)
        for i, answer in enumerate(answers):
            shared[i] += np.count_nonzero(answer & truth & known)
            either[i] += np.count_nonzero((answer | truth) & known)
    names = ["the bundle", *(f"the truth, {aside_px:g} px aside" for aside_px in ASIDE_PX)]
    bars = [0.70, *(None for _ in ASIDE_PX)]
    return [
        Measure(f"rail IoU on {count} held-out scenes: {name}", float(iou), "", bar, "higher")
        for name, iou, bar in zip(names, shared / either, bars, strict=True)
    ]


def main() -> None:
    arguments = parser("Time of one frame through a bundle, and its IoU of rails.")
    arguments.add_argument("--scenes", type=int, default=40, help="held-out scenes (default 40)")
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
            *rail_iou(many, options.scenes),
        ],
        options.json,
    )


if __name__ == "__main__":
    main()
