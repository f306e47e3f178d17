"""Make the pictures of docs/anomalies.md from the rendered world.

python docs/make_anomalies_pictures.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from railinspect.anomalies import (
    Base,
    Distortion,
    Generated,
    GeneratorSettings,
    NoTrackError,
    WorldSource,
    built_in,
    distort,
    generate,
    place,
)
from railinspect.labels import colourise
from railinspect.scenes import SceneSettings

PICTURES = Path(__file__).parent / "pictures"
SOURCE = WorldSource(640, SceneSettings(size_wh=(1280, 720), weather=False))
TILE_WH = (420, 280)


def bases(count: int) -> list[Base]:
    """Clear pictures with a track in full view."""
    found: list[Base] = []
    for index in range(60):
        try:
            base = SOURCE.base(index)
            base.track.section(0.3, 0.8)
            found.append(base)
        except NoTrackError:
            continue
        if len(found) == count:
            break
    return found


def about(image: np.ndarray, box_xyxy: tuple[float, float, float, float]) -> np.ndarray:
    """The part of a picture about a box, at the tile's proportions."""
    left, top, right, bottom = box_xyxy
    tall = max(140.0, 1.7 * (bottom - top), 1.4 * (right - left) * TILE_WH[1] / TILE_WH[0])
    tall = min(tall, 700.0)
    wide = tall * TILE_WH[0] / TILE_WH[1]
    rows, cols = image.shape[:2]
    v = int(np.clip((top + bottom - tall) / 2, 0, rows - tall))
    u = int(np.clip((left + right - wide) / 2, 0, cols - wide))
    part = image[v : v + int(tall), u : u + int(wide)]
    return cv2.resize(part, TILE_WH, interpolation=cv2.INTER_CUBIC)


def save(name: str, tiles: list[np.ndarray], columns: int) -> None:
    """Write tiles as one picture."""
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    bgr = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 86])[1]
    (PICTURES / name).write_bytes(data.tobytes())


def gallery(pictures: list[Base]) -> None:
    """Three anomalies of each type."""
    tiles = []
    for kind in ("distortion", "obstruction", "trespasser"):
        for number, base in enumerate(pictures):
            rng = np.random.default_rng([5, number])
            made: Generated = generate(base.rgb, base.labels, kind, rng, base.track)
            tiles.append(about(made.rgb, made.box_xyxy))
    save("anomalies.jpg", tiles, 3)


def steps(base: Base) -> None:
    """R′; alpha alone; the mix; the mask; a ripple and its mask."""
    near, far = base.track.section(0.3, 0.8)
    shown = base.rgb.copy()
    along = np.linspace(near, far, 40)
    reach = base.track.camera.rail_spacing_m / 2
    for half, colour in ((1.5, (250, 210, 60)), (reach, (80, 220, 250))):
        edge = np.concatenate(
            [base.track.pixels(along, half, 0.0), base.track.pixels(along[::-1], -half, 0.0)]
        )
        cv2.polylines(shown, [np.rint(edge).astype(np.int32)], True, colour, 2, cv2.LINE_AA)
    at = near + 0.25 * (far - near)
    thing, settings = built_in("person", 2), GeneratorSettings()
    tiles, boxes = [], []
    for alpha, chosen in ((1.0, GeneratorSettings(shadow=0.0)), (0.5, settings)):
        rgb, labels = base.rgb.copy(), base.labels.copy()
        boxes.append(place(rgb, labels, base.track, thing, at, 0.3, alpha, chosen).box_xyxy)
        tiles.append(about(rgb, boxes[0]))
    tiles.append(about(colourise(labels), boxes[0]))
    rgb, labels = base.rgb.copy(), base.labels.copy()
    plan = Distortion("ripple", near, 0.6 * (far - near), 0.25)
    polygon, _, _ = distort(rgb, labels, base.track, plan)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    box = (*map(float, low), *map(float, high))
    tiles = [about(shown, box), *tiles, about(rgb, box), about(colourise(labels), box)]
    save("anomalies_steps.jpg", tiles, 3)


def main() -> None:
    """Make both pictures."""
    pictures = bases(3)
    gallery(pictures)
    steps(pictures[0])


if __name__ == "__main__":
    main()
