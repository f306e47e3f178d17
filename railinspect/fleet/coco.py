"""COCO: class masks of pictures as annotations with run lengths, and corrected ones back."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from railinspect.errors import BadInputError
from railinspect.fleet.masks import (
    LABELS,
    Mask,
    classes_in,
    from_run_lengths,
    pack,
    paint_polygon,
    run_lengths,
    unpack,
)
from railinspect.images import check_size
from railinspect.labels import CLASSES, VOID

MAX_BYTES: Final = 64 << 20
"""Larger COCO files are refused: they are held in memory as a whole."""


@dataclass(frozen=True)
class Labelled:
    """A picture and its mask.

    Attributes:
        file_name: Name of the picture's file.
        mask: Class ids, shape (H, W); 255 where nothing is labelled.
    """

    file_name: str
    mask: Mask


def write_coco(path: Path, pictures: Iterable[Labelled]) -> int:
    """Write a COCO file; category ids are class ids plus one. Returns the number of pictures.

    One mask per class and picture, as packed run lengths down the columns (``iscrowd`` 1).
    """
    images: list[dict[str, Any]] = []
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write('{"annotations":[\n')
        number = 0
        for one in pictures:
            height, width = one.mask.shape
            images.append(
                {
                    "id": len(images) + 1,
                    "file_name": one.file_name,
                    "width": width,
                    "height": height,
                }
            )
            for which in classes_in(one.mask):
                bits = one.mask == which
                rows, columns = np.flatnonzero(bits.any(axis=1)), np.flatnonzero(bits.any(axis=0))
                number += 1
                annotation = {
                    "id": number,
                    "image_id": len(images),
                    "category_id": which + 1,
                    "iscrowd": 1,
                    "area": int(bits.sum()),
                    "bbox": [
                        int(columns[0]),
                        int(rows[0]),
                        int(columns[-1] - columns[0] + 1),
                        int(rows[-1] - rows[0] + 1),
                    ],
                    "segmentation": {"size": [height, width], "counts": pack(run_lengths(bits.T))},
                }
                file.write(("" if number == 1 else ",\n") + json.dumps(annotation))
        categories = [{"id": i + 1, "name": name} for i, name in enumerate(CLASSES)]
        file.write(
            f'\n],"images":{json.dumps(images, ensure_ascii=False)},'
            f'"categories":{json.dumps(categories)}}}\n'
        )
    return len(images)


def read_coco(path: Path) -> Iterator[Labelled]:
    """Masks of a COCO file, one at a time: polygons and run lengths, packed or not.

    Later annotations of a picture cover earlier ones; what none covers is void.

    Raises:
        BadInputError: if the file is larger than 64 MiB, is no COCO file, or names a class that
            is none of RailSem19's; by each picture, if its annotations do not fit it.
    """
    document = _document(path)
    try:
        values = {one["id"]: LABELS.get(str(one["name"])) for one in document["categories"]}
        names = {one["id"]: str(one["name"]) for one in document["categories"]}
        by_image: dict[Any, list[Any]] = {}
        for annotation in document["annotations"]:
            by_image.setdefault(annotation["image_id"], []).append(annotation)
        images = [
            (one["id"], str(one["file_name"]), int(one["width"]), int(one["height"]))
            for one in document["images"]
        ]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadInputError(
            f"{path} is no COCO file ({type(error).__name__}: {error}); export it as COCO again"
        ) from error
    for image_id, name, width, height in images:
        where = f"{path}, picture {name[:200]!r}"
        check_size((width, height), where)
        mask = np.full((height, width), VOID, np.uint8)
        for annotation in by_image.get(image_id, []):
            try:
                value = values[annotation["category_id"]]
                if value is None:
                    raise BadInputError(
                        f"{where}: label {names[annotation['category_id']][:80]!r} is none of "
                        "RailSem19's classes; rename it, or delete what it marks"
                    )
                _paint(mask, annotation["segmentation"], value)
            except BadInputError:
                raise
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                raise BadInputError(f"{where}: an annotation holds {error}") from error
        yield Labelled(name, mask)


def _document(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInputError(f"{path} is larger than 64 MiB; export fewer pictures at a time")
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise BadInputError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not JSON ({error}); export it again") from error
    if not isinstance(document, dict):
        raise BadInputError(f"{path} is no COCO file; it must hold a JSON object")
    return document


def _paint(mask: Mask, segmentation: Any, value: int) -> None:
    """Put one annotation on the mask.

    Raises:
        KeyError, TypeError, ValueError, OverflowError: if it is none.
    """
    if isinstance(segmentation, list):
        for polygon in segmentation:
            points = np.array(polygon, float).reshape(-1, 2)
            paint_polygon(mask, points, value)
        return
    height, width = mask.shape
    if [int(one) for one in segmentation["size"]] != [height, width]:
        raise ValueError(f"a mask of size {segmentation['size']}, the picture's is [h, w]")
    counts = segmentation["counts"]
    lengths = unpack(counts, mask.size) if isinstance(counts, str) else counts
    bits = from_run_lengths(lengths, mask.size).reshape(width, height).T
    mask[bits] = value
