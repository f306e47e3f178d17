"""A second look at what the masks say, in the picture itself: close-ups of the track.

The segmentation and the close-ups' network err in different pictures. What the masks show and the
close-ups clearly do not is a drop on the lens, the edge of a shadow or a turnout. What the masks
show weakly and the close-ups too is there, and so is what the close-ups alone show clearly, at two
places side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, cast

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from railinspect.boxes import boxes_touch
from railinspect.close_ups import ANSWERS, CloseUps, LookAtTrack
from railinspect.findings.finding import Finding, FindingType
from railinspect.findings.place import place_on_track
from railinspect.thresholds import Thresholds
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]

BESIDE: Final = 1.2
"""A close-up speaks of what is up to this ratio of its range nearer or farther."""

WATCH_EVERY: Final = 5
"""Each so-many-th place of the close-ups is watched in a recording: 1.54 times farther each."""

AROUND: Final = 1.35
"""What a watched place shows lies up to this ratio of its range nearer or farther."""

LEAVING: Final = 1.15
"""Ratio to the range of the picture's lower border below which a window shows too little ground."""

PLACE_REL: Final = {"distortion": 0.11, "obstruction": 0.06, "trespasser": 0.06}
"""Standard deviation of the range of what close-ups alone show, as a share of it."""

BEFORE: Final = 0.956
"""A thing stands before the places that show it most surely, at this ratio of their range: it hides
what lies behind it, and is seen in the windows of that too."""

_BOX_M: Final = {"distortion": (1.5, 0.3), "obstruction": (1.5, 1.0), "trespasser": (1.5, 1.8)}
"""Width and height of the box drawn where only close-ups say that something is, metres."""

_CALLED: Final = {
    "distortion": "a distortion",
    "obstruction": "an obstruction",
    "trespasser": "a trespasser",
}

_NEVER: Final = 1e-6
_DISTORTION: Final = ANSWERS.index("distortion")

_DOUBT: Final = "but close-ups of the track there hardly show it"


