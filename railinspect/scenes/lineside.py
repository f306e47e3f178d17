"""What stands along, over and between the tracks of a world."""

from __future__ import annotations

from functools import partial

import numpy as np

from railinspect import labels
from railinspect.scenes import furniture as f
from railinspect.scenes import movables
from railinspect.scenes import raster as r
from railinspect.scenes.appearance import jitter
from railinspect.scenes.draft import START_M, Draft


def furnish(draft: Draft) -> None:
    """Put masts, wires, signals, fences, platforms, buildings, plants and vehicles in place."""
    rng, kit, sun = draft.rng, draft.kit, draft.looks.sun_side
    right, left = draft.edges()
    end = draft.end_m - 60
    if draft.kind != "none" and rng.random() < 0.62:
        _electrify(draft, right, left, end)
    if draft.kind == "station":
        for _ in range(int(rng.integers(1, 3))):
            start = float(rng.uniform(-15, max(60.0, draft.length_m * 0.9)))
            long = float(rng.uniform(80, 260))
            wide = float(rng.uniform(3, 8))
            if rng.random() < 0.5:
                f.platform(kit, rng, start, start + long, left, wide, sun)
            else:
                f.platform(kit, rng, start, start + long, right, -wide, sun)
    at = float(rng.uniform(10, 120))
    while at < end and draft.kind != "none":
        side = left + rng.uniform(0.6, 1.2) if rng.random() < 0.5 else right - rng.uniform(0.6, 1.2)
        f.signal(kit, rng, at, float(side), draft.looks.night)
        at += float(rng.uniform(60, 500))
    at = float(rng.uniform(5, 80))
    while at < end:
        side = left + rng.uniform(0.5, 2.5) if rng.random() < 0.5 else right - rng.uniform(0.5, 2.5)
        f.sign(kit, rng, at, float(side))
        at += float(rng.uniform(25, 200))
    for limit, away in ((left, 1.0), (right, -1.0)):
        _line_side(draft, limit, away, end)
    if draft.settings.distractors:
        for _ in range(int(rng.integers(0, 3))):  # hand rails, cables, third rails, pipes
            base = (
                left + rng.uniform(-0.4, 2) if rng.random() < 0.5 else right - rng.uniform(-0.4, 2)
            )
            high = float(rng.choice([0.12, 0.4, 1.0]))
            colour = r.tint(rng.choice([(150, 150, 150), (60, 58, 56), (200, 196, 180)]))
            start = float(rng.uniform(-10, 60))
            stop = min(end, start + float(rng.uniform(40, 300)))
            while start < stop:
                kit.line(
                    (start, base, high), (start + 8.0, base, high), 0.035, colour, labels.FENCE
                )
                if high > 0.9:
                    kit.line((start, base, -0.3), (start, base, high), 0.03, colour, labels.FENCE)
                start += 8.0
    if draft.settings.occluders:
        _populate(draft, right, left)
    if draft.kind != "none":
        _span(draft, right, left)


def _electrify(draft: Draft, right: float, left: float, end: float) -> None:
    rng, kit = draft.rng, draft.kit
    steel = r.tint(rng.choice([(128, 132, 134), (92, 108, 96), (150, 148, 142), (104, 72, 54)]))
    side = left + rng.uniform(0.8, 1.4) if rng.random() < 0.5 else right - rng.uniform(0.8, 1.4)
    portals = len(draft.tracks) > 2 and rng.random() < 0.6
    pitch = float(rng.uniform(38, 64))
    at = float(rng.uniform(-15, 30))
    middles = [float(o[0]) for o in draft.offsets if np.isfinite(o).all()]
    while at < end:
        if portals:
            f.gantry(kit, at, left + 1.0, right - 1.0, steel)
        else:
            f.mast(kit, rng, at, float(side), 0.0, steel)
            if len(middles) > 1:
                other = left + right - float(side)
                f.mast(kit, rng, at, other, min(middles, key=lambda m: abs(m - other)), steel)
        for middle in middles:
            for low, high, sag in ((5.3, 5.3, 0.0), (6.3, 6.3, 0.6)):
                half = at + pitch / 2
                wire = (46.0, 46.0, 48.0)
                kit.line((at, middle, low), (half, middle, high - sag), 0.012, wire, r.NO_LABEL)
                kit.line(
                    (half, middle, high - sag), (at + pitch, middle, low), 0.012, wire, r.NO_LABEL
                )
        at += pitch


