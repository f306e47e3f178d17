"""Things and people: foreign regions whose foot stands inside the clearance envelope."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numba
import numpy as np
import numpy.typing as npt

from railinspect.boxes import overlap_share
from railinspect.findings.bodies import bodies_of
from railinspect.findings.finding import Finding, FindingType
from railinspect.findings.looks import looks_of, sureness
from railinspect.findings.place import place_on_track
from railinspect.findings.regions import components, contacts
from railinspect.labels import (
    CAR,
    CLASSES,
    GROUND,
    HUMAN,
    ON_RAILS,
    POLE,
    RAILS,
    TRAFFIC_LIGHT,
    TRAFFIC_SIGN,
    TRUCK,
    VEGETATION,
)
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import SegmentationLike, TrackGeometry
from railinspect.track.level import world_pixels

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.intp]

_VEHICLES = (CLASSES[CAR], CLASSES[TRUCK], CLASSES[ON_RAILS])

_GROUND = frozenset((*GROUND, *RAILS)) - {VEGETATION}

_CREST_PX = 4.0
"""Rows within which the ground ends at a crest: its edge is not level, pixels."""

_THING, _PERSON = 1, 2
_EITHER = _THING | _PERSON
"""What a region is of: things, people, or people parts of whom read as things."""

_PERSON_SHARE = 0.3
"""So much of such a person reads as one at least."""

_AROUND_PX = 8
"""What closing a mask may change lies within so much of what it is of, pixels."""

_LOW_M = 2.0
"""Above this height, metres, nothing of a body says that it stands on the track."""

_SAME_THING = 0.5
"""Findings whose boxes share this much of the smaller one are one thing, as in events."""

_FAMILY = np.arange(256)
"""What may hang over what: one id per class, but masts carry signals and vehicles are alike."""
_FAMILY[[TRAFFIC_LIGHT, TRAFFIC_SIGN]] = POLE
_FAMILY[[TRUCK, ON_RAILS]] = CAR


def find_things(
    segmentation: SegmentationLike, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """Foreign regions whose foot stands inside the clearance envelope, in any of the looks."""
    found: list[Finding] = []
    for look in looks_of(segmentation):
        new = _find_in(look, segmentation, track, limits)
        new = [n for n in new if all(_surer(n, f) for f in found if _same(f, n))]
        found = [f for f in found if not any(_same(f, n) for n in new)] + new
    return found


def _touch(kind: Image) -> bool:
    """Whether a person comes as near to a thing as what closing makes one region."""
    people = cv2.dilate((kind == _PERSON).view(np.uint8), np.ones((9, 5), np.uint8))
    return bool((people.view(np.bool_) & (kind == _THING)).any())


def _surer(one: Finding, two: Finding) -> bool:
    return (one.doubt is None, one.confidence) > (two.doubt is None, two.confidence)


def _same(one: Finding, two: Finding) -> bool:
    """Whether two findings of different looks, or of people and their parts, are one thing."""
    return one.type == two.type and overlap_share(one.box_xyxy, two.box_xyxy) >= _SAME_THING


def _find_in(
    segmentation: SegmentationLike,
    whole: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
) -> list[Finding]:
    """What one look shows inside the envelope; how sure it is, the whole segmentation says."""
    path = track.path
    assert path is not None
    labels = segmentation.labels
    scale = labels.shape[1] / 640.0
    reach = limits.reach_share * (track.reach_m or 0.0) + 1.0
    used = int(np.searchsorted(path.chainage_m, reach, side="right"))
    if used < 2:
        return []
    # Rows the envelope can occupy; the thing itself may stand up above them.
    first = max(0, int(np.fmin.reduce(path.uv[:used, 1])) - 1)
    table = np.zeros(256, np.uint8)
    table[list(limits.foreign)] = _THING
    table[HUMAN] = _PERSON
    kind = np.empty(labels.shape, np.uint8)
    cv2.LUT(labels[first:], table, kind[first:])
    widest = max(limits.person_clearance_m, limits.clearance_m)
    beside = kind[first:] & _corridor(track, used, widest, first)
    there = [code for code in (_PERSON, _THING) if (beside & code).any()]
    if len(there) == 2:
        there.append(_EITHER)
    there = [
        code
        for code in there
        if _stands_there(kind[first:], beside, code, first, track, reach, limits)
    ]
    if not there:
        return []
    if first > 0:
        cv2.LUT(labels[:first], table, kind[:first])
    if _EITHER in there and not _touch(kind):
        there.remove(_EITHER)
    found: list[Finding] = []
    for code in there:
        clearance = _clearance(limits, code)
        mask, rows, cols = _ends(kind, code, first)
        feet = np.stack([cols, rows + 0.5], axis=1).astype(float)
        chainage, lateral = _places(track, feet, limits)
        near = np.isfinite(lateral) & (chainage <= reach) & (np.abs(lateral) <= clearance + 3.0)
        inside = near & (np.abs(lateral) <= clearance)
        if not inside.any():
            continue
        # Only what lies in the columns of the near contacts can be part of a body.
        left, right = int(cols[near].min()), int(cols[near].max()) + 1
        number_of, sizes = components(
            np.ascontiguousarray(mask[:, left:right]), rows[inside], cols[inside] - left
        )
        component = np.where(near, number_of[rows, np.clip(cols - left, 0, right - left - 1)], 0)
        for number in range(1, len(sizes)):
            if sizes[number] < limits.least_area_px * scale**2:
                continue
            part = near & (component == number)
            region = np.zeros(mask.shape, bool)
            region[:, left:right] = number_of == number
            standing = _standing(
                segmentation,
                whole,
                track,
                limits,
                code,
                region,
                feet[part],
                chainage[part],
                lateral[part],
            )
            if code == _EITHER:
                standing = [s for s in standing if not any(_same(f, s) for f in found)]
            found += standing
    return found


def _ends(kind: Image, code: int, first: int) -> tuple[Image, Indices, Indices]:
    """Mask of what is of this kind, and rows and columns from ``first`` on where it ends below."""
    mask = ((kind & code) > 0).view(np.uint8)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8))
    mask = np.asarray(closed, np.uint8)
    return mask, *contacts(mask, kind, first)


def _places(track: TrackGeometry, feet: Array, limits: Thresholds) -> tuple[Array, Array]:
    """Chainage and lateral position of feet in the picture, metres."""
    chainage, lateral, _ = place_on_track(track, feet)
    # Feet stand on the bed, below the plane of the rail tops: a little farther out.
    return chainage, lateral * (1.0 - limits.foot_m / track.camera.height_m)


def _stands_there(
    kind: Image,
    beside: Image,
    code: int,
    first: int,
    track: TrackGeometry,
    reach: float,
    limits: Thresholds,
) -> bool:
    """Whether anything of this kind ends inside the envelope, looking only where it may.

    Most of what a corridor hides stands beside it or farther on: masts, walls, platforms.

    Args:
        kind: Kinds from row ``first`` on.
        beside: Those of them in the corridor, else 0; some are of this kind.
        code: The kind.
        first: The row.
        track: The track.
        reach: Chainage up to which anything is judged, metres.
        limits: Thresholds.
    """
    left, top, wide, high = cv2.boundingRect(beside & np.uint8(code))
    left, right = max(0, left - _AROUND_PX), left + wide + _AROUND_PX
    top, bottom = max(0, top - _AROUND_PX), top + high + _AROUND_PX
    _, rows, cols = _ends(np.ascontiguousarray(kind[top:bottom, left:right]), code, 0)
    feet = np.stack([cols + left, rows + (first + top + 0.5)], axis=1)
    chainage, lateral = _places(track, feet, limits)
    return bool(np.any((chainage <= reach) & (np.abs(lateral) <= _clearance(limits, code))))


@numba.njit(cache=True)
def _border(xy_m: Array, heading_rad: Array, half_m: float) -> Array:
    """Outline ``half_m`` to either side of a line, up its left and down its right, (2N, 2).

    Every fourth sample will do: the outline is smooth and drawn with a broad line.
    """
    last = len(xy_m) - 1
    count = (last + 3) // 4 + 1
    border = np.empty((2 * count, 2))
    for i in range(count):
        at = min(4 * i, last)
        aside_x, aside_y = -half_m * math.sin(heading_rad[at]), half_m * math.cos(heading_rad[at])
        border[i, 0], border[i, 1] = xy_m[at, 0] + aside_x, xy_m[at, 1] + aside_y
        border[-1 - i, 0], border[-1 - i, 1] = xy_m[at, 0] - aside_x, xy_m[at, 1] - aside_y
    return border


@numba.njit(cache=True)
def _drawable(outline_uv: Array, first: int, width: int) -> npt.NDArray[np.int32]:
    """Places of an outline in the picture from row ``first`` on, without what lies behind."""
    points, count = np.empty((len(outline_uv), 1, 2), np.int32), 0
    for u, v in outline_uv:
        if not math.isnan(u):
            points[count, 0, 0] = round(min(max(u, -4.0 * width), 5.0 * width))
            points[count, 0, 1] = round(min(max(v, -4.0 * width), 5.0 * width)) - first
            count += 1
    return points[:count]


def _corridor(track: TrackGeometry, used: int, half_m: float, first: int) -> Image:
    """Mask, from row ``first`` on, of what is up to ``half_m`` beside the centre line and a bit.

    The first ``used`` samples of the path say where that is.
    """
    path = track.path
    assert path is not None
    width, height = track.camera.size_wh
    border = _border(path.xy_m[:used], path.heading_rad[:used], half_m)
    points = _drawable(world_pixels(track.camera, border), first, width)
    mask = np.zeros((height - first, width), np.uint8)
    cv2.fillPoly(mask, [points], 255)
    cv2.polylines(mask, [points], True, 255, 5)
    return mask


def _standing(
    segmentation: SegmentationLike,
    whole: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
    code: int,
    region: Bools,
    feet: Array,
    chainage: Array,
    lateral: Array,
) -> list[Finding]:
    """Judge each body of one region that has a foot inside the clearance envelope."""
    # The lowest contact of each column is the foot; one above it is a hole's upper edge.
    order = np.lexsort((-feet[:, 1], feet[:, 0]))
    feet, chainage, lateral = feet[order], chainage[order], lateral[order]
    lowest = np.concatenate([[True], feet[1:, 0] != feet[:-1, 0]])
    feet, chainage, lateral = feet[lowest], chainage[lowest], lateral[lowest]
    clearance = _clearance(limits, code)
    found: list[Finding] = []
    for body in bodies_of(feet, _families(segmentation, limits, code, feet), track, limits):
        standing = np.concatenate(body.feet)
        inside = standing[np.abs(lateral[standing]) <= clearance]
        if len(inside) == 0:
            continue
        innermost = min(body.feet, key=lambda part: float(np.abs(lateral[part]).min()))
        columns = feet[np.concatenate([inside, body.hanging]), 0]
        finding = _judge(
            segmentation,
            whole,
            track,
            limits,
            code,
            region,
            feet[inside],
            chainage[inside],
            lateral[inside],
            float(np.mean(np.abs(lateral[innermost]) <= clearance)),
            (int(columns.min()), int(columns.max())),
        )
        if finding is not None:
            found.append(finding)
    sure = [finding for finding in found if finding.doubt is None]
    doubtful = [finding for finding in found if finding.doubt is not None]
    return _one_thing(track, sure) + _one_thing(track, doubtful)


def _families(
    segmentation: SegmentationLike, limits: Thresholds, code: int, feet: Array
) -> npt.NDArray[np.intp]:
    """Kind of structure at each contact; a filled hole's is that of the contact before it."""
    if code != _THING:
        return np.zeros(len(feet), np.intp)
    classes = segmentation.labels[feet[:, 1].astype(int), feet[:, 0].astype(int)]
    known = np.where(np.isin(classes, limits.foreign), np.arange(len(feet)), 0)
    return np.asarray(_FAMILY[classes[np.maximum.accumulate(known)]], np.intp)


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


