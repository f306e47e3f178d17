"""The network back out of a bundle, so that training can start from the one that ships."""

from __future__ import annotations

from pathlib import Path

import onnx
import torch
from google.protobuf.message import DecodeError
from onnx import numpy_helper
from torch import nn

from fscnn.models import build, settings_of
from fscnn.models.blocks import fold_norms
from fscnn.training.checkpoint import Trained
from railinspect.bundle import MAX_BYTES, METADATA_KEY, BundleMetadata
from railinspect.errors import BadInputError

_PREFIX = "network."
"""What the exporter's own module puts before the names of the network's weights."""


def load_bundle(path: Path) -> Trained:
    """Rebuild the network of a bundle, with its norms folded as they are in the file.

    Args:
        path: A bundle in single or half precision, as ``python -m export`` writes it.

    Raises:
        BadInputError: if it cannot be read, is no bundle, or its weights are not all there (one in
            eight bits keeps them in another form).
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInputError(f"{path} is larger than any bundle ({MAX_BYTES // 2**20} MiB)")
        model = onnx.load(path, load_external_data=False)
    except OSError as error:
        raise BadInputError(f"cannot read bundle {path}: {error.strerror or error}") from error
    except DecodeError as error:
        raise BadInputError(f"{path} is not an ONNX file") from error
    texts = {entry.key: entry.value for entry in model.metadata_props}
    metadata = BundleMetadata.from_json(texts.get(METADATA_KEY, ""), path)
    recipe = metadata.training.get("recipe", {})
    network = fold_norms(build(metadata.network, recipe.get("settings", {})))
    held = {
        entry.name.removeprefix(_PREFIX): torch.from_numpy(numpy_helper.to_array(entry).copy())
        for entry in model.graph.initializer
        if entry.name.startswith(_PREFIX)
    }
    weights = network.state_dict()
    for name, own in weights.items():
        if name.endswith("num_batches_tracked"):
            continue
        if name not in held or held[name].shape != own.shape:
            raise BadInputError(
                f"{path} does not hold {name} of network {metadata.network} as it was trained; "
                "start from a bundle in single precision or from a checkpoint"
            )
        weights[name] = held[name].to(own.dtype)
    network.load_state_dict(weights)
    # The exporter folds the division by 255 into the first convolution.
    next(m for m in network.modules() if isinstance(m, nn.Conv2d)).weight.data *= 255
    return Trained(
        network.eval(),
        metadata.network,
        settings_of(network),
        True,
        dict(recipe),
        metadata.training_fingerprint,
        int(metadata.training.get("steps", 0)),
    )
