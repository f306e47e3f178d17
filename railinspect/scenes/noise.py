"""Tileable value noise with a mip pyramid: the one source of texture in the rendered world."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from numba import njit

TILE_PX = 512
LEVELS = 8

Pyramid = npt.NDArray[np.float32]


def _octave(rng: np.random.Generator, cells: int) -> npt.NDArray[np.float32]:
    lattice = rng.standard_normal((cells, cells)).astype(np.float32)
    steps = np.arange(TILE_PX, dtype=np.float32) * (cells / TILE_PX)
    low = steps.astype(np.int64) % cells
    high = (low + 1) % cells
    part = steps - np.floor(steps)
    part = part * part * (3 - 2 * part)
    rows = lattice[low] * (1 - part)[:, None] + lattice[high] * part[:, None]
    blended: npt.NDArray[np.float32] = rows[:, low] * (1 - part) + rows[:, high] * part
    return blended


@lru_cache(maxsize=1)
def pyramids() -> Pyramid:
    """Three zero-mean, unit-variance noise fields, each as a flat mip pyramid.

    Field 0 is grainy (ballast, asphalt), field 1 is middling (grass, foliage), field 2 is smooth
    (patches, clouds). Level l of a field is a (512 >> l)² tile; its variance falls from level to
    level as box filtering makes it, so distant texture loses contrast as it does in a lens.

    Returns:
        Array of shape (3, LEVELS, 512, 512); of level l only the leading (512 >> l)² is used.
    """
    rng = np.random.default_rng(20231)
    weights = (
        {64: 0.3, 128: 0.6, 256: 1.0, 512: 0.9},
        {8: 0.3, 16: 0.5, 32: 0.7, 64: 0.9, 128: 0.8, 256: 0.6},
        {4: 1.0, 8: 0.8, 16: 0.5, 32: 0.3, 64: 0.2, 128: 0.12},
    )
    stack = np.zeros((len(weights), LEVELS, TILE_PX, TILE_PX), np.float32)
    for kind, octaves in enumerate(weights):
        tile = np.zeros((TILE_PX, TILE_PX), np.float32)
        for cells, weight in octaves.items():
            tile += np.float32(weight) * _octave(rng, cells)
        tile = (tile - tile.mean()) / tile.std()
        for level in range(LEVELS):
            size = TILE_PX >> level
            stack[kind, level, :size, :size] = tile
            tile = tile.reshape(size // 2, 2, size // 2, 2).mean(axis=(1, 3))
    stack.setflags(write=False)
    return stack


@njit(cache=True, inline="always", error_model="numpy")
def sample(
    stack: Pyramid, kind: int, along: float, across: float, footprint: float
) -> float:  # pragma: no cover - compiled
    """Noise at a point given in texels of level 0, box-filtered to ``footprint`` texels."""
    level = 0
    while footprint > 1.5 and level < LEVELS - 1:
        footprint *= 0.5
        level += 1
    scale = 1.0 / (1 << level)
    size = TILE_PX >> level
    x = along * scale - 0.5
    y = across * scale - 0.5
    x0 = np.floor(x)
    y0 = np.floor(y)
    fx = np.float32(x - x0)
    fy = np.float32(y - y0)
    i0 = int(x0) & (size - 1)
    j0 = int(y0) & (size - 1)
    i1 = (i0 + 1) & (size - 1)
    j1 = (j0 + 1) & (size - 1)
    one = np.float32(1.0)
    top = stack[kind, level, i0, j0] * (one - fy) + stack[kind, level, i0, j1] * fy
    low = stack[kind, level, i1, j0] * (one - fy) + stack[kind, level, i1, j1] * fy
    return float(top * (one - fx) + low * fx)
