"""Where the tracks lie: the alignment, the ego track, its neighbours and the switches."""

from __future__ import annotations

import numpy as np

from railinspect.scenes import tables
from railinspect.scenes.alignment import Alignment
from railinspect.scenes.appearance import jitter
from railinspect.scenes.draft import Array, Draft

TURN_SLOPE, TURN_REACH_M = 2.2, 60.0
"""How steeply a turn leaves the ego track, as a tangent, and how far aside it is laid, metres."""


def draw_alignment(
    rng: np.random.Generator, end_m: float, min_radius_m: float, curvy: float
) -> Alignment:
    """Straights, transitions and arcs to ``end_m``; ``curvy`` is the share of arcs, 0…1."""
    knots, curvature = [-100.0], [0.0]
    at = float(rng.uniform(-60, 60))
    while at < end_m:
        if rng.random() < curvy:
            radius = min_radius_m / rng.uniform(0.08, 1.0) ** 0.8
            bend = float(rng.choice([-1.0, 1.0])) / radius
            ramp = float(np.clip(9000.0 / radius, 15, 80))
            arc = float(rng.uniform(20, 220))
            knots += [at, at + ramp, at + ramp + arc, at + 2 * ramp + arc]
            curvature += [0.0, bend, bend, 0.0]
            at += 2 * ramp + arc
        at += float(rng.uniform(10, 250))
    if rng.random() < curvy * 0.5:  # the observer may already stand in the curve
        knots = [k - float(rng.uniform(0, 120)) for k in knots[:1]] + [k - 60.0 for k in knots[1:]]
    slopes = np.arange(-100.0, end_m + 300, float(rng.uniform(120, 260)))
    grades = np.clip(rng.normal(0, 0.008, len(slopes)), -0.03, 0.03)
    order = np.argsort(knots, kind="stable")
    return Alignment(np.array(knots)[order], np.array(curvature)[order], slopes, grades)


def _rail_colours(rng: np.random.Generator, used: bool) -> tuple[float, float, float, float]:
    if used:
        grey = rng.uniform(120, 250)
        shine, head = rng.uniform(0.5, 1.0), np.array([grey, grey, grey * rng.uniform(0.95, 1.05)])
        if rng.random() < 0.2:  # dark heads on light ground
            head, shine = head * 0.4, shine * 0.6
    else:
        head, shine = jitter(rng, (112, 80, 62), 0.2), rng.uniform(0.0, 0.3)
    return float(shine), float(head[0]), float(head[1]), float(head[2])


def add_track(
    draft: Draft,
    offset: Array,
    used: bool = True,
    embedded: float = 0.0,
    like: tuple[float, ...] | None = None,
    turn: bool = False,
) -> None:
    """Lay a track; ``embedded`` 0 is open bed, 1 grooved in the ground, 2 in a paved strip.

    A ``turn`` leaves the corridor the tracks run in; the last tracks laid may be such.
    """
    rng = draft.rng
    if like is not None and rng.random() < 0.7:
        base = list(like)
    else:
        kind = rng.choice(["concrete", "wood", "steel", "slab"], p=[0.5, 0.34, 0.06, 0.1])
        colour = {
            "concrete": (158, 152, 142),
            "wood": (84, 68, 56),
            "steel": (92, 74, 64),
            "slab": (150, 148, 142),
        }[str(kind)]
        pitch = 0.0 if kind == "slab" else float(rng.uniform(0.58, 0.72))
        base = [
            float(rng.uniform(1.55, 2.4)),
            pitch,
            float(rng.uniform(0.22, 0.30)),
            float(draft.spacing_m / 2 + rng.uniform(0.4, 0.62)),
            *jitter(rng, colour, 0.2),
            0.0,
            0.0,
            0.0,
            0.0,
            embedded,
        ]
    base[tables.TRACK_SHINE : tables.TRACK_HEAD_B + 1] = _rail_colours(rng, used)
    base[tables.TRACK_EMBEDDED] = embedded
    (draft.turns if turn else draft.offsets).append(offset)
    draft.tracks.append(tuple(float(b) for b in base))


def _smooth(along: Array, start: float, length: float) -> Array:
    part = np.clip((along - start) / length, 0, 1)
    return part * part * (3 - 2 * part)