def _line_side(draft: Draft, limit: float, away: float, end: float) -> None:
    """Build what lines one side of the railway, stretch by stretch."""
    rng, kit, looks = draft.rng, draft.kit, draft.looks
    at = -15.0
    while at < end:
        long = float(rng.uniform(40, 260))
        stop = min(end, at + long)
        near = limit + away * float(rng.uniform(1.2, 4.0))
        what = rng.choice(
            ["open", "fence", "wall", "barrier", "hedge", "cutting", "forest", "low"],
            p=[0.24, 0.15, 0.11, 0.07, 0.11, 0.10, 0.15, 0.07],
        )
        if not all(draft.in_the_open(spot) for spot in np.arange(at, stop, 6.0)):
            what = "open"  # nothing bars a street junction
        strip = partial(f.strip, kit, at, stop, near)
        if what == "fence":
            high = float(rng.uniform(0.9, 2.2))
            strip(
                -0.4,
                high,
                r.tint(jitter(rng, rng.uniform(60, 190), 0.2)),
                labels.FENCE,
                r.MESH,
                p0=float(rng.choice([0.15, 0.5, 2.5])),
                p1=float(rng.uniform(0.12, 0.4)),
            )
        elif what == "wall":
            strip(
                -0.5,
                float(rng.uniform(1.0, 4.0)),
                r.tint(
                    rng.choice([(150, 144, 136), (128, 84, 66), (108, 40, 32)]),
                    rng.uniform(0.6, 1.2),
                ),
                labels.CONSTRUCTION,
                r.BRICK if rng.random() < 0.6 else r.PLAIN,
                grain=0.15,
            )
        elif what == "barrier":
            strip(
                -0.4,
                float(rng.uniform(1.8, 4.0)),
                r.tint(jitter(rng, (120, 124, 118), 0.35)),
                labels.CONSTRUCTION,
                r.BOARDS,
                p0=float(rng.choice([0.2, 0.5, 2.0])),
            )
        elif what == "low":
            strip(
                -0.4,
                float(rng.uniform(0.15, 0.6)),
                r.tint((160, 156, 148), rng.uniform(0.6, 1.2)),
                labels.CONSTRUCTION,
                r.PLAIN,
            )
        elif what == "hedge":
            strip(
                -0.5,
                float(rng.uniform(1.0, 4.5)),
                r.tint(looks.foliage[rng.integers(3)]),
                labels.VEGETATION,
                r.HEDGE,
            )
        elif what == "cutting":
            high = float(rng.uniform(2, 9))
            kind = rng.random() < 0.75
            strip(
                -0.4,
                high,
                r.tint(looks.foliage[rng.integers(3)] if kind else (120, 112, 104)),
                labels.VEGETATION if kind else labels.TERRAIN,
                r.PLAIN,
                grain=0.35,
                lean=away * high * float(rng.uniform(0.5, 1.6)),
            )
        dense = {"forest": 2.2, "open": 25.0, "fence": 14.0}.get(str(what), 18.0)
        if draft.kind == "tram":
            dense *= 2.5
        spot = at
        while spot < stop:
            depth = float(rng.gamma(1.6, 6.0)) + (2.5 if what != "open" else 5.0)
            if draft.in_the_open(spot):
                f.tree(kit, rng, spot, near + away * depth, looks.foliage)
            spot += float(rng.exponential(dense)) + 0.8
        built = {"tram": 0.9, "station": 0.5, "line": 0.22, "none": 0.6}[draft.kind]
        spot = at
        while spot < stop and rng.random() < built:
            start = near + away * float(rng.uniform(3, 9 if draft.kind == "tram" else 30))
            if draft.in_the_open(spot):
                f.building(kit, rng, spot, start, looks.sun_side)
            spot += float(rng.uniform(15, 60))
        at = stop