def reviewed(
    found: Sequence[Finding], look: LookAtTrack, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """Findings of the masks, held against close-ups of their places alone.

    Args:
        found: What the masks show, at least one.
        look: Takes the close-ups.
        track: The track, with a path.
        limits: Thresholds.
    """
    stretches = [stretch(finding, track) for finding in found]
    from_m, to_m = min(s[0] for s in stretches), max(s[1] for s in stretches)
    return _held(found, look(track, from_m / BESIDE, to_m * BESIDE), track, limits)


def watched(
    found: Sequence[Finding], look: LookAtTrack, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """Findings of the masks, and what close-ups of a few places show besides.

    A recording has no time for close-ups all along the track, but what stands on it passes every
    place as the train nears: a few are looked at in each frame, and all around only where one of
    them shows what the masks do not.

    Args:
        found: What the masks show.
        look: Takes the close-ups.
        track: The track, with a path.
        limits: Thresholds.
    """
    seen = look(track, limits.watch_from_m, limits.watch_to_m, WATCH_EVERY)
    something = 1.0 - seen.chances[:, 0]
    for finding in found:
        if finding.doubt is None:
            from_m, to_m = stretch(finding, track)
            known = (seen.chainage_m >= from_m / AROUND) & (seen.chainage_m <= to_m * AROUND)
            something[known] = 0.0
    if not np.any(something >= limits.seen_again):
        return list(found)
    at = float(seen.chainage_m[something.argmax()])
    alone = _alone(look(track, at / AROUND, at * AROUND), track, limits)
    return [*found, alone] if alone is not None else list(found)


def searched(
    found: Sequence[Finding],
    weak: Sequence[Finding],
    close_ups: CloseUps,
    track: TrackGeometry,
    limits: Thresholds,
) -> list[Finding]:
    """Findings of the masks, reviewed, and what close-ups all along the track show besides.

    Args:
        found: What the masks show.
        weak: What they show by weaker thresholds (:meth:`.Thresholds.weaker`).
        close_ups: What the close-ups say.
        track: The track, with a path.
        limits: Thresholds.
    """
    held = _held(found, close_ups, track, limits)
    for finding in weak:
        support = _support(_there(finding, close_ups, track))
        if finding.doubt is not None or support is None or support < limits.seen_both:
            continue
        if not any(boxes_touch(finding.box_xyxy, f.box_xyxy) for f in held if f.doubt is None):
            held.append(replace(finding, confidence=support))
    alone = _alone(close_ups, track, limits)
    if alone is not None and all(finding.doubt for finding in held):
        held.append(alone)
    return _named(held, close_ups, track, limits)


def _held(
    found: Sequence[Finding], close_ups: CloseUps, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    held = []
    for finding in found:
        support = _support(_there(finding, close_ups, track))
        if support is None or support >= limits.seen_again:
            held.append(finding)
        elif support >= limits.seen_perhaps:
            held.append(replace(finding, doubt=finding.doubt or _DOUBT))
    return held


def stretch(finding: Finding, track: TrackGeometry) -> tuple[float, float]:
    """From where to where along the track a finding lies, metres; a thing lies at its foot."""
    uv = finding.polygon_uv if finding.type == "distortion" else finding.foot_uv[None]
    chainage, _, _ = place_on_track(track, np.asarray(uv, float))
    chainage = chainage[np.isfinite(chainage)]
    if not len(chainage):
        return np.inf, np.inf
    return float(chainage.min()), float(chainage.max())


def _there(finding: Finding, close_ups: CloseUps, track: TrackGeometry) -> Array:
    """What close-ups say where a finding lies, (N, 4); of no place if nobody looked.

    Nor did anybody look at what is about to leave the picture at its lower border.
    """
    from_m, to_m = stretch(finding, track)
    path = track.path
    assert path is not None
    if to_m < LEAVING * float(path.chainage_m[0]):
        return close_ups.chances[:0]
    there = (close_ups.chainage_m >= from_m / BESIDE) & (close_ups.chainage_m <= to_m * BESIDE)
    return close_ups.chances[there]


def _support(chances: Array) -> float | None:
    """The largest probability of anything at all among some places; None for no place."""
    return 1.0 - float(chances[:, 0].min()) if len(chances) else None


def _named(
    held: Sequence[Finding], close_ups: CloseUps, track: TrackGeometry, limits: Thresholds
) -> list[Finding]:
    """The same findings, each called what close-ups surely show there.

    Of a person the masks often take the legs or a coat for a thing, and of bent rails the ground
    between them. What then touches a finding of its new name is a part of that.
    """
    named: list[Finding] = []
    renamed: list[Finding] = []
    for finding in held:
        sums = _there(finding, close_ups, track)[:, 1:].sum(axis=0)
        kind = cast(FindingType, ANSWERS[1 + int(sums.argmax())])
        unsure = not sums.any() or sums.max() < limits.seen_named * sums.sum()
        if unsure or kind == finding.type or finding.doubt:
            named.append(finding)
        else:
            evidence = f"{finding.evidence}; close-ups show {_CALLED[kind]}"
            renamed.append(replace(finding, type=kind, evidence=evidence))
    for finding in renamed:
        if not any(
            finding.type == f.type and boxes_touch(finding.box_xyxy, f.box_xyxy) for f in named
        ):
            named.append(finding)
    return named


def _alone(close_ups: CloseUps, track: TrackGeometry, limits: Thresholds) -> Finding | None:
    """What two neighbouring close-ups show most surely; None where that is not sure."""
    something = 1.0 - close_ups.chances[:, 0]
    if len(something) < 2:
        return None
    odds = logit(np.clip(something, _NEVER, 1.0 - _NEVER))
    both = expit(0.5 * (odds[:-1] + odds[1:]))
    kinds = 1 + (close_ups.chances[:-1, 1:] + close_ups.chances[1:, 1:]).argmax(axis=1)
    path = track.path
    assert path is not None
    metres = np.interp(close_ups.chainage_m[:-1], path.chainage_m, path.metre_px)
    bent = (kinds == _DISTORTION) & (metres >= limits.bent_metre_px)
    least = np.where(bent, limits.seen_bent, limits.seen_alone)
    best = int((logit(both) - logit(least)).argmax())
    if both[best] < least[best]:
        return None
    pair = slice(best, best + 2)
    kind = cast(FindingType, ANSWERS[kinds[best]])
    at = close_ups.chainage_m[pair]
    range_m = BEFORE * float(np.exp(np.average(np.log(at), weights=something[pair])))
    if kind == "distortion":  # a stretch, of which the beginning counts
        first = best
        while first > 0 and something[first - 1] >= limits.seen_alone:
            first -= 1
        range_m = float(close_ups.chainage_m[first])
    u, v, metre = (
        float(np.interp(range_m, path.chainage_m, values))
        for values in (path.uv[:, 0], path.uv[:, 1], path.metre_px)
    )
    wide, tall = (metre * side for side in _BOX_M[kind])
    width, height = track.camera.size_wh
    box = (
        max(0.0, u - wide / 2),
        max(0.0, v - tall),
        min(width - 1.0, u + wide / 2),
        min(height - 1.0, v + 0.1 * metre),
    )
    left, top, right, bottom = box
    return Finding(
        type=kind,
        polygon_uv=np.array([[left, top], [right, top], [right, bottom], [left, bottom]]),
        box_xyxy=box,
        confidence=float(both[best]),
        foot_uv=np.array([u, v]),
        evidence=f"close-ups show {_CALLED[kind]} at about {range_m:.0f} m, the masks do not",
        place_rel=PLACE_REL[kind],
    )
