"""Distortions: stretches where the rails leave the smooth track."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from railinspect.findings.finding import Finding
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


_LONG_ROWS = 8
_ONE_STEP = 0.75
"""A bend over more rows than these rises and falls over more than one: no single step takes this
share of its height."""

_FROM_TOP = 0.6
"""What goes along with another rail jumps back from as far as it got, at least this share of it."""


def find_distortions(
    track: TrackGeometry, limits: Thresholds, share: Array | float = 1.0
) -> list[Finding]:
    """Stretches where the rails leave the smooth track together, or one does by more.

    Args:
        track: The track.
        limits: Thresholds.
        share: What part of the deviation in pixels that a single look needs is enough in each row
            of the profile, 0…1, shape (M,): a closer look sees the rails sharper.
    """
    profile, path = track.profile, track.path
    assert profile is not None
    assert path is not None
    scale = track.camera.size_wh[0] / 640.0
    metre = profile.metre_px
    rows = len(metre)
    apart = 2.0 * path.half_m[:rows] * path.across_px[:rows]
    told_apart = (apart >= limits.bend_spacing_px * scale)[:, None]
    residual = np.where(told_apart, profile.residual_m * metre[:, None], np.nan)
    # A rail that runs sideways through the image moves far along its rows: noise does so too, and
    # the pixels of a bend count at right angles to it.
    slant = metre / path.across_px[:rows]
    least_px = limits.bend_m * metre
    bend_px, noise_px = limits.bend_px * scale * share, profile.noise_px * share
    swing = np.maximum(bend_px, limits.bend_noise * noise_px * slant)
    swing = np.maximum(swing, least_px)
    limit = np.maximum(bend_px * slant, limits.bend_noise * noise_px)
    limit = np.maximum(limit, least_px)
    # A mean over some rows exceeds its limit only where a row does; limits change little by row.
    least = 0.8 * min(1.0, limits.bend_one_rail, limits.ripple_share)
    if not np.any(np.abs(residual) >= (least * np.minimum(swing, limit))[:, None]):  # NaN: False
        return []
    everything = residual
    # Where no rail lies on the smooth track any more, the one beside it is no other track's.
    highest, lowest = np.maximum(*profile.smooth_peak.T), np.minimum(*profile.peak.T)
    vacant = highest < limits.bend_vacant * lowest
    unsure = profile.doubtful & ~vacant[:, None]
    residual = np.where(unsure, np.nan, residual)
    smooth = _running_means(everything, 3)
    smooth[unsure] = np.nan
    steepest = np.full_like(metre, limits.bend_step_px * scale)
    steepest[:-1] += limits.bend_slope * np.diff(profile.chainage_m) * metre[:-1]
    # Some doubtful samples may take part in a wave, whose own slant makes a rail look wide, but not
    # where a rail lies on the smooth track too: what went aside is the other one.
    waves = np.where(
        unsure & (np.abs(everything) > limits.ripple_beside_px * scale), np.nan, everything
    )
    if (ripple := _ripple(waves, profile.doubtful, swing, steepest, limits)) is not None:
        return [_distortion(track, [ripple], ["both rails"], swing, everything, limits)]
    common, alone = _split(smooth, profile.at_switch, limits.switch_agreement)
    gentle = np.full_like(metre, limits.bend_step_px * scale)
    # Where both rails are seen alone and none is left where the track would run, nothing but they
    # themselves can have gone aside, whatever crosses them farther on.
    alone_there = vacant & ~profile.doubtful.any(axis=1) & (np.abs(common) >= limit)
    lobes = [
        lobe
        for lobe in _lobes(common, limit, limits, profile.chainage_m)
        if np.count_nonzero(alone_there[lobe[0] : lobe[1] + 1]) >= limits.bend_sure_rows
        or not any(_jumps(everything[:, i], lobe, limit, steepest) for i in range(2))
    ]
    kind = ["both rails"] * len(lobes)
    for rail, name in enumerate(("the left rail", "the right rail")):
        own = alone[:, rail]
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


@numba.njit(cache=True)
def _split(smooth: Array, at_switch: Bools, agreement: float) -> tuple[Array, Array]:
    """The mean of both rails where they leave the smooth track alike, else what each does alone.

    Nothing, that is NaN, where a rail is not seen; nor does a rail count alone at a switch.
    """
    common, alone = np.full(len(smooth), np.nan), np.full(smooth.shape, np.nan)
    for i in range(len(smooth)):
        left, right = smooth[i, 0], smooth[i, 1]
        if math.isnan(left) or math.isnan(right):
            continue
        least = (agreement if at_switch[i] else 0.5) * max(abs(left), abs(right))
        if np.sign(left) == np.sign(right) and min(abs(left), abs(right)) >= least:
            common[i] = 0.5 * (left + right)
        elif not at_switch[i]:
            alone[i, 0], alone[i, 1] = left, right
    return common, alone


def _ripple(
    residual: Array, doubtful: Bools, limit: Array, steepest: Array, limits: Thresholds
) -> tuple[int, int, int] | None:
    """First and last row and peak of a stretch where both rails swing together.

    The mean product of the two rails' residuals is the square of what they share; what the
    segmentation adds to each by itself averages out. It sees waves too short for a running mean.
    """
    first, last, peak = _swing(
        residual,
        doubtful,
        limit,
        steepest,
        limits.ripple_rows,
        limits.ripple_share,
        limits.ripple_doubt,
    )
    return None if first < 0 else (first, last, peak)


@numba.njit(cache=True)
def _swing(
    residual: Array,
    doubtful: Bools,
    limit: Array,
    steepest: Array,
    length: int,
    share: float,
    doubt: float,
) -> tuple[int, int, int]:
    """What :func:`_ripple` looks for over ``length`` rows; first is −1 where there is none."""
    shared = _running_mean(residual[:, 0] * residual[:, 1], length)
    half = length // 2
    first, last, peak = -1, -1, -1
    for row in range(half, len(shared) - half - 4):
        if not math.sqrt(max(shared[row], 0.0)) >= share * limit[row]:  # NaN compares False
            continue
        if first >= 0:
            if row <= first + half + 6 * length:
                last = row + half
            continue
        # A wave turns: within the window both rails must go to both sides.
        part = residual[row - half : row + half + 1]
        if np.sum(doubtful[row - half : row + half + 1]) > doubt * part.size:
            continue
        if _leaps(part, steepest[row - half : row + half]):
            continue  # a jump to another track's rail
        swing = min(part[:, 0].max(), part[:, 1].max(), -part[:, 0].min(), -part[:, 1].min())
        if swing >= 0.4 * limit[row]:
            first, last = row - half, row + half
            peak = first + int(np.argmax(np.abs(part[:, 0] + part[:, 1])))
    return first, last, peak


@numba.njit(cache=True)
def _leaps(part: Array, steepest: Array) -> bool:
    """Whether one step from row to row is more than any bend's, or most of the whole swing."""
    for rail in range(2):
        swing = part[:, rail].max() - part[:, rail].min()
        for i in range(len(steepest)):
            most = max(steepest[i], _ONE_STEP * swing)
            if abs(part[i + 1, rail] - part[i, rail]) > most:
                return True
    return False


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


