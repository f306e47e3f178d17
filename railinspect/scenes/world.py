"""One railway world: its camera, tracks, surroundings, things and looks, drawn from a seed."""

from __future__ import annotations

import numpy as np

from railinspect.camera import Camera
from railinspect.labels import GAUGES_M
from railinspect.scenes.alignment import Alignment
from railinspect.scenes.appearance import draw_appearance
from railinspect.scenes.draft import Draft, World
from railinspect.scenes.lineside import furnish
from railinspect.scenes.settings import SceneSettings
from railinspect.scenes.terrain import lay_ground
from railinspect.scenes.tracks import draw_alignment, lay_tracks

LOOK_DROP = 0.15
"""How far above their middle row closer looks (:mod:`railinspect.fovea`) have the horizon, share of
the height."""


def draw_camera(rng: np.random.Generator, settings: SceneSettings, gauge_m: float) -> Camera:
    """A random cab camera over a track of the given gauge."""
    if settings.camera is not None:
        return settings.camera
    width, height = settings.size_wh
    fov = np.radians(rng.uniform(35, 80))
    # horizon above the middle row, share of the height
    drop = rng.uniform(-0.12, 0.22)
    if settings.closer > 1:
        fov = 2 * np.arctan(np.tan(fov / 2) / settings.closer)
        drop = rng.normal(LOOK_DROP, 0.05)
    focal = width / 2 / np.tan(fov / 2)
    distorted = rng.random() < 0.2
    return Camera.from_field_of_view(
        settings.size_wh,
        float(fov),
        float(np.clip(rng.normal(2.6, 0.55), 1.5, 4.0)),
        pitch_rad=float(np.arctan(drop * height / focal)),
        roll_rad=float(np.clip(rng.normal(0, 0.012), -0.05, 0.05)),
        yaw_rad=float(np.clip(rng.normal(0, 0.03), -0.12, 0.12)) / settings.closer,
        offset_m=float(np.clip(rng.normal(0, 0.18), -0.7, 0.7)),
        distortion=(float(rng.uniform(-0.16, 0.04)) if distorted else 0.0, 0.0, 0.0, 0.0, 0.0),
        gauge_m=gauge_m,
    )


def finish(draft: Draft, seed: int, alignment: Alignment, camera: Camera) -> World:
    """Freeze a draft into a world."""
    size = draft.along.size
    geometry, attributes = draft.kit.tables()
    return World(
        seed=seed,
        kind=draft.kind,
        alignment=alignment,
        camera=camera,
        looks=draft.looks,
        offsets=np.array([*draft.offsets, *draft.turns], float).reshape(-1, size)
        if draft.offsets
        else np.full((1, size), np.nan),
        tracks=np.array(draft.tracks, float).reshape(-1, 12) if draft.tracks else np.zeros((1, 12)),
        waves=np.array(draft.waves, float).reshape(-1, 6),
        zones=np.array(draft.zones, float).reshape(-1, 9),
        crossings=np.array(draft.crossings, float).reshape(-1, 6),
        light=draft.light,
        geometry=geometry,
        attributes=attributes,
        things=tuple(draft.things),
    )


def begin(
    seed: int, settings: SceneSettings, length_m: float = 0.0
) -> tuple[Draft, Alignment, Camera]:
    """Draw a world without anomalies, still open for planting some."""
    rng = np.random.default_rng([seed, 0x5CE4E])
    kind = settings.kind
    if kind == "any":
        kind = str(rng.choice(["line", "station", "tram", "none"], p=[0.56, 0.22, 0.18, 0.04]))  # type: ignore[assignment]  # numpy's str
    if settings.camera is not None:
        gauge = settings.camera.gauge_m
    else:
        names = ["standard", "russian", "iberian", "metre"]
        gauge = GAUGES_M[str(rng.choice(names, p=[0.7, 0.1, 0.08, 0.12]))]
    camera = draw_camera(rng, settings, gauge)
    looks = draw_appearance(rng, settings)
    draft = Draft(rng, settings, looks, kind, length_m, camera.rail_spacing_m)
    curvy = float(rng.choice([0.15, 0.6, 0.95]))
    alignment = draw_alignment(rng, draft.end_m, settings.min_radius_m, curvy)
    lay_tracks(draft)
    lay_ground(draft)
    furnish(draft)
    return draft, alignment, camera
