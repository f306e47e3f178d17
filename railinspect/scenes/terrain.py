"""The ground beside the tracks, and the roads and paths across them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from railinspect import labels
from railinspect.scenes import movables
from railinspect.scenes import raster as r
from railinspect.scenes.appearance import jitter
from railinspect.scenes.draft import Draft


def lay_ground(draft: Draft) -> None:
    """Choose terrain, roads and paths along the track, and roads across it."""
    rng = draft.rng
    grass = draft.looks.grass
    right, left = draft.edges()
    urban = draft.kind == "tram"

    def zone(
        low: float,
        high: float,
        colour: npt.ArrayLike,
        grain: float,
        kind: int,
        label: int,
        mark: int = 0,
    ) -> None:
        red, green, blue = np.asarray(colour, float)
        draft.zones.append((low, high, red, green, blue, grain, kind, label, mark))

    if urban or (draft.kind == "none" and rng.random() < 0.6):
        asphalt = jitter(rng, (104, 104, 106), 0.25)
        lawn = rng.random() < 0.3 and draft.kind == "tram"
        zone(-400, 400, jitter(rng, (150, 146, 140), 0.15), 0.05, 0, labels.SIDEWALK)
        span_l, span_r = left + rng.uniform(1.5, 7), right - rng.uniform(1.5, 7)
        zone(span_r, span_l, asphalt, 0.06, 0, labels.ROAD, int(rng.integers(0, 3)))
        if draft.settings.distractors:
            for edge in (span_l, span_r):
                zone(
                    edge - 0.14,
                    edge + 0.14,
                    jitter(rng, (186, 182, 174), 0.1),
                    0.04,
                    0,
                    labels.SIDEWALK,
                )
            if rng.random() < 0.6:
                for _ in range(int(rng.integers(1, 4))):
                    at = float(rng.uniform(span_r, span_l))
                    zone(at - 0.07, at + 0.07, (226, 226, 222), 0.05, 0, labels.ROAD)
        if lawn:
            zone(right + 0.2, left - 0.2, grass, 0.16, 1, labels.TERRAIN)
        elif rng.random() < 0.4:
            zone(right + 0.4, left - 0.4, jitter(rng, asphalt, 0.15), 0.06, 0, labels.ROAD)
        return
    zone(-400, 400, grass, rng.uniform(0.08, 0.2), 1, labels.TERRAIN)
    verge = jitter(rng, 0.5 * grass + 0.5 * draft.looks.look[:3], 0.12)
    zone(
        right - rng.uniform(0.5, 3),
        left + rng.uniform(0.5, 3),
        verge,
        rng.uniform(0.1, 0.25),
        int(rng.integers(0, 2)),
        labels.TERRAIN,
    )
    if draft.kind == "station":
        bed = draft.looks.look[:3]
        zone(right - 0.3, left + 0.3, jitter(rng, bed, 0.08), 0.2, 0, labels.TRACKBED)
    if draft.settings.distractors:
        if rng.random() < 0.3:  # road beside the track
            low = (left + rng.uniform(2, 8)) if rng.random() < 0.5 else (right - rng.uniform(9, 16))
            zone(
                low,
                low + rng.uniform(3, 7),
                jitter(rng, (108, 108, 110), 0.2),
                0.06,
                0,
                labels.ROAD,
                int(rng.integers(0, 3)),
            )
            if rng.random() < 0.5:
                zone(
                    low - 0.12,
                    low + 0.12,
                    jitter(rng, (180, 178, 172), 0.1),
                    0.05,
                    0,
                    labels.SIDEWALK,
                )
        for _ in range(int(rng.integers(0, 3))):  # cable troughs, paths, drains
            at = (
                (left + rng.uniform(-0.2, 3))
                if rng.random() < 0.5
                else (right - rng.uniform(-0.2, 3))
            )
            wide = float(rng.choice([0.06, 0.12, 0.35, 0.8]))
            zone(
                at - wide / 2,
                at + wide / 2,
                jitter(rng, (160, 154, 144), 0.3),
                0.07,
                0,
                labels.TERRAIN,
            )
    every = 700.0 if draft.kind == "line" else 2500.0
    if draft.kind in ("line", "station"):
        at = float(rng.uniform(15, every))
        while at < draft.length_m + 250:
            wide = float(rng.uniform(3.5, 8))
            colour = jitter(rng, (112, 110, 108), 0.2)
            draft.crossings.append((at, at + wide, *colour, float(rng.integers(0, 2))))
            _furnish_crossing(draft, at, wide, right, left)
            at += float(rng.uniform(0.6, 1.6)) * every


def _furnish_crossing(draft: Draft, at: float, wide: float, right: float, left: float) -> None:
    rng, kit = draft.rng, draft.kit
    for side, edge in ((1.0, left + 1.6), (-1.0, right - 1.6)):
        post = (at - 0.6, edge, 0.0)
        kit.line(post, (post[0], edge, 3.0), 0.06, (210, 210, 210), labels.POLE)
        kit.face(
            (post[0] - 0.05, edge + 0.5, 2.3),
            (0, -1.0, 0),
            (0, 0, 0.8),
            (225, 225, 222),
            labels.TRAFFIC_SIGN,
            r.ELLIPSE,
        )
        if rng.random() < 0.6:
            lifted = rng.random() < 0.4
            tip = (at - 0.5, edge + side * 0.2, 5.5) if lifted else (at - 0.5, edge, 1.0)
            far = (at - 0.5, edge + side * 0.4, 1.0)
            kit.line(
                far, tip if lifted else (at + wide, edge, 1.0), 0.06, (226, 60, 44), labels.POLE
            )
    if draft.settings.occluders and rng.random() < 0.5:
        for side, edge in ((1.0, left + 3.5), (-1.0, right - 3.5)):
            if rng.random() < 0.6:
                movables.car(
                    kit,
                    rng,
                    at + wide * (0.25 if side > 0 else 0.6),
                    edge + side * 3.0,
                    0.0,
                    draft.looks.sun_side,
                    truck=rng.random() < 0.2,
                    crosswise=True,
                )
