"""Cut-outs: pictures of things with a matte, a metric height and a class; reading the user's."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.images import check_size, header_size_wh
from railinspect.labels import CAR, CLASSES, CONSTRUCTION, HUMAN

Image = npt.NDArray[np.uint8]
CutoutType = Literal["obstruction", "trespasser"]

HEIGHTS_FILE: Final = "heights.csv"
"""Optional table in a cut-out folder: columns file, height_m, type, class."""

MAX_HEIGHT_M: Final = 10.0
_OPAQUE: Final = 128
_NAME_HEIGHT: Final = re.compile(r"(?:^|[_\-])(\d+(?:\.\d+)?)m(?=[_\-]|$)", re.IGNORECASE)
_PEOPLE: Final = ("person", "people", "human", "man", "woman", "child", "worker", "trespasser")


@dataclass(frozen=True)
class Cutout:
    """One thing, cut out along its outline; its lowest opaque row stands on the ground.

    Attributes:
        name: What it is, e.g. ``stone`` or a file's name.
        type: Which anomaly it makes.
        rgba: Colour and matte, uint8, shape (H, W, 4), not premultiplied.
        height_m: Height from the lowest to the highest opaque row, metres.
        label: Class id its pixels get in the mask.
    """

    name: str
    type: CutoutType
    rgba: Image
    height_m: float
    label: int

    def __post_init__(self) -> None:
        if self.rgba.ndim != 3 or self.rgba.shape[2:] != (4,) or self.rgba.dtype != np.uint8:
            raise BadInputError(
                f"cut-out {self.name} has no alpha channel: it is {self.rgba.dtype} of shape "
                f"{self.rgba.shape}, expected 8-bit RGBA; save it as a PNG with transparency"
            )
        if not (math.isfinite(self.height_m) and 0 < self.height_m <= MAX_HEIGHT_M):
            raise BadInputError(
                f"cut-out {self.name} is {self.height_m} m high; give a height above 0 and up to "
                f"{MAX_HEIGHT_M:.0f} m"
            )
        if not 0 <= self.label < len(CLASSES):
            raise BadInputError(
                f"cut-out {self.name} has class id {self.label}; allowed are 0…{len(CLASSES) - 1}"
            )
        if not (self.rgba[..., 3] >= _OPAQUE).any():
            raise BadInputError(
                f"cut-out {self.name} is transparent everywhere, so it has no height; check its "
                "alpha channel"
            )

    def mirrored(self) -> Cutout:
        """The same thing seen in a mirror."""
        flipped = np.ascontiguousarray(self.rgba[:, ::-1])
        return Cutout(self.name, self.type, flipped, self.height_m, self.label)


def trimmed(
    name: str, kind: CutoutType, rgba: Image, height_m: float, label: int, margin_px: int = 2
) -> Cutout:
    """A cut-out without the empty border around it; a thin transparent margin stays."""
    whole = Cutout(name, kind, rgba, height_m, label)
    rows, cols = np.nonzero(whole.rgba[..., 3] >= _OPAQUE)
    part = whole.rgba[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    edge = ((margin_px, margin_px), (margin_px, margin_px), (0, 0))
    padded = np.pad(part, edge, mode="edge")
    hull = np.zeros(padded.shape[:2], bool)
    hull[margin_px:-margin_px, margin_px:-margin_px] = True
    padded[..., 3][~hull] = 0
    return Cutout(name, kind, padded, height_m, label)


def read_cutouts(folder: Path) -> tuple[Cutout, ...]:
    """Read a folder of the user's own cut-outs: PNG files with transparency.

    The height comes from ``heights.csv`` (columns ``file``, ``height_m`` and, if wanted, ``type``
    and ``class``) or from the file's name, as in ``worker_1.82m.png``. What has no type there is a
    trespasser if its name or class says person, else an obstruction.

    Returns:
        The cut-outs in order of file name.

    Raises:
        BadInputError: if the folder holds no usable cut-out, or one of them has no alpha channel,
            no opaque pixel, no height or a height that is none.
    """
    if not folder.is_dir():
        raise BadInputError(f"there is no folder of cut-outs at {folder}; check the path")
    table = _read_table(folder / HEIGHTS_FILE)
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() == ".png" and p.is_file())
    if not files:
        raise BadInputError(
            f"no PNG file lies in {folder}; cut-outs are PNG files with transparency"
        )
    if missing := sorted(set(table) - {p.name for p in files}):
        raise BadInputError(f"{folder / HEIGHTS_FILE} names {missing[0]}, which is not there")
    return tuple(_read_one(path, table.get(path.name, {})) for path in files)


def _read_one(path: Path, row: dict[str, str]) -> Cutout:
    text = row.get("height_m", "")
    if not text:
        found = _NAME_HEIGHT.search(path.stem)
        if found is None:
            raise BadInputError(
                f"cut-out {path} has no height; name it like {path.stem}_1.80m.png or list it in "
                f"{HEIGHTS_FILE}"
            )
        text = found.group(1)
    try:
        height = float(text)
    except ValueError as error:
        raise BadInputError(
            f"the height of cut-out {path} is {text!r}; give a number of metres"
        ) from error
    words = set(re.split(r"[^a-z]+", path.stem.lower()))
    named = row.get("class", "")
    if named and named not in CLASSES:
        raise BadInputError(
            f"cut-out {path} has class {named!r}; RailSem19's are {', '.join(CLASSES)}"
        )
    kind = row.get("type", "")
    if kind not in ("", "obstruction", "trespasser"):
        raise BadInputError(f"cut-out {path} has type {kind!r}; expected obstruction or trespasser")
    if not kind:
        human = named == CLASSES[HUMAN] or (not named and words & set(_PEOPLE))
        kind = "trespasser" if human else "obstruction"
    default = HUMAN if kind == "trespasser" else CAR if "car" in words else CONSTRUCTION
    label = CLASSES.index(named) if named else default
    return trimmed(path.stem, cast(CutoutType, kind), _read_rgba(path), height, label)


def _read_rgba(path: Path) -> Image:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read cut-out {path}: {error.strerror or error}") from error
    size = header_size_wh(data)
    if size is None:
        raise BadInputError(f"cut-out {path} is not a PNG image; check that it is not another file")
    if min(size) >= 32:
        check_size(size, f"cut-out {path}")
    elif max(size) > 10_000:
        raise BadInputError(f"cut-out {path} claims {size[0]}×{size[1]} pixels; scale it down")
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        log.setLogLevel(level)
    if image is None:
        raise BadInputError(f"cut-out {path} is damaged and cannot be decoded; copy it again")
    if image.ndim != 3 or image.shape[2] != 4:
        raise BadInputError(
            f"cut-out {path} has no alpha channel; save it as a PNG with transparency"
        )
    if image.dtype == np.uint16:
        image = np.right_shift(np.asarray(image, np.uint16), 8).astype(np.uint8)
    if image.dtype != np.uint8:
        raise BadInputError(f"cut-out {path} stores {image.dtype}; save it with 8 bits per channel")
    return cast(Image, cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA))


def _read_table(path: Path) -> dict[str, dict[str, str]]:
    if not path.is_file():
        return {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(f"cannot read {path}: {error}") from error
    table = {}
    for number, row in enumerate(rows, 2):
        name = (row.get("file") or "").strip()
        if not name:
            raise BadInputError(
                f"{path}, line {number}, names no file; its columns are file, height_m, type, class"
            )
        table[name] = {k: (v or "").strip() for k, v in row.items() if isinstance(k, str)}
    return table
