"""The shipped bundle in a runtime that is not ours."""

from pathlib import Path

import numpy as np
import pytest

import railinspect
from railinspect import scenes
from railinspect.bundle import golden_image
from railinspect.segmenter import MIN_AGREEMENT, Segmenter


def test_openvino_gives_the_same_bytes() -> None:
    openvino = pytest.importorskip("openvino", reason="needs openvino")
    path = Path(railinspect.__file__).parent / "bundles" / "fscnn_s.onnx"
    native = Segmenter.load(path, threads=1)
    width, height = native.metadata.input_size_wh
    settings = {"INFERENCE_NUM_THREADS": 1, "INFERENCE_PRECISION_HINT": "f32"}
    other = openvino.compile_model(str(path), "CPU", settings)
    scene = np.zeros((height, width, 3), np.uint8)
    rgb = scenes.render(900_000).rgb[:height, :width]
    scene[: rgb.shape[0], : rgb.shape[1]] = rgb
    images = np.stack([golden_image((width, height)), scene])
    found = other({"image": images})  # two at once: the batch is free
    for number, image in enumerate(images):
        here = native(image)
        assert len(np.unique(here.labels)) > 2
        assert np.mean(found["labels"][number] == here.labels) >= MIN_AGREEMENT
        for name in ("confidence", "rail_score"):
            there = found[name][number].astype(int)
            assert np.abs(there - getattr(here, name)).max() <= 3  # of 255
