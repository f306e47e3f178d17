"""People, animals, vehicles and things that lie about; each function adds one to a kit."""

from __future__ import annotations

import numpy as np

from railinspect import labels
from railinspect.scenes import raster as r
from railinspect.scenes.raster import Kit, Point, tint

Rng = np.random.Generator


def person(
    kit: Kit,
    rng: Rng,
    along: float,
    left: float,
    up: float,
    thing: int = 0,
    height: float | None = None,
) -> float:
    """Add a standing, walking, crouching or sitting person; returns the standing height, m."""
    tall = float(height if height is not None else np.clip(rng.normal(1.72, 0.09), 1.45, 1.98))
    pose = rng.choice(["stand", "walk", "crouch"], p=[0.4, 0.5, 0.1])
    bend = 0.62 if pose == "crouch" and height is None else 1.0
    wear = rng.random()
    if wear < 0.3:
        coat = tint(rng.choice([(255, 120, 20), (225, 235, 40)]), rng.uniform(0.75, 1.0))
    else:
        coat = tint(rng.uniform(15, 215, 3))
    legs = coat if wear < 0.12 else tint(rng.uniform(15, 130, 3) * np.array([0.9, 0.9, 1.1]))
    skin = tint(rng.choice([(224, 180, 150), (186, 136, 106), (112, 78, 60)]))
    hip = up + 0.5 * tall * bend
    neck = up + 0.83 * tall * bend
    stride = rng.uniform(0.08, 0.28) if pose == "walk" else 0.07
    turn = rng.uniform(0, np.pi)
    step_l, step_a = stride * np.cos(turn) + 0.06, stride * np.sin(turn)
    width = 0.105 * tall
    for side in (-1.0, 1.0):
        foot = (along + side * step_a, left + side * step_l, up)
        knee = (
            along + side * step_a * 0.6,
            left + side * step_l * 0.75 + (0.05 if pose == "crouch" else 0.0),
            (up + hip) / 2,
        )
        kit.line(foot, knee, 0.042 * tall, legs, labels.HUMAN, thing)
        kit.line(knee, (along, left + side * 0.06, hip), 0.05 * tall, legs, labels.HUMAN, thing)
        shoe = (foot[0] - 0.1, foot[1], up + 0.04)
        kit.line(shoe, (foot[0] + 0.1, foot[1], up + 0.05), 0.05, (24, 22, 22), labels.HUMAN, thing)
        swing = rng.uniform(-0.12, 0.2)
        shoulder = (along, left + side * width, neck - 0.03)
        hand = (along, left + side * (width + 0.06 + swing), hip - 0.02 + abs(swing))
        kit.line(shoulder, hand, 0.032 * tall, coat, labels.HUMAN, thing)
    kit.line(
        (along, left, hip - 0.06), (along, left, neck), 0.095 * tall, coat, labels.HUMAN, thing
    )
    kit.line(
        (along, left + width * 0.8, neck - 0.03),
        (along, left - width * 0.8, neck - 0.03),
        0.05,
        coat,
        labels.HUMAN,
        thing,
    )
    if wear < 0.3:
        for band in (0.35, 0.62):
            z = hip + band * (neck - hip)
            kit.face(
                (along - 0.2, left + width * 0.9, z),
                (0, -width * 1.8, 0),
                (0, 0, 0.05),
                (225, 228, 220),
                labels.HUMAN,
                thing=thing,
            )
    size = 0.135 * tall
    kit.face(
        (along - 0.02, left + size * 0.42, neck - 0.01),
        (0, -size * 0.84, 0),
        (0, 0, size * 1.15),
        skin if rng.random() < 0.5 else tint(rng.uniform(20, 110, 3)),
        labels.HUMAN,
        r.ELLIPSE,
        thing=thing,
    )
    shadow(kit, along, left, up, 0.9, 0.7)
    return float(tall * bend)


def shadow(
    kit: Kit, along: float, left: float, up: float, width: float, length: float, dark: float = 0.55
) -> None:
    """Add a soft contact shadow on the ground."""
    kit.face(
        (along - length / 2, left + width / 2, up + 0.01),
        (0, -width, 0),
        (length, 0, 0),
        (0, 0, 0),
        r.NO_LABEL,
        r.SHADOW,
        p0=1.0,
        grain=dark,
    )


