"""Images and class masks in RailSem19's folder layout.

The archive's layout is ``rs19_val/{jpgs,uint8}/rs19_val/rs00000.{jpg,png}``; the innermost folder
is optional here, so sets may also lie in ``DIR/jpgs/*.jpg`` and ``DIR/uint8/*.png``. Masks are
8-bit class ids 0 … 18, and 255 for void. Beside them lie ``jsons/…/rs00000.json`` with the geometry
of each image and ``rs19-config.json`` with the class names in order of their ids.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.annotations import Annotation, Box, RailPair, Shape, rail_pair
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, VOID

Image = npt.NDArray[np.uint8]

_MAX_NOTES_BYTES = 20_000_000
_ALLOWED = np.zeros(256, bool)
_ALLOWED[: len(CLASSES)] = True
_ALLOWED[VOID] = True


@dataclass(frozen=True)
class Pair:
    """One image file and its mask file."""

    image: Path
    mask: Path


def list_pairs(folder: Path) -> tuple[Pair, ...]:
    """Pair every image under ``folder/jpgs`` with its mask under ``folder/uint8``, by name.

    Raises:
        BadInputError: if a folder is missing or empty, an image has no mask, or the set's own
            ``rs19-config.json`` names other classes.
    """
    _check_classes(folder / "rs19-config.json")
    images, masks = folder / "jpgs", folder / "uint8"
    for part in (images, masks):
        if not part.is_dir():
            raise BadInputError(
                f"{folder} is not in RailSem19's layout: there is no folder {part}; expected "
                "DIR/jpgs with images and DIR/uint8 with masks"
            )
    pairs = []
    for image in sorted(images.rglob("*.jpg")):
        mask = (masks / image.relative_to(images)).with_suffix(".png")
        if not mask.is_file():
            raise BadInputError(f"image {image} has no mask; expected it at {mask}")
        pairs.append(Pair(image, mask))
    if not pairs:
        raise BadInputError(f"no *.jpg image lies under {images}; check the path")
    return tuple(pairs)


def read_pair(pair: Pair) -> tuple[Image, Image]:
    """Read one image and its mask.

    Returns:
        RGB image (H, W, 3) and class ids (H, W).

    Raises:
        BadInputError: if a file is missing or damaged, sizes differ, or a mask holds another id.
    """
    image = _decode(pair.image, cv2.IMREAD_COLOR_RGB)
    mask = _decode(pair.mask, cv2.IMREAD_UNCHANGED)
    if mask.ndim != 2 or mask.dtype != np.uint8:
        raise BadInputError(
            f"mask {pair.mask} has shape {mask.shape} and type {mask.dtype}; expected one channel "
            "of 8-bit class ids (the files in RailSem19's uint8 folder)"
        )
    if mask.shape != image.shape[:2]:
        raise BadInputError(
            f"mask {pair.mask} is {mask.shape[1]}×{mask.shape[0]} but its image is "
            f"{image.shape[1]}×{image.shape[0]}; export both at the same size"
        )
    if not _ALLOWED[mask].all():
        wrong = int(mask[~_ALLOWED[mask]][0])
        raise BadInputError(
            f"mask {pair.mask} holds class id {wrong}; allowed are 0…{len(CLASSES) - 1} and {VOID} "
            "for void; convert the mask to RailSem19's ids"
        )
    return image, mask


def read_annotation(pair: Pair) -> Annotation:
    """Read the geometry of one image from the JSON file beside it.

    Raises:
        BadInputError: if the file is missing or not in RailSem19's form.
    """
    folder = next((p for p in pair.image.parents if p.name == "jpgs"), pair.image.parent)
    path = (folder.parent / "jsons" / pair.image.relative_to(folder)).with_suffix(".json")
    return annotation_of(read_notes(path), path)


def annotation_of(notes: dict[str, Any], path: Path) -> Annotation:
    """The geometry in an image's notes.

    Args:
        notes: What :func:`read_notes` read.
        path: The file they came from, for messages.

    Raises:
        BadInputError: if they are not in RailSem19's form or hold numbers that are not finite.
    """
    rails: list[RailPair] = []
    shapes: list[Shape] = []
    boxes: list[Box] = []
    try:
        for number, thing in enumerate(notes["objects"]):
            label = str(thing["label"])
            if "polyline-pair" in thing:
                one, other = (_points(line) for line in thing["polyline-pair"])
                rails.append(rail_pair(one, other, f"{label} {number}"))
            elif "boundingbox" in thing:
                left, top, right, bottom = _finite(thing["boundingbox"])
                boxes.append(Box(label, (float(left), float(top), float(right), float(bottom))))
            elif "polygon" in thing:
                shapes.append(Shape(label, _points(thing["polygon"]), closed=True))
            else:
                shapes.append(Shape(label, _points(thing["polyline"]), closed=False))
        size = (int(notes["imgWidth"]), int(notes["imgHeight"]))
        name = str(notes["frame"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadInputError(
            f"{path} is not in RailSem19's form ({type(error).__name__}: {error}); fetch it again"
        ) from error
    return Annotation(name, size, tuple(rails), tuple(shapes), tuple(boxes))


def read_notes(path: Path) -> dict[str, Any]:
    """The JSON object of an image's notes: its geometry, and whatever else a set adds.

    Raises:
        BadInputError: if the file is missing, larger than 20 MB, or not a JSON object.
    """
    try:
        if path.stat().st_size > _MAX_NOTES_BYTES:
            raise BadInputError(f"{path} is larger than 20 MB; it holds no image's geometry")
        notes = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"cannot read {path}: {error.strerror}; check the data set") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not JSON ({error}); fetch this file again") from error
    if not isinstance(notes, dict):
        raise BadInputError(f"{path} must hold a JSON object; fetch this file again")
    return notes


def _points(values: Any) -> npt.NDArray[np.float64]:
    points = _finite(values)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points of shape {points.shape}, expected (N, 2)")
    return points


def _finite(values: Any) -> npt.NDArray[np.float64]:
    numbers = np.array(values, float)
    if not np.isfinite(numbers).all():
        raise ValueError("numbers that are not finite")
    return numbers


def _check_classes(path: Path) -> None:
    if not path.is_file():
        return
    try:
        names = tuple(str(label["name"]) for label in read_notes(path)["labels"])
    except (KeyError, TypeError) as error:
        raise BadInputError(f"{path} holds no list of labels; fetch this file again") from error
    if names[: len(CLASSES)] != CLASSES:
        wrong = next((n for n, c in zip(names, CLASSES, strict=False) if n != c), "too few")
        raise BadInputError(
            f"{path} orders other classes than RailSem19 ({wrong} first); masks with other ids "
            "must be converted to RailSem19's"
        )


def _decode(path: Path, flags: int) -> Image:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read {path}: {error.strerror}; check the data set") from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    # OpenCV fills the rest of a JPEG that breaks off with grey and reports success.
    broken = path.suffix == ".jpg" and not data.rstrip(b"\0").endswith(b"\xff\xd9")
    if image is None or broken:
        raise BadInputError(f"{path} is damaged or not an image; fetch this file again")
    return cast(Image, image)
