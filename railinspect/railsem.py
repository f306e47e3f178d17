"""Images and class masks in RailSem19's folder layout.

The archive's layout is ``rs19_val/{jpgs,uint8}/rs19_val/rs00000.{jpg,png}``; the innermost folder
is optional here, so sets may also lie in ``DIR/jpgs/*.jpg`` and ``DIR/uint8/*.png``. Masks are
8-bit class ids 0 … 18, and 255 for void.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, VOID

Image = npt.NDArray[np.uint8]

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
        BadInputError: if a folder is missing or empty, or an image has no mask.
    """
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
