"""How the camera looks at the track in one frame, from the rails alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

MIN_ROWS: Final = 12
"""Fewer rows with both rails say nothing about the camera."""


@dataclass(frozen=True)
class View:
    """What the rails of one frame say about the camera.

    Attributes:
        horizon_v_px: Row in which the rails would meet, pixels.
        spacing_per_row: Pixels by which the rails lie further apart per row below the horizon. For
            a level camera it is the distance of the rails over the camera's height, whatever the
            focal length: w = s·(v − v₀) with w = f·b/x and v − v₀ = f·h/x gives s = b/h.
    """

    horizon_v_px: float
    spacing_per_row: float


def view_of(frame: Mapping[str, Any]) -> View | None:
    """Fit w = s·(v − v₀) to the rails of one line of ``frames.jsonl``.

    Each row weighs as the rails are apart in it: a pixel of error counts less where they are far
    apart, and far ahead the track may rise or fall.

    Returns:
        None if the rails were not followed, or over fewer than twelve rows, or the fit makes no
        sense.
    """
    left, right = frame["rails"]["left"], frame["rails"]["right"]
    if not frame["followed"] or len(left) < MIN_ROWS or len(right) < MIN_ROWS:
        return None
    one, other = np.array(left, float), np.array(right, float)
    top, bottom = max(one[0, 1], other[0, 1]), min(one[-1, 1], other[-1, 1])
    rows = one[(one[:, 1] >= top) & (one[:, 1] <= bottom), 1]
    if rows.size < MIN_ROWS:
        return None
    width = np.interp(rows, other[:, 1], other[:, 0]) - np.interp(rows, one[:, 1], one[:, 0])
    weight = np.maximum(width, 0.0) ** 2
    total = weight.sum()
    if total <= 0:
        return None
    row, wide = (weight * rows).sum() / total, (weight * width).sum() / total
    spread = (weight * (rows - row) ** 2).sum()
    if spread <= 0:
        return None
    slope = float((weight * (rows - row) * (width - wide)).sum() / spread)
    if slope <= 0:
        return None
    return View(float(row - wide / slope), slope)
