"""The pictures of a data set with their truth: what was put where, and the camera if known.

Two kinds of folder are read: one made by ``railinspect anomalies build``, whose manifest names
the anomaly of each picture, and any folder in RailSem19's layout whose notes name them, as
``railinspect scenes images`` writes them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.anomalies.manifest import MANIFEST, ManifestEntry, read_manifest
from railinspect.boxes import Box
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.evaluation.answers import TYPES
from railinspect.images import IMAGE_SUFFIXES, read_image
from railinspect.scenes.dataset import IMAGES, MASKS, NOTES


@dataclass(frozen=True)
class Anomaly:
    """What a picture shows that it should not.

    Attributes:
        type: "distortion", "obstruction" or "trespasser".
        box_xyxy: Where, input pixels.
        range_m: Distance along the track, metres; None if not known.
    """

    type: str
    box_xyxy: Box
    range_m: float | None


@dataclass(frozen=True)
class Sample:
    """One picture of a data set.

    Attributes:
        name: Short name, unique in its set.
        image: The picture's file.
        mask: Its true class mask; None if the set has none.
        anomaly: What is wrong in it; None for a clear track.
        camera: Its camera; None if not known.
    """

    name: str
    image: Path
    mask: Path | None
    anomaly: Anomaly | None
    camera: Camera | None = None

    def rgb(self) -> npt.NDArray[np.uint8]:
        """The picture, uint8 (H, W, 3)."""
        return read_image(self.image)

    def labels(self) -> npt.NDArray[np.uint8]:
        """The true class ids, uint8 (H, W).

        Raises:
            BadInputError: if the set holds no mask for the picture, or none that can be read.
        """
        if self.mask is None:
            raise BadInputError(
                f"{self.image} has no class mask; judge it with a bundle instead of --truth"
            )
        labels = cv2.imread(str(self.mask), cv2.IMREAD_GRAYSCALE)
        if labels is None:
            raise BadInputError(f"class mask {self.mask} cannot be read; build the set again")
        return np.asarray(labels, np.uint8)


def read_samples(folder: Path) -> list[Sample]:
    """All pictures of a data set, by name.

    Args:
        folder: Root of the set.

    Raises:
        BadInputError: if the folder holds no such set or a picture's truth is incomplete.
    """
    if not folder.is_dir():
        raise BadInputError(f"data set {folder} is not a folder")
    if (folder / MANIFEST).exists():
        return [_listed(folder, entry) for entry in read_manifest(folder)]
    images = sorted(p for p in (folder / IMAGES).glob("*") if p.suffix.lower() in IMAGE_SUFFIXES)
    if not images:
        raise BadInputError(
            f"data set {folder} holds no picture in {IMAGES}; make one with railinspect anomalies "
            "build or railinspect scenes images"
        )
    return [_noted(folder, image) for image in images]


def _listed(folder: Path, entry: ManifestEntry) -> Sample:
    """A picture whose truth is in the manifest."""
    anomaly = None
    if entry.type != "none":
        assert entry.box_xyxy is not None  # the manifest's reader sees to that
        anomaly = Anomaly(entry.type, entry.box_xyxy, entry.range_m)
    mask = folder / entry.mask
    image = folder / entry.image
    name = Path(entry.image).stem
    return Sample(name, image, mask if mask.is_file() else None, anomaly, entry.camera)


def _noted(folder: Path, image: Path) -> Sample:
    """A picture whose truth is in its notes."""
    path = folder / NOTES / f"{image.stem}.json"
    mask = folder / MASKS / f"{image.stem}.png"
    try:
        notes = json.loads(path.read_text(encoding="utf-8"))
        size_wh = (int(notes["imgWidth"]), int(notes["imgHeight"]))
        objects = [one for one in notes.get("objects", []) if one.get("anomaly") in TYPES]
        anomalies = [_anomaly(one) for one in objects]
        camera = _camera(notes.get("camera"), size_wh)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInputError(
            f"the notes {path} do not say what {image.name} shows ({error!r}); build the set again"
        ) from error
    nearest = min(anomalies, key=lambda a: a.range_m or math.inf, default=None)
    return Sample(image.stem, image, mask if mask.is_file() else None, nearest, camera)


def _anomaly(entry: Mapping[str, Any]) -> Anomaly:
    left, top, right, bottom = (float(v) for v in entry["boundingbox"])
    range_m = entry.get("range_m")
    box = (left, top, right, bottom)
    return Anomaly(entry["anomaly"], box, None if range_m is None else float(range_m))


def _camera(entry: Mapping[str, Any] | None, size_wh: tuple[int, int]) -> Camera | None:
    """The camera of a picture's notes: centred principal point, as rendered scenes have it."""
    if entry is None:
        return None
    numbers: dict[str, Any] = {name: float(v) for name, v in entry.items() if name != "distortion"}
    numbers["distortion"] = tuple(float(v) for v in entry.get("distortion", (0.0,) * 5))
    centre = ((size_wh[0] - 1) / 2, (size_wh[1] - 1) / 2)
    return Camera(size_wh, principal_uv=centre, **numbers)
