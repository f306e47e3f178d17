"""Anomalies of the ego track: distorted rails, things that obstruct it, people on it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from railinspect import labels
from railinspect.scenes import movables, rails, tables
from railinspect.scenes.draft import Draft, Thing

AnomalyType = Literal["distortion", "obstruction", "trespasser"]
ANOMALY_TYPES: tuple[AnomalyType, ...] = ("distortion", "obstruction", "trespasser")

BED_LEVEL_M = -rails.RAIL_HEIGHT_M


def plant(
    draft: Draft,
    kind: AnomalyType,
    chainage_m: float,
    rng: np.random.Generator,
    clear_of_m: float | None = None,
) -> Thing:
    """Put one anomaly on the ego track.

    Args:
        draft: The world to change.
        kind: What to plant.
        chainage_m: Position of its near end, metres.
        rng: Source of its details.
        clear_of_m: Least lateral amplitude of a distortion, metres (default 0.12).

    Returns:
        The planted thing.
    """
    thing = draft.next_id()
    sun = draft.looks.sun_side
    half = draft.spacing_m / 2
    up = BED_LEVEL_M
    for row in draft.crossings:
        if row[tables.CROSS_NEAR] <= chainage_m <= row[tables.CROSS_FAR]:
            up = 0.0
    if draft.tracks and draft.tracks[0][tables.TRACK_EMBEDDED] > 0:
        up = 0.0
    if kind == "distortion":
        amplitude = float(rng.uniform(clear_of_m or 0.12, 0.30))
        period = float(rng.choice([0.0, rng.uniform(3.0, 9.0)]))
        length = float(rng.uniform(8, 14)) if period == 0 else period * float(rng.uniform(1.5, 3))
        draft.waves.append((chainage_m, length, amplitude, period, 1.0, 1.0))
        made = Thing(thing, kind, labels.RAIL_RAISED, chainage_m, 0.0, length, amplitude, True)
    elif kind == "trespasser":
        left = float(rng.uniform(-1.0, 1.0))
        high = movables.person(draft.kit, rng, chainage_m, left, up, thing)
        made = Thing(thing, kind, labels.HUMAN, chainage_m, left, 0.4, high, True)
    else:
        what = rng.choice(["stones", "log", "crate", "animal", "car"], p=[0.3, 0.2, 0.3, 0.1, 0.1])
        left = float(rng.uniform(-half, half))
        label = labels.CONSTRUCTION
        if what == "stones":
            high = movables.boulder(
                draft.kit, rng, chainage_m, left, up, float(rng.uniform(0.4, 1.1)), thing
            )
        elif what == "log":
            high = movables.log(draft.kit, rng, chainage_m, left * 0.5, up + 0.1, thing)
        elif what == "crate":
            high = movables.crate(draft.kit, rng, chainage_m, left, up, sun, thing)
        elif what == "animal":
            high = movables.animal(draft.kit, rng, chainage_m, left, up, thing)
        else:
            high = movables.car(
                draft.kit, rng, chainage_m, left * 0.5, up, sun, thing, truck=False, crosswise=True
            )
            label = labels.CAR
        made = Thing(thing, kind, label, chainage_m, left, 1.0, high, True)
    draft.things.append(made)
    return made


def sprinkle(draft: Draft, rng: np.random.Generator, focal_px: float) -> None:
    """Give a training picture its share of anomalies and of trains on the ego track.

    Args:
        draft: The world to change.
        rng: Source of what is planted and where.
        focal_px: Focal length of the camera, pixels: how far things can be made out.
    """
    nearest_m = 6.0 * draft.settings.closer
    reach_m = min(80.0 * draft.settings.closer, 0.08 * focal_px)
    if draft.settings.crowded:
        for _ in range(int(rng.integers(1, 5))):
            kind = ANOMALY_TYPES[int(rng.choice(3, p=[0.1, 0.5, 0.4]))]
            plant(draft, kind, float(nearest_m + rng.gamma(1.6, 0.14 * reach_m)), rng)
        return
    chance = rng.random()
    if chance < 0.34:
        for _ in range(int(rng.integers(1, 3))):
            kind = ANOMALY_TYPES[int(rng.choice(3, p=[0.2, 0.45, 0.35]))]
            plant(draft, kind, float(nearest_m + rng.gamma(1.5, 0.2 * reach_m)), rng)
    elif chance < 0.42:
        at = 2 * nearest_m + float(rng.gamma(1.6, 30.0))
        thing = draft.next_id()
        high = movables.train(
            draft.kit, rng, at, 0.0, float(rng.uniform(20, 120)), draft.looks.sun_side, thing
        )
        draft.things.append(Thing(thing, "obstruction", labels.ON_RAILS, at, 0.0, 20.0, high, True))
