"""The manifest of a set of images with known anomalies: one JSON object per image and line.

``manifest.jsonl`` lies in the data set's folder. It is the only thing the generator and whoever
judges an inspector on its pictures have in common.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Final, Literal, get_args

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError

MANIFEST: Final = "manifest.jsonl"
"""Name of the file in the data set's folder."""

AnomalyType = Literal["none", "distortion", "obstruction", "trespasser"]
ANOMALY_TYPES: Final[tuple[str, ...]] = get_args(AnomalyType)

Box = tuple[float, float, float, float]
Point = tuple[float, float]


@dataclass(frozen=True)
class ManifestEntry:
    """What is known about one image of the set.

    Attributes:
        image: Image file, relative to the data set's folder, with ``/``.
        mask: Mask file of RailSem19 class ids, relative likewise.
        base: The picture it was made from: a file name, or ``world`` and the world's seed.
        seed: Seed of everything that was drawn for this image.
        type: ``none`` for an original, else the anomaly's type.
        kind: What it is, e.g. ``ripple``, ``buckle``, ``break``, ``gap``, ``stone``, ``person``;
            empty for an original.
        polygon_uv: Outline of the anomaly, pixels; empty for an original.
        box_xyxy: Its box, pixels: left, top, right, bottom; None for an original.
        range_m: True distance along the track from the camera to its near end, metres; None where
            no camera is known.
        lateral_m: Position of its middle against the track's centre line, metres, positive left.
        height_m: Its height; for a distortion the largest lateral displacement; for a break or a
            gap the missing length, metres. None for an original.
        label: Class id the object has in the mask; None for an original or a distortion.
        blend: Settings of the blending or of the distortion, by name.
        camera: The camera, where it is known.
    """

    image: str
    mask: str
    base: str
    seed: int
    type: AnomalyType
    kind: str = ""
    polygon_uv: tuple[Point, ...] = ()
    box_xyxy: Box | None = None
    range_m: float | None = None
    lateral_m: float | None = None
    height_m: float | None = None
    label: int | None = None
    blend: Mapping[str, Any] = field(default_factory=dict)
    camera: Camera | None = None

    def as_json(self) -> dict[str, Any]:
        """The entry as its line's JSON object."""
        data = asdict(self)
        data["blend"] = dict(self.blend)
        return data


def write_manifest(folder: Path, entries: Iterable[ManifestEntry]) -> Path:
    """Write the manifest of a data set; returns its path."""
    path = folder / MANIFEST
    lines = (json.dumps(entry.as_json(), allow_nan=False) + "\n" for entry in entries)
    path.write_text("".join(lines), encoding="utf-8")
    return path


def read_manifest(folder: Path) -> tuple[ManifestEntry, ...]:
    """Read the manifest of a data set.

    Args:
        folder: The data set's folder.

    Returns:
        The entries in the order of the file.

    Raises:
        BadInputError: if the file is missing or empty, or a line is not an entry; the sentence
            names the line and the value.
    """
    path = folder / MANIFEST
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(
            f"cannot read the manifest {path}: {error}; give the folder of a data set made by "
            "'railinspect anomalies build'"
        ) from error
    entries = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            entries.append(_entry(json.loads(line)))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            reason = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)
            raise BadInputError(
                f"{path}, line {number}, is not a manifest entry: {reason}; build the set again"
            ) from error
    if not entries:
        raise BadInputError(f"the manifest {path} lists no image; build the set again")
    return tuple(entries)


def _entry(data: Any) -> ManifestEntry:
    if not isinstance(data, dict):
        raise TypeError(f"a JSON object is expected, got {type(data).__name__}")
    kind = data["type"]
    if kind not in ANOMALY_TYPES:
        raise ValueError(f"type is {kind!r}; expected one of {', '.join(ANOMALY_TYPES)}")
    polygon = tuple((_number(u), _number(v)) for u, v in data.get("polygon_uv", ()))
    box = data.get("box_xyxy")
    if kind != "none" and (box is None or len(polygon) < 3):
        raise ValueError(f"a {kind} needs box_xyxy and a polygon_uv of three points or more")
    if box is not None and len(box) != 4:
        raise ValueError(f"box_xyxy has {len(box)} numbers; expected left, top, right, bottom")
    label = data.get("label")
    return ManifestEntry(
        image=_relative(data["image"]),
        mask=_relative(data["mask"]),
        base=str(data["base"]),
        seed=int(data["seed"]),
        type=kind,
        kind=str(data.get("kind", "")),
        polygon_uv=polygon,
        box_xyxy=None if box is None else (*map(_number, box),),  # type: ignore[arg-type]  # four, checked
        range_m=_optional(data.get("range_m")),
        lateral_m=_optional(data.get("lateral_m")),
        height_m=_optional(data.get("height_m")),
        label=None if label is None else int(label),
        blend=dict(data.get("blend", {})),
        camera=_camera(data.get("camera")),
    )


def _relative(name: Any) -> str:
    """A file name that stays inside the data set's folder."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in str(name) or not path.name:
        raise ValueError(f"file name {name!r} leaves the data set's folder")
    return str(path)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a finite number")
    return float(value)


def _optional(value: Any) -> float | None:
    return None if value is None else _number(value)


def _camera(data: Any) -> Camera | None:
    if data is None:
        return None
    values = dict(data)
    values["std"] = CameraStd(**values.get("std", {}))
    for name in ("size_wh", "principal_uv", "distortion"):
        if name in values:
            values[name] = tuple(values[name])
    return Camera(**values)
