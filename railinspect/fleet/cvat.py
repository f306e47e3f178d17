"""CVAT for images 1.1: class masks of pictures as XML, and corrected ones back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element
from xml.sax.saxutils import quoteattr

import numpy as np

from railinspect.errors import BadInputError
from railinspect.fleet.coco import Labelled
from railinspect.fleet.masks import (
    LABELS,
    MAX_POINTS,
    Mask,
    classes_in,
    from_run_lengths,
    numbers,
    paint_polygon,
    run_lengths,
)
from railinspect.images import check_size
from railinspect.labels import CLASSES, PALETTE, VOID
from railinspect.xml_elements import read_elements

MAX_SHAPES: Final = 20_000
"""Most shapes on one picture."""

_IGNORED: Final = ("tag", "attribute")


def write_cvat(path: Path, pictures: Iterable[Labelled]) -> int:
    """Write an annotation file for CVAT to load; returns the number of pictures.

    One ``mask`` per class and picture: run lengths along the rows of the box around it.
    """
    count = 0
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write('<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n')
        file.write("  <version>1.1</version>\n  <meta><task><labels>\n")
        for name, colour in zip(CLASSES, PALETTE.tolist(), strict=True):
            hex_ = "#{:02x}{:02x}{:02x}".format(*colour)
            file.write(f"    <label><name>{name}</name><color>{hex_}</color></label>\n")
        file.write("  </labels></task></meta>\n")
        for one in pictures:
            height, width = one.mask.shape
            file.write(
                f'  <image id="{count}" name={quoteattr(one.file_name)} width="{width}" '
                f'height="{height}">\n'
            )
            count += 1
            for which in classes_in(one.mask):
                file.write(f"    {_mask_element(one.mask == which, CLASSES[which])}\n")
            file.write("  </image>\n")
        file.write("</annotations>\n")
    return count


def _mask_element(bits: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], name: str) -> str:
    rows, columns = np.flatnonzero(bits.any(axis=1)), np.flatnonzero(bits.any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    box = bits[top : rows[-1] + 1, left : columns[-1] + 1]
    return (
        f'<mask label="{name}" source="auto" occluded="0" '
        f'rle="{", ".join(map(str, run_lengths(box)))}" left="{left}" top="{top}" '
        f'width="{box.shape[1]}" height="{box.shape[0]}" z_order="0"></mask>'
    )


def read_cvat(path: Path) -> Iterator[Labelled]:
    """Masks of a file exported as "CVAT for images 1.1", one picture at a time.

    Polygons, boxes and masks count, in the order of their z_order and of the file; what none
    covers is void.

    Raises:
        BadInputError: if the file is no such XML, declares a document type, or names a class that
            is none of RailSem19's; by each picture, if its shapes do not fit it.
    """
    kind = "a file of CVAT for images 1.1"
    for image in read_elements(path, "annotations", ("image",), str(path), kind):
        name = image.get("name", "")
        where = f"{path}, picture {name[:200]!r}"
        try:
            width, height = int(image.attrib["width"]), int(image.attrib["height"])
        except (KeyError, ValueError) as error:
            raise BadInputError(f"{where} has no width and height; export it again") from error
        check_size((width, height), where)
        shapes = [shape for shape in image if shape.tag not in _IGNORED]
        if len(shapes) > MAX_SHAPES:
            raise BadInputError(f"{where} has {len(shapes)} shapes; expected at most {MAX_SHAPES}")
        mask = np.full((height, width), VOID, np.uint8)
        try:
            for shape in sorted(shapes, key=lambda one: int(one.get("z_order", "0"))):
                _paint(mask, shape, where)
        except BadInputError:
            raise
        except (KeyError, ValueError, OverflowError) as error:
            raise BadInputError(f"{where}: a shape holds {error}") from error
        yield Labelled(name, mask)


def _paint(mask: Mask, shape: Element, where: str) -> None:
    """Put one shape on the mask.

    Raises:
        BadInputError: if its label or its kind is none that can be painted.
        KeyError, ValueError: if it is damaged.
    """
    label = shape.attrib["label"]
    if label not in LABELS:
        raise BadInputError(
            f"{where}: label {label[:80]!r} is none of RailSem19's classes; rename it, or delete "
            "what it marks"
        )
    value = LABELS[label]
    if shape.tag == "polygon":
        points = shape.attrib["points"]
        if points.count(";") >= MAX_POINTS:
            raise ValueError(f"a polygon of more than {MAX_POINTS} points")
        pairs = [numbers(point, 2) for point in points.split(";")]
        paint_polygon(mask, np.array(pairs), value)
    elif shape.tag == "box":
        left, top, right, bottom = (float(shape.attrib[s]) for s in ("xtl", "ytl", "xbr", "ybr"))
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        paint_polygon(mask, corners, value)
    elif shape.tag == "mask":
        left_px, top_px, wide, high = (
            int(float(shape.attrib[side])) for side in ("left", "top", "width", "height")
        )
        inside = 0 <= left_px <= left_px + wide <= mask.shape[1]
        if not (inside and 0 <= top_px <= top_px + high <= mask.shape[0]):
            raise ValueError("a mask that lies outside the picture")
        lengths = numbers(shape.attrib["rle"]).astype(np.int64).tolist()
        bits = from_run_lengths(lengths, wide * high).reshape(high, wide)
        mask[top_px : top_px + high, left_px : left_px + wide][bits] = value
    else:
        raise BadInputError(
            f"{where}: a {shape.tag[:40]} is no area; draw polygons, boxes or masks"
        )
