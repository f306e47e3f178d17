"""Class masks as the run lengths and polygons in which labelling tools keep them, and back.

Everything that comes from a file is checked against the size of its picture before anything is
allocated for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.labels import CLASSES, VOID

Mask = npt.NDArray[np.uint8]
Bits = npt.NDArray[np.bool_]

LABELS: Final[dict[str, int]] = {**{name: i for i, name in enumerate(CLASSES)}, "void": VOID}
"""Mask value of each label a corrected file may use."""

MAX_POINTS: Final = 100_000
"""Most points of one polygon."""

FAR_PX: Final = 100_000.0
"""Coordinates beyond this are no drawing on a picture."""

_SHIFT: Final = 4


def run_lengths(bits: Bits) -> list[int]:
    """Lengths of the runs of a flat array of bits, alternating, the first one of zeros.

    Example:
        >>> run_lengths(np.array([1, 1, 0, 1], bool)), run_lengths(np.zeros(3, bool))
        ([0, 2, 1, 1], [3])
    """
    flat = np.concatenate([[False], bits.ravel()])
    ends = np.flatnonzero(flat[1:] != flat[:-1])
    return [int(b - a) for a, b in pairwise([0, *ends.tolist(), bits.size])]


def from_run_lengths(lengths: Sequence[int], size: int) -> Bits:
    """The flat array of bits of such lengths.

    Args:
        lengths: The runs; what they do not reach is zero.
        size: Number of bits.

    Raises:
        ValueError: if a length is negative or they reach beyond the size.
    """
    runs = np.array(lengths, np.int64)
    if runs.ndim != 1 or (runs < 0).any() or (runs > size).any() or int(runs.sum()) > size:
        raise ValueError(f"run lengths that do not fit {size} pixels")
    values = np.repeat(np.arange(runs.size) % 2 == 1, runs)
    return np.concatenate([values, np.zeros(size - values.size, bool)])


def pack(lengths: Sequence[int]) -> str:
    """Run lengths as the text COCO's tools write: differences in base 32, signed, from ASCII 48.

    Example:
        >>> pack([5, 3, 40, 2]), unpack(pack([5, 3, 40, 2]), 50)
        ('53X1O', [5, 3, 40, 2])
    """
    text = []
    for index, length in enumerate(lengths):
        rest = length - lengths[index - 2] if index > 2 else length
        more = True
        while more:
            digit = rest & 31
            rest >>= 5
            more = rest != -1 if digit & 16 else rest != 0
            text.append(chr(48 + (digit | 32 if more else digit)))
    return "".join(text)


def unpack(text: str, size: int) -> list[int]:
    """Undo :func:`pack`.

    Raises:
        ValueError: if the text is none, or holds more or longer runs than ``size`` pixels can have.
    """
    lengths: list[int] = []
    value, place = 0, 0
    for character in text:
        digit = ord(character) - 48
        if not 0 <= digit < 64 or place > 7 or len(lengths) > size:
            raise ValueError("run lengths that are not packed as COCO packs them")
        value |= (digit & 31) << (5 * place)
        place += 1
        if not digit & 32:
            if digit & 16:
                value -= 1 << (5 * place)
            lengths.append(value + (lengths[-2] if len(lengths) > 2 else 0))
            value, place = 0, 0
    if place:
        raise ValueError("run lengths that break off")
    return lengths


def paint_polygon(mask: Mask, points_uv: npt.NDArray[np.float64], value: int) -> None:
    """Fill a polygon.

    Args:
        mask: Class ids, shape (H, W), changed in place.
        points_uv: Corners, pixels, shape (N, 2); (0, 0) is the top-left corner of the top-left
            pixel, as labelling tools count.
        value: The class id.

    Raises:
        ValueError: if there are fewer than three or too many points, or they are no pixels.
    """
    if points_uv.ndim != 2 or points_uv.shape[1] != 2 or not 3 <= len(points_uv) <= MAX_POINTS:
        raise ValueError(f"a polygon of shape {points_uv.shape}; expected 3 to {MAX_POINTS} points")
    if not (np.abs(points_uv) <= FAR_PX).all():
        raise ValueError("a polygon whose coordinates are no pixels")
    fixed = np.round((points_uv - 0.5) * (1 << _SHIFT)).astype(np.int32)
    cv2.fillPoly(mask, [fixed], value, cv2.LINE_8, _SHIFT)


def classes_in(labels: Mask) -> list[int]:
    """Class ids that occur in a mask, rising; void is no class."""
    return [int(one) for one in np.unique(labels) if one < len(CLASSES)]


def numbers(text: str, count: int | None = None) -> npt.NDArray[np.float64]:
    """Numbers separated by commas.

    Raises:
        ValueError: if one is none, or there are not as many as there should be.
    """
    values = np.array(text.split(","), dtype=object).astype(float)
    if count is not None and values.size != count:
        raise ValueError(f"{values.size} numbers where {count} were expected")
    return cast(npt.NDArray[np.float64], values)
