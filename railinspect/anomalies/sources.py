"""Pictures of clear tracks: from the rendered world, or a folder in RailSem19's layout."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.annotations import RailPair
from railinspect.anomalies.ego import (
    EgoTrack,
    NoTrackError,
    is_embedded,
    track_of_mask,
    track_of_rails,
    track_of_world,
)
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.images import read_image
from railinspect.labels import RAIL_RAISED, RAIL_TRACK, VOID
from railinspect.railsem import Pair, annotation_of, read_notes, read_pair
from railinspect.scenes import SceneSettings
from railinspect.scenes.render import view
from railinspect.scenes.world import begin, finish

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Base:
    """A picture of a clear track with its mask and its track."""

    name: str
    rgb: Image
    labels: Image
    track: EgoTrack


class Source(Protocol):
    """Numbered pictures of clear tracks."""

    @property
    def count(self) -> int | None:
        """How many there are; None for as many as are asked for."""

    def base(self, index: int) -> Base:
        """Picture ``index``; raises BadInputError (mostly NoTrackError) if it cannot be used."""


@dataclass(frozen=True)
class WorldSource:
    """Rendered pictures: number i is the world of seed ``first_seed + i``, without anomalies.

    Attributes:
        first_seed: Seed of the first world.
        settings: Size, camera, weather and surroundings.
    """

    first_seed: int
    settings: SceneSettings = field(default_factory=SceneSettings)

    @property
    def count(self) -> int | None:
        """None: there is always another world."""
        return None

    def base(self, index: int) -> Base:
        """Render a world without anomalies on the ego track.

        Raises:
            NoTrackError: if the picture shows too little of a track.
        """
        seed = self.first_seed + index
        draft, alignment, camera = begin(seed, self.settings)
        if draft.kind == "none":
            raise NoTrackError(f"world {seed} has no track")
        world = finish(draft, seed, alignment, camera)
        picture = view(world, np.random.default_rng([seed, 0xF17E]))
        return Base(f"world {seed}", picture.rgb, picture.labels, track_of_world(world, picture))


@dataclass(frozen=True)
class FolderSource:
    """Pictures in ``jpgs`` with masks in ``uint8``, polylines in ``jsons``, or both.

    The ego rails come from the polylines where there are some, else they are followed in the mask.
    A picture without a mask gets one drawn from its polylines.

    Attributes:
        folder: The folder.
        camera: The camera of all pictures, if it is known; else a picture's own notes may state it.
    """

    folder: Path
    camera: Camera | None = None

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """The pictures, by name.

        Raises:
            BadInputError: if there are none.
        """
        images = self.folder / "jpgs"
        if not images.is_dir():
            raise BadInputError(
                f"{self.folder} is not in RailSem19's layout: there is no folder {images}; "
                "expected jpgs with pictures and uint8 with masks or jsons with polylines"
            )
        found = sorted(p for p in images.rglob("*") if p.suffix.lower() in _SUFFIXES)
        if not found:
            raise BadInputError(f"no picture (.jpg, .png) lies under {images}; check the path")
        return tuple(found)

    @property
    def count(self) -> int | None:
        """Number of pictures."""
        return len(self.files)

    def base(self, index: int) -> Base:
        """Read a picture, its mask and its rails.

        Raises:
            BadInputError: if a file is damaged or there is neither mask nor polylines.
            NoTrackError: if no track is found.
        """
        path = self.files[index]
        inner = path.relative_to(self.folder / "jpgs")
        mask = (self.folder / "uint8" / inner).with_suffix(".png")
        notes_path = (self.folder / "jsons" / inner).with_suffix(".json")
        notes = read_notes(notes_path) if notes_path.is_file() else {}
        if mask.is_file():
            rgb, labels = read_pair(Pair(path, mask))
        elif notes:
            rgb, labels = read_image(path), None
        else:
            raise BadInputError(
                f"picture {path} has neither a mask ({mask}) nor polylines ({notes_path})"
            )
        height, width = rgb.shape[:2]
        pairs = annotation_of(notes, notes_path).rails if notes else ()
        rails = ego_rails(pairs, (width, height))
        camera = self.camera or camera_of_notes(notes, (width, height))
        name = inner.as_posix()
        if rails is None:
            if labels is None:
                raise NoTrackError(f"the notes {notes_path} hold no pair of rails")
            return Base(name, rgb, labels, track_of_mask(labels, camera))
        track = track_of_rails(rails.left_uv, rails.right_uv, (width, height), camera)
        if labels is None:
            labels = draw_mask(track, (width, height))
        else:
            track = replace(track, embedded=is_embedded(labels, rails.left_uv))
        return Base(name, rgb, labels, track)


def ego_rails(pairs: Sequence[RailPair], size_wh: tuple[int, int]) -> RailPair | None:
    """The rails of the ego track among a picture's pairs of rails.

    It is the pair that begins lowest and nearest to the middle of the picture. None if there is no
    usable pair.
    """
    width, height = size_wh

    def cost(pair: RailPair) -> float:
        left, right = pair.left_uv[-1], pair.right_uv[-1]
        middle = 0.5 * (left[0] + right[0])
        low = min(left[1], right[1])
        return float(abs(middle - width / 2) / width + 2.0 * (height - low) / height)

    usable = [pair for pair in pairs if min(len(pair.left_uv), len(pair.right_uv)) >= 2]
    return min(usable, key=cost, default=None)


def camera_of_notes(notes: dict[str, Any], size_wh: tuple[int, int]) -> Camera | None:
    """The camera a rendered picture's notes state, else None."""
    data = notes.get("camera")
    if not isinstance(data, dict):
        return None
    names = ("focal_px", "height_m", "pitch_rad", "roll_rad", "yaw_rad", "offset_m", "gauge_m")
    try:
        values: dict[str, Any] = {name: float(data[name]) for name in names}
        bend = tuple(float(k) for k in data.get("distortion", (0.0,) * 5))
    except (KeyError, TypeError, ValueError):
        return None
    if len(bend) != 5 or not all(map(math.isfinite, [*values.values(), *bend])):
        return None
    centre = ((size_wh[0] - 1) / 2, (size_wh[1] - 1) / 2)
    return Camera(size_wh, principal_uv=centre, distortion=bend, **values)


def draw_mask(track: EgoTrack, size_wh: tuple[int, int]) -> Image:
    """A class mask that knows the ego track alone: rails, track between them, void elsewhere."""
    width, height = size_wh
    labels = np.full((height, width), VOID, np.uint8)
    left = np.stack([track.left_px, track.rows_px], axis=-1)
    right = np.stack([track.right_px, track.rows_px], axis=-1)
    bed = np.stack([track.metre_px * 0.5, np.zeros(len(left))], axis=-1)
    outline = np.concatenate([left - bed, (right + bed)[::-1]])
    cv2.fillPoly(labels, [np.rint(outline).astype(np.int32)], RAIL_TRACK)
    half = np.maximum(0.036 * track.metre_px, 1.0)[:, None] * np.array([1.0, 0.0])
    for rail in (left, right):
        strip = np.concatenate([rail - half, (rail + half)[::-1]])
        cv2.fillPoly(labels, [np.rint(strip).astype(np.int32)], RAIL_RAISED)
    return cast(Image, labels)
