"""Make the picture of docs/scenes.md: twelve scenes of every kind.

python docs/make_scenes_picture.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from railinspect.scenes import SceneSettings, render

PICTURE = Path(__file__).parent / "pictures" / "scenes.jpg"
SEEDS = (1, 3, 4, 5, 11, 8, 19, 12, 9000641, 15, 9000228, 23)
COLUMNS = 3
TILE_WH = (400, 225)


def main() -> None:
    """Render, tile, save."""
    tiles = []
    for seed in SEEDS:
        kind = "tram" if seed > 1000 else "any"
        picture = render(seed, SceneSettings(size_wh=(1280, 720), kind=kind))
        tiles.append(cv2.resize(picture.rgb, TILE_WH, interpolation=cv2.INTER_AREA))
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(PICTURE), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    print(PICTURE)


if __name__ == "__main__":
    main()