def _clearance(limits: Thresholds, code: int) -> float:
    return limits.clearance_m if code == _THING else limits.person_clearance_m


def _innermost(
    code: int,
    inside: Array,
    lateral: Array,
    lowest: int,
    columns_uv: tuple[int, int],
    metre: float,
) -> float:
    """Least distance of a body from the centre line: its feet's; a person's middle counts too.

    Who runs has one foot on the ground and that one maybe behind.
    """
    least = float(np.abs(lateral).min())
    if code == _THING:
        return least
    aside = (float(inside[lowest, 0]) - sum(columns_uv) / 2) / metre  # to the left of the foot
    return min(least, abs(float(lateral[lowest]) + aside))


def _behind_crest(
    segmentation: SegmentationLike,
    inside: Array,
    columns_uv: tuple[int, int],
    scale: float,
    aside_px: float = 0.0,
) -> bool:
    """Whether the ground ends at the foot on both sides too, so that the foot itself is hidden.

    With ``aside_px`` it has to end so far to both sides, and nowhere in between may it go on.
    """
    reach = math.ceil(2.0 * scale)
    lift = reach if aside_px == 0.0 else math.ceil(_CREST_PX * scale)
    row = max(0, int(inside[:, 1].min()) - lift)
    first, last = columns_uv[0] - reach, columns_uv[1] + reach
    columns = [first, last]
    if aside_px > 0.0:
        columns = list(range(first - math.ceil(aside_px), last + math.ceil(aside_px) + 1))
    seen = [segmentation.labels[row, u] for u in columns if 0 <= u < segmentation.labels.shape[1]]
    return not any(label in _GROUND for label in seen)


