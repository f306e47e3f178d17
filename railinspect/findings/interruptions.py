"""Interruptions: holes in both rails that nothing found so far explains."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.findings.finding import Finding
from railinspect.labels import CLASSES, GROUND, RAILS
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import Gap, RailProfile, SegmentationLike, TrackGeometry

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_RAIL_THERE = 0.5
"""Rail probability from which a rail lies at a place."""


def find_interruptions(
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
        if gap.continued and _rails_there(profile, gap):
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


def _rails_there(profile: RailProfile, gap: Gap) -> bool:
    """Whether rails lie in the hole where the smooth track has them: the growing missed them."""
    hole = (profile.chainage_m >= gap.from_m) & (profile.chainage_m < gap.to_m)
    return bool(np.median(profile.smooth_peak[hole].min(axis=1)) >= _RAIL_THERE)


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
