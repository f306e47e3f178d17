"""From a trained network to a verified one-file bundle."""

from __future__ import annotations

import collections
import io
import json
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import onnx
import torch

from export.deployed import Deployed
from export.quantise import Comparison, RefusedError, compare_speed_and_rails, quantise
from fscnn.training.checkpoint import Trained
from railinspect import bundle as layout
from railinspect.bundle import BundleMetadata, Image, digest, golden_image, pack_labels
from railinspect.errors import BadInputError, RailInspectError
from railinspect.labels import CLASSES, PALETTE
from railinspect.segmenter import MIN_AGREEMENT, Segmenter

FORBIDDEN = ("ScatterND", "ScatterElements", "Loop", "If", "Scan")
"""Operators that embedded runtimes run slowly or not at all."""

LEAST_AGREEMENT = {"fp32": MIN_AGREEMENT, "fp16": 0.99, "int8": 0.0}
"""Share of labels that must equal the checkpoint's; an eight-bit graph is judged by its rails."""


class ParityError(RailInspectError, ArithmeticError):
    """The exported graph does not give what the checkpoint gives."""


@dataclass(frozen=True)
class Exported:
    """What an export produced.

    Attributes:
        path: The bundle.
        size_bytes: Its size.
        input_size_wh: Width and height it takes.
        agreement: Least share of equal labels, checkpoint against bundle, over the checked images.
        score_difference: Largest difference of rail score on them, 0 … 255.
        nodes: Graph nodes by operator.
        precision: ``fp32``, ``fp16`` or ``int8``.
        comparison: An eight-bit graph's time and rail IoU beside the float one's.
    """

    path: Path
    size_bytes: int
    input_size_wh: tuple[int, int]
    agreement: float
    score_difference: int
    nodes: dict[str, int]
    precision: str = "fp32"
    comparison: Comparison | None = None