def _populate(draft: Draft, right: float, left: float) -> None:
    """Other trains, vehicles and people beside the ego track."""
    rng, kit, sun = draft.rng, draft.kit, draft.looks.sun_side
    reach = draft.length_m + 250
    for offset in draft.offsets[1:]:
        if np.isfinite(offset).all() and rng.random() < 0.22 * max(1.0, reach / 800):
            start = float(rng.uniform(12, reach))
            long = float(rng.uniform(24, 160))
            place = float(offset[int(start) - START_M])
            if abs(place) > 2.8 + draft.spacing_m / 4:
                movables.train(kit, rng, start, place, long, sun)
    for _ in range(rng.poisson(1.2 * reach / 300)):
        side = left + rng.uniform(1.0, 7) if rng.random() < 0.5 else right - rng.uniform(1.0, 7)
        movables.person(kit, rng, float(rng.uniform(6, reach)), float(side), -0.15)
    for low, high, *_rest, label, _mark in draft.zones:
        if (
            label == labels.ROAD
            and high - low > 2
            and (low > left - 1 or high < right + 1 or draft.kind in ("tram", "none"))
        ):
            for _ in range(rng.poisson(2.0 * reach / 300)):
                middle = float(rng.uniform(low + 1.0, high - 1.0))
                if draft.kind != "none" and abs(middle) < 3.2:
                    continue
                movables.car(
                    kit,
                    rng,
                    float(rng.uniform(10, reach)),
                    middle,
                    0.0,
                    sun,
                    truck=rng.random() < 0.2,
                )


def _span(draft: Draft, right: float, left: float) -> None:
    """Bridges over the line, and a tunnel now and then."""
    rng, kit = draft.rng, draft.kit
    reach = draft.length_m + 300
    at = float(rng.exponential(900)) + 25
    while at < reach:
        wide = float(rng.uniform(4, 14))
        high = float(rng.uniform(5.8, 7.5))
        tone = r.tint((150, 146, 138), rng.uniform(0.6, 1.1))
        kit.box(
            at,
            (left + right) / 2,
            high,
            (wide, left - right + 24, float(rng.uniform(0.8, 1.6))),
            tone,
            labels.CONSTRUCTION,
            draft.looks.sun_side,
            r.BRICK,
        )
        for edge, away in ((left + 1.4, 1.0), (right - 1.4, -1.0)):
            kit.face(
                (at, edge, -0.5),
                (wide, 0, 0),
                (0, 0, high + 0.5),
                r.tint(tone, 0.6),
                labels.CONSTRUCTION,
            )
            kit.face(
                (at, edge, -0.5),
                (0, away * 9, 0),
                (0, 0, high + 0.5),
                r.tint(tone, 0.85),
                labels.CONSTRUCTION,
                r.BRICK,
            )
        self_shadow = (draft.along > at - 1) & (draft.along < at + wide + 1)
        draft.light[self_shadow] *= 0.45
        at += wide + float(rng.exponential(1500)) + 60
    if rng.random() < 0.05 * max(1.0, reach / 1500) and draft.kind == "line":
        _tunnel(draft, float(rng.uniform(25, reach)), right, left)


def _tunnel(draft: Draft, start: float, right: float, left: float) -> None:
    rng, kit = draft.rng, draft.kit
    long = float(rng.uniform(60, 300))
    high = 6.4
    stone = r.tint((120, 114, 106), rng.uniform(0.6, 1.2))
    inside = r.tint((70, 66, 62), 0.5)
    for edge, away in ((left + 0.9, 1.0), (right - 0.9, -1.0)):
        kit.face(
            (start, edge, -0.6),
            (0, away * 14, 0),
            (0, 0, high + 5),
            stone,
            labels.CONSTRUCTION,
            r.BRICK,
        )
        at = start
        while at < start + long:
            kit.face(
                (at, edge, -0.6),
                (8, 0, 0),
                (0, 0, high + 0.6),
                r.tint(inside, 0.6),
                labels.CONSTRUCTION,
            )
            at += 8
    kit.face(
        (start, left + 0.9, high),
        (0, right - left - 1.8, 0),
        (0, 0, 4.4),
        stone,
        labels.CONSTRUCTION,
        r.BRICK,
    )
    kit.face(
        (start, left + 16, high + 4),
        (0, right - left - 32, 0),
        (4, 0, 9),
        r.tint(draft.looks.foliage[0]),
        labels.VEGETATION,
        r.PLAIN,
        grain=0.3,
    )
    at = start
    while at < start + long:
        kit.face(
            (at, left + 0.9, high),
            (0, right - left - 1.8, 0),
            (8, 0, 0),
            r.tint(inside, 0.4),
            labels.CONSTRUCTION,
        )
        at += 8
    into = np.clip((draft.along - start) / 12, 0, 1) * (draft.along < start + long)
    draft.light *= 1 - 0.9 * into
