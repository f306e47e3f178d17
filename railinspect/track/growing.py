"""Region growing: follow both rails upwards through the image as one track on the ground.

The windows of the source's (43) grow from the beginning points and take the next window's
direction from the local Hough line. Here each window lies on the ground plane, spans both rails at
once and carries offset, heading and curvature from window to window in a Kalman filter, so a
curve is followed, a hole is crossed, and a neighbouring track or a switch's other leg, which fits
neither the spacing nor the curvature, does not capture the growing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from railinspect.track.level import Level, inside, project, sample_line, x_at
from railinspect.track.settings import FollowerSettings

Array = npt.NDArray[np.float64]

# Columns of a grown node.
S, X, Y, PSI, KAPPA, HALF, LEFT, RIGHT, SIGMA = range(9)

# Why the growing stopped.
NO_BEGIN, LOST, ONE_RAIL, MERGED, HORIZON, TURNED, OUTSIDE, FAR, FULL = range(9)

_MAX_NODES, _MAX_ROWS, _MAX_SHIFTS, _SLOPES = 160, 12, 81, 5


@dataclass(frozen=True)
class Growth:
    """Nodes of a grown track.

    Attributes:
        nodes: One row per window: rows below the horizon, x, y (m), heading (rad), curvature
            (1/m), half the rail spacing (m), mean rail probability left and right (0..1, −1
            outside the image), standard deviation of the lateral position (m). Shape (N, 9).
        last: Number of nodes up to the last one where a rail was seen.
        stop: Why the growing stopped, one of this module's codes.
        support: Mean probability of both rails over the rows between bottom and horizon.
    """

    nodes: Array
    last: int
    stop: int
    support: float


@numba.njit(cache=True)
def _sample(
    score: npt.NDArray[np.uint8],
    cam: Array,
    x: float,
    y: float,
    nx: float,
    ny: float,
    reach: float,
    steps: int,
    out: Array,
) -> bool:
    """Grey values along the normal through one ground point; True if inside the image."""
    u0, v0 = project(cam, x - reach * nx, y - reach * ny)
    u1, v1 = project(cam, x + reach * nx, y + reach * ny)
    sample_line(score, u0, v0, u1 - u0, v1 - v0, 0, steps - 1, out[:steps])
    middle = (steps // 2) / (steps - 1)
    rows, cols = score.shape
    return inside(rows, cols, u0 + middle * (u1 - u0), v0 + middle * (v1 - v0))


@numba.njit(cache=True)
def _top(profile: Array, first: int, last: int) -> tuple[float, float]:
    """Sub-sample position and height of the highest value in [first, last]."""
    best, centre = -1.0, 0.5 * (first + last)
    at = first
    for i in range(first, last + 1):
        if profile[i] > best + 1e-12 or (
            abs(profile[i] - best) <= 1e-12 and abs(i - centre) < abs(at - centre)
        ):
            best, at = profile[i], i
    where = float(at)
    if 0 < at < profile.shape[0] - 1:
        a, b, c = profile[at - 1], profile[at], profile[at + 1]
        bend = a - 2.0 * b + c
        if bend < -1e-9:
            where += min(0.5, max(-0.5, 0.5 * (a - c) / bend))
    return where, best


@numba.njit(cache=True)
def _grow(
    score: npt.NDArray[np.uint8],
    cam: Array,
    start: Array,
    std: Array,
    half: float,
    s_first: float,
    step_px: float,
    search_px: float,
    seen: float,
    walk: float,
    shrink: float,
    gap_m: float,
    gap_share: float,
    near_gap: float,
    min_spacing: float,
    s_least: float,
    max_reach: float,
    nodes: Array,
) -> tuple[int, int, int]:
    """Grow from ``start`` (x, y, ψ, κ); return nodes written, nodes up to the last seen, stop."""
    cols_n = score.shape[1]
    x, y, psi, kappa = start[0], start[1], start[2], start[3]
    p = np.zeros((3, 3))
    for i in range(3):
        p[i, i] = std[i] * std[i]
    half0, half_var = half, (0.02 * half) ** 2
    left_profiles = np.zeros((_MAX_ROWS, _MAX_SHIFTS))
    right_profiles = np.zeros((_MAX_ROWS, _MAX_SHIFTS))
    left_sum, right_sum = np.zeros(_MAX_SHIFTS), np.zeros(_MAX_SHIFTS)
    left_best, right_best = np.zeros(_MAX_SHIFTS), np.zeros(_MAX_SHIFTS)
    smooth = np.zeros(_MAX_SHIFTS)
    drift = np.zeros(_MAX_ROWS)
    count, last, ever = 0, 0, False
    gap_from, one_from = -1.0, -1.0
    s_from = s_first
    while True:
        if count >= nodes.shape[0]:
            return count, last, 8
        s_to = min(s_from * shrink, s_from - 2.0)
        if s_to < s_least:
            return count, last, 4
        s_mid = 0.5 * (s_from + s_to)
        # Move the state from the last node to this window's middle.
        cos_psi = math.cos(psi)
        if cos_psi < 0.5:
            return count, last, 5
        t = (x_at(cam, s_mid) - x) / cos_psi
        for _ in range(2):  # the arc that ends at the wanted x
            t += (x_at(cam, s_mid) - (x + t * math.cos(psi + 0.5 * kappa * t))) / cos_psi
        x += t * math.cos(psi + 0.5 * kappa * t)
        y += t * math.sin(psi + 0.5 * kappa * t)
        psi += kappa * t
        a = abs(t)
        f01, f02 = t, 0.5 * t * t
        p00 = p[0, 0] + 2 * f01 * p[0, 1] + 2 * f02 * p[0, 2] + f01 * f01 * p[1, 1]
        p00 += 2 * f01 * f02 * p[1, 2] + f02 * f02 * p[2, 2]
        p01 = p[0, 1] + f01 * p[1, 1] + f02 * p[1, 2] + t * (p[0, 2] + f01 * p[1, 2])
        p01 += t * f02 * p[2, 2]
        p02 = p[0, 2] + f01 * p[1, 2] + f02 * p[2, 2]
        p11 = p[1, 1] + 2 * t * p[1, 2] + t * t * p[2, 2]
        p12 = p[1, 2] + t * p[2, 2]
        q = walk * walk
        p[0, 0] = p00 + q * a**5 / 20
        p[0, 1] = p[1, 0] = p01 + q * a**4 / 8
        p[0, 2] = p[2, 0] = p02 + q * a**3 / 6
        p[1, 1] = p11 + q * a**3 / 3
        p[1, 2] = p[2, 1] = p12 + q * a * a / 2
        p[2, 2] += q * a
        half_var += (0.012 * half) ** 2
        if x > max_reach:
            return count, last, 7
        # Where the window lies in the image, and whether its rails can be told apart.
        nx, ny = -math.sin(psi), math.cos(psi)
        ul, vl = project(cam, x + half * nx, y + half * ny)
        ur, vr = project(cam, x - half * nx, y - half * ny)
        ahead = 0.05 * x
        ua, va = project(cam, x + ahead * math.cos(psi), y + ahead * math.sin(psi))
        um, vm = project(cam, x, y)
        length = math.hypot(ua - um, va - vm) + 1e-9
        across = abs((ur - ul) * (va - vm) - (vr - vl) * (ua - um)) / length
        if across < min_spacing:
            return count, last, 3
        if not (0.0 <= um < cols_n and vm >= 0.0):
            return count, last, 6
        metre = math.hypot(ur - ul, vr - vl) / (2.0 * half)  # pixels per metre across
        # Lateral search range and sampling.
        noise = 0.8 * 2.0 * step_px / metre
        sigma = math.sqrt(p[0, 0] + noise * noise)
        reach = max(search_px / metre, 3.0 * math.sqrt(p[0, 0]))
        reach = min(reach, 0.9 * half, 20.0 / metre * 2.0 * step_px)
        steps = 2 * math.ceil(reach * metre / step_px) + 1
        steps = max(7, min(_MAX_SHIFTS, steps))
        grid = 2.0 * reach / (steps - 1)
        n_rows = max(3, min(_MAX_ROWS, round(s_from - s_to) + 1))
        left_in, right_in = 0, 0
        for j in range(n_rows):
            s_j = s_from + (s_to - s_from) * (j + 0.5) / n_rows
            t_j = (x_at(cam, s_j) - x) / math.cos(psi)
            drift[j] = t_j
            psi_j = psi + kappa * t_j
            xc = x + t_j * math.cos(psi + 0.5 * kappa * t_j)
            yc = y + t_j * math.sin(psi + 0.5 * kappa * t_j)
            nxj, nyj = -math.sin(psi_j), math.cos(psi_j)
            if xc < 0.3:
                left_profiles[j, :] = 0.0
                right_profiles[j, :] = 0.0
                continue
            if _sample(
                score,
                cam,
                xc + half * nxj,
                yc + half * nyj,
                nxj,
                nyj,
                reach,
                steps,
                left_profiles[j],
            ):
                left_in += 1
            if _sample(
                score,
                cam,
                xc - half * nxj,
                yc - half * nyj,
                nxj,
                nyj,
                reach,
                steps,
                right_profiles[j],
            ):
                right_in += 1
        # Local Hough transform over shift and drift, both rails jointly, with the filter's
        # expectation as prior.
        best, best_shift = -1e9, 0.0
        half_span = 0.5 * abs(drift[n_rows - 1] - drift[0]) + 1e-9
        mid = steps // 2
        for k in range(_SLOPES):
            lean = (k - _SLOPES // 2) * 2.0 * step_px / metre / half_span
            if k == _SLOPES // 2 or abs(lean) < 3.0 * math.sqrt(p[1, 1]) + 0.02:
                for i in range(steps):
                    left_sum[i], right_sum[i] = 0.0, 0.0
                for j in range(n_rows):
                    off = round(lean * drift[j] / grid)
                    for i in range(max(0, -off), min(steps, steps - off)):
                        left_sum[i] += left_profiles[j, i + off]
                        right_sum[i] += right_profiles[j, i + off]
                for i in range(steps):
                    lo, hi = max(0, i - 1), min(steps - 1, i + 1)
                    le = (left_sum[lo] + 2 * left_sum[i] + left_sum[hi]) / (4.0 * n_rows)
                    ri = (right_sum[lo] + 2 * right_sum[i] + right_sum[hi]) / (4.0 * n_rows)
                    e = (i - mid) * grid / sigma
                    value = 0.5 * (le + ri) + 0.3 * min(le, ri) - 0.03 * e * e
                    value -= 0.005 * abs(k - _SLOPES // 2)
                    if value > best + 1e-12 or (
                        abs(value - best) <= 1e-12 and abs(i - mid) < abs(best_shift)
                    ):
                        best, best_shift = value, float(i - mid)
                        for m in range(steps):
                            left_best[m] = left_sum[m] / n_rows
                            right_best[m] = right_sum[m] / n_rows
        # Each rail's own position near the joint one.
        at = int(best_shift) + mid
        slack = round(max(2.0, 1.5 * 2.0 * step_px / metre / grid, 0.06 / grid))
        lo, hi = max(0, at - slack), min(steps - 1, at + slack)
        for i in range(steps):
            smooth[i] = (
                left_best[max(0, i - 1)] + 2 * left_best[i] + left_best[min(steps - 1, i + 1)]
            ) / 4.0
        where_left, high_left = _top(smooth[:steps], lo, hi)
        for i in range(steps):
            smooth[i] = (
                right_best[max(0, i - 1)] + 2 * right_best[i] + right_best[min(steps - 1, i + 1)]
            ) / 4.0
        where_right, high_right = _top(smooth[:steps], lo, hi)
        e_left, e_right = (where_left - mid) * grid, (where_right - mid) * grid
        has_left, has_right = high_left >= seen, high_right >= seen
        if gap_from >= 0.0 and not (has_left and has_right):
            has_left = has_right = False  # after a hole only a whole track counts
        node = nodes[count]
        measured, shift = has_left or has_right, 0.0
        if has_left and has_right:
            shift = 0.5 * (e_left + e_right)
            gain = half_var / (half_var + 0.5 * noise * noise)
            half += gain * 0.5 * (e_left - e_right)
            half_var *= 1.0 - gain
            half = min(1.5 * half0, max(0.67 * half0, half))
        elif has_left:
            shift, noise = e_left, 2.0 * noise
        elif has_right:
            shift, noise = e_right, 2.0 * noise
        if measured:
            innovation = p[0, 0] + noise * noise
            g0, g1, g2 = p[0, 0] / innovation, p[0, 1] / innovation, p[0, 2] / innovation
            x += g0 * shift * nx
            y += g0 * shift * ny
            psi += g1 * shift
            kappa += g2 * shift
            row0, row1, row2 = p[0, 0], p[0, 1], p[0, 2]
            p[0, 0] -= g0 * row0
            p[0, 1] -= g0 * row1
            p[0, 2] -= g0 * row2
            p[1, 1] -= g1 * row1
            p[1, 2] -= g1 * row2
            p[2, 2] -= g2 * row2
            p[1, 0], p[2, 0], p[2, 1] = p[0, 1], p[0, 2], p[1, 2]
        node[0], node[1], node[2], node[3], node[4], node[5] = s_mid, x, y, psi, kappa, half
        node[6] = high_left if 2 * left_in >= n_rows else -1.0
        node[7] = high_right if 2 * right_in >= n_rows else -1.0
        if gap_from >= 0.0 and not measured:  # nothing between the last sight and here
            node[6], node[7] = min(node[6], 0.0), min(node[7], 0.0)
        node[8] = math.sqrt(max(0.0, p[0, 0]))
        count += 1
        # Holes.
        if measured:
            gap_from = -1.0
            ever = True
            last = count
        elif gap_from < 0.0:
            gap_from = x
        one = measured and not (has_left and has_right) and node[6] >= 0 and node[7] >= 0
        if not one:
            one_from = -1.0
        elif one_from < 0.0:
            one_from = x
        if not ever:
            gap_from = -1.0
            if s_to < s_first * (1.0 - near_gap):
                return count, 0, 0
        elif gap_from >= 0.0 and x - gap_from > min(gap_m, gap_share * gap_from):
            return count, last, 1
        elif one_from >= 0.0 and x - one_from > min(gap_m, gap_share * one_from):
            return count, last, 2
        s_from = s_to


def grow(
    score: npt.NDArray[np.uint8],
    level: Level,
    start: tuple[float, float, float, float],
    std: tuple[float, float, float],
    half_m: float,
    s_first_px: float,
    settings: FollowerSettings,
) -> Growth:
    """Grow a track from its beginning.

    Args:
        score: Soft rail probability, shape (H, W).
        level: Levelled view with this frame's horizon.
        start: x, y (m), heading (rad) and curvature (1/m) at the beginning.
        std: Standard deviations of lateral position, heading and curvature there.
        half_m: Half the spacing of the rails in this view's metres.
        s_first_px: Rows below the horizon where the first window begins.
        settings: Tuning.
    """
    scale = score.shape[1] / 640.0
    nodes = np.zeros((_MAX_NODES, 9))
    count, last, stop = _grow(
        score,
        level.vector,
        np.array(start),
        np.array(std),
        half_m,
        s_first_px,
        settings.step_px * scale,
        settings.search_px * scale,
        settings.seen,
        settings.curvature_walk,
        settings.shrink,
        settings.gap_m,
        settings.gap_share,
        settings.near_gap,
        settings.min_spacing_px * scale,
        2.5 * scale,
        settings.max_reach_m,
        nodes,
    )
    grown = nodes[:count]
    support = 0.0
    if last:
        kept = grown[:last]
        heights = np.append(s_first_px, kept[:-1, S]) - kept[:, S]
        sight = np.maximum(kept[:, LEFT], 0) + np.maximum(kept[:, RIGHT], 0)
        support = float(heights @ sight / (2 * s_first_px))
    return Growth(grown, int(last), int(stop), support)
