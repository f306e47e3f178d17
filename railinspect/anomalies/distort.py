"""Distorted rails: a sideways displacement of every row of the track, and missing pieces of rail.

Displacements are metres across the track; the track's own scale turns them into pixels row by row,
so a distortion has one true size whatever its distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.anomalies.ego import EgoTrack

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

DistortionKind = Literal["ripple", "buckle", "break", "gap"]
DISTORTION_KINDS: Final[tuple[DistortionKind, ...]] = ("ripple", "buckle", "break", "gap")

SHOULDER_M: Final = 0.45
"""The track panel moves as a whole this far beyond its rails, metres,"""

FADE_M: Final = 0.9
"""and the ballast beside it less and less over this width, metres."""

_STRIP_M: Final = 0.26
_ASIDE_M: Final = 0.52


@dataclass(frozen=True)
class Distortion:
    """A distortion of the ego rails.

    Attributes:
        kind: ``ripple`` (a wave, equation 47), ``buckle`` (one bulge to a side), ``break`` (one
            rail interrupted, its end knocked aside) or ``gap`` (pieces of the rails missing).
        near_m: Where it begins, distance along the track, metres.
        length_m: How long it is along the track, metres.
        amplitude_m: Largest lateral displacement, metres; positive begins to the left.
        waves: Number of waves of a ripple.
        rails: Which rails are affected by a break or a gap: left, right.
    """

    kind: DistortionKind
    near_m: float
    length_m: float
    amplitude_m: float
    waves: float = 2.0
    rails: tuple[bool, bool] = (True, True)

    @property
    def far_m(self) -> float:
        """Where it ends, metres along the track."""
        return self.near_m + self.length_m


def displacement_m(distortion: Distortion, rows_px: Array, along_m: Array) -> Array:
    """Lateral displacement of the track in each row, metres, positive to the left, shape (N,).

    A ripple is equation 47 with the row ν in the sine, as its authors' pictures are made:
    a·(ν_near − ν)/(ν_near − ν_far) · sin(2π·ν/λ), so that it dies away towards the camera; its
    phase starts at the far end, where it therefore dies away too. The amplitude is metres, and
    the largest displacement is the amplitude asked for. A buckle is a·sin²(π·s/L).

    Args:
        distortion: The distortion.
        rows_px: Rows, falling with the distance, shape (N,).
        along_m: Distance along the track in each of them, metres, shape (N,).
    """
    inside = (along_m >= distortion.near_m) & (along_m <= distortion.far_m)
    out = np.zeros(len(rows_px))
    if inside.sum() < 2 or distortion.kind in ("break", "gap"):
        return out
    if distortion.kind == "buckle":
        part = (along_m[inside] - distortion.near_m) / distortion.length_m
        out[inside] = distortion.amplitude_m * np.sin(np.pi * part) ** 2
        return out
    rows = rows_px[inside]
    near, far = rows.max(), rows.min()
    from_far = (rows - far) / (near - far)
    wave = (1.0 - from_far) * np.sin(2 * np.pi * distortion.waves * from_far)
    out[inside] = distortion.amplitude_m * wave / max(float(np.abs(wave).max()), 1e-9)
    return out


@dataclass(frozen=True)
class Moved:
    """Where points of a picture went when its rails were bent.

    Attributes:
        v: Rows, top to bottom, shape (N,).
        shift_px: How far the track moved to the right in each, pixels, shape (N,).
        left_px: Left and
        right_px: right rail before, columns, shape (N,).
        metre_px: Pixels per metre, shape (N,).
    """

    v: Array
    shift_px: Array
    left_px: Array
    right_px: Array
    metre_px: Array

    def __call__(self, points_uv: Array) -> Array:
        """Points (u, v) after the distortion, shape (N, 2); those beyond it stay."""
        u, v = points_uv[:, 0], points_uv[:, 1]
        inside = (v >= self.v[0]) & (v <= self.v[-1])
        shift, left, right, scale = (
            np.interp(v, self.v, column)
            for column in (self.shift_px, self.left_px, self.right_px, self.metre_px)
        )
        beyond = np.maximum(left - u, u - right) - (SHOULDER_M * scale + 2.0)
        part = np.clip(beyond / (FADE_M * scale + 2.0), 0.0, 1.0)
        weight = (1.0 - part * part * (3.0 - 2.0 * part)) * inside
        return np.stack([u + weight * shift, v], axis=-1)


@dataclass(frozen=True)
class _Rows:
    """The track in whole rows of the picture, top to bottom."""

    v: npt.NDArray[np.int64]
    along_m: Array
    left_px: Array
    right_px: Array
    metre_px: Array

    def across_px(self, shift_px: Array) -> float:
        """The largest of some shifts along the rows, measured at right angles to the track.

        Where the track runs along the rows a shift moves the rails along themselves, and nobody
        sees it.
        """
        if len(self.v) < 2:
            return 0.0
        slope = np.gradient(0.5 * (self.left_px + self.right_px))
        return float(np.abs(shift_px / np.hypot(1.0, slope)).max())


def _rows(track: EgoTrack, near_m: float, far_m: float, height: int) -> _Rows:
    """The rows in which the stretch lies."""
    ends = np.interp([far_m, near_m], track.along_m, track.rows_px)
    v = np.arange(max(0, math.floor(ends[0])), min(height - 1, math.ceil(ends[1])) + 1)
    key = -track.rows_px  # rising
    along, left, right, scale = (
        np.interp(-v, key, values)
        for values in (track.along_m, track.left_px, track.right_px, track.metre_px)
    )
    return _Rows(v, along, left, right, scale)


def seen_px(track: EgoTrack, distortion: Distortion, height: int) -> float:
    """Largest displacement of a ripple or buckle in the picture, pixels across the track.

    Args:
        track: The track.
        distortion: What would be done to it.
        height: Rows of the picture.
    """
    rows = _rows(track, distortion.near_m, distortion.far_m, height)
    return rows.across_px(_shift(distortion, rows))


def _shift(distortion: Distortion, rows: _Rows) -> Array:
    """How far the track moves to the right in each row, pixels."""
    return -displacement_m(distortion, rows.v.astype(float), rows.along_m) * rows.metre_px


def distort(
    rgb: Image, labels: Image, track: EgoTrack, distortion: Distortion
) -> tuple[Array, dict[str, Any], Moved | None]:
    """Distort the rails of a picture and of its mask, both changed in place.

    Args:
        rgb: Picture, uint8, shape (H, W, 3).
        labels: Class mask, uint8, shape (H, W).
        track: The track in it.
        distortion: What to do.

    Returns:
        The outline of what was distorted, pixels, shape (K, 2), the settings for the manifest, and
        how points moved with it (None where the track did not move as a whole).
    """
    height, width = labels.shape
    rows = _rows(track, distortion.near_m, distortion.far_m, height)
    if distortion.kind in ("ripple", "buckle"):
        shift = _shift(distortion, rows)
        _move(rgb, labels, rows, shift)
        outline = _outline(rows, np.minimum(shift, 0), np.maximum(shift, 0), width, height)
        peak = rows.across_px(shift)
        moved = Moved(rows.v.astype(float), shift, rows.left_px, rows.right_px, rows.metre_px)
    else:
        moved = None
        peak = 0.0
        ends = np.zeros(len(rows.v))
        if distortion.kind == "break":
            # the far end of the broken rail stands aside and comes back over the last two thirds
            part = np.clip((rows.along_m - distortion.near_m) / distortion.length_m, 0, 1)
            ends = -distortion.amplitude_m * np.where(part > 0.33, 1.5 * (1 - part), 0.0)
            ends = ends * rows.metre_px
            peak = rows.across_px(ends)
            hole = part <= 0.33
        else:
            hole = np.ones(len(rows.v), bool)
        for rail, side, hit in (
            (rows.left_px, 1.0, distortion.rails[0]),
            (rows.right_px, -1.0, distortion.rails[1]),
        ):
            if hit:
                if distortion.kind == "break":
                    _move_rail(rgb, labels, rows, rail, ends)
                _remove_rail(rgb, labels, rows, rail, side, hole)
        outline = _outline(rows, np.minimum(ends, 0), np.maximum(ends, 0), width, height)
    notes = {
        "length_m": round(distortion.length_m, 3),
        "amplitude_m": round(distortion.amplitude_m, 4),
        "amplitude_px": round(peak, 2),
        "waves": round(distortion.waves, 3) if distortion.kind == "ripple" else None,
        "rails": [n for n, on in zip(("left", "right"), distortion.rails, strict=True) if on],
    }
    return outline, notes, moved


def _move(rgb: Image, labels: Image, rows: _Rows, shift: Array) -> None:
    """Move the track panel sideways, row by row; the ballast beside it gives way."""
    flat = SHOULDER_M * rows.metre_px + 2.0
    fade = FADE_M * rows.metre_px + 2.0
    low = max(0, math.floor((rows.left_px - flat - fade).min()))
    high = min(rgb.shape[1], math.ceil((rows.right_px + flat + fade).max()) + 1)
    # columns of the displaced panel: full weight between its shoulders, cosine beyond
    u = np.arange(low, high, dtype=np.float32)[None]
    left = (rows.left_px + shift - flat).astype(np.float32)[:, None]
    right = (rows.right_px + shift + flat).astype(np.float32)[:, None]
    beyond = np.maximum(left - u, u - right)
    beyond *= (1.0 / fade).astype(np.float32)[:, None]
    np.clip(beyond, 0.0, 1.0, out=beyond)
    weight = beyond * beyond * (3.0 - 2.0 * beyond)
    weight -= 1.0
    weight *= shift.astype(np.float32)[:, None]
    _remap(rgb, labels, rows.v, low, high, np.asarray(weight, np.float32))


def _move_rail(rgb: Image, labels: Image, rows: _Rows, rail_px: Array, shift: Array) -> None:
    """Move one rail sideways and leave the ballast where it is."""
    half = _STRIP_M * rows.metre_px + 1.0
    low = max(0, math.floor((rail_px - 3 * half).min()))
    high = min(rgb.shape[1], math.ceil((rail_px + 3 * half).max()) + 1)
    u = np.arange(low, high, dtype=np.float32)[None]
    away = np.abs(u - (rail_px + shift).astype(np.float32)[:, None])
    away /= half.astype(np.float32)[:, None]
    weight = np.clip(2.0 - away, 0.0, 1.0) * -shift.astype(np.float32)[:, None]
    _remap(rgb, labels, rows.v, low, high, np.asarray(weight, np.float32))


def _remap(
    rgb: Image,
    labels: Image,
    v: npt.NDArray[np.int64],
    low: int,
    high: int,
    offset: npt.NDArray[np.float32],
) -> None:
    if high - low < 2 or len(v) < 2:
        return
    first, last = int(v[0]), int(v[-1]) + 1
    u = np.arange(low, high, dtype=np.float32)
    map_u = offset
    map_u += (u - np.float32(low))[None]
    map_v = np.broadcast_to(np.arange(last - first, dtype=np.float32)[:, None], map_u.shape).copy()
    for plane, how in ((rgb, cv2.INTER_CUBIC), (labels, cv2.INTER_NEAREST)):
        part = plane[first:last, low:high]
        part[...] = cv2.remap(part, map_u, map_v, how, borderMode=cv2.BORDER_REPLICATE)


def _remove_rail(
    rgb: Image, labels: Image, rows: _Rows, rail_px: Array, side: float, hole: npt.NDArray[np.bool_]
) -> None:
    """Cover a rail with what lies beside it between the rails, row by row."""
    chosen = np.flatnonzero(hole)
    if not len(chosen):
        return
    width = rgb.shape[1]
    half = _STRIP_M * rows.metre_px + 1.5
    aside = side * _ASIDE_M * rows.metre_px
    low = max(0, math.floor((rail_px - half - 2).min()))
    high = min(width, math.ceil((rail_px + half + 2).max()) + 1)
    if high - low < 2:
        return
    u = np.arange(low, high)[None]
    feather = np.clip((half[:, None] - np.abs(u - rail_px[:, None])) / 1.5, 0.0, 1.0)
    feather *= hole[:, None]
    source = np.clip(np.rint(u + aside[:, None]), 0, width - 1).astype(np.int64)
    v = rows.v[:, None]
    patch = rgb[v, source].astype(np.float32)
    part = rgb[rows.v[0] : rows.v[-1] + 1, low:high]
    mixed = part + feather[..., None].astype(np.float32) * (patch - part)
    part[...] = np.rint(mixed).astype(np.uint8)
    mask = labels[rows.v[0] : rows.v[-1] + 1, low:high]
    mask[...] = np.where(feather > 0.5, labels[v, source], mask)


def _outline(rows: _Rows, left_add: Array, right_add: Array, width: int, height: int) -> Array:
    """Polygon round both rails where they were and where they are."""
    margin = 0.12 * rows.metre_px + 1.0
    keep = np.unique(np.linspace(0, len(rows.v) - 1, min(24, len(rows.v))).astype(int))
    left = np.stack([rows.left_px + left_add - margin, rows.v], axis=-1)[keep]
    right = np.stack([rows.right_px + right_add + margin, rows.v], axis=-1)[keep]
    polygon = np.concatenate([left, right[::-1]])
    return cast(Array, np.clip(polygon, 0, [width - 1, height - 1]))
