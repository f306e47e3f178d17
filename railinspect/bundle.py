"""The one-file bundle: what its metadata says, and the checks a file must pass to be run.

A bundle is an ONNX file. Input ``image`` is uint8 (N, H, W, 3), RGB, of one fixed size; outputs
``labels``, ``confidence`` and ``rail_score`` are uint8 (N, H, W). Scaling, network, upsampling and
arg-max are inside the graph, so every runtime gets the same numbers. The entry ``railinspect`` of
the file's metadata is the JSON form of :class:`BundleMetadata`.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from railinspect.errors import BundleError
from railinspect.labels import CLASSES, PALETTE

Image = npt.NDArray[np.uint8]

METADATA_KEY: Final = "railinspect"
FORMAT: Final = 1
OUTPUTS: Final = ("labels", "confidence", "rail_score")
MAX_BYTES: Final = 256 * 1024 * 1024
"""Largest file that is read at all."""


@dataclass(frozen=True)
class BundleMetadata:
    """What a bundle says about itself.

    Attributes:
        format: Version of this layout.
        network: Name of the network.
        classes: Class names; the position is the id in ``labels``.
        palette: RGB colour of each class.
        input_size_wh: Width and height the graph takes, pixels.
        colour_order: Always ``RGB``.
        package_version: Version of the package that wrote the bundle.
        training_fingerprint: SHA-256 over the list of training files.
        training: Recipe the weights come from: configuration and steps.
        golden_input: Name of the formula of the golden input, see :func:`golden_image`.
        golden_sha256: SHA-256 of each output for the golden input, by name.
        golden_labels: Labels for it, zlib-packed and base64-coded: another processor may round
            differently, and the share of equal labels is then what counts.
        nodes: Number of graph nodes by operator.
    """

    format: int
    network: str
    classes: tuple[str, ...]
    palette: tuple[tuple[int, ...], ...]
    input_size_wh: tuple[int, int]
    colour_order: str
    package_version: str
    training_fingerprint: str
    training: Mapping[str, Any]
    golden_input: str
    golden_sha256: Mapping[str, str]
    golden_labels: str
    nodes: Mapping[str, int]

    def to_json(self) -> str:
        """The text kept in the file."""
        return json.dumps(asdict(self), sort_keys=True)

    @staticmethod
    def from_json(text: str, path: Path | str) -> BundleMetadata:
        """Read the text back and check it.

        Raises:
            BundleError: if something is missing, of another kind, or not what this package runs.
        """
        try:
            data = json.loads(text)
            names = [f.name for f in fields(BundleMetadata)]
            values = {name: data[name] for name in names}
            values["classes"] = tuple(str(name) for name in values["classes"])
            values["palette"] = tuple(tuple(int(c) for c in rgb) for rgb in values["palette"])
            width, height = (int(side) for side in values["input_size_wh"])
            values["input_size_wh"] = (width, height)
            for name in ("training", "golden_sha256", "nodes"):
                if not isinstance(values[name], dict):
                    raise TypeError(f"{name} is not a mapping")
            metadata = BundleMetadata(**values)
        except (ValueError, KeyError, TypeError) as error:
            raise BundleError(
                f"the metadata of bundle {path} is damaged ({type(error).__name__}: {error}); "
                "export the checkpoint again"
            ) from error
        if metadata.format != FORMAT:
            raise BundleError(
                f"bundle {path} has format {metadata.format}, this package reads {FORMAT}; export "
                "the checkpoint again with this version"
            )
        palette = tuple(tuple(int(c) for c in rgb) for rgb in PALETTE)
        for name, found, expected in (
            ("classes", metadata.classes, CLASSES),
            ("palette", metadata.palette, palette),
            ("colour order", metadata.colour_order, "RGB"),
            ("golden input", metadata.golden_input, GOLDEN_INPUT),
        ):
            if found != expected:
                raise BundleError(
                    f"bundle {path} was made for other {name} than this package's; export it again"
                )
        return metadata


GOLDEN_INPUT: Final = "converging-rails-1"


def golden_image(size_wh: tuple[int, int]) -> Image:
    """The golden input, by formula, in integers only, so that it is the same everywhere.

    Rows above h = 2·H/5 are a vertical ramp (sky); below, a speckled grey with two bright lines
    that start W/5 left and right of the middle at the bottom and meet at row h.

    Args:
        size_wh: Width W and height H, pixels.

    Returns:
        RGB image, shape (H, W, 3).
    """
    width, height = size_wh
    v, u = np.mgrid[:height, :width].astype(np.int64)
    horizon = 2 * height // 5
    depth = height - horizon
    sky = 235 - 60 * v // height
    ground = 80 + ((13 * u + 29 * v) ^ (u * v >> 5)) % 48
    offset = np.abs(np.abs(2 * u - width) * depth * 5 - 2 * width * (v - horizon))
    rail = offset <= 2 * 5 * (v - horizon) * width // 100 + depth * 5
    grey = np.where(v < horizon, sky, np.where(rail, 215, ground))
    tint = np.array([0, 4, 12])
    image: Image = np.clip(grey[..., None] + tint, 0, 255).astype(np.uint8)
    return image


def digest(array: Image) -> str:
    """SHA-256 of an output's bytes, row by row."""
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def pack_labels(labels: Image) -> str:
    """Labels as text for the metadata."""
    return base64.b64encode(zlib.compress(np.ascontiguousarray(labels).tobytes(), 9)).decode()


def unpack_labels(text: str, size_wh: tuple[int, int]) -> Image:
    """Inverse of :func:`pack_labels`.

    Raises:
        BundleError: if the text is damaged or belongs to another size.
    """
    width, height = size_wh
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(text), width * height + 1)
        return np.frombuffer(data, np.uint8).reshape(height, width)
    except (ValueError, zlib.error) as error:
        raise BundleError("the bundle's golden labels are damaged; export it again") from error


def read_bytes(path: Path) -> bytes:
    """Read a bundle file that may come from anywhere.

    Raises:
        BundleError: if it cannot be read, is empty or too large, or points to further files.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BundleError(
                f"bundle {path} has {size / 2**20:.0f} MiB, more than the "
                f"{MAX_BYTES // 2**20} MiB a bundle may have"
            )
        data = path.read_bytes()
    except OSError as error:
        raise BundleError(f"cannot read bundle {path}: {error.strerror or error}") from error
    if not data:
        raise BundleError(f"bundle {path} is empty; copy or export it again")
    # The key that every reference to an external file must carry, as protobuf writes it.
    if b"\x0a\x08location" in data:
        raise BundleError(
            f"bundle {path} keeps weights in another file; a bundle is one file: export it with "
            "python -m export"
        )
    return data