def _judge(
    segmentation: SegmentationLike,
    whole: SegmentationLike,
    track: TrackGeometry,
    limits: Thresholds,
    code: int,
    region: Bools,
    inside: Array,
    chainage: Array,
    lateral: Array,
    share: float,
    columns_uv: tuple[int, int],
) -> Finding | None:
    """Accept or reject one body, of whose feet these contacts lie inside the envelope."""
    path = track.path
    assert path is not None
    scale = region.shape[1] / 640.0
    lowest = int(np.argmax(inside[:, 1]))
    range_m = float(chainage[lowest])
    metre = float(np.interp(range_m, path.chainage_m, path.metre_px))
    pixel_m = 1.0 / metre
    first, last = columns_uv
    across = float(np.interp(range_m, path.chainage_m, path.across_px))
    spacing_px = 2.0 * across * float(np.interp(range_m, path.chainage_m, path.half_m))
    if last - first + 1 < limits.least_foot_px * scale:
        return None
    if spacing_px < limits.least_spacing_px * scale:
        return None
    far = spacing_px < limits.far_spacing_px * scale
    hides = any(not gap.continued for gap in track.gaps)  # the rails end where they should go on
    across_both = lateral.min() < -limits.far_centre_m and lateral.max() > limits.far_centre_m
    if far and not (hides and across_both):
        return None
    width_m = float(np.ptp(lateral)) + pixel_m
    deep = _clearance(limits, code) - _innermost(code, inside, lateral, lowest, columns_uv, metre)
    if deep < limits.deep_m or deep * across < limits.deep_px * scale:
        return None
    if share < limits.inside_share and width_m < limits.wide_m:
        return None
    inner = float(np.abs(lateral).min())
    along = float(np.ptp(chainage))
    if code == _THING and inner > limits.core_m and along > max(limits.along_m, 3.0 * width_m):
        return None  # runs along the track: a platform's edge, a wall, a cable trough
    if inner > limits.core_m and _behind_crest(segmentation, inside, columns_uv, scale):
        return None  # it stands farther on and who knows where
    # The body above the foot: the region's pixels in its columns, up to the region's top.
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
    least_height = limits.person_height_m if code != _THING else limits.least_height_m
    least_width = 0.0 if code != _THING else limits.least_width_m
    if area < limits.least_area_px * scale**2 or height_m < least_height or width_m < least_width:
        return None
    v, u = np.nonzero(body)
    points = np.stack([u + first, v + top], axis=1).astype(np.float32)
    polygon = cv2.convexHull(points.reshape(-1, 1, 2)).reshape(-1, 2).astype(float)
    classes = segmentation.labels[top : base + 1, first : last + 1][body]
    if code == _EITHER and np.mean(classes == HUMAN) < _PERSON_SHARE:
        return None  # things are judged by themselves
    name = CLASSES[int(np.bincount(classes[classes < len(CLASSES)], minlength=1).argmax())]
    cut_off = base >= region.shape[0] - 2  # by the image's bottom: its height is not known
    if name in _VEHICLES and height_m < limits.vehicle_m and not cut_off:
        return None
    sure = sureness(whole, (top, first), body, round(_LOW_M * metre), limits.foreign)
    needed = limits.least_confidence if code == _THING else limits.person_confidence
    if sure < min(limits.least_doubt, needed):
        return None
    doubt = None if sure >= needed else f"only {100 * sure:.0f} % sure"
    distant = spacing_px < limits.crest_spacing_px * scale
    if code == _THING and distant and name not in _VEHICLES:
        aside_px = limits.crest_m * metre
        if _behind_crest(segmentation, inside, columns_uv, scale, aside_px):
            doubt = "but all ground ends at its foot, so it may stand farther on"
    size = min(1.0, area / (6.0 * limits.least_area_px * scale**2))
    known = 1.0 if track.followed and range_m <= (track.reach_m or 0.0) * 1.05 else 0.8
    middle = float(lateral.mean())
    side = "left" if middle > 0 else "right"
    kind: FindingType = "trespasser" if code != _THING else "obstruction"
    what = "person" if code != _THING else f"{name} region"
    if code == _THING and name == CLASSES[ON_RAILS]:
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
        doubt=doubt,
    )
