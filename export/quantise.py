"""Eight-bit graphs: static quantisation with calibration, kept only where it pays.

Each convolution gets quantise/dequantise pairs around it (QDQ), ranges measured on calibration
images. Whether that is faster depends on the processor, and what it costs on the data, so both are
measured and the float graph stays where either speaks against it.
"""

from __future__ import annotations

import logging
import statistics
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnxruntime.quantization import (
    CalibrationDataReader,
    QuantFormat,
    QuantType,
    quantize_static,
)

from fscnn.training.evaluation import evaluate
from railinspect.bundle import Image
from railinspect.errors import RailInspectError
from railinspect.segmenter import Segmenter

MAX_LOSS = 0.01
"""Rail IoU an eight-bit graph may lose against the float one."""


class RefusedError(RailInspectError, ArithmeticError):
    """A quantised graph that is not worth having here."""


@dataclass(frozen=True)
class Comparison:
    """An eight-bit graph against the float one it came from.

    Attributes:
        frame_s: Median time of a frame, seconds.
        float_frame_s: The float graph's.
        rail_iou: Rail IoU on the labelled images.
        float_rail_iou: The float graph's.
    """

    frame_s: float
    float_frame_s: float
    rail_iou: float
    float_rail_iou: float

    def objection(self) -> str | None:
        """Why the eight-bit graph is refused; None where it is kept."""
        reasons = []
        if not self.frame_s < self.float_frame_s:
            reasons.append(
                f"it takes {self.frame_s * 1e3:.1f} ms a frame where the float graph takes "
                f"{self.float_frame_s * 1e3:.1f} ms"
            )
        if not self.rail_iou >= self.float_rail_iou - MAX_LOSS:
            reasons.append(
                f"its rail IoU is {self.rail_iou:.3f} where the float graph's is "
                f"{self.float_rail_iou:.3f}"
            )
        return " and ".join(reasons) or None


class _Images(CalibrationDataReader):
    def __init__(self, images: Sequence[Image]) -> None:
        self._left: Iterator[Image] = iter(images)

    def get_next(self) -> Any:
        image = next(self._left, None)
        return None if image is None else {"image": image[None]}


def quantise(model: onnx.ModelProto, images: Sequence[Image]) -> onnx.ModelProto:
    """Quantise the convolutions of a bundle's graph.

    Args:
        model: The float graph; input ``image``, uint8 (N, H, W, 3).
        images: Calibration images of that size, RGB.
    """
    log = logging.getLogger()
    level = log.level
    log.setLevel(logging.ERROR)  # it recommends a pass that this graph does not need
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        source, target = Path(folder) / "float.onnx", Path(folder) / "int8.onnx"
        onnx.save(model, source)
        quantize_static(
            source,
            target,
            _Images(images),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv"],
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        result = onnx.load(target)
    log.setLevel(level)
    return result


def compare_speed_and_rails(
    int8: Segmenter, float32: Segmenter, labelled: Sequence[tuple[Image, Image]], repeats: int = 15
) -> Comparison:
    """Time both graphs in turn on this machine, and score both on the same labelled images."""
    image = np.ascontiguousarray(labelled[0][0])
    times: tuple[list[float], list[float]] = ([], [])
    for turn in range(repeats + 1):
        for segmenter, seen in zip((int8, float32), times, strict=True):
            began = time.perf_counter()
            segmenter(image)
            if turn:  # the first warms up
                seen.append(time.perf_counter() - began)
    ious = [float(evaluate(s, labelled).summary()["rail_iou"]) for s in (int8, float32)]
    return Comparison(*(statistics.median(t) for t in times), *ious)
