"""A bundle built node by node: quick, without a network, and with outputs one can foretell.

``labels`` is the red channel modulo 19, ``confidence`` the green and ``rail_score`` the blue one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper

from railinspect.bundle import (
    FORMAT,
    GOLDEN_INPUT,
    METADATA_KEY,
    BundleMetadata,
    digest,
    golden_image,
    pack_labels,
)
from railinspect.labels import CLASSES, PALETTE

SIZE_WH = (48, 32)


def golden_outputs(size_wh: tuple[int, int]) -> dict[str, npt.NDArray[np.uint8]]:
    image = golden_image(size_wh)
    return {
        "labels": image[..., 0] % 19,
        "confidence": image[..., 1],
        "rail_score": image[..., 2],
    }


def metadata(size_wh: tuple[int, int] = SIZE_WH) -> BundleMetadata:
    golden = golden_outputs(size_wh)
    return BundleMetadata(
        format=FORMAT,
        network="by hand",
        classes=CLASSES,
        palette=tuple(tuple(int(c) for c in rgb) for rgb in PALETTE),
        input_size_wh=size_wh,
        colour_order="RGB",
        package_version="0",
        training_fingerprint="",
        training={},
        golden_input=GOLDEN_INPUT,
        golden_sha256={name: digest(part) for name, part in golden.items()},
        golden_labels=pack_labels(golden["labels"]),
        nodes={},
    )


def model(
    size_wh: tuple[int, int] = SIZE_WH, input_name: str = "image", kind: int = TensorProto.UINT8
) -> onnx.ModelProto:
    width, height = size_wh
    names = ("labels", "confidence", "rail_score")
    nodes = [
        helper.make_node("Split", [input_name], ["r", "g", "b"], axis=3, num_outputs=3),
        helper.make_node("Squeeze", ["r", "last"], ["red"]),
        helper.make_node("Mod", ["red", "nineteen"], ["labels"]),
        helper.make_node("Squeeze", ["g", "last"], ["confidence"]),
        helper.make_node("Squeeze", ["b", "last"], ["rail_score"]),
    ]
    graph = helper.make_graph(
        nodes,
        "by hand",
        [helper.make_tensor_value_info(input_name, kind, ["n", height, width, 3])],
        [helper.make_tensor_value_info(name, kind, ["n", height, width]) for name in names],
        [
            helper.make_tensor("last", TensorProto.INT64, [1], [3]),
            helper.make_tensor("nineteen", kind, [1], [19]),
        ],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)


def bundle(
    built: onnx.ModelProto | None = None,
    change: Callable[[str], str] = lambda text: text,
    key: str = METADATA_KEY,
    **fields: object,
) -> bytes:
    """The file's bytes, after changing the metadata's text or fields."""
    built = built or model()
    entry = built.metadata_props.add()
    entry.key = key
    entry.value = change(replace(metadata(), **fields).to_json())
    return bytes(built.SerializeToString())
