"""Bodies: which stretches of a region's contact with the ground are feet, and what hangs over them.

A region meets the image of the ground wherever it ends: at its feet, and above them along its
belly, its arms, the board of a barrier. The lowest contact of each column makes foot lines; a line
that hangs over another one is part of what stands there, and lines that stand side by side at one
level are the feet of one body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from railinspect.thresholds import Thresholds
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Body:
    """One body over the ground.

    Attributes:
        feet: Its foot lines, each as indices of contacts.
        hanging: Indices of the contacts that hang over them.
    """

    feet: tuple[Indices, ...]
    hanging: Indices


def bodies_of(
    contacts_uv: Array, family: Indices, track: TrackGeometry, limits: Thresholds
) -> list[Body]:
    """Bodies that one region's contacts belong to.

    Args:
        contacts_uv: The lowest contact of each column, by rising column, pixels, shape (N, 2).
        family: Kind of structure that meets the ground there: a car does not hang over a mast.
        track: The track, for the scale of each row.
        limits: Thresholds.
    """
    path = track.path
    assert path is not None
    part, body, stands = _grouped(
        contacts_uv,
        family,
        np.ascontiguousarray(path.uv[::-1, 1]),
        np.ascontiguousarray(path.metre_px[::-1]),
        track.camera.horizon_v(),
        track.camera.size_wh[0] / 640.0,
        limits.level_m,
        limits.overhang_m,
        limits.overhang_width_m,
        limits.stride_m,
    )
    of_contact = body[part]
    return [
        Body(
            tuple(np.flatnonzero(part == p) for p in np.flatnonzero(stands & (body == number))),
            np.flatnonzero((of_contact == number) & ~stands[part]),
        )
        for number in np.unique(body)
    ]


@numba.njit(cache=True)
def _grouped(
    uv: Array,
    family: Indices,
    rows: Array,
    metres: Array,
    horizon: float,
    scale: float,
    level_m: float,
    overhang_m: float,
    overhang_width_m: float,
    stride_m: float,
) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Foot line of each contact, body of each foot line, and whether the line stands."""
    count = len(uv)
    part = np.zeros(count, np.intp)
    for i in range(1, count):
        tolerance = max(3.0 * scale, 0.06 * abs(uv[i, 1] - horizon))
        apart = uv[i, 0] - uv[i - 1, 0] > 2.0 * scale + 1.0
        apart = apart or abs(uv[i, 1] - uv[i - 1, 1]) > tolerance or family[i] != family[i - 1]
        part[i] = part[i - 1] + (1 if apart else 0)
    parts = part[-1] + 1
    first, last = np.zeros(parts, np.intp), np.zeros(parts, np.intp)
    bottom = np.zeros(parts)
    for i in range(count):
        p = part[i]
        if i == 0 or part[i - 1] != p:
            first[p] = i
        last[p] = i
        bottom[p] = max(bottom[p], uv[i, 1])
    metre = np.interp(bottom, rows, metres)
    # What a line hangs over: the lowest line of its family that is near enough below it.
    base = np.arange(parts)
    for p in range(parts):
        lowest = -1.0
        width = uv[last[p], 0] - uv[first[p], 0]
        middle = 0.5 * (uv[last[p], 0] + uv[first[p], 0])
        for q in range(parts):
            if q == p or family[first[q]] != family[first[p]]:
                continue
            near = first[q]
            while near < last[q] and abs(uv[near + 1, 0] - middle) <= abs(uv[near, 0] - middle):
                near += 1
            lift = uv[near, 1] - bottom[p]
            if not level_m * metre[q] < lift < overhang_m * metre[q]:
                continue
            aside = max(uv[first[p], 0] - uv[near, 0], uv[near, 0] - uv[last[p], 0], 0.0)
            if max(width, aside) < overhang_width_m * metre[q] and uv[near, 1] > lowest:
                lowest, base[p] = uv[near, 1], q
    stands = base == np.arange(parts)
    for p in range(parts):  # what hangs over something hanging belongs to what stands below
        while base[base[p]] != base[p]:
            base[p] = base[base[p]]
    # Feet side by side at one level carry one body.
    body = np.full(parts, -1)
    for p in range(parts):
        if not stands[p]:
            continue
        body[p] = p
        for q in range(p):
            if not stands[q] or family[first[q]] != family[first[p]]:
                continue
            level = abs(bottom[p] - bottom[q]) <= level_m * max(metre[p], metre[q])
            beside = uv[first[p], 0] - uv[last[q], 0] < stride_m * max(metre[p], metre[q])
            if level and beside and body[q] != body[p]:
                old, new = body[p], body[q]
                for r in range(p + 1):
                    if body[r] == old:
                        body[r] = new
    for p in range(parts):
        if not stands[p]:
            body[p] = body[base[p]]
    return part, body, stands
