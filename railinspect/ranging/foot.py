"""The foot's row at the image's full resolution, where the network's masks are coarser.

A network that sees the picture at 640 pixels knows the foot of a thing to a few pixels of that
width, and shadows and feet to worse. The picture itself knows better. Colours of the thing (its
body above the foot) and of the ground (beside it, in the sun and in shade) say of each row around
the coarse foot which of the two it shows, and an edge that is not also an edge of the ground beside
it may be the foot: shadows end softly, sleepers go on to both sides. What speaks for each row
makes a distribution; its mode is the foot and its width the foot's own uncertainty.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from railinspect.findings import Finding
from railinspect.labels import (
    RAIL_EMBEDDED,
    RAIL_RAISED,
    RAIL_TRACK,
    ROAD,
    SIDEWALK,
    SKY,
    TERRAIN,
    TRACKBED,
    TRAM_TRACK,
    VEGETATION,
)

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_BINS = 8
_SHADE = 0.55
"""Brightness of shaded ground against the same ground in the sun."""

_GROUND = np.zeros(256, np.bool_)
_GROUND[
    [
        RAIL_EMBEDDED,
        RAIL_RAISED,
        RAIL_TRACK,
        ROAD,
        SIDEWALK,
        SKY,
        TERRAIN,
        TRACKBED,
        TRAM_TRACK,
        VEGETATION,
        255,
    ]
] = True

_LEAST_PIXELS = 24
_COLUMNS = 12
"""So many columns of a strip are looked at, at most."""


class Feet(NamedTuple):
    """How a foot's place follows from masks and picture, for one kind of thing.

    Where masks are right, their feet lie about the true one as Student's t of three degrees; a
    share of them has missed a large part of the thing.

    Attributes:
        below_m: So far below the masks' foot the true one lies on average, metres of height.
        mask_m: Width of the distribution of feet about that, metres; the masks' pixels add
            ``MASK_CELLS``, in squares.
        stray: Share of the masks that have missed a part of the thing, 0 … 1,
        stray_m: and the standard deviation of their feet, likewise.
        row: Worth of one row's verdict: neighbouring rows say nearly the same.
        edge: Worth of an edge that is sharper than the ground's beside it by once the scatter of
            all rows.
    """

    below_m: float
    mask_m: float
    stray: float
    stray_m: float
    row: float
    edge: float


# Fitted by likelihood to the 316 feet that the shipped network found with its closer looks, as in
# single pictures, on rendered rides 600–619.
PERSON = Feet(0.091, 0.044, 0.335, 0.37, 0.005, 2.25)
THING = Feet(0.0, 0.018, 0.23, 0.42, 0.034, 1.63)

MASK_CELLS = 0.90
"""Width of the distribution of feet about the masks', in the network's pixels."""

EDGE_LEAST, EDGE_MOST = -0.4, 3.5
"""Multiples of the rows' scatter between which the sharpness of an edge counts; it nears the upper
one slowly, so that of several sharp rows the sharpest stays the first."""

STANDING_M, STANDING_STD_M, NOT_STANDING = 1.72, 0.145, 4e-3
"""Height of people, and how likely any other is: masks of people often end at the coat."""

_T3, _NORMAL = 2.0 / (math.pi * math.sqrt(3.0)), 1.0 / math.sqrt(2.0 * math.pi)
"""Heights of the two distributions, of width 1, at their middle."""

UP_M, PERSON_UP_M, DOWN_M = 0.45, 0.12, 1.1
"""So far above and below the masks' foot the true one is looked for, metres of height: masks of
things go on into their shadows, those of people end at the coat."""


class FootRow(NamedTuple):
    """The row of a foot and what else it might be.

    Attributes:
        row: The likeliest boundary, as ``foot_uv`` counts.
        std_px: Root mean square distance of all others from it.
        above_px: So far above it the true one lies in all but 2.5 % of cases.
        below_px: The same below it.
    """

    row: float
    std_px: float
    above_px: float
    below_px: float


def refine_foot(
    rgb: Image, labels: Image, finding: Finding, metre_px: float, horizon_v: float
) -> FootRow | None:
    """Row of a finding's foot in the picture, with its uncertainty.

    Args:
        rgb: The picture, uint8 (H, W, 3).
        labels: Class ids from the coarse masks, at the picture's size, uint8 (H, W).
        finding: The thing with its coarse foot.
        metre_px: Pixels per metre across the track at the coarse foot, > 0.
        horizon_v: Row of the horizon, above the coarse foot.

    Returns:
        The boundary between the thing's last row and the ground; None where the picture shows too
        little of thing or ground.
    """
    left, top, right, bottom = finding.box_xyxy
    box = float(left), float(top), float(right), float(bottom)
    u, v = (float(value) for value in finding.foot_uv)
    cell, metre = rgb.shape[1] / 640.0, float(metre_px)
    person = finding.type == "trespasser"
    found = FootRow(*_refined(rgb, labels, (u, v), box, metre, cell, person, float(horizon_v)))
    return None if math.isnan(found.row) else found


@numba.njit(cache=True)
def _refined(
    rgb: Image,
    labels: Image,
    foot: tuple[float, float],
    box: tuple[float, float, float, float],
    metre: float,
    cell: float,
    person: bool,
    horizon: float,
) -> tuple[float, float, float, float]:
    """What :class:`FootRow` holds; NaN where the picture shows too little."""
    u, v = foot
    up_m = PERSON_UP_M if person else UP_M
    first, total, edge = _evidence(rgb, labels, u, v, box, metre, cell, up_m)
    count = len(total) - 2
    if count < 1 or v <= horizon:
        return np.nan, np.nan, np.nan, np.nan
    feet = PERSON if person else THING
    width = math.hypot(feet.mask_m * metre, MASK_CELLS * cell)
    stray = math.hypot(feet.stray_m * metre, MASK_CELLS * cell)
    typical = max(1.0, np.std(edge[1:-1]))
    log_p = np.empty(count)
    for i in range(count):
        row = first + i + 0.5
        off, astray = (row - v - feet.below_m * metre) / width, (row - v) / stray
        log_p[i] = math.log(
            (1.0 - feet.stray) * _T3 / width / (1.0 + off * off / 3.0) ** 2
            + feet.stray * _NORMAL / stray * math.exp(-0.5 * astray * astray)
        )
        log_p[i] += feet.row * total[i + 1]
        sharp = EDGE_MOST * math.tanh(edge[i + 1] / typical / EDGE_MOST)
        log_p[i] += feet.edge * max(EDGE_LEAST, sharp)
        if person and box[1] >= 2.0:
            tall = (row - box[1]) / (metre * max(0.1, (row - horizon) / (v - horizon)))
            log_p[i] += math.log(
                math.exp(-0.5 * ((tall - STANDING_M) / STANDING_STD_M) ** 2) + NOT_STANDING
            )
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    best = int(np.argmax(p))
    squared = 0.0
    for i in range(count):
        squared += p[i] * (i - best) ** 2
    above, below = _beyond(p, best, 1), _beyond(p, best, -1)
    return first + best + 0.5, math.sqrt(squared + 1.0 / 12.0), above, below


@numba.njit(cache=True)
def _beyond(p: Array, best: int, step: int) -> float:
    """Rows from the middle of the best to where 2.5 % of all probability lie beyond, 0 at least.

    Counted from the first row on (step 1) or from the last (step −1); within a row it is even.
    """
    left = 0.025 * p.sum()
    i = 0 if step > 0 else len(p) - 1
    while i != best and left >= p[i]:
        left -= p[i]
        i += step
    rows: float = abs(best - i) + 0.5 - left / p[i]
    return max(0.0, rows)


@numba.njit(cache=True)
def _evidence(
    rgb: Image,
    labels: Image,
    u: float,
    v: float,
    box: tuple[float, float, float, float],
    metre: float,
    cell: float,
    up_m: float,
) -> tuple[int, Array, Array]:
    """First row looked at; for a boundary above each row from there on, what speaks for it.

    The sum of the verdicts of the rows above it, and how much sharper its edge is than the
    ground's beside it. Empty where the picture shows too little of thing or ground.
    """
    rows, cols = labels.shape
    left, top, right, bottom = box
    tall = bottom - top
    none = np.zeros(0)
    up = min(int(up_m * metre + 2.0 * cell), int(0.5 * tall))
    first = max(2, int(v) - up)
    last = min(rows - 3, int(v) + round(DOWN_M * metre + 3.0 * cell))
    half = max(min(0.25 * metre, 0.5 * (right - left)), 2.0)
    c0, c1 = max(1, round(u - half)), min(cols - 1, round(u + half) + 1)
    gap, beside = int(max(3.0, 0.12 * metre)), int(max(6.0, 0.6 * metre))
    l1 = max(1, int(left) - gap)
    l0 = max(1, l1 - beside)
    r0 = min(cols - 1, int(right) + gap)
    r1 = min(cols - 1, r0 + beside)
    if last - first < 6 or c1 - c0 < 2 or (l1 - l0) + (r1 - r0) < 6:
        return first, none, none
    body, pixels = _body(rgb, labels, v, box)
    ground, beside_pixels = _ground(rgb, first, last, l0, l1, r0, r1)
    if pixels < _LEAST_PIXELS or beside_pixels < _LEAST_PIXELS:
        return first, none, none
    verdict = np.full(_BINS**3, np.nan)
    count = last - first + 1
    total = np.zeros(count)
    for i in range(1, count):
        # Boundary above row ``first + i``: the verdicts of all rows above it add up.
        mean, taken = 0.0, 0
        for c in range(c0, c1, _stride(c0, c1)):
            place = _bin(rgb, first + i - 1, c)
            if np.isnan(verdict[place]):
                verdict[place] = math.log((body[place] + 2e-3) / (ground[place] + 2e-3))
            mean += verdict[place]
            taken += 1
        total[i] = total[i - 1] + min(2.0, max(-2.0, mean / taken))
    own, _ = _edges(rgb, first, count, c0, c1)
    at_left, left_columns = _edges(rgb, first, count, l0, l1)
    at_right, right_columns = _edges(rgb, first, count, r0, r1)
    beside_both = (at_left * left_columns + at_right * right_columns) / (
        left_columns + right_columns
    )
    return first, total, own - beside_both


@numba.njit(cache=True, inline="always")
def _bin(rgb: Image, row: int, column: int) -> int:
    place = 0
    for channel in range(3):
        place = place * _BINS + rgb[row, column, channel] * _BINS // 256
    return place


@numba.njit(cache=True, inline="always")
def _stride(first: int, last: int) -> int:
    """Step at which at most ``_COLUMNS`` columns are looked at."""
    return max(1, (last - first + _COLUMNS - 1) // _COLUMNS)


@numba.njit(cache=True)
def _edges(rgb: Image, first: int, count: int, left: int, right: int) -> tuple[Array, int]:
    """Mean over columns of the colour step across each boundary, and how many columns.

    The step lies between the two rows above row ``first + i`` and the two from it on, each three
    columns wide; the first row's is 0.
    """
    stride = _stride(left, right)
    taken = (right - left + stride - 1) // stride if right > left else 0
    total = np.zeros(count)
    # Row by row, as the picture lies in memory: sums of three columns, by channel.
    band = np.empty((count + 3, 3, max(1, taken)), np.int32)
    for i in range(count + 3):
        row = first - 2 + i
        for k in range(taken):
            c = left + k * stride
            for channel in range(3):
                band[i, channel, k] = (
                    np.int32(rgb[row, c - 1, channel])
                    + np.int32(rgb[row, c, channel])
                    + np.int32(rgb[row, c + 1, channel])
                )
    for i in range(1, count):
        for k in range(taken):
            squared = 0
            for channel in range(3):
                step = band[i + 2, channel, k] + band[i + 3, channel, k]
                step -= band[i, channel, k] + band[i + 1, channel, k]
                squared += step * step
            total[i] += math.sqrt(float(squared))
        total[i] /= 6.0 * max(1, taken)
    return total, taken


@numba.njit(cache=True)
def _body(
    rgb: Image, labels: Image, v: float, box: tuple[float, float, float, float]
) -> tuple[Array, int]:
    """Colours of the thing above its foot: pixels of its commonest class."""
    rows, cols = labels.shape
    left, top, right, bottom = box
    tall = bottom - top
    first, last = max(0, int(v - 0.7 * tall)), min(rows, int(v - 0.12 * tall))
    c0, c1 = max(0, int(left)), min(cols, int(right) + 1)
    colours = np.zeros(_BINS**3)
    if last <= first or c1 <= c0:
        return colours, 0
    stride = max(1, int(np.sqrt((last - first) * (c1 - c0) / 600.0)))
    seen = np.zeros(256, np.int64)
    for row in range(first, last, stride):
        for c in range(c0, c1, stride):
            if not _GROUND[labels[row, c]]:
                seen[labels[row, c]] += 1
    own = np.argmax(seen)
    for row in range(first, last, stride):
        for c in range(c0, c1, stride):
            if labels[row, c] == own and seen[own] > 0:
                colours[_bin(rgb, row, c)] += 1.0
    return _smoothed(colours), seen[own]


@numba.njit(cache=True)
def _ground(
    rgb: Image, first: int, last: int, l0: int, l1: int, r0: int, r1: int
) -> tuple[Array, int]:
    """Colours of the ground beside the thing, in the sun and in shade."""
    colours = np.zeros(_BINS**3)
    area = (last - first) * ((l1 - l0) + (r1 - r0))
    stride = max(1, int(np.sqrt(area / 600.0)))
    count = 0
    for row in range(first, last, stride):
        for side in range(2):
            begin, end = (l0, l1) if side == 0 else (r0, r1)
            for c in range(begin, end, stride):
                colours[_bin(rgb, row, c)] += 0.7
                shaded = 0
                for channel in range(3):
                    value = int(_SHADE * rgb[row, c, channel])
                    shaded = shaded * _BINS + value * _BINS // 256
                colours[shaded] += 0.3
                count += 1
    return _smoothed(colours), count


@numba.njit(cache=True)
def _smoothed(colours: Array) -> Array:
    """A colour histogram blurred by one bin in each channel, of sum 1."""
    n = _BINS
    for stride, blocks in ((1, n * n), (n, n), (n * n, 1)):
        blurred = 0.6 * colours
        for block in range(blocks):
            first = block * n * stride
            for i in range(first, first + (n - 1) * stride):
                blurred[i] += 0.2 * colours[i + stride]
                blurred[i + stride] += 0.2 * colours[i]
        colours = blurred
    shares: Array = colours / max(colours.sum(), 1e-9)
    return shares
