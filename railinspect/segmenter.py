"""Class labels, confidence and rail score of an image, from a bundle run by ONNX Runtime."""

from __future__ import annotations

import functools
import importlib.resources
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import onnxruntime

from railinspect.bundle import (
    METADATA_KEY,
    OUTPUTS,
    BundleMetadata,
    Image,
    digest,
    golden_image,
    read_bytes,
    unpack_labels,
)
from railinspect.close_ups import CloseUpNetwork, LookAtTrack
from railinspect.errors import BadInputError, BundleError
from railinspect.onnx_session import open_session

MIN_SIDE_PX = 16
"""Least width and height of an image; anything smaller shows no track."""

MIN_AGREEMENT = 0.999
"""Share of labels that must equal the bundle's golden ones."""


@dataclass(frozen=True)
class Segmentation:
    """What the network says of one image; all maps have the image's size.

    Attributes:
        labels: Class ids, uint8 (H, W).
        confidence: Probability of the likeliest class, 0 … 255 for 0 … 1, uint8 (H, W).
        rail_score: P(rail-raised) + P(rail-embedded), 0 … 255 for 0 … 1, uint8 (H, W).
        closest_xyxy: Where a closer look at a part of the image (:mod:`railinspect.fovea`) took the
            place of what was seen before, pixels; None for a single look.
        before: What was seen before that closer look; None for a single look.
        close_ups: Looks at the track in the picture itself once it is followed, all along or from
            … to, metres (:mod:`railinspect.close_ups`); None where nobody does.
    """

    labels: Image
    confidence: Image
    rail_score: Image
    closest_xyxy: tuple[int, int, int, int] | None = None
    before: Segmentation | None = None
    close_ups: LookAtTrack | None = None


class Segmenter:
    """A bundle, loaded and checked; call it with RGB images of any size.

    An image of another size than the bundle's is stretched to it, labels return by the nearest
    pixel and scores linearly. The shipped network has seen its proportions vary by some 15 %.

    Attributes:
        metadata: What the bundle says about itself.
        threads: Processor threads of one image.
    """

    def __init__(
        self,
        data: bytes,
        name: str = "bundle",
        threads: int | None = None,
        close_ups: CloseUpNetwork | None = None,
    ) -> None:
        """Load a bundle from its bytes; :meth:`load` and :meth:`default` read them from a file.

        Args:
            data: The ONNX file.
            name: How error messages call it.
            threads: Processor threads; None uses every core this process may run on.
            close_ups: Looks at the track in each picture besides, once it is followed; None for
                masks alone.

        Raises:
            BundleError: if the bytes are not a bundle this package can run.
        """
        if threads is None:
            allowed = getattr(os, "sched_getaffinity", None)
            threads = len(allowed(0)) if allowed else os.cpu_count() or 1
        if threads < 1:
            raise BadInputError(f"threads must be at least 1, got {threads}")
        self.threads = threads
        self._source, self._close_ups = (data, name), close_ups
        self._single: Segmenter | None = self if threads == 1 else None
        session = open_session(data, name, threads)
        text = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
        if text is None:
            raise BundleError(
                f"{name} is an ONNX file but not one of ours: it has no {METADATA_KEY!r} metadata; "
                "make one with python -m export"
            )
        self.metadata = BundleMetadata.from_json(text, name)
        _check_signature(session, self.metadata, name)
        self._session = session

    @staticmethod
    def load(path: Path | str, threads: int | None = None, close_ups: bool = True) -> Segmenter:
        """Load a bundle file.

        Args:
            path: The ``.onnx`` file.
            threads: Processor threads; None uses every core this process may run on.
            close_ups: Whether the network of the close-ups that ships looks at the track besides.

        Raises:
            BundleError: if the file is missing, damaged, too large, not a bundle, or disagrees
                with its own metadata.
        """
        looker = CloseUpNetwork.default() if close_ups else None
        return Segmenter(read_bytes(Path(path)), f"bundle {path}", threads, looker)

    @staticmethod
    def default(threads: int | None = None, close_ups: bool = True) -> Segmenter:
        """Load the bundle that ships with the package; arguments as those of :meth:`load`."""
        shipped = importlib.resources.files("railinspect") / "bundles" / "fscnn_s.onnx"
        with importlib.resources.as_file(shipped) as path:
            return Segmenter.load(path, threads, close_ups)

    def on_one_thread(self) -> Segmenter:
        """The same network for several images at once, each on a thread of its own.

        Two images side by side take less time than one after the other on two threads.
        """
        if self._single is None:  # loaded once, however many recordings follow
            self._single = Segmenter(*self._source, threads=1, close_ups=self._close_ups)
        return self._single

    def __call__(self, rgb: Image) -> Segmentation:
        """Segment one image.

        Args:
            rgb: RGB image, uint8 of shape (H, W, 3), at least 16 × 16.

        Raises:
            BadInputError: if the array is of another kind.
        """
        seen = segment_at(rgb, self.metadata.input_size_wh, self._run)
        if self._close_ups is None:
            return seen
        return replace(seen, close_ups=functools.partial(self._close_ups, rgb))

    def _run(self, rgb: Image) -> tuple[Image, Image, Image]:
        labels, confidence, rail_score = self._session.run(
            OUTPUTS, {"image": np.ascontiguousarray(rgb)[None]}
        )
        return cast(Image, labels)[0], cast(Image, confidence)[0], cast(Image, rail_score)[0]


