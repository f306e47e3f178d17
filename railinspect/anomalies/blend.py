"""Mixed image blending: Porter–Duff "over" and Poisson editing weighed by α, in the object's box.

Poisson editing (Pérez et al., equation 4) asks for a picture f whose gradients are the object's and
which meets the surroundings at the border of its domain. With f = object + r the correction r is
harmonic inside and given at the border: a membrane. The mix of section IV-E is then

    α · object + (1 − α) · f = object + (1 − α) · r.

The domain is the object's outline plus a padding, and outside the outline the object is taken to
stand before neutral ground; so r carries over the light and the colour of the place, not every
stone that happens to lie at the outline. As r is smooth it is solved on a coarse grid. Nothing is
re-centred: an object stays at the very pixel it was put.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

NEUTRAL_RGB: Final = (112.0, 108.0, 102.0)
"""Ground before which cut-outs are taken to stand in neutral light, 0…255."""

GRID_PX: Final = 44
"""Longer side of the coarse grid on which the membrane is solved."""


@dataclass(frozen=True)
class Blended:
    """What a blend did.

    Attributes:
        method: ``mixed``, or ``alpha`` where the padded object meets the picture's border, at
            which the Poisson equation has no border values.
        padding_px: Padding that was used.
    """

    method: str
    padding_px: int


def blend(
    rgb: Image,
    colour: Floats,
    matte: Floats,
    at_xy: tuple[int, int],
    alpha: float,
    padding_px: int | None = None,
) -> Blended:
    """Blend an object into a picture, in place.

    Args:
        rgb: Picture, uint8, shape (H, W, 3).
        colour: The object's colours, premultiplied by the matte, 0…255, shape (h, w, 3).
        matte: Its opacity, 0…1, shape (h, w).
        at_xy: Pixel of its upper left corner; the box may reach beyond the picture.
        alpha: Share of plain alpha blending, 0…1; the rest is Poisson editing.
        padding_px: Padding of the Poisson domain; None takes an eighth of the object's height.

    Returns:
        How it was done.
    """
    rows, cols = rgb.shape[:2]
    left, top = at_xy
    tall, wide = matte.shape
    if padding_px is None:
        padding_px = max(3, round(tall / 8))
    v0, v1 = max(top, 0), min(top + tall, rows)
    u0, u1 = max(left, 0), min(left + wide, cols)
    if v0 >= v1 or u0 >= u1:
        return Blended("alpha", padding_px)
    cut = np.s_[v0 - top : v1 - top, u0 - left : u1 - left]
    solid = matte > 0.02
    inside = np.flatnonzero(solid.any(axis=1)), np.flatnonzero(solid.any(axis=0))
    clear = (
        len(inside[0]) > 0
        and top + inside[0][0] - padding_px >= 1
        and left + inside[1][0] - padding_px >= 1
        and top + inside[0][-1] + padding_px < rows - 1
        and left + inside[1][-1] + padding_px < cols - 1
    )
    method = "mixed" if clear and alpha < 1 else "alpha"
    part = rgb[v0:v1, u0:u1]
    opaque, over = matte[cut][..., None], colour[cut]
    if method == "mixed":
        lift = membrane(rgb, matte, at_xy, padding_px)[cut]
        over = over + (1.0 - alpha) * opaque * lift
        np.clip(over, 0.0, 255.0 * opaque, out=over)
    mixed = part * (1.0 - opaque) + over
    np.rint(mixed, out=mixed)
    part[...] = np.clip(mixed, 0, 255).astype(np.uint8)
    return Blended(method, padding_px)


def membrane(rgb: Image, matte: Floats, at_xy: tuple[int, int], padding_px: int) -> Floats:
    """The harmonic correction r over the object's box, shape (h, w, 3).

    The box and its padding must lie inside the picture.
    """
    left, top = at_xy
    tall, wide = matte.shape
    pad = padding_px + 1
    low_v, low_u = max(0, top - pad), max(0, left - pad)
    high_v = min(rgb.shape[0], top + tall + pad)
    high_u = min(rgb.shape[1], left + wide + pad)
    area = rgb[low_v:high_v, low_u:high_u]
    shrink = min(1.0, GRID_PX / max(area.shape[:2]))
    grid = (max(3, round(area.shape[1] * shrink)), max(3, round(area.shape[0] * shrink)))
    border = cv2.resize(area, grid, interpolation=cv2.INTER_AREA).astype(np.float32)
    border -= np.array(NEUTRAL_RGB, np.float32)
    room = np.zeros(area.shape[:2], np.float32)
    room[top - low_v : top - low_v + tall, left - low_u : left - low_u + wide] = matte[
        : high_v - top, : high_u - left
    ]
    cover = cv2.resize(room, grid, interpolation=cv2.INTER_AREA)
    reach = max(1, round(padding_px * shrink))
    free = cv2.dilate((cover > 0.004).astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8))
    free[[0, -1]] = 0
    free[:, [0, -1]] = 0
    solved = solve_laplace(border, free > 0)
    full = cv2.resize(solved, (area.shape[1], area.shape[0]), interpolation=cv2.INTER_LINEAR)
    out = full[top - low_v : top - low_v + tall, left - low_u : left - low_u + wide]
    return np.asarray(out, np.float32)


def solve_laplace(values: Floats, free: npt.NDArray[np.bool_], sweeps: int = 120) -> Floats:
    """Harmonic continuation of known values into free cells (Dirichlet problem).

    Args:
        values: Known values, shape (H, W, C); what stands in free cells is ignored.
        free: Cells to fill, shape (H, W); none of them at the edge.
        sweeps: Sweeps of successive over-relaxation.

    Returns:
        The values with the free cells filled, float32, shape (H, W, C).
    """
    out = values.astype(np.float32)
    if not free.any():
        return out
    if free.all() or free[[0, -1]].any() or free[:, [0, -1]].any():
        raise ValueError("the cells at the edge of the grid must be known")
    ring = cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & ~free
    out[free] = out[ring].mean(axis=0)
    size = max(free.any(axis=0).sum(), free.any(axis=1).sum()) + 1
    _relax(out, free, sweeps, 2.0 / (1.0 + math.sin(math.pi / size)))
    return out


@njit(cache=True, error_model="numpy")
def _relax(out, free, sweeps, omega):  # type: ignore[no-untyped-def]  # compiled
    rows, cols, planes = out.shape
    for _ in range(sweeps):
        for v in range(1, rows - 1):
            for u in range(1, cols - 1):
                if free[v, u]:
                    for c in range(planes):
                        near = out[v - 1, u, c] + out[v + 1, u, c]
                        near += out[v, u - 1, c] + out[v, u + 1, c]
                        out[v, u, c] += omega * (0.25 * near - out[v, u, c])
