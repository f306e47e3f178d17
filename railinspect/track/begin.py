"""Beginning points: the pair of straight lines the ego rails make near the camera.

A Hough transform over ridge points collects lines; each pair of lines is weighed by the rows it
covers, by whether it meets near the horizon, by its spacing and by how far off centre it lies.
Lines are written in the levelled view as X = slope·(Y − Y_b) + X_b with Y_b the bottom row,
because rails may be far from vertical but are never horizontal near the camera; the (l, θ) of the
paper's Hough transform follow from these two numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_BINS_BOTTOM, _BINS_TOP, _LINES = 224, 160, 20


@dataclass(frozen=True)
class Line:
    """A line of rail-like points near the camera, in the levelled view.

    Attributes:
        bottom_px: X at the bottom row.
        slope: dX/dY.
        votes: Share of the rows of the band it passes through a ridge.
    """

    bottom_px: float
    slope: float
    votes: float


@dataclass(frozen=True)
class Prior:
    """What is already known about the two rails.

    Attributes:
        horizon_px: Expected horizon row Y_h, levelled pixels, and its standard deviation.
        growth: Expected spacing growth k (see :mod:`railinspect.track.level`), and the standard
            deviation of its logarithm.
        aside: Expected offset of the centre line, in pixels per row below the horizon, and its
            standard deviation.
        heading_px: Expected X of the vanishing point and its standard deviation.
    """

    horizon_px: float
    horizon_std_px: float
    growth: float
    growth_std: float
    aside: float
    aside_std: float
    heading_px: float
    heading_std_px: float


@dataclass(frozen=True)
class Pair:
    """Two lines taken for the ego rails.

    Attributes:
        left: Left rail's line.
        right: Right rail's line.
        vanishing_px: Levelled (X, Y) where they meet.
        growth: Spacing growth k, pixels of spacing per row.
        aside: Centre line's offset, pixels per row.
        score: Evidence and prior together; above 0 means at least some of both.
    """

    left: Line
    right: Line
    vanishing_px: tuple[float, float]
    growth: float
    aside: float
    score: float


@numba.njit(cache=True)
def _vote(
    points: Array,
    bottom: float,
    top: float,
    a0: float,
    da: float,
    c0: float,
    dc: float,
    horizon: float,
    heading: float,
    spread: float,
    votes: Array,
) -> None:
    """Let each point vote for the lines through it that pass near the vanishing point.

    Axes of ``votes`` are X at the bottom and at the top of the band.
    """
    n_a, n_c = votes.shape
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        t = (y - top) / (bottom - top)  # 0 at the top of the band, 1 at the bottom
        stretch = (bottom - y) / (y - horizon)
        middle = x + (x - heading) * stretch
        first = max(0, int((middle - spread * stretch - a0) / da))
        last = min(n_a - 1, int((middle + spread * stretch - a0) / da) + 1)
        for a in range(first, last + 1):
            c = ((x - t * (a0 + a * da)) / (1.0 - t + 1e-3) - c0) / dc
            if t > 0.999:  # at the very bottom X there is the line's, whatever its slope
                share = (top - horizon) / (bottom - horizon)
                c = (heading + (a0 + a * da - heading) * share - c0) / dc
            if not 0.0 <= c < n_c - 1.0:
                continue
            j = int(c)
            votes[a, j] += points[i, 2] * (1.0 - c + j)
            votes[a, j + 1] += points[i, 2] * (c - j)


@numba.njit(cache=True)
def _peaks(votes: Array, least: float, reach: int, out: Array) -> int:
    """Local maxima of ``votes`` by falling height into ``out`` (value, row, column)."""
    n_a, n_c = votes.shape
    count = 0
    for a in range(n_a):
        for c in range(n_c):
            value = votes[a, c]
            if value < least:
                continue
            highest = True
            for i in range(max(0, a - reach), min(n_a, a + reach + 1)):
                for j in range(max(0, c - reach), min(n_c, c + reach + 1)):
                    if votes[i, j] > value or (votes[i, j] == value and (i, j) < (a, c)):
                        highest = False
                        break
                if not highest:
                    break
            if not highest:
                continue
            at = count
            while at > 0 and out[at - 1, 0] < value:
                if at < out.shape[0]:
                    out[at] = out[at - 1]
                at -= 1
            if at < out.shape[0]:
                out[at, 0], out[at, 1], out[at, 2] = value, a, c
                count = min(count + 1, out.shape[0])
    return count


@numba.njit(cache=True)
def _refined(
    points: Array, bottom: float, slope: float, x: float, tolerance: float
) -> tuple[float, float, int]:
    """Weighted least-squares line through the points near a Hough cell, twice narrowed.

    Returns X at the bottom, slope and the number of rows with a point on the line, 0 for none.
    Points must be ordered by row.
    """
    for turn in range(2):
        reach = 2.5 * tolerance if turn == 0 else tolerance
        total, sum_u, sum_v, sum_vv, sum_uv = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(points.shape[0]):
            v = points[i, 1] - bottom
            if abs(points[i, 0] - x - slope * v) < reach:
                w, u = points[i, 2], points[i, 0]
                total += w
                sum_u += w * u
                sum_v += w * v
                sum_vv += w * v * v
                sum_uv += w * u * v
        spread = sum_vv - sum_v * sum_v / (total + 1e-12)
        if spread < 1e-6:
            return x, slope, 0
        slope = (sum_uv - sum_u * sum_v / total) / spread
        x = (sum_u - slope * sum_v) / total
    rows, row = 0, -1e9
    for i in range(points.shape[0]):
        v = points[i, 1] - bottom
        if points[i, 3] != row and abs(points[i, 0] - x - slope * v) < tolerance:
            rows += 1
            row = points[i, 3]
    return x, slope, rows


def find_lines(
    points: Array,
    bottom_px: float,
    top_px: float,
    half_width_px: float,
    rows: int,
    tolerance: float,
    vanishing_px: tuple[float, float],
    spread_px: float,
) -> list[Line]:
    """Straight lines through ridge points between two levelled rows, towards the vanishing point.

    Args:
        points: Levelled X and Y, weight, image row, ordered by image row, shape (N, 4).
        bottom_px: Lowest row Y.
        top_px: Highest row Y, smaller than ``bottom_px``.
        half_width_px: Half the image's width; lines start within 1.6 of it.
        rows: How many rows were sampled for points, for the share in ``votes``.
        tolerance: Distance within which a point supports a line, pixels.
        vanishing_px: Expected vanishing point (X, Y), above ``top_px``.
        spread_px: How far to its side lines may pass.
    """
    if len(points) < 8 or rows < 1:
        return []
    votes = np.zeros((_BINS_BOTTOM, _BINS_TOP))
    da, dc = 3.2 * half_width_px / _BINS_BOTTOM, 2.2 * half_width_px / _BINS_TOP
    a0, c0 = -1.6 * half_width_px, -1.1 * half_width_px
    heading, horizon = vanishing_px
    _vote(points, bottom_px, top_px, a0, da, c0, dc, horizon, heading, spread_px, votes)
    found = np.empty((_LINES, 3))
    count = _peaks(votes, 0.12 * rows, 3, found)
    lines: list[Line] = []
    for _, a, c in found[:count]:
        x = a0 + a * da
        slope = (x - (c0 + c * dc)) / (bottom_px - top_px)
        x, slope, on_line = _refined(points, bottom_px, slope, x, tolerance)
        if on_line < 4:
            continue
        line = Line(x, slope, min(1.0, on_line / rows))
        same = any(
            abs(line.bottom_px - other.bottom_px) < tolerance
            and abs(line.slope - other.slope) * (bottom_px - top_px) < 2 * tolerance
            for other in lines
        )
        if not same:
            lines.append(line)
    return lines


def pairs_of(lines: list[Line], bottom_px: float, prior: Prior, limit: int = 3) -> list[Pair]:
    """The most credible ego-rail pairs among the lines, best first.

    Args:
        lines: Lines of :func:`find_lines`.
        bottom_px: Row Y their ``bottom_px`` refers to.
        prior: What is known beforehand; each term is capped, so that strong evidence can
            overrule a weak prior but never a prior by five standard deviations.
        limit: How many pairs to return at most.
    """
    pairs: list[Pair] = []
    for first in lines:
        for second in lines:
            if first.bottom_px >= second.bottom_px:
                continue
            pair = pair_of(first, second, bottom_px, prior)
            if pair is not None:
                pairs.append(pair)
    return sorted(pairs, key=lambda p: -p.score)[:limit]


def lone_pairs(lines: list[Line], bottom_px: float, prior: Prior, limit: int = 3) -> list[Pair]:
    """Pairs of which one line alone is seen, best first.

    Where a wiper or a thing hides one rail, or a curve leaves no straight line of it, the other one
    and the camera say where it runs: it meets the seen one at the expected horizon, the expected
    growth aside.

    Args:
        lines: Lines of :func:`find_lines`.
        bottom_px: Row Y their ``bottom_px`` refers to.
        prior: What is known beforehand.
        limit: How many pairs to return at most.
    """
    below = bottom_px - prior.horizon_px
    pairs: list[Pair | None] = []
    for line in lines:
        left, right = (
            Line(line.bottom_px + side * below, line.slope + side, 0.0)
            for side in (-prior.growth, prior.growth)
        )
        pairs += [pair_of(left, line, bottom_px, prior), pair_of(line, right, bottom_px, prior)]
    return sorted((pair for pair in pairs if pair is not None), key=lambda p: -p.score)[:limit]


def pair_of(left: Line, right: Line, bottom_px: float, prior: Prior) -> Pair | None:
    """Weigh two lines as the ego rails; None where they cannot be a track at all."""
    closing = right.slope - left.slope
    if closing < 0.05:
        return None
    below = (right.bottom_px - left.bottom_px) / closing  # rows from the vanishing point down
    horizon = bottom_px - below
    growth = closing
    vanish_x = left.bottom_px - left.slope * below
    aside = (left.slope + right.slope) / 2
    terms = (
        (horizon - prior.horizon_px) / prior.horizon_std_px,
        math.log(growth / prior.growth) / prior.growth_std,
        (aside - prior.aside) / prior.aside_std,
        (vanish_x - prior.heading_px) / prior.heading_std_px,
    )
    if below <= 0 or max(abs(t) for t in terms) > 5.0:
        return None
    score = left.votes + right.votes - 0.12 * sum(t * t for t in terms)
    return Pair(left, right, (vanish_x, horizon), growth, aside, score)
