"""Distortions: stretches where the rails leave the smooth track."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from railinspect.findings.finding import Finding
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


_LONG_ROWS = 8
_ONE_STEP = 0.75
"""A bend over more rows than these rises and falls over more than one: no single step takes this
share of its height."""

_FROM_TOP = 0.6
"""What goes along with another rail jumps back from as far as it got, at least this share of it."""


def find_distortions(track: TrackGeometry, limits: Thresholds) -> list[Finding]:
    """Stretches where the rails leave the smooth track together, or one does by more."""
    profile, path = track.profile, track.path
    assert profile is not None
    assert path is not None
    scale = track.camera.size_wh[0] / 640.0
    metre = profile.metre_px
    rows = len(metre)
    apart = 2.0 * path.half_m[:rows] * path.across_px[:rows]
    told_apart = (apart >= limits.bend_spacing_px * scale)[:, None]
    residual = np.where(told_apart, profile.residual_m * metre[:, None], np.nan)
    everything = residual
    # Where no rail lies on the smooth track any more, the one beside it is no other track's.
    vacant = profile.smooth_peak.max(axis=1) < limits.bend_vacant * profile.peak.min(axis=1)
    unsure = profile.doubtful & ~vacant[:, None]
    residual = np.where(unsure, np.nan, residual)
    # A rail that runs sideways through the image moves far along its rows: noise does so too, and
    # the pixels of a bend count at right angles to it.
    slant = metre / path.across_px[:rows]
    least_px = limits.bend_m * metre
    swing = np.maximum(limits.bend_px * scale, limits.bend_noise * profile.noise_px * slant)
    swing = np.maximum(swing, least_px)
    limit = np.maximum(limits.bend_px * scale * slant, limits.bend_noise * profile.noise_px)
    limit = np.maximum(limit, least_px)
    # A mean over some rows exceeds its limit only where a row does; limits change little by row.
    least = 0.8 * min(1.0, limits.bend_one_rail, limits.ripple_share)
    if not np.any(
        np.abs(everything) >= least * np.minimum(swing, limit)[:, None]
    ):  # NaN compares False
        return []
    smooth = np.stack([_running_mean(everything[:, i], 3) for i in range(2)], axis=1)
    smooth[unsure] = np.nan
    along = np.append(np.diff(profile.chainage_m), 0.0)
    steepest = limits.bend_step_px * scale + limits.bend_slope * along * metre
    # Some doubtful samples may take part here: a short wave's own slant makes it look wide.
    if (ripple := _ripple(everything, profile.doubtful, swing, steepest, limits)) is not None:
        return [_distortion(track, [ripple], ["both rails"], swing, everything, limits)]
    common = smooth.mean(axis=1)  # NaN unless both rails are seen
    together = np.sign(smooth[:, 0]) == np.sign(smooth[:, 1])
    weaker, stronger = np.abs(smooth).min(axis=1), np.abs(smooth).max(axis=1)
    together &= weaker >= np.where(profile.at_switch, limits.switch_agreement, 0.5) * stronger
    gentle = np.full_like(metre, limits.bend_step_px * scale)
    lobes = [
        lobe
        for lobe in _lobes(np.where(together, common, np.nan), limit, limits, profile.chainage_m)
        if not any(_jumps(everything[:, i], lobe, limit, steepest) for i in range(2))
    ]
    kind = ["both rails"] * len(lobes)
    for rail, name in enumerate(("the left rail", "the right rail")):
        own = np.where(together | profile.at_switch | np.isnan(common), np.nan, smooth[:, rail])
        extra = [
            lobe
            for lobe in _lobes(own, limits.bend_one_rail * limit, limits, profile.chainage_m)
            if not _jumps(everything[:, rail], lobe, limit, gentle)
            and np.isfinite(residual[max(0, lobe[0] - 8) : lobe[1] + 9, rail]).all()
        ]
        lobes += extra
        kind += [name] * len(extra)
    if not lobes:
        return []
    return [_distortion(track, lobes, kind, limit, smooth, limits)]


def _ripple(
    residual: Array, doubtful: Bools, limit: Array, steepest: Array, limits: Thresholds
) -> tuple[int, int, int] | None:
    """First and last row and peak of a stretch where both rails swing together.

    The mean product of the two rails' residuals is the square of what they share; what the
    segmentation adds to each by itself averages out. It sees waves too short for a running mean.
    """
    length = limits.ripple_rows
    product = residual[:, 0] * residual[:, 1]
    shared = _running_mean(product, length)
    high = np.sqrt(np.maximum(np.nan_to_num(shared), 0.0)) >= limits.ripple_share * limit
    # A wave turns: within the window both rails must go to both sides.
    half = length // 2
    rows = np.flatnonzero(high[half : len(high) - half - 4]) + half
    for row in rows:
        if doubtful[row - half : row + half + 1].mean() > limits.ripple_doubt:
            continue
        part = residual[row - half : row + half + 1]
        most = np.maximum(steepest[row - half : row + half, None], _ONE_STEP * np.ptp(part, axis=0))
        if np.any(np.abs(np.diff(part, axis=0)) > most):
            continue  # a jump to another track's rail
        if min(part.max(axis=0).min(), (-part.min(axis=0)).min()) >= 0.4 * limit[row]:
            inside = rows[(rows >= row) & (rows <= row + 6 * length)]
            peak = int(row - half + np.argmax(np.abs(part.mean(axis=1))))
            return int(row - half), int(inside.max() + half), peak
    return None


def _jumps(
    residual_px: Array, lobe: tuple[int, int, int], limit: Array, steepest_px: Array
) -> bool:
    """Whether a rail's place jumps by more than any bend could, in or beside a deviation.

    Where another rail crosses or leaves, the measured centre goes along with it and jumps back,
    which may be farther on than the other rail's deviation lasts.
    """
    off = np.flatnonzero(np.abs(residual_px) < 0.5 * limit)
    first, last, _ = lobe
    before, after = off[off < first], off[off > last]
    first = int(before[-1]) if len(before) else 0
    last = int(after[0]) if len(after) else len(residual_px) - 1
    beside = slice(max(0, first - 8), last + 9)
    away = np.abs(residual_px[beside])
    step = np.abs(np.diff(residual_px[beside]))
    most = steepest_px[beside][: len(step)]
    height = float(np.nanmax(np.abs(residual_px[lobe[0] : lobe[1] + 1])))
    if last - first > _LONG_ROWS:
        most = np.minimum(most, max(_ONE_STEP * height, float(np.nanmin(limit))))
    from_top = np.maximum(away[1:], away[:-1]) >= _FROM_TOP * height
    return bool(np.any((step > most) & from_top))  # NaN compares False


def _running_mean(values: Array, length: int) -> Array:
    """Centred mean of ``length`` neighbours; NaN where any is missing."""
    out = np.full_like(values, np.nan)
    if len(values) < length:
        return out
    half = length // 2
    inner = len(values) - 2 * half
    out[half : half + inner] = sum(values[i : i + inner] for i in range(length)) / length
    return out


def _lobes(
    values: Array, limit: Array, limits: Thresholds, chainage_m: Array
) -> list[tuple[int, int, int]]:
    """(first, last, peak) of each one-sided deviation over its limit that is long enough."""
    lobes: list[tuple[int, int, int]] = []
    for sign in (1.0, -1.0):
        over = sign * values > 0.5 * limit
        padded = np.concatenate([[False], over, [False]])
        edges = np.flatnonzero(padded[1:] != padded[:-1])
        for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
            ratio = sign * values[first : last + 1] / limit[first : last + 1]
            peak = int(first + np.argmax(ratio))
            rows = last - first + 1
            length = chainage_m[last] - chainage_m[first]
            high = np.count_nonzero(ratio >= 1.0)
            # A deviation that reaches the end of the sight may be the end itself.
            ends = last >= len(values) - 4
            if (
                high >= 2
                and rows >= limits.bend_rows
                and length >= limits.bend_length_m
                and not ends
            ):
                lobes.append((int(first), int(last), peak))
    return lobes


def _distortion(
    track: TrackGeometry,
    lobes: list[tuple[int, int, int]],
    kind: list[str],
    limit: Array,
    smooth: Array,
    limits: Thresholds,
) -> Finding:
    """One finding for the strongest lobe and those beside it: a ripple has several."""
    profile = track.profile
    assert profile is not None
    excess_of = [float(np.nanmax(np.abs(smooth[lobe[2]])) / limit[lobe[2]]) for lobe in lobes]
    first, last, _ = lobes[int(np.argmax(excess_of))]
    for _ in lobes:  # grow over neighbours until none is near
        for start, end, _ in lobes:
            near, far = profile.chainage_m[[first, last]]
            reach = max(limits.bend_join_m, 0.1 * float(near))
            if profile.chainage_m[start] <= far + reach and profile.chainage_m[end] >= near - reach:
                first, last = min(first, start), max(last, end)
    chosen = [i for i, lobe in enumerate(lobes) if first <= lobe[2] <= last]
    lobes, kind = [lobes[i] for i in chosen], [kind[i] for i in chosen]
    uv = profile.uv[first : last + 1]
    polygon = np.concatenate([uv[:, 0], uv[::-1, 1]])
    heights = [float(np.nanmax(np.abs(smooth[peak]))) for _, _, peak in lobes]
    best = int(np.argmax([h / limit[peak] for h, (_, _, peak) in zip(heights, lobes, strict=True)]))
    peak = lobes[best][2]
    excess = heights[best] / float(limit[peak])
    near, far = float(profile.chainage_m[first]), float(profile.chainage_m[last])
    box = (
        float(polygon[:, 0].min()),
        float(polygon[:, 1].min()),
        float(polygon[:, 0].max()),
        float(polygon[:, 1].max()),
    )
    sight = float(np.clip(profile.peak[first : last + 1].mean(), 0.0, 1.0))
    return Finding(
        type="distortion",
        polygon_uv=polygon,
        box_xyxy=box,
        confidence=float(np.clip(sight * (1.0 - math.exp(-excess)), 0.0, 1.0)),
        foot_uv=uv[0].mean(axis=0),
        evidence=(
            f"{kind[best]} leave the smooth track by {heights[best]:.1f} px "
            f"({heights[best] / profile.metre_px[peak]:.2f} m) between {near:.0f} m and {far:.0f} m"
        ).replace("rail leave", "rail leaves"),
    )