def boulder(
    kit: Kit, rng: Rng, along: float, left: float, up: float, size: float, thing: int
) -> float:
    """Add a heap of one to three stones about ``size`` high; returns the height, m."""
    colour = tint(
        rng.choice([(128, 122, 112), (98, 92, 86), (156, 146, 128)]), rng.uniform(0.7, 1.2)
    )
    shadow(kit, along, left, up, size * 2.2, size * 1.6)
    for i in range(int(rng.integers(1, 4))):
        scale = size * (1.0 if i == 0 else rng.uniform(0.4, 0.7))
        side = 0.0 if i == 0 else rng.uniform(-0.8, 0.8) * size
        wide = scale * rng.uniform(1.1, 1.6)
        kit.face(
            (along - 0.05 * i, left + side + wide / 2, up - 0.06 * scale),
            (0, -wide, 0),
            (0, 0, scale * 1.06),
            tint(colour, rng.uniform(0.85, 1.1)),
            labels.CONSTRUCTION,
            r.STONE,
            grain=0.25,
            thing=thing,
        )
    return size


def log(kit: Kit, rng: Rng, along: float, left: float, up: float, thing: int) -> float:
    """Add a fallen trunk across the track, with branches; returns the height, m."""
    radius = float(rng.uniform(0.16, 0.3))
    length = float(rng.uniform(2.4, 5.0))
    skew = float(rng.uniform(-0.8, 0.8))
    bark = tint((92, 74, 56), rng.uniform(0.6, 1.3))
    shadow(kit, along, left, up, length, 1.2)
    kit.line(
        (along - skew, left + length / 2, up + radius),
        (along + skew, left - length / 2, up + radius),
        radius,
        bark,
        labels.CONSTRUCTION,
        thing,
    )
    for _ in range(int(rng.integers(0, 5))):
        at = rng.uniform(-0.45, 0.45) * length
        kit.line(
            (along, left + at, up + radius),
            (along, left + at + rng.uniform(-0.6, 0.6), up + radius + rng.uniform(0.4, 1.0)),
            0.035,
            bark,
            labels.CONSTRUCTION,
            thing,
        )
    return 2 * radius


def crate(
    kit: Kit, rng: Rng, along: float, left: float, up: float, sun: float, thing: int
) -> float:
    """Add a crate, a pallet stack, a barrel or a barrier; returns the height, m."""
    kind = rng.choice(["crate", "barrel", "barrier", "bags"])
    high = float(rng.uniform(0.5, 1.3))
    colour = tint(
        rng.choice(
            [
                (168, 132, 88),
                (60, 90, 150),
                (190, 60, 44),
                (200, 196, 60),
                (210, 210, 206),
                (74, 80, 84),
            ]
        ),
        rng.uniform(0.7, 1.1),
    )
    shadow(kit, along, left, up, 2.2, 1.6)
    if kind == "barrel":
        kit.line(
            (along, left, up), (along, left, up + high), 0.32, colour, labels.CONSTRUCTION, thing
        )
    elif kind == "barrier":
        kit.box(
            along,
            left,
            up,
            (0.5, 2.2, high * 0.7),
            colour,
            labels.CONSTRUCTION,
            sun,
            r.BAND,
            (235, 235, 232),
            0.35,
            0.65,
            thing=thing,
        )
        high *= 0.7
    else:
        kit.box(
            along,
            left,
            up,
            (0.9, float(rng.uniform(0.8, 1.6)), high),
            colour,
            labels.CONSTRUCTION,
            sun,
            r.BOARDS if kind == "crate" else r.PLAIN,
            p0=0.14,
            grain=0.15,
            thing=thing,
        )
    return high


def animal(kit: Kit, rng: Rng, along: float, left: float, up: float, thing: int) -> float:
    """Add a deer, a cow or a sheep seen from the side; returns the height, m."""
    high = float(rng.uniform(0.8, 1.5))
    coat = tint(rng.choice([(120, 84, 52), (60, 48, 42), (205, 200, 188)]), rng.uniform(0.8, 1.15))
    facing = float(rng.choice([-1.0, 1.0]))
    long = high * 0.62
    shadow(kit, along, left, up, 2 * long, 0.8)
    for at in (-0.9, -0.7, 0.7, 0.9):
        kit.line(
            (along, left + at * long, up),
            (along, left + at * long * 0.9, up + high * 0.55),
            0.045 * high,
            coat,
            labels.CONSTRUCTION,
            thing,
        )
    kit.line(
        (along, left - long, up + high * 0.66),
        (along, left + long, up + high * 0.66),
        0.2 * high,
        coat,
        labels.CONSTRUCTION,
        thing,
    )
    neck = left + facing * long
    kit.line(
        (along, neck, up + high * 0.7),
        (along, neck + facing * 0.3 * high, up + high * 1.0),
        0.09 * high,
        coat,
        labels.CONSTRUCTION,
        thing,
    )
    kit.line(
        (along, neck + facing * 0.25 * high, up + high),
        (along, neck + facing * 0.5 * high, up + high * 0.9),
        0.08 * high,
        coat,
        labels.CONSTRUCTION,
        thing,
    )
    return high * 1.05


