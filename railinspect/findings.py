"""What is wrong with the track in one frame: distorted rails, things on it, people on it.

Nothing here reads the input image: findings come from the segmentation's classes and from the
track's geometry, in metres on the plane of the rails. A frame whose track is not followed may
still have findings; without any it is unknown, not clear (``TrackGeometry.followed``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.labels import CLASSES, GROUND, HUMAN, ON_RAILS, RAILS
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import SegmentationLike, TrackGeometry, TrackPath

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

FindingType = Literal["distortion", "obstruction", "trespasser"]


@dataclass(frozen=True)
class Finding:
    """One anomaly in one frame.

    Attributes:
        type: What it is.
        polygon_uv: Its outline, input pixels, shape (K, 2).
        box_xyxy: Its box, input pixels.
        confidence: 0 to 1.
        foot_uv: Where it meets the ground on the track, input pixels, shape (2,).
        evidence: What was measured, in words with units.
    """

    type: FindingType
    polygon_uv: Array
    box_xyxy: tuple[float, float, float, float]
    confidence: float
    foot_uv: Array
    evidence: str


def find(
    segmentation: SegmentationLike, track: TrackGeometry, thresholds: Thresholds | None = None
) -> tuple[Finding, ...]:
    """Judge one frame.

    Args:
        segmentation: Masks of the frame.
        track: The track in it, from the same masks.
        thresholds: Limits; defaults are stated there.

    Returns:
        Findings, nearest first; none without a path.
    """
    if track.path is None or track.profile is None or len(track.path.uv) < 4:
        return ()
    thresholds = thresholds or Thresholds()
    found = _things(segmentation, track, thresholds)
    found += _distortions(track, thresholds)
    found += _interruptions(segmentation, track, thresholds, found)
    return tuple(sorted(found, key=lambda f: -f.foot_uv[1]))


# Place on the track


def track_coordinates(
    path: TrackPath, world_xy: Array
) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Chainage and lateral position of ground points against the track.

    The lateral position is scaled so that the rails, as seen on the plane, lie where the nearest
    rails lie: a gradient or an error of the horizon then does not move things off the track.

    Args:
        path: The centre line.
        world_xy: Ground points, metres, shape (N, 2).

    Returns:
        Chainage (m), lateral position (m, positive left) and index of the nearest sample, (N,).
    """
    x = world_xy[:, 0]
    at: npt.NDArray[np.intp] = np.clip(np.searchsorted(path.xy_m[:, 0], x), 0, len(x_of(path)) - 1)
    along = np.zeros(len(x))
    across = np.zeros(len(x))
    for _ in range(3):
        cos, sin = np.cos(path.heading_rad[at]), np.sin(path.heading_rad[at])
        d = world_xy - path.xy_m[at]
        along = d[:, 0] * cos + d[:, 1] * sin
        across = -d[:, 0] * sin + d[:, 1] * cos
        at = np.clip(
            np.searchsorted(path.chainage_m, path.chainage_m[at] + along), 0, len(x_of(path)) - 1
        )
    cos, sin = np.cos(path.heading_rad[at]), np.sin(path.heading_rad[at])
    d = world_xy - path.xy_m[at]
    along = d[:, 0] * cos + d[:, 1] * sin
    across = -d[:, 0] * sin + d[:, 1] * cos
    nearest = float(np.median(path.half_m[: max(3, len(path.half_m) // 4)]))
    return path.chainage_m[at] + along, across * nearest / path.half_m[at], at


def x_of(path: TrackPath) -> Array:
    """World x of the path's samples."""
    return path.xy_m[:, 0]


# Things and people


def _things(
    segmentation: SegmentationLike, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """Foreign regions whose foot stands inside the clearance envelope."""
    path = track.path
    assert path is not None
    labels = segmentation.labels
    width = labels.shape[1]
    scale = width / 640.0
    reach = limits.reach_share * (track.reach_m or 0.0) + 1.0
    used = path.chainage_m <= reach
    if np.count_nonzero(used) < 2:
        return []
    # Rows the envelope can occupy; the thing itself may stand up above them.
    first = max(0, int(np.nanmin(path.uv[used, 1])) - 1)
    table = np.zeros(256, np.uint8)
    table[list(limits.foreign)] = 1
    table[HUMAN] = 2
    kind = cv2.LUT(labels, table)
    found: list[Finding] = []
    for code, clearance in ((2, limits.person_clearance_m), (1, limits.clearance_m)):
        # People hide things and things hide people: neither ends in a foot on the other.
        mask = (kind == code).astype(np.uint8)
        if not mask[first:].any():
            continue
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8))
        below = np.zeros_like(kind)
        below[:-1] = kind[1:]
        contact = (mask[first:] == 1) & (below[first:] == 0)
        below_mask = np.zeros_like(mask)
        below_mask[:-1] = mask[1:]
        contact &= below_mask[first:] == 0
        rows, cols = np.nonzero(contact)
        if len(rows) == 0:
            continue
        rows = rows + first
        feet = np.stack([cols, rows + 0.5], axis=1).astype(float)
        chainage, lateral, _ = place_on_track(track, feet)
        # Feet stand on the bed, below the plane of the rail tops: a little farther out.
        lateral *= 1.0 - limits.foot_m / track.camera.height_m
        near = np.isfinite(lateral) & (chainage <= reach) & (np.abs(lateral) <= clearance + 3.0)
        if not np.any(near & (np.abs(lateral) <= clearance)):
            continue
        _, components = cv2.connectedComponents(mask, connectivity=8)
        component = components[rows, cols]
        inside = near & (np.abs(lateral) <= clearance)
        for number in np.unique(component[inside]):
            part = near & (component == number)
            region = components == number
            found += _feet(
                segmentation,
                track,
                limits,
                code,
                clearance,
                scale,
                region,
                feet[part],
                chainage[part],
                lateral[part],
            )
    return found


def place_on_track(track: TrackGeometry, uv: Array) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Chainage, lateral position and nearest sample of ground pixels; NaN above the horizon."""
    path = track.path
    assert path is not None
    world = track.camera.ground(track.camera.undistort(uv))
    lost: npt.NDArray[np.bool_] = ~np.isfinite(world[:, 0] + world[:, 1])
    chainage, lateral, at = track_coordinates(path, np.where(lost[:, None], 1.0, world))
    lateral[lost] = np.nan
    chainage[lost] = np.inf
    return chainage, lateral, at


def _feet(
    segmentation: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
    code: int,
    clearance: float,
    scale: float,
    region: Bools,
    feet: Array,
    chainage: Array,
    lateral: Array,
) -> list[Finding]:
    """Split a region's contact with the ground into foot lines and judge each."""
    # The lowest contact of each column is the foot; one above it is a hole's upper edge.
    order = np.lexsort((-feet[:, 1], feet[:, 0]))
    feet, chainage, lateral = feet[order], chainage[order], lateral[order]
    lowest = np.concatenate([[True], feet[1:, 0] != feet[:-1, 0]])
    feet, chainage, lateral = feet[lowest], chainage[lowest], lateral[lowest]
    step = np.abs(np.diff(feet[:, 1]))
    tolerance = np.maximum(3.0 * scale, 0.06 * np.abs(feet[1:, 1] - track.camera.horizon_v()))
    cut = np.flatnonzero((np.diff(feet[:, 0]) > 2.0 * scale + 1) | (step > tolerance)) + 1
    parts = np.split(np.arange(len(feet)), cut)
    bases = [_base(track, limits, feet, part, parts) for part in parts]
    found: list[Finding] = []
    for number, part in enumerate(parts):
        inside = part[np.abs(lateral[part]) <= clearance]
        if len(inside) == 0 or bases[number] is not None:
            continue
        # What hangs over beside the foot belongs to the body: an animal on its legs.
        body = [part] + [other for i, other in enumerate(parts) if bases[i] is part]
        columns = feet[np.concatenate(body), 0]
        finding = _judge(
            segmentation,
            track,
            limits,
            code,
            clearance,
            scale,
            region,
            feet[part],
            feet[inside],
            chainage[inside],
            lateral[inside],
            (int(columns.min()), int(columns.max())) if len(body) > 1 else None,
        )
        if finding is not None:
            found.append(finding)
    return _one_thing(track, found)


def _one_thing(track: TrackGeometry, found: list[Finding]) -> list[Finding]:
    """Join feet of one region that stand side by side: two legs, a stone with a hollow below."""
    path = track.path
    assert path is not None
    joined: list[Finding] = []
    for finding in sorted(found, key=lambda f: f.box_xyxy[0]):
        if joined:
            last = joined[-1]
            row = max(last.box_xyxy[3], finding.box_xyxy[3])
            metre = float(np.interp(row, path.uv[::-1, 1], path.metre_px[::-1]))
            apart = finding.box_xyxy[0] - last.box_xyxy[2]
            lift = abs(last.box_xyxy[3] - finding.box_xyxy[3])
            if apart < 1.5 * metre and lift < 0.4 * metre:
                joined[-1] = _union(last, finding)
                continue
        joined.append(finding)
    return joined


def _union(one: Finding, two: Finding) -> Finding:
    """Two findings as one, named after the surer of them."""
    points = np.concatenate([one.polygon_uv, two.polygon_uv]).astype(np.float32)
    hull = cv2.convexHull(points.reshape(-1, 1, 2)).reshape(-1, 2).astype(float)
    surer = one if one.confidence >= two.confidence else two
    nearer = one if one.foot_uv[1] >= two.foot_uv[1] else two
    low, high = hull.min(axis=0), hull.max(axis=0)
    return replace(
        surer,
        polygon_uv=hull,
        box_xyxy=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        foot_uv=nearer.foot_uv,
    )


def _base(
    track: TrackGeometry, limits: Thresholds, feet: Array, part: Indices, parts: list[Indices]
) -> Indices | None:
    """The foot line a foot line hangs over, as an overhanging part of something nearer."""
    path = track.path
    assert path is not None
    bottom = float(feet[part, 1].max())
    best: tuple[float, Indices] | None = None
    for other in parts:
        near = other[np.argmin(np.abs(feet[other, 0] - feet[part, 0].mean()))]
        base = float(feet[near, 1])
        if other is part or base <= bottom:
            continue
        metre = float(np.interp(base, path.uv[::-1, 1], path.metre_px[::-1]))
        if np.ptp(feet[part, 0]) > limits.overhang_width_m * metre:
            continue  # too wide for an arm
        aside = float(np.abs(feet[near, 0] - feet[part, 0]).min()) / metre
        near = (base - bottom) / metre < limits.overhang_m and aside < limits.overhang_m
        if near and (best is None or base > best[0]):
            best = (base, other)
    return None if best is None else best[1]


def _judge(
    segmentation: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
    code: int,
    clearance: float,
    scale: float,
    region: Bools,
    foot_line: Array,
    inside: Array,
    chainage: Array,
    lateral: Array,
    columns_uv: tuple[int, int] | None,
) -> Finding | None:
    """Accept or reject one foot line."""
    path = track.path
    assert path is not None
    lowest = int(np.argmax(inside[:, 1]))
    range_m = float(chainage[lowest])
    metre = float(np.interp(range_m, path.chainage_m, path.metre_px))
    pixel_m = 1.0 / metre
    width_m = float(np.ptp(lateral)) + pixel_m
    deep = clearance - float(np.abs(lateral).min())
    share = len(inside) / len(foot_line)
    across = float(np.interp(range_m, path.chainage_m, path.across_px))
    if len(inside) < limits.least_foot_px * scale:
        return None
    if deep < limits.deep_m or deep * across < limits.deep_px * scale:
        return None
    if share < limits.inside_share and width_m < limits.wide_m:
        return None
    inner = float(np.abs(lateral).min())
    along = float(np.ptp(chainage))
    if code == 1 and inner > limits.core_m and along > max(limits.along_m, 3.0 * width_m):
        return None  # runs along the track: a platform's edge, a wall, a cable trough
    # The body above the foot: the region's pixels in its columns, up to the region's top.
    first, last = columns_uv or (int(inside[:, 0].min()), int(inside[:, 0].max()))
    width_m = max(width_m, (last - first + 1) * pixel_m)
    base = int(inside[:, 1].max())
    columns = region[: base + 1, first : last + 1]
    rows = np.flatnonzero(columns.any(axis=1))
    # Follow the body upwards until it ends.
    holes = np.flatnonzero(np.diff(rows[::-1]) < -3)
    top = int(rows[::-1][holes[0]] if len(holes) else rows[0])
    body = columns[top:]
    area = float(np.count_nonzero(body))
    height_m = (base - top + 1) * pixel_m
    least_height = limits.person_height_m if code == 2 else limits.least_height_m
    least_width = 0.0 if code == 2 else limits.least_width_m
    if area < limits.least_area_px * scale**2 or height_m < least_height or width_m < least_width:
        return None
    v, u = np.nonzero(body)
    points = np.stack([u + first, v + top], axis=1).astype(np.float32)
    polygon = cv2.convexHull(points.reshape(-1, 1, 2)).reshape(-1, 2).astype(float)
    classes = segmentation.labels[top : base + 1, first : last + 1][body]
    name = CLASSES[int(np.bincount(classes[classes < len(CLASSES)], minlength=1).argmax())]
    sure = float(segmentation.confidence[top : base + 1, first : last + 1][body].mean()) / 255
    if sure < limits.least_confidence:
        return None
    size = min(1.0, area / (6.0 * limits.least_area_px * scale**2))
    known = 1.0 if track.followed and range_m <= (track.reach_m or 0.0) * 1.05 else 0.8
    middle = float(lateral.mean())
    side = "left" if middle > 0 else "right"
    kind: FindingType = "trespasser" if code == 2 else "obstruction"
    what = "person" if code == 2 else f"{name} region"
    if code == 1 and name == CLASSES[ON_RAILS]:
        what = "rail vehicle on the ego track"
    return Finding(
        type=kind,
        polygon_uv=polygon,
        box_xyxy=(float(first), float(top), float(last), float(base)),
        confidence=float(np.clip(sure * (0.5 + 0.5 * size) * known, 0.0, 1.0)),
        foot_uv=np.array([float(inside[:, 0].mean()), float(inside[lowest, 1])]),
        evidence=(
            f"{what}, {width_m:.1f} m wide and {height_m:.1f} m high, its foot {abs(middle):.1f} m "
            f"{side} of the centre line at about {range_m:.0f} m"
        ),
    )


# Distorted rails


def _distortions(track: TrackGeometry, limits: Thresholds) -> list[Finding]:
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
    residual = np.where(profile.doubtful, np.nan, residual)
    limit = np.maximum(limits.bend_px * scale, limits.bend_m * metre)
    limit = np.maximum(limit, limits.bend_noise * profile.noise_px)
    smooth = np.stack([_running_mean(residual[:, i], 3) for i in range(2)], axis=1)
    # Doubtful samples may take part here: another track's rail moves one of ours, or both to one
    # side, but never both to and fro.
    if (ripple := _ripple(everything, limit, limits)) is not None:
        return [_distortion(track, [ripple], ["both rails"], limit, everything, limits)]
    common = smooth.mean(axis=1)  # NaN unless both rails are seen
    together = np.sign(smooth[:, 0]) == np.sign(smooth[:, 1])
    together &= np.abs(smooth).min(axis=1) >= 0.5 * np.abs(smooth).max(axis=1)
    lobes = _lobes(np.where(together, common, np.nan), limit, limits, profile.chainage_m)
    kind = ["both rails"] * len(lobes)
    for rail, name in enumerate(("the left rail", "the right rail")):
        own = np.where(together | np.isnan(common), np.nan, smooth[:, rail])
        extra = [
            lobe
            for lobe in _lobes(own, limits.bend_one_rail * limit, limits, profile.chainage_m)
            if _continuous(residual[:, rail], lobe, limits.bend_step_px * scale)
        ]
        lobes += extra
        kind += [name] * len(extra)
    if not lobes:
        return []
    return [_distortion(track, lobes, kind, limit, smooth, limits)]


def _ripple(residual: Array, limit: Array, limits: Thresholds) -> tuple[int, int, int] | None:
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
        part = residual[row - half : row + half + 1]
        if min(part.max(axis=0).min(), (-part.min(axis=0)).min()) >= 0.4 * limit[row]:
            inside = rows[(rows >= row) & (rows <= row + 6 * length)]
            peak = int(row - half + np.argmax(np.abs(part.mean(axis=1))))
            return int(row - half), int(inside.max() + half), peak
    return None


def _continuous(residual_px: Array, lobe: tuple[int, int, int], step_px: float) -> bool:
    """Whether one rail bends out and back without a jump or a hole.

    Where another rail crosses, the measured centre goes along with it and jumps back.
    """
    first, last, _ = lobe
    window = residual_px[max(0, first - 8) : last + 9]
    return bool(np.all(np.abs(np.diff(window)) <= step_px))  # NaN compares False


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


# Interruptions


def _interruptions(
    segmentation: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
    found: list[Finding],
) -> list[Finding]:
    """Holes in both rails with rails seen well before and after, not explained otherwise."""
    profile, path = track.profile, track.path
    assert profile is not None
    assert path is not None
    scale = track.camera.size_wh[0] / 640.0
    chainage = profile.chainage_m
    extra: list[Finding] = []
    for gap in track.gaps:
        if gap.rail != "both":
            continue
        spacing = float(np.interp(gap.from_m, path.chainage_m, path.metre_px * 2.0 * path.half_m))
        tall = gap.from_v - gap.to_v
        if spacing < limits.gap_spacing_px * scale or tall < limits.gap_px * scale:
            continue
        if gap.to_m - gap.from_m < limits.gap_m:
            continue
        before = profile.peak[(chainage < gap.from_m)][-8:]
        if len(before) < 6 or before.min(axis=1).mean() < limits.gap_contrast:
            continue
        share, name = _non_ground(segmentation, track, gap.from_m, gap.to_m)
        if gap.continued:
            after = profile.peak[(chainage > gap.to_m)][:8]
            if len(after) < 6 or after.min(axis=1).mean() < limits.gap_contrast:
                continue
        elif share < 0.5:
            continue
        inside = (path.chainage_m >= gap.from_m) & (path.chainage_m <= gap.to_m)
        if np.count_nonzero(inside) < 2:
            continue
        if any(f.box_xyxy[1] <= gap.from_v <= f.box_xyxy[3] + 12 * scale for f in found):
            continue  # a thing that was found explains the hole
        polygon = _corridor(track, inside, limits.clearance_m / 2)
        foot = np.array([np.interp(gap.from_m, path.chainage_m, path.uv[:, 0]), gap.from_v])
        seen_again = "found again beyond" if gap.continued else f"{name} above it"
        extra.append(
            Finding(
                type="obstruction",
                polygon_uv=polygon,
                box_xyxy=(
                    float(polygon[:, 0].min()),
                    float(polygon[:, 1].min()),
                    float(polygon[:, 0].max()),
                    float(polygon[:, 1].max()),
                ),
                confidence=float(np.clip(0.45 + 0.4 * share, 0.0, 1.0)),
                foot_uv=foot,
                evidence=(
                    f"both rails interrupted from {gap.from_m:.0f} m to {gap.to_m:.0f} m, "
                    f"{seen_again}"
                ),
            )
        )
    return extra


def _corridor(track: TrackGeometry, inside: Bools, half_m: float) -> Array:
    """Outline of a stretch of the track, ``half_m`` to either side, in pixels."""
    path = track.path
    assert path is not None
    uv, metre = path.uv[inside], path.metre_px[inside]
    left = uv - np.stack([half_m * metre, 0 * metre], axis=1)
    right = uv + np.stack([half_m * metre, 0 * metre], axis=1)
    return np.concatenate([left, right[::-1]])


def _non_ground(
    segmentation: SegmentationLike, track: TrackGeometry, from_m: float, to_m: float
) -> tuple[float, str]:
    """Share of non-ground pixels between the rails over a stretch, and their commonest class."""
    path = track.path
    assert path is not None
    inside = (path.chainage_m >= from_m) & (path.chainage_m <= to_m)
    labels = segmentation.labels
    if np.count_nonzero(inside) < 2:
        return 0.0, "nothing"
    polygon = _corridor(track, inside, 0.9)
    mask = np.zeros(labels.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1)
    classes = labels[mask > 0]
    if len(classes) == 0:
        return 0.0, "nothing"
    ground = np.isin(classes, [*GROUND, *RAILS])
    rest = classes[~ground]
    rest_known = rest[rest < len(CLASSES)]
    name = CLASSES[int(np.bincount(rest_known).argmax())] if len(rest_known) else "void"
    return 1.0 - float(ground.mean()), name