def export(
    trained: Trained,
    out: Path,
    size_wh: tuple[int, int] = (640, 368),
    images: tuple[Image, ...] = (),
    precision: str = "fp32",
    labelled: Sequence[tuple[Image, Image]] = (),
) -> Exported:
    """Write a bundle and prove that it agrees with the network.

    ``fp16`` halves the file; where a processor has no half-precision kernels its runtime computes
    in single precision. ``int8`` is kept only where it is faster on this machine and loses no more
    than a point of rail IoU; it calibrates on the first half of ``labelled`` and is judged on the
    second.

    Args:
        trained: The network and where it comes from.
        out: File to write.
        size_wh: Width and height of the bundle's input, divisible by 16.
        images: RGB images of that size to compare on, besides the golden input.
        precision: ``fp32``, ``fp16`` or ``int8``.
        labelled: For ``int8``: RGB images of that size and their masks, two at least.

    Raises:
        BadInputError: if the size does not suit the network or ``out`` cannot be written.
        ParityError: if the graph holds a forbidden operator, or fewer labels agree on one of the
            images than :data:`LEAST_AGREEMENT` asks for. No file is left then.
        RefusedError: if an eight-bit graph is not worth having here. No file is left then.
    """
    if precision not in LEAST_AGREEMENT:
        known = ", ".join(LEAST_AGREEMENT)
        raise BadInputError(f"unknown precision {precision!r}; known: {known}")
    if precision == "int8" and len(labelled) < 2:
        raise BadInputError(
            f"int8 needs labelled images to calibrate and to judge on, got {len(labelled)}; give "
            "--folder or more --scenes"
        )
    width, height = size_wh
    if width % 16 or height % 16 or min(size_wh) < 64:
        raise BadInputError(
            f"size {width}x{height} does not suit the network; both sides must be divisible by 16 "
            "and at least 64"
        )
    deployed = Deployed(trained.network, torch.float16 if precision == "fp16" else torch.float32)
    example = torch.zeros(2, height, width, 3, dtype=torch.uint8)
    model = to_onnx(deployed, example, "image", layout.OUTPUTS)
    float_model = model
    if precision == "int8":
        model = quantise(model, [image for image, _ in labelled[: (len(labelled) + 1) // 2]])
    nodes = count_nodes(model)
    if found := sorted(set(nodes) & set(FORBIDDEN)):
        raise ParityError(f"the exported graph holds {', '.join(found)}, which no bundle may")

    golden = golden_image(size_wh)
    metadata = BundleMetadata(
        format=layout.FORMAT,
        network=trained.name,
        classes=CLASSES,
        palette=tuple(tuple(int(c) for c in rgb) for rgb in PALETTE),
        input_size_wh=(width, height),
        colour_order="RGB",
        package_version=package_version(),
        training_fingerprint=trained.fingerprint,
        training={
            "recipe": _public(trained.recipe),
            "steps": trained.steps,
            "precision": precision,
        },
        golden_input=layout.GOLDEN_INPUT,
        golden_sha256={},
        golden_labels="",
        nodes=nodes,
    )
    result = Segmenter(_with_metadata(model, metadata), "the new graph")(golden)
    metadata = replace(
        metadata,
        golden_sha256={name: digest(getattr(result, name)) for name in layout.OUTPUTS},
        golden_labels=pack_labels(result.labels),
    )
    data = _with_metadata(model, metadata)
    segmenter = Segmenter(data, "the new bundle")
    exact = Deployed(trained.network) if precision == "fp16" else deployed
    agreement, difference = compare(exact, segmenter, (golden, *images))
    if agreement < LEAST_AGREEMENT[precision]:
        raise ParityError(
            f"only {agreement:.2%} of the bundle's labels equal the checkpoint's, "
            f"{LEAST_AGREEMENT[precision]:.1%} are needed; nothing was written"
        )
    comparison = None
    if precision == "int8":
        rival = Segmenter(_with_metadata(float_model, metadata), "the float graph")
        judged = labelled[(len(labelled) + 1) // 2 :]
        comparison = compare_speed_and_rails(segmenter, rival, judged)
        if objection := comparison.objection():
            raise RefusedError(f"int8 refused on this machine: {objection}; nothing was written")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    except OSError as error:
        raise BadInputError(f"cannot write {out}: {error.strerror}") from error
    return Exported(
        out, len(data), (width, height), agreement, difference, nodes, precision, comparison
    )


def compare(
    deployed: torch.nn.Module, segmenter: Segmenter, images: tuple[Image, ...]
) -> tuple[float, int]:
    """Least share of equal labels, and largest rail-score difference, over images."""
    agreements, differences = [1.0], [0]
    for image in images:
        with torch.no_grad():
            labels, _, rails = (part[0].numpy() for part in deployed(torch.from_numpy(image)[None]))
        run = segmenter(image)
        agreements.append(float(np.mean(labels == run.labels)))
        differences.append(int(np.abs(rails.astype(int) - run.rail_score).max()))
    return min(agreements), max(differences)


def count_nodes(model: onnx.ModelProto) -> dict[str, int]:
    """Graph nodes by operator, most frequent first."""
    return dict(collections.Counter(node.op_type for node in model.graph.node).most_common())


def to_onnx(
    module: torch.nn.Module, example: torch.Tensor, input_name: str, outputs: Sequence[str]
) -> onnx.ModelProto:
    """A network with one input as an ONNX graph for batches of any size, nothing but the graph.

    Args:
        module: The network as it is to run.
        example: An input of two: a batch of one would be taken for a constant.
        input_name: Name of the graph's input.
        outputs: Names of its outputs.
    """
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # the exporter's own deprecations; nothing a user can act on
        program = torch.onnx.export(
            module,
            (example,),
            input_names=[input_name],
            output_names=list(outputs),
            dynamic_shapes=({0: torch.export.Dim("batch", min=1, max=64)},),
            dynamo=True,
            verbose=False,
        )
    stream = io.BytesIO()
    program.save(stream)
    model = onnx.load_from_string(stream.getvalue())
    for node in model.graph.node:  # stack traces of the exporting machine's files
        del node.metadata_props[:]
        node.doc_string = ""
    del model.graph.value_info[:]
    del model.graph.metadata_props[:]
    for initializer in model.graph.initializer:
        del initializer.metadata_props[:]
    for port in (*model.graph.input, *model.graph.output):
        del port.metadata_props[:]
    del model.metadata_props[:]
    onnx.checker.check_model(model)
    return model


def _with_metadata(model: onnx.ModelProto, metadata: BundleMetadata) -> bytes:
    del model.metadata_props[:]
    entry = model.metadata_props.add()
    entry.key, entry.value = layout.METADATA_KEY, metadata.to_json()
    return bytes(model.SerializeToString(deterministic=True))


def _public(recipe: dict[str, object]) -> dict[str, object]:
    """The recipe without the folders of the machine it ran on."""
    text = json.loads(json.dumps(recipe))
    for group, names in (("data", ("train_folders", "val_folders", "railsem")), ("run", ("out",))):
        for name in names:
            text.get(group, {}).pop(name, None)
    text.pop("start_from", None)
    if "blended_with" in text:
        text["blended_with"]["recipe"] = _public(text["blended_with"]["recipe"])
    return dict(text)


def package_version() -> str:
    """The version of this package, for a file's metadata."""
    try:
        return version("railinspect")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "0+checkout"


def to_json(exported: Exported) -> str:
    """The one JSON document ``python -m export --json`` prints."""
    return json.dumps({**asdict(exported), "path": str(exported.path)})
