"""Drawn stand-ins for scenes: two rails on a bed under a sky, small and quick."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.labels import RAIL_RAISED, SKY, TRACKBED

Image = npt.NDArray[np.uint8]


def draw(seed: int, width: int = 96, height: int = 64, rail_px: int = 4) -> tuple[Image, Image]:
    """Image and mask: rails ``rail_px`` wide at the bottom and half of that at the horizon."""
    rng = np.random.default_rng(seed)
    image = np.empty((height, width, 3), np.uint8)
    mask = np.empty((height, width), np.uint8)
    horizon = int(rng.integers(height // 4, height // 2))
    image[:horizon], mask[:horizon] = (90, 140, 220), SKY
    image[horizon:], mask[horizon:] = rng.integers(40, 110, 3), TRACKBED
    meet = int(rng.integers(width // 3, 2 * width // 3))
    bright = tuple(int(v) for v in rng.integers(180, 255, 3))
    for foot in (meet - width // 4, meet + width // 4):
        near, far = rail_px // 2, rail_px // 4
        rail = np.array(
            [
                [foot - near, height],
                [foot + near, height],
                [meet + far, horizon],
                [meet - far, horizon],
            ]
        )
        cv2.fillConvexPoly(image, rail, bright)
        cv2.fillConvexPoly(mask, rail, RAIL_RAISED)
    return image, mask


def write_set(
    folder: Path, count: int, inner: str = "", rail_px: int = 4
) -> list[tuple[Image, Image]]:
    """Write drawings in RailSem19's layout and return them."""
    images, masks = folder / "jpgs" / inner, folder / "uint8" / inner
    images.mkdir(parents=True)
    masks.mkdir(parents=True)
    drawn = [draw(seed, rail_px=rail_px) for seed in range(count)]
    for seed, (image, mask) in enumerate(drawn):
        cv2.imwrite(str(images / f"rs{seed:05d}.jpg"), image[..., ::-1])
        cv2.imwrite(str(masks / f"rs{seed:05d}.png"), mask)
    return drawn
