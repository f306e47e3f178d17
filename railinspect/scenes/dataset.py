"""Image sets of rendered scenes in RailSem19's layout, made by any number of workers."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import OutputError
from railinspect.labels import CLASSES, PALETTE
from railinspect.scenes.render import Rendered, render
from railinspect.scenes.settings import SceneSettings

IMAGES = Path("jpgs") / "rs19_val"
MASKS = Path("uint8") / "rs19_val"
NOTES = Path("jsons") / "rs19_val"
CONFIG = "rs19-config.json"


def write_images(
    out: Path,
    seeds: Sequence[int],
    settings: SceneSettings | None = None,
    workers: int = 1,
    quality: int = 93,
) -> Iterator[Path]:
    """Render one picture per seed into ``out``; pictures already there are kept.

    Every file is written under a temporary name and renamed, the mask and the notes before the
    picture, so a picture that exists is complete and a stopped run continues where it was.

    Args:
        out: Folder of the set; made if needed.
        seeds: One seed per picture; picture names are ``rs`` and the seed.
        settings: Choices left to the caller.
        workers: Number of processes; the files do not depend on it.
        quality: JPEG quality of the pictures, 1…100.

    Yields:
        The path of each picture, in the order of ``seeds``.

    Raises:
        OutputError: if the folder cannot be written to.
    """
    settings = settings or SceneSettings()
    try:
        for part in (IMAGES, MASKS, NOTES):
            (out / part).mkdir(parents=True, exist_ok=True)
        config = {
            "labels": [
                {"name": name, "color": PALETTE[i].tolist()} for i, name in enumerate(CLASSES)
            ]
        }
        _write(out / CONFIG, json.dumps(config, indent=1).encode())
    except OSError as error:
        raise OutputError(f"cannot write the image set to {out}: {error.strerror}") from error
    one = partial(_write_image, out=out, settings=settings, quality=quality)
    if workers <= 1:
        yield from map(one, seeds)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(one, seeds, chunksize=4)


def notes(picture: Rendered) -> dict[str, object]:
    """The truth of a picture as RailSem19 keeps it (ego rails as polylines) and more."""
    left, right = picture.ego_rails
    rails = [
        {"label": "rail", "polyline": np.round(rail, 2).tolist()}
        for rail in (left, right)
        if len(rail)
    ]
    pair = [np.round(left, 2).tolist(), np.round(right, 2).tolist()]
    height, width = picture.labels.shape
    return {
        "imgHeight": height,
        "imgWidth": width,
        "frame": f"rs{picture.seed:05d}",
        "objects": [
            *rails,
            *([{"label": "rail", "polyline-pair": pair}] if len(left) and len(right) else []),
            *(
                {
                    "label": CLASSES[thing.label],
                    "anomaly": thing.type,
                    "boundingbox": list(thing.box_xyxy),
                    "range_m": round(thing.range_m, 3),
                    "height_m": round(thing.height_m, 3),
                    "lateral_m": round(thing.lateral_m, 3),
                    "visible_px": thing.visible_px,
                }
                for thing in picture.objects
            ),
        ],
        "seed": picture.seed,
        "camera": {
            "focal_px": picture.camera.focal_px,
            "height_m": picture.camera.height_m,
            "pitch_rad": picture.camera.pitch_rad,
            "roll_rad": picture.camera.roll_rad,
            "yaw_rad": picture.camera.yaw_rad,
            "offset_m": picture.camera.offset_m,
            "gauge_m": picture.camera.gauge_m,
            "distortion": list(picture.camera.distortion),
        },
    }


def _write_image(seed: int, out: Path, settings: SceneSettings, quality: int) -> Path:
    cv2.setNumThreads(1)
    name = f"rs{seed:05d}"
    target = out / IMAGES / f"{name}.jpg"
    if target.exists():
        return target
    picture = render(seed, settings)
    _write(out / NOTES / f"{name}.json", json.dumps(notes(picture)).encode())
    _write(out / MASKS / f"{name}.png", encode(".png", picture.labels))
    bgr = np.asarray(cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2BGR), np.uint8)
    _write(target, encode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality]))
    return target


def encode(suffix: str, image: npt.NDArray[np.uint8], options: Sequence[int] = ()) -> bytes:
    """An image file's bytes; ``image`` is grey or BGR."""
    return bytes(cv2.imencode(suffix, image, list(options))[1])


def _write(path: Path, data: bytes) -> None:
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    scratch.write_bytes(data)
    scratch.replace(path)
