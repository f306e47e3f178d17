"""Which stretch of a track to leave out of the smooth one: where the rails may be bent.

A smooth track fitted to bent rails follows a part of the bend, and what is left over is smaller
than the bend and spread beyond its ends. So each stretch is asked in turn: if the rails outside it
alone said how the track runs, how far off would the rails inside it lie? Everything needed for
that is in the normal equations of the one fit; a stretch is left out by taking its rows' share
away from them.
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.smooth import CORRELATED_ROWS, SmoothTrack, centre_bases, centre_prior

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_LEAST_UPRIGHT: Final = 0.05
"""Sine of the flattest angle at which a track is taken to run through the image."""

_SUSPECT_PX: Final = 0.4
"""Where both rails leave the smooth track by so much, mean of three rows, pixels of a 640 pixels
wide image, it may have followed a part of a bend."""

_BACK_PX: Final = 0.3
_BACK_SHARE: Final = 0.25
"""Outside the bend both rails lie within so much of the smooth track, pixels of a 640 pixels wide
image, or within this share of the bend, mean of three rows."""

_LENGTHS_M: Final = (7.0, 9.0, 12.0, 15.0, 19.0, 24.0)
"""Lengths of the stretches, metres along the track: waves of 5 m to buckles of 14 m, and their
ends."""

_STEP: Final = 0.2
"""Stretches begin this share of their length apart."""

_LEAST_ROWS: Final = 6
"""Rows inside a stretch and before it that say anything,"""

_LEAST_BEYOND: Final = 3
"""and beyond it, where each holds more of the track; of so many on
either side at once more than half."""

_SURE_SHARE: Final = 0.8
"""Least share of sure rows: at a switch the rails say little of the track's shape."""

_FREE: Final = 1.0
"""Squared deviation, in standard deviations, that a row inside the stretch must exceed on average
before leaving it out explains anything."""

_LEAST_GAIN: Final = 2.0
"""Least fall of the fit's cost beyond that."""

_SIGNIFICANT: Final = 2.5
"""The rails must lie off by so many standard deviations of what the other rows leave open."""


@numba.njit(cache=True)
def upright(centre_uv: Array) -> Array:
    """How upright a track runs through the image: the sine of its angle to the rows, (M,).

    Args:
        centre_uv: Its centre line, one sample per row, pixels, shape (M, 2).
    """
    sine, last = np.empty(len(centre_uv)), len(centre_uv) - 1
    for i in range(len(centre_uv)):
        before, after = max(i - 3, 0), min(i + 3, last)
        along_u = centre_uv[after, 0] - centre_uv[before, 0]
        along_v = centre_uv[after, 1] - centre_uv[before, 1]
        length = math.hypot(along_u, along_v)
        sine[i] = max(abs(along_v) / length if length > 0.0 else 0.0, _LEAST_UPRIGHT)
    return sine


def stands_out(common_px: Array, sure: Bools, scale: float) -> bool:
    """Whether what both rails share of their residuals is more than the scatter of a clear track.

    Args:
        common_px: It, pixels across the track, shape (M,).
        sure: Rows in which both rails were seen and are nobody else's, shape (M,).
        scale: Image width over 640 pixels.
    """
    return bool(_highest(common_px[sure]) > _SUSPECT_PX * scale)


def comes_back(common_px: Array, sure: Bools, inside: Bools, scale: float) -> bool:
    """Whether the rails lie on the smooth track again outside a stretch that was left out.

    Rails that leave the track come back to it; where they do not, the plane or the model is wrong.

    Args:
        common_px: What both rails share of their residuals, pixels across the track, shape (M,).
        sure: Rows in which both rails were seen and are nobody else's, shape (M,).
        inside: Rows that were left out, shape (M,).
        scale: Image width over 640 pixels.
    """
    bend_px = float(np.abs(common_px[sure & inside]).max(initial=0.0))
    most_px = max(_BACK_PX * scale, _BACK_SHARE * bend_px)
    return bool(_highest(common_px[sure & ~inside]) < most_px)