def car(
    kit: Kit,
    rng: Rng,
    along: float,
    left: float,
    up: float,
    sun: float,
    thing: int = 0,
    truck: bool = False,
    crosswise: bool = False,
) -> float:
    """Add a car, van or lorry, lengthwise or across the track; returns the height, m."""
    label = labels.TRUCK if truck else labels.CAR
    paint = tint(
        rng.choice(
            [
                (210, 210, 210),
                (40, 42, 46),
                (150, 30, 28),
                (40, 70, 130),
                (120, 122, 126),
                (235, 235, 238),
            ]
        ),
        rng.uniform(0.75, 1.05),
    )
    glass = (38.0, 46.0, 56.0)
    length, width, high = (8.0, 2.5, 3.3) if truck else (4.3, 1.8, 1.5)
    size: Point = (width, length, high * 0.55) if crosswise else (length, width, high * 0.55)
    shadow(kit, along + size[0] / 2, left, up, size[1] * 1.2, size[0] * 1.1, 0.7)
    kit.box(along, left, up + 0.25, size, paint, label, sun, thing=thing, grain=0.03)
    if truck:
        load: Point = (
            (size[0] * 0.96, size[1] * 0.7, high * 0.6)
            if crosswise
            else (size[0] * 0.7, size[1], high * 0.6)
        )
        kit.box(
            along,
            left + (0.15 * size[1] if crosswise else 0),
            up + 0.25 + size[2],
            load,
            tint(paint, 0.9),
            label,
            sun,
            r.BAND,
            (220, 220, 216),
            0.3,
            0.7,
            thing=thing,
        )
    else:
        cabin: Point = (
            (size[0] * 0.85, size[1] * 0.55, high * 0.4)
            if crosswise
            else (size[0] * 0.5, size[1] * 0.88, high * 0.4)
        )
        kit.box(
            along + size[0] * 0.1,
            left,
            up + 0.25 + size[2],
            cabin,
            paint,
            label,
            sun,
            r.BAND,
            glass,
            0.12,
            0.85,
            thing=thing,
            grain=0.03,
        )
    for a in (0.0, size[0]):
        for side in (-0.36, 0.36):
            wheel = (along + a * 0.9 + 0.05, left + side * size[1], up + 0.32)
            kit.face(
                (wheel[0] - 0.06, wheel[1] + 0.32, up),
                (0, -0.64, 0),
                (0, 0, 0.64),
                (22, 22, 24),
                label,
                r.ELLIPSE,
                thing=thing,
            )
    return high


def train(
    kit: Kit,
    rng: Rng,
    along: float,
    left: float,
    length: float,
    sun: float,
    thing: int = 0,
    seen_head: bool = True,
) -> float:
    """Add a train of given length standing on a track; returns the height, m."""
    high, width, floor = 3.7, 2.85, 0.55
    livery = tint(
        rng.choice(
            [
                (190, 34, 34),
                (230, 230, 232),
                (40, 84, 150),
                (36, 112, 70),
                (232, 180, 40),
                (92, 96, 102),
            ]
        ),
        rng.uniform(0.75, 1.05),
    )
    band = tint(rng.uniform(30, 230, 3))
    at = along
    while at < along + length:
        part = min(24.0, along + length - at)
        kit.box(
            at,
            left,
            floor,
            (part - 0.6, width, high - floor),
            livery,
            labels.ON_RAILS,
            sun,
            r.WINDOWS if rng.random() < 0.6 else r.BAND,
            (34, 40, 50),
            2.0,
            2.2 if rng.random() < 0.6 else 0.8,
            thing=thing,
            grain=0.04,
        )
        kit.box(
            at + 0.5,
            left,
            0.05,
            (part - 1.5, width * 0.8, floor),
            (36, 36, 38),
            labels.ON_RAILS,
            sun,
            thing=thing,
        )
        at += part
    if seen_head:
        front = along - 0.05
        kit.face(
            (front, left + width / 2, floor),
            (0, -width, 0),
            (0, 0, high - floor),
            tint(livery, 0.95),
            labels.ON_RAILS,
            thing=thing,
            grain=0.04,
        )
        kit.face(
            (front - 0.02, left + width * 0.42, 1.9),
            (0, -width * 0.84, 0),
            (0, 0, 1.1),
            (30, 36, 44),
            labels.ON_RAILS,
            thing=thing,
            grain=0.04,
        )
        kit.face(
            (front - 0.02, left + width / 2, floor + 0.2),
            (0, -width, 0),
            (0, 0, 0.45),
            band,
            labels.ON_RAILS,
            thing=thing,
        )
        for side in (-0.38, 0.38):
            kit.face(
                (front - 0.05, left + side * width + 0.16, 1.2),
                (0, -0.32, 0),
                (0, 0, 0.32),
                (255, 246, 220),
                labels.ON_RAILS,
                r.ELLIPSE,
                thing=thing,
            )
    shadow(kit, along + 1.0, left, -0.15, 3.4, 3.0, 0.7)
    return high