def lay_tracks(draft: Draft) -> None:
    """Lay the ego track, its neighbours and switches between them."""
    rng, along = draft.rng, draft.along
    if draft.kind == "none":
        return
    embedded = float(rng.choice([1.0, 2.0])) if draft.kind == "tram" else 0.0
    add_track(draft, np.zeros(along.size), used=rng.random() < 0.9, embedded=embedded)
    ego = draft.tracks[0]
    busy = {"line": 0.55, "station": 0.95, "tram": 0.7}[draft.kind]
    many = int(rng.integers(1, 5 if draft.kind == "station" else 3)) if rng.random() < busy else 0
    pitch = float(rng.uniform(3.4, 5.2)) if draft.kind != "tram" else float(rng.uniform(2.9, 3.6))
    pitch += draft.spacing_m - 1.5
    side = float(rng.choice([-1.0, 1.0]))
    left = right = 0
    for _ in range(many):
        place = side if rng.random() < (0.75 if draft.kind == "tram" else 0.55) else -side
        if place > 0:
            left += 1
            target = left * pitch
        else:
            right += 1
            target = -right * pitch
        offset = np.full(along.size, target)
        if rng.random() < 0.1:
            offset += np.sign(target) * rng.uniform(0, 6) * _smooth(along, rng.uniform(0, 200), 150)
        add_track(draft, offset, rng.random() < 0.75, embedded, ego)
        if rng.random() < (0.5 if draft.kind == "station" else 0.3):
            _add_switch(draft, target, embedded, ego)
    if draft.kind == "tram" and rng.random() < 0.5:
        _add_junction(draft, ego)
        return
    if rng.random() < 0.12:  # a siding that leaves and runs away
        _add_switch(draft, float(rng.choice([-1.0, 1.0])) * rng.uniform(4, 14), embedded, ego)


def _add_switch(draft: Draft, target: float, embedded: float, like: tuple[float, ...]) -> None:
    rng, along = draft.rng, draft.along
    start = float(rng.uniform(5, max(120.0, draft.length_m)))
    length = float(np.clip(abs(target) * rng.uniform(8, 16), 30, 140))
    shape = _smooth(along, start, length)
    facing = rng.random() < 0.5
    offset = target * (shape if facing else 1 - shape)
    outside = along < start if facing else along > start + length
    parked = np.abs(offset - target) < 1e-3
    offset[outside | parked] = np.nan
    add_track(draft, offset, rng.random() < 0.7, embedded, like)


def _add_junction(draft: Draft, like: tuple[float, ...]) -> None:
    """A street junction: every track turns off on one side, another line may cross."""
    rng, along = draft.rng, draft.along
    start = float(rng.uniform(-8, 30))
    radius, side = float(rng.uniform(22, 45)), float(rng.choice([-1.0, 1.0]))
    facing = rng.random() < 0.5
    middles = [float(o[0]) for o in draft.offsets if np.isfinite(o).all()]
    courses = [_turn(along, start, radius, side, middle, facing) for middle in middles]
    if rng.random() < 0.4:
        slope = float(rng.choice([-1.0, 1.0]) * rng.uniform(1.2, TURN_SLOPE))
        middle = start + float(rng.uniform(10, 30))
        for aside in (0.0, float(rng.uniform(3.0, 3.8))):
            courses.append(slope * (along - middle) + aside * np.hypot(1.0, slope))
    for course in courses:
        course[np.abs(course) > TURN_REACH_M] = np.nan
        add_track(draft, course, rng.random() < 0.75, 1.0, like, turn=True)
    ways = along[np.isfinite(np.array(courses)).any(axis=0)]
    asphalt = jitter(rng, (104, 104, 106), 0.25)
    draft.crossings.append((ways.min() - 2.0, ways.max() + 2.0, *asphalt, 0.0))


def _turn(
    along: Array, start: float, radius: float, side: float, middle: float, facing: bool
) -> Array:
    """Lateral offset of an arc that leaves a track and runs on straight; NaN before it."""
    # Parallel tracks turn about one centre.
    radius -= side * middle
    into = along - start if facing else start + radius - along
    steep = TURN_SLOPE / np.hypot(1.0, TURN_SLOPE)
    on_arc = np.clip(into / radius, 0.0, steep)
    beyond = np.maximum(into / radius - steep, 0.0)
    aside = radius * (1.0 - np.sqrt(1.0 - on_arc**2) + TURN_SLOPE * beyond)
    return np.asarray(np.where(into > 0, middle + side * aside, np.nan))