def _highest(values: Array) -> float:
    """Largest size of a mean of three neighbours; 0 where there are fewer."""
    if len(values) < 3:
        return 0.0
    return float(np.abs(values[2:] + values[1:-1] + values[:-2]).max() / 3.0)


def bent_stretch(
    smooth: SmoothTrack,
    x_m: Array,
    common_m: Array,
    sigma_m: Array,
    sure: Bools,
    curvature: float,
    rate: float,
    noise: float,
) -> tuple[float, float] | None:
    """The stretch whose leaving out makes the smooth track fit the other rows so much better.

    Args:
        smooth: The track fitted to all rows.
        x_m: Ground distance of each row, metres, rising, shape (M,).
        common_m: What both rails share of their residuals there, metres, shape (M,).
        sigma_m: Standard deviation of each, metres, shape (M,).
        sure: Rows in which both rails were seen and are nobody else's, shape (M,).
        curvature: Standard deviation of the smooth track's second derivative, 1/m.
        rate: Standard deviation of its change per metre over 10 m, 1/m².
        noise: Scatter that neighbouring rows really have, as a multiple of ``sigma_m``.

    Returns:
        Ground distance of its first and last row, metres; None where no stretch stands out.
    """
    basis = centre_bases(x_m, smooth.knots_m)[0]
    common_m = np.where(sure, common_m, 0.0)
    off = common_m / sigma_m
    weight = sure / (sigma_m**2 * CORRELATED_ROWS * (1.0 + (0.5 * off) ** 2))
    outer = weight[:, None, None] * basis[:, :, None] * basis[:, None, :]
    moment = (weight * common_m)[:, None] * basis
    excess = weight * common_m**2 - sure * _FREE * noise**2 / CORRELATED_ROWS
    sums = [np.cumsum(np.concatenate([np.zeros_like(a[:1]), a]), axis=0) for a in (outer, moment)]
    costs = np.concatenate([[0.0], np.cumsum(excess)])
    start = np.concatenate(
        [np.arange(x_m[0], x_m[-1] - 0.5 * length, _STEP * length) for length in _LENGTHS_M]
    )
    counts = [len(np.arange(x_m[0], x_m[-1] - 0.5 * n, _STEP * n)) for n in _LENGTHS_M]
    end = start + np.repeat(_LENGTHS_M, counts)
    first, last = np.searchsorted(x_m, start), np.searchsorted(x_m, end)
    counted = np.concatenate([[0], np.cumsum(sure)])
    inside = counted[last] - counted[first]
    useful = (inside >= _LEAST_ROWS) & (inside >= _SURE_SHARE * (last - first))
    useful &= (counted[first] >= _LEAST_ROWS) & (counted[-1] - counted[last] >= _LEAST_BEYOND)
    before, beyond = first - _LEAST_BEYOND, np.minimum(last + _LEAST_BEYOND, len(x_m))
    beside = counted[first] - counted[before.clip(0)] + counted[beyond] - counted[last]
    useful &= beside > _LEAST_BEYOND
    first, last = first[useful], last[useful]
    if len(first) == 0:
        return None
    gram = outer.sum(axis=0) + centre_prior(smooth.knots_m, curvature, rate)
    rest = gram[None] - (sums[0][last] - sums[0][first])
    pull = sums[1][last] - sums[1][first]
    middle = basis[(first + last) // 2]
    solved = np.linalg.solve(rest, np.stack([pull, middle], axis=2))
    moved = solved[:, :, 0]
    gain = costs[last] - costs[first] + np.einsum("ki,ki->k", pull, moved)
    # How far off the rows lie then, against what the others leave open in the stretch's middle.
    rows = np.arange(len(x_m))
    inside = (rows >= first[:, None]) & (rows < last[:, None])
    off_m = np.abs(common_m + moved @ basis.T) * (inside & sure)
    open_m = np.sqrt(np.einsum("ki,ki->k", middle, solved[:, :, 1]))
    gain[off_m.max(axis=1) < _SIGNIFICANT * open_m] = 0.0
    best = int(np.argmax(gain))
    if gain[best] < _LEAST_GAIN * noise**2:
        return None
    return float(x_m[first[best]]), float(x_m[last[best] - 1])
