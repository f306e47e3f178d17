"""What is built or grows along a railway; each function adds one thing to a kit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from railinspect import labels
from railinspect.scenes import raster as r
from railinspect.scenes.movables import person
from railinspect.scenes.raster import Colour, Kit, tint

Rng = np.random.Generator


def tree(kit: Kit, rng: Rng, along: float, left: float, foliage: npt.NDArray[np.float64]) -> None:
    """Add a broad-leaved tree, a conifer, a bare tree or a bush."""
    colour = foliage[rng.integers(len(foliage))] * rng.uniform(0.75, 1.25)
    kind = rng.choice(["broad", "conifer", "bush", "bare"], p=[0.4, 0.22, 0.3, 0.08])
    bark = tint((78, 66, 54), rng.uniform(0.6, 1.3))
    veg = labels.VEGETATION
    if kind == "bush":
        high = float(rng.uniform(0.8, 3.0))
        wide = high * float(rng.uniform(1.1, 2.0))
        kit.face(
            (along, left + wide / 2, -0.4),
            (0, -wide, 0),
            (0, 0, high),
            tint(colour),
            veg,
            r.FOLIAGE,
        )
        return
    high = float(rng.uniform(5, 15))
    kit.line((along, left, -0.4), (along, left, high * 0.75), 0.012 * high + 0.05, bark, veg)
    if kind == "broad":
        for _ in range(int(rng.integers(2, 4))):
            wide = high * float(rng.uniform(0.4, 0.65))
            base = high * float(rng.uniform(0.25, 0.45))
            kit.face(
                (along + rng.uniform(-1, 1), left + wide / 2 + rng.uniform(-0.2, 0.2) * high, base),
                (0, -wide, 0),
                (0, 0, wide),
                tint(colour, rng.uniform(0.85, 1.15)),
                veg,
                r.FOLIAGE,
            )
    elif kind == "conifer":
        for level in range(3):
            wide = high * (0.42 - 0.1 * level)
            kit.face(
                (along - 0.1 * level, left + wide / 2, high * (0.12 + 0.26 * level)),
                (0, -wide, 0),
                (0, 0, high * 0.42),
                tint(colour, 0.75 + 0.08 * level),
                veg,
                r.FOLIAGE,
            )
    else:
        for _ in range(9):
            lean = rng.uniform(-0.3, 0.3, 2) * high
            start = high * float(rng.uniform(0.3, 0.7))
            kit.line(
                (along, left, start),
                (along + lean[0], left + lean[1], start + 0.3 * high),
                0.04,
                bark,
                veg,
            )


def mast(kit: Kit, rng: Rng, along: float, left: float, reach: float, colour: Colour) -> None:
    """Add a catenary mast at ``left`` whose arm reaches the wire at ``reach``."""
    kit.line((along, left, -0.5), (along, left, 7.2), 0.13, colour, labels.POLE)
    kit.line((along, left, 6.7), (along, reach, 6.2), 0.035, colour, labels.POLE)
    kit.line((along, left, 5.4), (along, reach, 6.2), 0.03, colour, labels.POLE)
    kit.line((along, left, 5.5), (along, reach, 5.3), 0.025, colour, labels.POLE)
    if rng.random() < 0.15:
        kit.face(
            (along - 0.15, left + 0.25, 1.6),
            (0, -0.5, 0),
            (0, 0, 0.4),
            tint(rng.choice([(235, 235, 230), (240, 200, 40)])),
            labels.TRAFFIC_SIGN,
        )


def gantry(kit: Kit, along: float, left: float, right: float, colour: Colour) -> None:
    """Add a portal over several tracks."""
    for side in (left, right):
        kit.line((along, side, -0.5), (along, side, 7.6), 0.16, colour, labels.POLE)
    for high in (6.9, 7.6):
        kit.line((along, left, high), (along, right, high), 0.06, colour, labels.POLE)
    steps = max(2, int(abs(left - right) / 1.5))
    for a in np.linspace(left, right, steps + 1)[:-1]:
        kit.line(
            (along, float(a), 6.9),
            (along, float(a) + (right - left) / steps, 7.6),
            0.03,
            colour,
            labels.POLE,
        )


def signal(kit: Kit, rng: Rng, along: float, left: float, night: bool) -> None:
    """Add a main signal, or a dwarf signal on the ground."""
    dwarf = rng.random() < 0.25
    base = 0.5 if dwarf else float(rng.uniform(2.6, 4.2))
    kit.line((along, left, -0.4), (along, left, base + 0.2), 0.06, (120, 122, 124), labels.POLE)
    wide, high = (0.35, 0.45) if dwarf else (0.5, float(rng.uniform(0.8, 1.5)))
    kit.face(
        (along - 0.08, left + wide / 2, base),
        (0, -wide, 0),
        (0, 0, high),
        (18, 18, 20),
        labels.TRAFFIC_LIGHT,
    )
    lamp = tint(rng.choice([(255, 60, 40), (60, 255, 120), (255, 200, 60)]))
    at = base + high * float(rng.uniform(0.2, 0.7))
    kit.face(
        (along - 0.12, left + 0.09, at),
        (0, -0.18, 0),
        (0, 0, 0.18),
        lamp,
        labels.TRAFFIC_LIGHT,
        r.ELLIPSE,
    )
    if night or rng.random() < 0.3:
        kit.face(
            (along - 0.14, left + 0.35, at - 0.26),
            (0, -0.7, 0),
            (0, 0, 0.7),
            lamp,
            r.NO_LABEL,
            r.GLOW,
            grain=0.8,
        )


def sign(kit: Kit, rng: Rng, along: float, left: float) -> None:
    """Add a lineside board on a post."""
    high = float(rng.uniform(0.9, 2.4))
    size = float(rng.uniform(0.3, 0.7))
    kit.line((along, left, -0.4), (along, left, high), 0.035, (140, 140, 140), labels.POLE)
    kit.face(
        (along - 0.05, left + size / 2, high - 0.1),
        (0, -size, 0),
        (0, 0, size),
        tint(rng.choice([(240, 240, 236), (245, 200, 30), (200, 30, 30), (30, 30, 34)])),
        labels.TRAFFIC_SIGN,
        r.ELLIPSE if rng.random() < 0.4 else r.PLAIN,
        grain=0.05,
    )


def building(kit: Kit, rng: Rng, along: float, left: float, sun: float) -> None:
    """Add a house, a shed or a block with windows; its near wall stands at ``left``."""
    width = float(rng.uniform(7, 22))
    high = float(rng.choice([4, 6, 9, 15, 24], p=[0.25, 0.3, 0.25, 0.15, 0.05])) * rng.uniform(
        0.85, 1.2
    )
    length = float(rng.uniform(8, 40))
    wall = tint(
        rng.choice(
            [
                (178, 160, 138),
                (150, 92, 70),
                (206, 200, 190),
                (120, 118, 114),
                (190, 170, 120),
                (92, 84, 80),
                (130, 40, 34),
            ]
        ),
        rng.uniform(0.75, 1.15),
    )
    middle = left + np.sign(left) * width / 2
    kind = r.WINDOWS if rng.random() < 0.75 else r.BOARDS
    kit.box(
        along,
        float(middle),
        -0.5,
        (length, width, high),
        wall,
        labels.CONSTRUCTION,
        sun,
        kind,
        (50, 58, 68),
        float(rng.uniform(1.8, 3.5)) if kind == r.WINDOWS else 0.4,
        float(rng.uniform(2.6, 3.2)),
        grain=0.08,
    )
    if high < 10:
        roof = tint(
            rng.choice([(120, 62, 48), (72, 70, 72), (150, 150, 150)]), rng.uniform(0.8, 1.1)
        )
        rise = float(rng.uniform(1.0, 3.0))
        kit.face(
            (along, float(middle) + width / 2, high - 0.5),
            (0, -width / 2, rise),
            (length, 0, 0),
            roof,
            labels.CONSTRUCTION,
        )
        kit.face(
            (along, float(middle), high - 0.5 + rise),
            (0, -width / 2, -rise),
            (length, 0, 0),
            roof,
            labels.CONSTRUCTION,
        )


def strip(
    kit: Kit,
    start: float,
    end: float,
    left: float,
    low: float,
    high: float,
    colour: Colour,
    label: float,
    material: int,
    p0: float = 0.0,
    p1: float = 0.0,
    grain: float = 0.12,
    lean: float = 0.0,
) -> None:
    """Add a wall along the track from ``start`` to ``end`` in pieces that follow its curve."""
    at = start
    while at < end:
        part = min(8.0, end - at)
        kit.face(
            (at, left, low),
            (part, 0, 0),
            (0, lean, high - low),
            colour,
            label,
            material,
            p0=p0,
            p1=p1,
            grain=grain,
        )
        at += part


def platform(
    kit: Kit, rng: Rng, start: float, end: float, edge: float, width: float, sun: float
) -> None:
    """Add a platform whose edge stands at ``edge``; ``width`` is signed, away from the track."""
    high = float(rng.choice([0.35, 0.55, 0.76, 0.92])) - 0.02
    top = tint((168, 164, 156), rng.uniform(0.6, 1.25))
    face = tint((138, 132, 122), rng.uniform(0.5, 1.2))
    strip(
        kit,
        start,
        end,
        edge,
        -0.35,
        high,
        face,
        labels.CONSTRUCTION,
        r.BRICK if rng.random() < 0.5 else r.PLAIN,
        grain=0.15,
    )
    kit.face((start, edge, -0.3), (0, width, 0), (0, 0, high + 0.3), face, labels.CONSTRUCTION)
    line = tint((235, 232, 215)) if rng.random() < 0.7 else top
    sign_ = float(np.sign(width))
    at = start
    while at < end:
        part = min(8.0, end - at)
        for low, wide, colour in (
            (0.0, 0.35, top),
            (0.35, 0.12, line),
            (0.47, abs(width) - 0.47, top),
        ):
            kit.face(
                (at, edge + sign_ * low, high),
                (part, 0, 0),
                (0, sign_ * wide, 0),
                colour,
                labels.SIDEWALK,
                grain=0.07,
            )
        at += part
    for _ in range(int(rng.integers(0, 9))):
        person(
            kit,
            rng,
            float(rng.uniform(start, end)),
            edge + sign_ * float(rng.uniform(0.9, abs(width))),
            high,
        )
    at = start + float(rng.uniform(2, 15))
    while at < end:
        lamp = edge + sign_ * min(2.6, abs(width) * 0.8)
        kit.line((at, lamp, high), (at, lamp, high + 4.2), 0.06, (92, 96, 98), labels.POLE)
        at += float(rng.uniform(14, 25))
    if rng.random() < 0.5:
        place = edge + sign_ * abs(width) * 0.75
        kit.box(
            float(rng.uniform(start, end)),
            place,
            high,
            (6, 1.8, 2.5),
            tint((120, 124, 128)),
            labels.CONSTRUCTION,
            sun,
            r.WINDOWS,
            (90, 110, 120),
            1.0,
            2.4,
        )
