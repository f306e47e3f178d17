"""The shipped bundle in ONNX Runtime and, where it is installed, in OpenVINO: labels and time.

python -m benchmarks.runtimes [--json] [--bundle FILE] [--threads 2] [--scenes 8]
"""

from __future__ import annotations

import importlib.util
from importlib.resources import as_file, files
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common import Measure, alternating_medians, parser, publish
from railinspect import scenes
from railinspect.bundle import golden_image
from railinspect.segmenter import Segmenter

HELD_OUT = 900_000
"""Seed of the first scene; no network was trained on it or on those after it."""


def compare(bundle: Path, threads: int, count: int, repeats: int) -> list[Measure]:
    """Both runtimes on the golden input and on held-out scenes, timed in turn."""
    import openvino

    native = Segmenter.load(bundle, threads)
    size_wh = native.metadata.input_size_wh
    settings = {
        "INFERENCE_NUM_THREADS": threads,
        "INFERENCE_PRECISION_HINT": "f32",
        "PERFORMANCE_HINT": "LATENCY",
    }
    other = openvino.compile_model(str(bundle), "CPU", settings)
    rendered = (scenes.render(seed).rgb for seed in range(HELD_OUT, HELD_OUT + count))
    images = [golden_image(size_wh), *(cv2.resize(i, size_wh) for i in rendered)]
    equal, apart = [], []
    for image in images:
        here, there = native(image), other({"image": image[None]})
        equal.append(float(np.mean(here.labels == there["labels"][0])))
        difference = here.rail_score.astype(int) - there["rail_score"][0]
        apart.append(int(np.abs(difference).max()))
    one = images[0]
    times = alternating_medians(
        [lambda: native(one), lambda: other({"image": one[None]})], repeats, warm_up=3
    )
    shape = f"{size_wh[0]}×{size_wh[1]}, {threads} threads"
    return [
        Measure(f"ONNX Runtime, {shape}", times[0] * 1e3, "ms"),
        Measure(f"OpenVINO, {shape}", times[1] * 1e3, "ms"),
        Measure("OpenVINO / ONNX Runtime", times[1] / times[0], ""),
        Measure(f"labels equal, worst of {len(images)}", 100 * min(equal), "%", 99.9, "higher"),
        Measure("largest difference of rail score, of 255", max(apart), ""),
    ]


def main() -> None:
    arguments = parser("The shipped bundle in ONNX Runtime and in OpenVINO.")
    arguments.add_argument("--bundle", type=Path, help="default: the shipped one")
    arguments.add_argument("--threads", type=int, default=2, help="default 2")
    arguments.add_argument("--scenes", type=int, default=8, help="compared on (default 8)")
    arguments.add_argument("--repeats", type=int, default=40, help="timed frames (default 40)")
    options = arguments.parse_args()
    if importlib.util.find_spec("openvino") is None:
        arguments.error("OpenVINO is not installed; pip install openvino")
    with as_file(files("railinspect") / "bundles" / "fscnn_s.onnx") as shipped:
        bundle = options.bundle or shipped
        measures = compare(bundle, options.threads, options.scenes, options.repeats)
    publish("runtimes", measures, options.json)


if __name__ == "__main__":
    main()