def segment_at(
    rgb: Image, size_wh: tuple[int, int], run: Callable[[Image], tuple[Image, Image, Image]]
) -> Segmentation:
    """Segment an image of any size with a network of one size.

    The image keeps its proportions: it is scaled to fit, and the rest of the network's input, below
    and to the right, repeats its border.

    Args:
        rgb: RGB image, uint8 of shape (H, W, 3), at least 16 × 16.
        size_wh: Width and height the network takes.
        run: Gives labels, confidence and rail score of an image of that size.

    Raises:
        BadInputError: if the array is of another kind.
    """
    _check_image(rgb)
    height, width = rgb.shape[:2]
    if (width, height) == size_wh:
        return Segmentation(*run(rgb))
    wide, high = fitted_wh((width, height), size_wh)
    shrinks = width > wide or height > high
    way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    fitted = rgb
    if (width, height) != (wide, high):
        fitted = cast(Image, cv2.resize(rgb, (wide, high), interpolation=way))
    margin = (0, size_wh[1] - high, 0, size_wh[0] - wide)
    maps = run(cast(Image, cv2.copyMakeBorder(fitted, *margin, cv2.BORDER_REPLICATE)))
    labels, confidence, rail_score = (np.ascontiguousarray(one[:high, :wide]) for one in maps)
    if (width, height) == (wide, high):
        return Segmentation(labels, confidence, rail_score)
    size = (width, height)
    return Segmentation(
        cast(Image, cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST_EXACT)),
        cast(Image, cv2.resize(confidence, size, interpolation=cv2.INTER_LINEAR)),
        cast(Image, cv2.resize(rail_score, size, interpolation=cv2.INTER_LINEAR)),
    )


def fitted_wh(image_wh: tuple[int, int], room_wh: tuple[int, int]) -> tuple[int, int]:
    """Largest width and height in the image's own proportions that fit into the room, pixels.

    A picture of the room's width or height and at most its other side stays as it is: resampling
    by a few per cent would cost a two-pixel rail more than it gains.
    """
    scale = min(room / own for room, own in zip(room_wh, image_wh, strict=True))
    wide, high = (
        max(1, min(room, round(own * scale))) for room, own in zip(room_wh, image_wh, strict=True)
    )
    return wide, high


@dataclass(frozen=True)
class Verification:
    """Whether a bundle gives on this machine what it gave where it was made.

    Attributes:
        identical: All golden outputs equal, byte for byte.
        agreement: Share of golden labels that are equal.
        passed: ``agreement`` is at least 0.999.
        frame_s: Median time of one frame at the bundle's size, seconds.
    """

    identical: bool
    agreement: float
    passed: bool
    frame_s: float


def verify(segmenter: Segmenter, repeats: int = 10) -> Verification:
    """Run a bundle's golden input on this machine and compare.

    Args:
        segmenter: The loaded bundle.
        repeats: Timed runs.
    """
    metadata = segmenter.metadata
    image = golden_image(metadata.input_size_wh)
    result = segmenter(image)
    identical = all(
        digest(getattr(result, name)) == metadata.golden_sha256.get(name) for name in OUTPUTS
    )
    golden = unpack_labels(metadata.golden_labels, metadata.input_size_wh)
    agreement = float(np.mean(result.labels == golden))
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        segmenter(image)
        times.append(time.perf_counter() - began)
    return Verification(
        identical, agreement, agreement >= MIN_AGREEMENT, float(np.median(times or [np.nan]))
    )


def _check_image(rgb: Any) -> None:
    if not isinstance(rgb, np.ndarray):
        raise BadInputError(f"an image must be a NumPy array, got {type(rgb).__name__}")
    if rgb.dtype != np.uint8:
        raise BadInputError(
            f"an image must hold 8-bit values, got {rgb.dtype}; scale it to 0…255 first, by what "
            "its full range is"
        )
    if rgb.ndim != 3 or rgb.shape[2] != 3:
        raise BadInputError(
            f"an image must be RGB of shape (H, W, 3), got {rgb.shape}; repeat a grey channel "
            "three times, drop an alpha channel"
        )
    height, width = rgb.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        raise BadInputError(
            f"an image must be at least {MIN_SIDE_PX}×{MIN_SIDE_PX} pixels, got {width}×{height}"
        )


def _check_signature(
    session: onnxruntime.InferenceSession, metadata: BundleMetadata, name: str
) -> None:
    width, height = metadata.input_size_wh
    expected = {"image": [height, width, 3], **{output: [height, width] for output in OUTPUTS}}
    found = {}
    for port in (*session.get_inputs(), *session.get_outputs()):
        if port.type != "tensor(uint8)":
            raise BundleError(f"{name}: {port.name} is {port.type}, expected tensor(uint8)")
        found[port.name] = list(port.shape[1:])
    if found != expected or len(session.get_inputs()) != 1:
        raise BundleError(
            f"{name} disagrees with its metadata: it takes and gives {found}, expected {expected}; "
            "export the checkpoint again"
        )
