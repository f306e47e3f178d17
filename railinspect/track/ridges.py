"""Rail ridges: where each image row crosses something rail-like, to a fraction of a pixel."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@numba.njit(cache=True)
def _collect(
    score: npt.NDArray[np.uint8], first: int, stride: int, low: int, widest: int, out: Array
) -> int:
    """Fill ``out`` with (u, v, weight) of every run of at least ``low``; return how many."""
    rows, cols = score.shape
    count = 0
    for r in range(first, rows, stride):
        c = 0
        while c < cols:
            if score[r, c] < low:
                c += 1
                continue
            start, total, moment, peak = c, 0.0, 0.0, 0
            while c < cols and score[r, c] >= low:
                value = score[r, c] - low + 1
                total += value
                moment += value * (c - start)
                peak = max(peak, score[r, c])
                c += 1
            if c - start <= widest and count < out.shape[0]:
                out[count, 0] = start + moment / total
                out[count, 1] = r
                out[count, 2] = peak / 255.0
                count += 1
    return count


def ridge_points(
    score: npt.NDArray[np.uint8], first_row: int, stride: int, low: float, widest_px: int
) -> Array:
    """Centres of the rail-like runs of each row.

    Args:
        score: Soft rail probability, 0..255, shape (H, W).
        first_row: First row looked at.
        stride: Rows are taken every ``stride`` pixels.
        low: Probability a run's pixels must all reach, 0..1.
        widest_px: Wider runs are areas, not rails, and are left out.

    Returns:
        (u, v, weight) of each run, weight its peak probability, shape (N, 3).
    """
    rows, cols = score.shape
    taken = max(0, -(-(rows - first_row) // stride))
    out = np.empty((taken * (cols // 2 + 1), 3))
    count = _collect(score, first_row, stride, max(1, round(255 * low)), widest_px, out)
    return out[:count]