@numba.njit(cache=True)
def _running_means(both: Array, length: int) -> Array:
    """Centred means of ``length`` neighbours of each of two columns."""
    means = np.empty(both.shape)
    for i in range(2):
        means[:, i] = _running_mean(both[:, i], length)
    return means


@numba.njit(cache=True)
def _running_mean(values: Array, length: int) -> Array:
    """Centred mean of ``length`` neighbours; NaN where any is missing."""
    out = np.full(len(values), np.nan)
    half = length // 2
    for i in range(half, len(values) - half):
        total = 0.0
        for j in range(i - half, i - half + length):
            total += values[j]
        out[i] = total / length
    return out


def _lobes(
    values: Array, limit: Array, limits: Thresholds, chainage_m: Array
) -> list[tuple[int, int, int]]:
    """(first, last, peak) of each one-sided deviation over its limit that is long enough."""
    return [
        (first, last, peak)
        for sign in (1.0, -1.0)
        for first, last, peak, high in _humps(sign * values / limit).tolist()
        # A deviation that reaches the end of the sight may be the end itself.
        if high >= 2
        and last - first + 1 >= limits.bend_rows
        and chainage_m[last] - chainage_m[first] >= limits.bend_length_m
        and last < len(values) - 4
    ]


@numba.njit(cache=True)
def _humps(ratio: Array) -> Indices:
    """First, last and highest row of each run above a half, and how many reach 1; (N, 4)."""
    humps = np.empty((len(ratio) // 2 + 1, 4), np.intp)
    count, i = 0, 0
    while i < len(ratio):
        if not ratio[i] > 0.5:  # NaN compares False
            i += 1
            continue
        first, peak, high = i, i, 0
        while i < len(ratio) and ratio[i] > 0.5:
            peak = i if ratio[i] > ratio[peak] else peak
            high += ratio[i] >= 1.0
            i += 1
        humps[count, 0], humps[count, 1] = first, i - 1
        humps[count, 2], humps[count, 3] = peak, high
        count += 1
    return humps[:count]


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
