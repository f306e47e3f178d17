"""The built-in cut-outs: people, stones, logs, boxes, animals and vehicles, drawn from a number.

:mod:`railinspect.scenes.movables` draws such things too, for a world in which they are one of
hundreds and a few pixels tall; what is blended into a photograph is seen from near.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np

from railinspect.anomalies.cutouts import Cutout, CutoutType, trimmed
from railinspect.anomalies.sculpt import Sculpture, Surface, Triple, picture
from railinspect.labels import CAR, CONSTRUCTION, HUMAN, TRUCK

Rng = np.random.Generator

VARIETY: Final = 16
"""Number of different things of each sort."""

LONGEST_PX: Final = 320
"""Longer side of a built-in cut-out, pixels."""


def person(rng: Rng) -> tuple[Sculpture, str, int]:
    """A worker, a passer-by or a child: standing, walking, running, working, crouching."""
    s = Sculpture()
    tall = float(np.clip(rng.normal(1.73, 0.09), 1.5, 1.97))
    pose = str(
        rng.choice(["stand", "walk", "run", "work", "crouch"], p=[0.3, 0.35, 0.1, 0.15, 0.1])
    )
    yaw = float(rng.uniform(-math.pi, math.pi))
    worker = rng.random() < 0.4 or pose == "work"
    skin = Surface(_pick(rng, [(226, 184, 156), (190, 142, 112), (120, 84, 64)]), 0.04)
    if worker:
        vest = _pick(rng, [(255, 116, 24), (222, 232, 48)])
        coat = Surface(vest, 0.07, 0.006, 9.0, (214, 218, 214), (0.30, 0.40))
        sleeve = Surface(vest if rng.random() < 0.7 else (40, 48, 74), 0.07, 0.004, 14.0)
        cloth = vest if rng.random() < 0.5 else (44, 52, 78)
        trousers = Surface(cloth, 0.08, 0.005, 11.0, (206, 210, 206), (0.62, 0.76))
    else:
        shade = tuple(float(c) for c in rng.uniform(24, 190, 3) * rng.uniform(0.5, 1.0))
        coat = Surface(shade, 0.10, 0.008, 8.0)  # type: ignore[arg-type]  # three of them
        sleeve = coat
        trousers = Surface(
            _pick(rng, [(46, 56, 82), (36, 36, 40), (92, 84, 70), (70, 74, 78)]), 0.10, 0.006, 10.0
        )
    shoe = Surface(_pick(rng, [(30, 26, 24), (62, 44, 30), (150, 148, 146)]), 0.05)
    lean = {"stand": 0.02, "walk": 0.06, "run": 0.22, "work": 0.75, "crouch": 0.45}[pose]
    hip_y = tall * {"crouch": 0.30, "work": 0.46, "run": 0.49}.get(pose, 0.51)
    stride = (
        {"stand": 0.04, "walk": 0.30, "run": 0.5, "work": 0.22, "crouch": 0.16}[pose] * tall / 1.75
    )
    phase = float(rng.uniform(0.55, 1.0))
    cos, sin = math.cos(yaw), math.sin(yaw)

    def at(side: float, up: float, ahead: float) -> Triple:
        """Body axes (right, up, forward) to object axes."""
        return (side * cos + ahead * sin, up, -side * sin + ahead * cos)

    hips: list[Triple] = []
    for k, side in enumerate((-1.0, 1.0)):
        swing = stride * phase * (1 if k else -1)
        lifted = 0.0
        if pose == "run" and k == 0:
            lifted = 0.28
        if pose == "walk" and k == 0:
            lifted = 0.05
        hip = at(side * 0.052 * tall, hip_y, 0.0)
        foot = at(side * 0.06 * tall, 0.055 + lifted, swing - (0.10 if lifted > 0.1 else 0))
        bend = {"crouch": 0.36, "run": 0.22, "work": 0.10, "walk": 0.05}.get(pose, 0.015)
        knee = at(
            side * 0.065 * tall, hip_y * (0.53 if pose != "crouch" else 0.85), swing * 0.5 + bend
        )
        s.cone(hip, knee, 0.050 * tall, 0.034 * tall, trousers, 0.03)
        s.cone(knee, foot, 0.034 * tall, 0.026 * tall, trousers, 0.02)
        toe = at(side * 0.07 * tall, 0.032 + lifted, swing + 0.13 - (0.10 if lifted > 0.1 else 0))
        s.cone((foot[0], foot[1] - 0.02, foot[2]), toe, 0.042, 0.030, shoe, 0.01)
        hips.append(hip)
    trunk = 0.30 * tall
    chest_ahead, chest_up = trunk * math.sin(lean), trunk * math.cos(lean)
    waist = at(0, hip_y + 0.02, 0.0)
    chest = at(0, hip_y + chest_up * 0.82, chest_ahead * 0.82)
    s.cone(hips[0], hips[1], 0.056 * tall, 0.056 * tall, trousers, 0.03)
    s.cone(waist, chest, 0.072 * tall, 0.088 * tall, coat, 0.04)
    shoulders = [
        at(side * 0.104 * tall, hip_y + chest_up * 0.97, chest_ahead * 0.97) for side in (-1, 1)
    ]
    s.cone(shoulders[0], shoulders[1], 0.045 * tall, 0.045 * tall, coat, 0.06)
    tool = None
    for k, side in enumerate((-1.0, 1.0)):
        swing = -stride * phase * 0.75 * (1 if k else -1)
        up, ahead = hip_y + chest_up * 0.97, chest_ahead * 0.97
        if pose == "work":
            elbow = at(side * 0.13 * tall, up - 0.15 * tall, ahead + 0.06)
            hand = at(side * 0.05 * tall, up - 0.27 * tall, ahead + 0.20 + 0.08 * k)
            tool = hand
        elif pose == "run":
            elbow = at(side * 0.14 * tall, up - 0.16 * tall, ahead + swing * 0.6)
            hand = at(side * 0.10 * tall, up - 0.12 * tall, ahead + swing * 0.6 + 0.22)
        elif pose == "stand" and k and rng.random() < 0.35:
            elbow = at(0.15 * tall, up - 0.15 * tall, ahead + 0.05)
            hand = at(0.06 * tall, up - 0.03 * tall, ahead + 0.16)
        else:
            elbow = at(side * 0.135 * tall, up - 0.17 * tall, ahead + swing * 0.3)
            hand = at(side * 0.13 * tall, up - 0.31 * tall, ahead + swing * 0.7 + 0.05)
        s.cone(shoulders[k], elbow, 0.034 * tall, 0.028 * tall, sleeve, 0.02)
        s.cone(elbow, hand, 0.028 * tall, 0.021 * tall, sleeve, 0.02)
        s.ellipsoid((hand[0], hand[1] - 0.03, hand[2]), (0.038, 0.055, 0.04), skin)
    neck = at(0, hip_y + chest_up * 1.06, chest_ahead * 1.08)
    head_y = hip_y + chest_up * 1.12 + 0.075 * tall
    head = at(0, head_y, chest_ahead * 1.15 + 0.03)
    s.cone(neck, (head[0], head[1] - 0.05, head[2]), 0.036 * tall, 0.034 * tall, skin, 0.02)
    s.ellipsoid(head, (0.046 * tall, 0.066 * tall, 0.054 * tall), skin, 0.02, yaw)
    if worker:
        hat = Surface(
            _pick(rng, [(240, 240, 236), (250, 214, 40), (40, 90, 190), (225, 60, 40)]), 0.02
        )
        s.ellipsoid(
            (head[0], head[1] + 0.035 * tall, head[2]),
            (0.058 * tall, 0.048 * tall, 0.064 * tall),
            hat,
            0.0,
            yaw,
        )
    elif rng.random() < 0.3:
        s.ellipsoid(
            (head[0], head[1] + 0.01, head[2]),
            (0.056 * tall, 0.07 * tall, 0.06 * tall),
            coat,
            0.02,
            yaw,
        )
        face = at(0, head_y - 0.005, chest_ahead * 1.15 + 0.06)
        s.ellipsoid(face, (0.036 * tall, 0.052 * tall, 0.045 * tall), skin, 0.0, yaw)
    else:
        hair = Surface(
            _pick(rng, [(38, 30, 26), (84, 60, 40), (150, 120, 76), (128, 126, 124)]), 0.2
        )
        back = at(0, head_y + 0.022 * tall, chest_ahead * 1.15 + 0.005)
        s.ellipsoid(back, (0.050 * tall, 0.056 * tall, 0.056 * tall), hair, 0.0, yaw)
    if not worker and rng.random() < 0.35:
        pack = Surface(_pick(rng, [(40, 44, 52), (150, 40, 36), (40, 80, 70), (96, 88, 70)]), 0.1)
        middle = at(0, hip_y + chest_up * 0.62, chest_ahead * 0.62 - 0.19)
        s.box(middle, (0.15, 0.22, 0.09), 0.07, pack, 0.0, yaw)
    if tool is not None:
        wood = Surface((150, 116, 74), 0.15)
        steel = Surface((96, 96, 98), 0.1)
        tip = at(0.0, 0.03, 0.85)
        s.cone(tool, tip, 0.018, 0.018, wood, 0.0)
        s.cone(tip, at(0.0, 0.02, 1.0), 0.05, 0.02, steel, 0.0)
    return s, "person", HUMAN


def stone(rng: Rng) -> tuple[Sculpture, str, int]:
    """A boulder, or a heap of fallen rock."""
    s = Sculpture()
    high = float(rng.uniform(0.35, 1.3))
    tone = np.array(_pick(rng, [(132, 126, 116), (106, 100, 94), (150, 138, 118), (122, 128, 130)]))
    for k in range(1 + int(rng.integers(0, 9)) * int(rng.random() < 0.6)):
        size = high * (1.0 if k == 0 else float(rng.uniform(0.15, 0.6)))
        x = 0.0 if k == 0 else float(rng.normal(0, 0.75) * high)
        z = 0.0 if k == 0 else float(rng.uniform(-0.3, 0.6) * high)
        r, g, b = (float(c) for c in tone * rng.uniform(0.85, 1.15))
        look = Surface((r, g, b), 0.34, 0.085 * size, 2.6 / size)
        half = (
            size * float(rng.uniform(0.55, 0.9)),
            size * 0.62,
            size * float(rng.uniform(0.45, 0.7)),
        )
        yaw, lean = float(rng.uniform(0, 3)), float(rng.uniform(-0.35, 0.35))
        if rng.random() < 0.75:
            s.box((x, 0.42 * size, z), half, 0.17 * size, look, 0.02, yaw, lean)
        else:
            s.ellipsoid((x, 0.40 * size, z), half, look, 0.02, yaw, lean)
    return s, "stone", CONSTRUCTION


def log(rng: Rng) -> tuple[Sculpture, str, int]:
    """A fallen trunk with the stumps of its branches, or with its crown."""
    s = Sculpture()
    radius = float(rng.uniform(0.14, 0.30))
    length = float(rng.uniform(2.2, 4.4))
    bark_colour = _pick(rng, [(104, 86, 66), (84, 74, 62), (128, 116, 100), (92, 70, 52)])
    bark = Surface(bark_colour, 0.35, 0.02, 7.0, stretch=5.0)
    wood = Surface((196, 164, 116), 0.12)
    skew = float(rng.uniform(-0.5, 0.5))
    a = (-length / 2, radius, -skew)
    b = (length / 2, radius * float(rng.uniform(0.65, 0.95)), skew)
    thin = float(rng.uniform(0.65, 0.95))
    s.cone(a, b, radius, radius * thin, bark)
    out = np.array(a) - np.array(b)
    out = out / np.linalg.norm(out)
    end = np.array(a) + out * radius * 0.85
    s.cylinder(a, tuple(end + out * 0.02), radius * 0.93, wood)
    for _ in range(int(rng.integers(2, 8))):
        part = float(rng.uniform(0.15, 0.98))
        root = tuple(float(p + part * (q - p)) for p, q in zip(a, b, strict=True))
        reach = float(rng.uniform(0.2, 1.0))
        angle = float(rng.uniform(0.2, math.pi - 0.2))
        tip = (
            root[0] + reach * 0.6 * float(rng.uniform(0.1, 1.0)),
            root[1] + reach * math.sin(angle),
            root[2] + reach * math.cos(angle),
        )
        s.cone(root, tip, 0.05, 0.018, bark)  # type: ignore[arg-type]  # three of them
        if rng.random() < 0.2:
            green = Surface(
                _pick(rng, [(74, 92, 44), (96, 104, 52), (120, 96, 50)]), 0.5, 0.09, 7.0
            )
            s.ellipsoid(tip, (0.22, 0.16, 0.22), green, 0.05)
    return s, "log", CONSTRUCTION


def box(rng: Rng) -> tuple[Sculpture, str, int]:
    """A crate, a stack of sleepers, a barrel, a barrier or sacks."""
    s = Sculpture()
    kind = str(rng.choice(["crate", "barrel", "barrier", "sacks", "sleepers"]))
    yaw = float(rng.uniform(-0.6, 0.6))
    if kind == "crate":
        high, wide = float(rng.uniform(0.45, 1.2)), float(rng.uniform(0.6, 1.3))
        wood = Surface(
            _pick(rng, [(176, 140, 94), (150, 122, 90), (128, 124, 116)]),
            0.18,
            board_m=0.13,
            stretch=4.0,
        )
        s.box((0, high / 2, 0), (wide / 2, high / 2, wide * 0.4), 0.015, wood, 0, yaw)
    elif kind == "barrel":
        colour = _pick(rng, [(40, 84, 150), (170, 60, 44), (74, 92, 74), (196, 180, 60)])
        steel = Surface(colour, 0.18, 0.003, 5.0, (120, 96, 76), (0.0, 0.06))
        for k in range(int(rng.integers(1, 4))):
            x, z = 0.66 * k - 0.4, float(rng.uniform(-0.3, 0.3))
            s.cylinder((x, 0, z), (x, 0.88, z), 0.29, steel)
            for ring in (0.02, 0.30, 0.58, 0.87):
                s.cylinder((x, ring - 0.012, z), (x, ring + 0.012, z), 0.302, steel)
    elif kind == "barrier":
        plank = Surface((206, 52, 40), 0.06)
        post = Surface((150, 150, 150), 0.1)
        for k in range(6):
            x = -0.9 + 0.3 * k
            shade = plank if k % 2 else Surface((236, 236, 230), 0.05)
            s.box((x + 0.15, 0.85, 0), (0.15, 0.11, 0.02), 0.006, shade)
            s.box((x + 0.15, 0.45, 0), (0.15, 0.11, 0.02), 0.006, shade)
        for x in (-0.7, 0.7):
            s.cone((x, 0.0, -0.25), (x, 0.95, 0.0), 0.022, 0.022, post, 0)
            s.cone((x, 0.0, 0.25), (x, 0.95, 0.0), 0.022, 0.022, post, 0)
    elif kind == "sacks":
        cloth = Surface(
            _pick(rng, [(186, 174, 150), (222, 220, 212), (40, 42, 46)]), 0.14, 0.02, 7.0
        )
        for k in range(int(rng.integers(2, 6))):
            x, y = float(rng.uniform(-0.6, 0.6)), 0.16 + 0.27 * (k // 3)
            s.box(
                (x, y, float(rng.uniform(-0.2, 0.2))),
                (0.42, 0.17, 0.28),
                0.15,
                cloth,
                0.02,
                float(rng.uniform(-0.5, 0.5)),
            )
    else:
        beam = Surface(_pick(rng, [(96, 82, 68), (160, 154, 144)]), 0.25, 0.006, 9.0, stretch=4.0)
        for k in range(int(rng.integers(4, 9))):
            s.box(
                (float(rng.uniform(-0.2, 0.2)), 0.09 + 0.17 * (k // 2), 0.3 * (k % 2)),
                (1.25, 0.08, 0.13),
                0.02,
                beam,
                0,
                float(rng.uniform(-0.25, 0.25)),
            )
    return s, kind, CONSTRUCTION


def animal(rng: Rng) -> tuple[Sculpture, str, int]:
    """A deer, a cow, a sheep, a wild boar or a dog."""
    s = Sculpture()
    kind = str(rng.choice(["deer", "cow", "sheep", "boar", "dog"]))
    high, long, thick, leg = {
        "deer": (0.92, 0.62, 0.19, 0.60),
        "cow": (1.30, 0.95, 0.36, 0.56),
        "sheep": (0.68, 0.46, 0.24, 0.45),
        "boar": (0.78, 0.60, 0.24, 0.45),
        "dog": (0.56, 0.38, 0.12, 0.55),
    }[kind]
    high *= float(rng.uniform(0.9, 1.15))
    scale = high / {"deer": 0.92, "cow": 1.3, "sheep": 0.68, "boar": 0.78, "dog": 0.56}[kind]
    long, thick = long * scale, thick * scale
    colours: dict[str, list[Triple]] = {
        "deer": [(140, 98, 62), (116, 84, 58)],
        "cow": [(70, 50, 40), (210, 206, 198), (150, 96, 60)],
        "sheep": [(214, 206, 188), (196, 186, 168)],
        "boar": [(64, 56, 50), (82, 70, 58)],
        "dog": [(60, 50, 44), (176, 138, 92), (216, 210, 200)],
    }
    wool = (0.014, 11.0) if kind == "sheep" else (0.008, 8.0)
    coat = Surface(_pick(rng, colours[kind]), 0.22, wool[0], wool[1])
    dark = Surface(tuple(0.6 * c for c in coat.colour), 0.15)  # type: ignore[arg-type]  # three
    yaw = float(rng.uniform(-0.7, 0.7)) + (math.pi if rng.random() < 0.5 else 0.0)
    cos, sin = math.cos(yaw), math.sin(yaw)

    def at(ahead: float, up: float, side: float) -> Triple:
        return (ahead * cos + side * sin, up, -ahead * sin + side * cos)

    back = high - 0.8 * thick
    s.cone(
        at(-0.72 * long, back, 0), at(0.55 * long, back + 0.02, 0), thick * 0.92, thick, coat, 0.06
    )
    for ahead in (-0.75, 0.62):
        for side in (-1.0, 1.0):
            step = float(rng.uniform(-0.12, 0.12)) * long
            top = at(ahead * long, back - 0.25 * thick, side * 0.55 * thick)
            knee = at(
                ahead * long + 0.4 * step + (-0.05 if ahead < 0 else 0.02),
                leg * high * 0.55,
                side * 0.5 * thick,
            )
            hoof = at(ahead * long + step, 0.02, side * 0.5 * thick)
            s.cone(top, knee, 0.36 * thick, 0.17 * thick, coat, 0.05)
            s.cone(knee, hoof, 0.16 * thick, 0.13 * thick, dark, 0.02)
    graze = rng.random() < 0.3
    lift = {"deer": 0.50, "cow": 0.12, "sheep": 0.16, "boar": -0.10, "dog": 0.22}[kind] * high
    reach = {"deer": 0.22, "cow": 0.42, "sheep": 0.28, "boar": 0.3, "dog": 0.2}[kind] * high
    lift = -0.35 * high if graze and kind in ("deer", "cow", "sheep") else lift
    throat = at(0.62 * long, back + 0.3 * thick, 0)
    skull_a, skull_u = 0.62 * long + reach, back + 0.25 * thick + lift
    skull = at(skull_a, skull_u, 0)
    s.cone(throat, skull, 0.62 * thick, 0.36 * thick, coat, 0.06)
    muzzle = at(skull_a + 0.20 * scale, skull_u - 0.10 * scale, 0)
    s.cone(
        skull,
        muzzle,
        0.36 * thick + 0.02,
        0.20 * thick + 0.01,
        dark if kind == "sheep" else coat,
        0.03,
    )
    for side in (-1.0, 1.0):
        ear = at(skull_a - 0.08 * scale, skull_u + 0.13 * scale, side * 0.13 * scale)
        s.cone(skull, ear, 0.035 * scale, 0.02 * scale, coat, 0.01)
        if kind == "deer" and high > 0.9:
            horn = at(skull_a - 0.06, skull_u + 0.36, side * 0.16)
            bone = Surface((150, 126, 96), 0.1)
            s.cone(skull, horn, 0.02, 0.012, bone, 0.0)
            s.cone(horn, at(skull_a + 0.12, skull_u + 0.48, side * 0.2), 0.014, 0.008, bone, 0.0)
    tail = at(-0.72 * long - 0.12 * scale, back - 0.1, 0)
    s.cone(
        at(-0.72 * long - 0.6 * thick, back + 0.3 * thick, 0),
        tail,
        0.05 * scale,
        0.025 * scale,
        coat,
        0.02,
    )
    return s, kind, CONSTRUCTION


def vehicle(rng: Rng) -> tuple[Sculpture, str, int]:
    """A car or a van standing across the track or askew on it."""
    s = Sculpture()
    van = rng.random() < 0.3
    paint_colour = _pick(
        rng,
        [
            (206, 208, 210),
            (46, 48, 52),
            (150, 34, 30),
            (44, 72, 130),
            (120, 124, 128),
            (232, 232, 230),
        ],
    )
    paint = Surface(paint_colour, 0.03)
    glass = Surface((44, 54, 64), 0.05)
    rubber, rim = Surface((26, 26, 28), 0.1), Surface((150, 152, 154), 0.05)
    lamp, tail = Surface((236, 232, 214), 0.02), Surface((170, 30, 26), 0.02)
    yaw = float(rng.uniform(-0.5, 0.5)) + (math.pi if rng.random() < 0.5 else 0.0)
    cos, sin = math.cos(yaw), math.sin(yaw)

    def at(ahead: float, up: float, side: float) -> Triple:
        return (ahead * cos + side * sin, up, -ahead * sin + side * cos)

    long, wide = (2.6, 0.98) if van else (2.15, 0.88)
    s.box(
        at(0, 0.60 if not van else 0.72, 0),
        (long, 0.30 if not van else 0.40, wide),
        0.16,
        paint,
        0.08,
        yaw,
    )
    if van:
        s.box(at(-0.35, 1.42, 0), (long - 0.45, 0.62, wide - 0.05), 0.22, paint, 0.10, yaw)
        s.box(at(long - 1.22, 1.52, 0), (0.36, 0.26, wide - 0.035), 0.08, glass, 0.0, yaw)
        s.box(at(long - 0.98, 1.50, 0), (0.30, 0.36, wide - 0.14), 0.20, glass, 0.0, yaw)
    else:
        s.ellipsoid(at(-0.20, 0.90, 0), (1.45, 0.60, wide - 0.08), paint, 0.10, yaw)
        s.box(at(-0.22, 1.12, 0), (1.02, 0.34, wide - 0.16), 0.20, paint, 0.12, yaw)
        for middle, half in ((-0.72, 0.40), (0.24, 0.42)):
            s.box(at(middle, 1.13, 0), (half, 0.19, wide - 0.10), 0.08, glass, 0.0, yaw)
    for ahead in (-0.62, 0.62):
        for side in (-1.0, 1.0):
            inner = at(ahead * long, 0.33, side * (wide - 0.22))
            outer = at(ahead * long, 0.33, side * (wide + 0.005))
            hub = at(ahead * long, 0.33, side * (wide + 0.02))
            s.cylinder(inner, outer, 0.33, rubber)
            s.cylinder(inner, hub, 0.20, rim)
    for side in (-1.0, 1.0):
        s.ellipsoid(at(long - 0.04, 0.70, side * (wide - 0.22)), (0.10, 0.09, 0.20), lamp, 0.0, yaw)
        s.ellipsoid(
            at(-long + 0.04, 0.74, side * (wide - 0.20)), (0.08, 0.10, 0.16), tail, 0.0, yaw
        )
    return s, "van" if van else "car", TRUCK if van else CAR


Maker = Callable[[Rng], tuple[Sculpture, str, int]]

SORTS: Final[dict[str, tuple[CutoutType, float, Maker]]] = {
    "person": ("trespasser", 1.0, person),
    "stone": ("obstruction", 0.32, stone),
    "log": ("obstruction", 0.18, log),
    "box": ("obstruction", 0.22, box),
    "animal": ("obstruction", 0.16, animal),
    "vehicle": ("obstruction", 0.12, vehicle),
}
"""Each sort: the anomaly it makes, how often it is drawn among those, and who makes it."""


@lru_cache(maxsize=len(SORTS) * VARIETY)
def built_in(sort: str, number: int) -> Cutout:
    """Thing ``number`` of a sort, 0 … VARIETY - 1; the same number is always the same thing."""
    kind, _, make = SORTS[sort]
    rng = np.random.default_rng([0x71BE, sorted(SORTS).index(sort), number])
    thing, name, label = make(rng)
    sun = (float(rng.uniform(-0.7, 0.7)), 0.75, 0.55)
    rgba, scale = picture(thing, LONGEST_PX, sun)
    rows = np.flatnonzero((rgba[..., 3] >= 128).any(axis=1))
    height = (rows[-1] - rows[0] + 1) / scale
    return trimmed(name, kind, rgba, float(height), label)


def draw_cutout(rng: Rng, kind: CutoutType) -> Cutout:
    """A random built-in thing that makes an anomaly of the given type."""
    names = [name for name, (type_, _, _) in SORTS.items() if type_ == kind]
    chances = np.array([SORTS[name][1] for name in names])
    sort = str(rng.choice(names, p=chances / chances.sum()))
    return built_in(sort, int(rng.integers(VARIETY)))


def _pick(rng: Rng, colours: list[Triple]) -> Triple:
    r, g, b = colours[int(rng.integers(len(colours)))]
    gain = float(rng.uniform(0.88, 1.1))
    return (min(r * gain, 255.0), min(g * gain, 255.0), min(b * gain, 255.0))
