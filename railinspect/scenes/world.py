"""One railway world: its alignment, tracks, surroundings, things and looks, drawn from a seed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from railinspect import labels
from railinspect.camera import Camera
from railinspect.labels import GAUGES_M
from railinspect.scenes import furniture as f
from railinspect.scenes import ground as g
from railinspect.scenes import raster as r
from railinspect.scenes.alignment import Alignment
from railinspect.scenes.appearance import Appearance, draw_appearance, jitter
from railinspect.scenes.raster import Kit
from railinspect.scenes.settings import SceneSettings

Array = npt.NDArray[np.float64]

START_M = -20
"""Chainage at which a world begins; the observer starts at 0."""

AHEAD_M = 700.0
"""How far a world reaches beyond the last place it is seen from, metres."""


@dataclass(frozen=True)
class Thing:
    """An object of interest standing in the world, or a distortion of the rails.

    Attributes:
        id: Identity, > 0.
        type: ``obstruction``, ``trespasser`` or ``distortion`` when it is an anomaly of the ego
            track, else the name of its class.
        label: Class id it is drawn with.
        chainage_m: Position of its near end along the track.
        lateral_m: Lateral position of its middle against the ego track, positive left.
        length_m: Extent along the track.
        height_m: Height; for a distortion the lateral amplitude.
        on_track: Whether it stands within the clearance of the ego track.
    """

    id: int
    type: str
    label: int
    chainage_m: float
    lateral_m: float
    length_m: float
    height_m: float
    on_track: bool


@dataclass(frozen=True)
class World:
    """Everything a renderer needs; see the modules of the tables for their columns."""

    seed: int
    kind: str
    alignment: Alignment
    camera: Camera
    looks: Appearance
    offsets: Array
    tracks: Array
    waves: Array
    zones: Array
    crossings: Array
    light: Array
    geometry: Array
    attributes: npt.NDArray[np.float32]
    things: tuple[Thing, ...]

    @property
    def spacing_m(self) -> float:
        """Distance between the centre lines of the two heads, metres."""
        return self.camera.rail_spacing_m


@dataclass
class Draft:
    """A world under construction, handed from builder to builder."""

    rng: np.random.Generator
    settings: SceneSettings
    looks: Appearance
    kind: str
    length_m: float
    spacing_m: float
    kit: Kit = field(default_factory=Kit)
    offsets: list[Array] = field(default_factory=list)
    tracks: list[tuple[float, ...]] = field(default_factory=list)
    waves: list[tuple[float, ...]] = field(default_factory=list)
    zones: list[tuple[float, ...]] = field(default_factory=list)
    crossings: list[tuple[float, ...]] = field(default_factory=list)
    things: list[Thing] = field(default_factory=list)
    light: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self.light = np.ones(self.along.size)

    @property
    def end_m(self) -> float:
        """Where the world ends, metres."""
        return self.length_m + AHEAD_M

    @property
    def along(self) -> Array:
        """Positions of the tables along the track, metres, step 1."""
        return np.arange(START_M, int(self.length_m + AHEAD_M) + 1, dtype=float)

    def next_id(self) -> int:
        """A fresh object id."""
        return len(self.things) + 1

    def edges(self) -> tuple[float, float]:
        """Right and left limits of the tracks, metres."""
        middles = [o[np.isfinite(o)] for o in self.offsets]
        every = np.concatenate([*middles, np.zeros(1)])
        return float(every.min()) - 1.6, float(every.max()) + 1.6


def draw_camera(rng: np.random.Generator, settings: SceneSettings, gauge_m: float) -> Camera:
    """A random cab camera over a track of the given gauge."""
    if settings.camera is not None:
        return settings.camera
    width, height = settings.size_wh
    fov = np.radians(rng.uniform(35, 80))
    focal = width / 2 / np.tan(fov / 2)
    drop = rng.uniform(-0.12, 0.22)  # horizon against the middle row, share of the height
    distorted = rng.random() < 0.2
    return Camera.from_field_of_view(
        settings.size_wh,
        float(fov),
        float(np.clip(rng.normal(2.6, 0.55), 1.5, 4.0)),
        pitch_rad=float(np.arctan(drop * height / focal)),
        roll_rad=float(np.clip(rng.normal(0, 0.012), -0.05, 0.05)),
        yaw_rad=float(np.clip(rng.normal(0, 0.03), -0.12, 0.12)),
        offset_m=float(np.clip(rng.normal(0, 0.18), -0.7, 0.7)),
        distortion=(float(rng.uniform(-0.16, 0.04)) if distorted else 0.0, 0.0, 0.0, 0.0, 0.0),
        gauge_m=gauge_m,
    )


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
) -> None:
    """Lay a track; ``embedded`` 0 is open bed, 1 grooved in the ground, 2 in a paved strip."""
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
    base[g.TRACK_SHINE : g.TRACK_HEAD_B + 1] = _rail_colours(rng, used)
    base[g.TRACK_EMBEDDED] = embedded
    draft.offsets.append(offset)
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
                f.car(
                    kit,
                    rng,
                    at + wide * (0.25 if side > 0 else 0.6),
                    edge + side * 3.0,
                    0.0,
                    draft.looks.sun_side,
                    truck=rng.random() < 0.2,
                    crosswise=True,
                )


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
            colour = f.tint(rng.choice([(150, 150, 150), (60, 58, 56), (200, 196, 180)]))
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
    steel = f.tint(rng.choice([(128, 132, 134), (92, 108, 96), (150, 148, 142), (104, 72, 54)]))
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
        if what == "fence":
            high = float(rng.uniform(0.9, 2.2))
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.4,
                high,
                f.tint(jitter(rng, rng.uniform(60, 190), 0.2)),
                labels.FENCE,
                r.MESH,
                p0=float(rng.choice([0.15, 0.5, 2.5])),
                p1=float(rng.uniform(0.12, 0.4)),
            )
        elif what == "wall":
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.5,
                float(rng.uniform(1.0, 4.0)),
                f.tint(
                    rng.choice([(150, 144, 136), (128, 84, 66), (108, 40, 32)]),
                    rng.uniform(0.6, 1.2),
                ),
                labels.CONSTRUCTION,
                r.BRICK if rng.random() < 0.6 else r.PLAIN,
                grain=0.15,
            )
        elif what == "barrier":
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.4,
                float(rng.uniform(1.8, 4.0)),
                f.tint(jitter(rng, (120, 124, 118), 0.35)),
                labels.CONSTRUCTION,
                r.BOARDS,
                p0=float(rng.choice([0.2, 0.5, 2.0])),
            )
        elif what == "low":
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.4,
                float(rng.uniform(0.15, 0.6)),
                f.tint((160, 156, 148), rng.uniform(0.6, 1.2)),
                labels.CONSTRUCTION,
                r.PLAIN,
            )
        elif what == "hedge":
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.5,
                float(rng.uniform(1.0, 4.5)),
                f.tint(looks.foliage[rng.integers(3)]),
                labels.VEGETATION,
                r.HEDGE,
            )
        elif what == "cutting":
            high = float(rng.uniform(2, 9))
            kind = rng.random() < 0.75
            f.strip(
                kit,
                at,
                stop,
                near,
                -0.4,
                high,
                f.tint(looks.foliage[rng.integers(3)] if kind else (120, 112, 104)),
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
            f.tree(kit, rng, spot, near + away * depth, looks.foliage)
            spot += float(rng.exponential(dense)) + 0.8
        built = {"tram": 0.9, "station": 0.5, "line": 0.22, "none": 0.6}[draft.kind]
        spot = at
        while spot < stop and rng.random() < built:
            start = near + away * float(rng.uniform(3, 9 if draft.kind == "tram" else 30))
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
                f.train(kit, rng, start, place, long, sun)
    for _ in range(rng.poisson(1.2 * reach / 300)):
        side = left + rng.uniform(1.0, 7) if rng.random() < 0.5 else right - rng.uniform(1.0, 7)
        f.person(kit, rng, float(rng.uniform(6, reach)), float(side), -0.15)
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
                f.car(
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
        tone = f.tint((150, 146, 138), rng.uniform(0.6, 1.1))
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
                f.tint(tone, 0.6),
                labels.CONSTRUCTION,
            )
            kit.face(
                (at, edge, -0.5),
                (0, away * 9, 0),
                (0, 0, high + 0.5),
                f.tint(tone, 0.85),
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
    stone = f.tint((120, 114, 106), rng.uniform(0.6, 1.2))
    inside = f.tint((70, 66, 62), 0.5)
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
                f.tint(inside, 0.6),
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
        f.tint(draft.looks.foliage[0]),
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
            f.tint(inside, 0.4),
            labels.CONSTRUCTION,
        )
        at += 8
    into = np.clip((draft.along - start) / 12, 0, 1) * (draft.along < start + long)
    draft.light *= 1 - 0.9 * into


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
        offsets=np.array(draft.offsets, float).reshape(-1, size)
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
