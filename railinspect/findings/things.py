"""Things and people: foreign regions whose foot stands inside the clearance envelope."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.findings.finding import Finding, FindingType
from railinspect.findings.place import place_on_track
from railinspect.labels import CAR, CLASSES, HUMAN, ON_RAILS, TRUCK
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import SegmentationLike, TrackGeometry

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

_VEHICLES = (CLASSES[CAR], CLASSES[TRUCK], CLASSES[ON_RAILS])


def find_things(
    segmentation: SegmentationLike, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """Foreign regions whose foot stands inside the clearance envelope."""
    path = track.path
    assert path is not None
    labels = segmentation.labels
    scale = labels.shape[1] / 640.0
    reach = limits.reach_share * (track.reach_m or 0.0) + 1.0
    used = path.chainage_m <= reach
    if np.count_nonzero(used) < 2:
        return []
    # Rows the envelope can occupy; the thing itself may stand up above them.
    first = max(0, int(np.nanmin(path.uv[used, 1])) - 1)
    table = np.zeros(256, np.uint8)
    table[list(limits.foreign)] = 1
    table[HUMAN] = 2
    low = cv2.LUT(labels[first:], table)
    widest = max(limits.person_clearance_m, limits.clearance_m)
    if not (low[_corridor(track, used, widest)[first:] > 0]).any():
        return []
    kind = np.concatenate([cv2.LUT(labels[:first], table), low]) if first else low
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
        _, components, sizes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        component = components[rows, cols]
        inside = near & (np.abs(lateral) <= clearance)
        for number in np.unique(component[inside]):
            if sizes[number, cv2.CC_STAT_AREA] < limits.least_area_px * scale**2:
                continue
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


def _corridor(track: TrackGeometry, used: Bools, half_m: float) -> npt.NDArray[np.uint8]:
    """Mask of everything up to ``half_m`` from the centre line on the plane, a little widened."""
    path = track.path
    assert path is not None
    width, height = track.camera.size_wh
    normal = np.stack([-np.sin(path.heading_rad), np.cos(path.heading_rad)], axis=1)[used]
    level = np.zeros((len(normal), 1))
    sides = [
        track.camera.project(np.hstack([path.xy_m[used] + side * half_m * normal, level]))
        for side in (1.0, -1.0)
    ]
    outline = track.camera.distort(np.concatenate([sides[0], sides[1][::-1]]))
    outline = np.clip(outline[np.isfinite(outline[:, 0])], -4 * width, 5 * width)
    mask = np.zeros((height, width), np.uint8)
    points = np.round(outline).astype(np.int32).reshape(-1, 1, 2)
    cv2.fillPoly(mask, [points], 1)
    cv2.polylines(mask, [points], True, 1, 5)
    return mask


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
        near_enough = (base - bottom) / metre < limits.overhang_m
        near_enough &= aside < limits.overhang_width_m
        if near_enough and (best is None or base > best[0]):
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
    spacing_px = 2.0 * across * float(np.interp(range_m, path.chainage_m, path.half_m))
    if len(inside) < limits.least_foot_px * scale or spacing_px < limits.least_spacing_px * scale:
        return None
    far = spacing_px < limits.far_spacing_px * scale
    hides = any(not gap.continued for gap in track.gaps)  # the rails end where they should go on
    across_both = lateral.min() < -limits.far_centre_m and lateral.max() > limits.far_centre_m
    if far and not (hides and across_both):
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
    cut_off = base >= region.shape[0] - 2  # by the image's bottom: its height is not known
    if name in _VEHICLES and height_m < limits.vehicle_m and not cut_off:
        return None
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
