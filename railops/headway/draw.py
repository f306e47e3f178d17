"""Pictures as SVG: heat map, surface, time–distance with blocking times, speed–distance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from railops.headway._svg import INK, Axes, Picture, colour
from railops.headway.ceiling import ceiling_speed
from railops.headway.characteristic import Characteristic
from railops.headway.interval import Succession
from railops.headway.simulation import simulate
from railops.headway.stairway import stairway

Array = npt.NDArray[np.float64]
FRONT, SECOND, CODE, LIMIT = "#c0392b", "#1f5fa8", "#e08e0b", "#7f8c8d"


def heat_map(table: Characteristic, dwell_s: float | None = None) -> str:
    """The characteristic as a coloured grid with its figures."""
    interval = table.interval_s(dwell_s)
    dwell = table.dwell_s if dwell_s is None else dwell_s
    rows, columns = interval.shape
    cell_w, cell_h = max(30.0, 560.0 / columns), max(20.0, 360.0 / rows)
    picture = Picture(
        round(110 + columns * cell_w + 20),
        round(60 + rows * cell_h + 62),
        f"Shortest interval, s, dwell {dwell:g} s: {table.name}",
    )
    low, high = float(np.nanmin(interval)), float(np.nanmax(interval))
    for i in range(rows):
        y = 44 + (rows - 1 - i) * cell_h
        picture.text(84, y + cell_h / 2 + 4, f"{table.second_s[i]:g}", anchor="end")
        for j in range(columns):
            value = interval[i, j]
            if math.isnan(value):
                continue
            part = (value - low) / (high - low) if high > low else 0.5
            x = 92 + j * cell_w
            picture.box(x, y, cell_w, cell_h, colour(part))
            shade = "#ffffff" if part < 0.6 else INK
            picture.text(
                x + cell_w / 2, y + cell_h / 2 + 4, f"{value:.0f}", 10, "middle", fill=shade
            )
    bottom = 44 + rows * cell_h
    for j in range(columns):
        picture.text(92 + (j + 0.5) * cell_w, bottom + 16, f"{table.first_s[j]:g}", anchor="middle")
    middle = 92 + columns * cell_w / 2
    picture.text(middle, bottom + 40, "run time of the train in front T(n−1), s", 12, "middle")
    picture.text(
        24, 44 + rows * cell_h / 2, "run time of the second train T(n), s", 12, "middle", turn=-90
    )
    return picture.svg()


def surface(table: Characteristic, dwell_s: float | None = None) -> str:
    """The characteristic as a surface in parallel projection, drawn from back to front."""
    interval = table.interval_s(dwell_s)
    picture = Picture(760, 560, f"Shortest interval: {table.name}")
    low, high = float(np.nanmin(interval)), float(np.nanmax(interval))
    a, b = table.second_s, table.first_s
    span = max(high - low, 1e-9)

    def place(run: float, front: float, value: float) -> tuple[float, float]:
        u = (run - a[0]) / max(a[-1] - a[0], 1e-9)
        v = (front - b[0]) / max(b[-1] - b[0], 1e-9)
        return 385 + 285 * (v - u), 255 + 105 * (u + v) - 185 * (value - low) / span

    corners = [(a[0], b[0]), (a[-1], b[0]), (a[-1], b[-1]), (a[0], b[-1]), (a[0], b[0])]
    picture.line([place(u, v, low) for u, v in corners], "#aab2bd")
    for u, v in corners[1:4]:
        picture.line([place(u, v, low), place(u, v, high)], "#d9dde3")
    for i in range(a.size - 1):  # far corner first: both run times rise towards the viewer
        for j in range(b.size - 1):
            cell = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            known = [(a[m], b[n], interval[m, n]) for m, n in cell if not np.isnan(interval[m, n])]
            if len(known) < 3:
                continue
            mean = sum(value for _, _, value in known) / len(known)
            points = [place(*corner) for corner in known]
            picture.area(points, colour((mean - low) / span), "#ffffff")
    for run, front in ((a[-1], b[0]), (a[-1], b[-1]), (a[0], b[-1])):
        x, y = place(run, front, low)
        words = f"T(n) {run:g} s, T(n−1) {front:g} s"
        anchor = (
            "middle" if run == a[-1] and front == b[-1] else "start" if front == b[0] else "end"
        )
        picture.text(x + {"start": -50, "middle": 0, "end": 50}[anchor], y + 24, words, 11, anchor)
    for value in (low, high):
        x, y = place(a[-1], b[0], value)
        picture.text(x - 8, y, f"{value:.0f} s", anchor="end")
    picture.text(380, 530, "T(n): second train, T(n−1): train in front", 12, "middle")
    return picture.svg()


def front_path(pair: Succession, first_s: float, dwell_s: float) -> tuple[Array, Array]:
    """Times and front positions of the train in front: run, dwell, drawing away."""
    run, away = pair.run(first_s).nodes, pair.away.nodes
    times = np.concatenate([run.time_s, away.time_s + first_s + dwell_s])
    return times, np.concatenate([run.position_m, away.position_m])


def time_distance(
    pair: Succession, second_s: float, first_s: float, dwell_s: float, interval_s: float
) -> str:
    """Both trains over time and place, with the blocking times of the second."""
    blocks, critical = stairway(pair, second_s, first_s, dwell_s)
    times, front = front_path(pair, first_s, dwell_s)
    run = pair.run(second_s).nodes
    top = max(float(front[-1]), *(block.end_m for block in blocks))
    end = max(float(times[-1]), interval_s + second_s) + 5.0
    picture = Picture(
        900, 560, f"{pair.section.name}: interval {interval_s:.1f} s, dwell {dwell_s:g} s"
    )
    axes = Axes(
        picture, (0.0, end), (-pair.section.stock.length_m, top), ("time, s", "position, m")
    )
    shown = pair.given_all_s(first_s, dwell_s)
    step = max(1, len(blocks) // 60)
    for level, block in enumerate(blocks, start=1):
        if level % step and block is not critical:
            continue
        fill, alpha = ("#c0392b", 0.45) if block is critical else ("#1f5fa8", 0.13)
        start, until = block.needed_s + interval_s, min(block.freed_s + interval_s, end)
        picture.area(
            [
                (axes.x(x), axes.y(y))
                for x, y in (
                    (start, block.start_m),
                    (until, block.start_m),
                    (until, block.end_m),
                    (start, block.end_m),
                )
            ],
            fill,
            alpha=alpha,
        )
        freed = float(shown[level]) if level < shown.size else math.inf
        if freed < end:
            axes.curve([freed, freed], [block.start_m, block.end_m], FRONT, 1.5)
    axes.curve(times.tolist(), front.tolist(), FRONT, 2)
    tail = front - pair.section.stock.length_m
    axes.curve(times.tolist(), tail.tolist(), FRONT, 1, "5 3")
    axes.curve((run.time_s + interval_s).tolist(), run.position_m.tolist(), SECOND, 2)
    picture.text(axes.left + 10, axes.top + 16, "train in front (dashed: its tail)", fill=FRONT)
    picture.text(axes.left + 10, axes.top + 32, "second train and its blocking times", fill=SECOND)
    picture.text(axes.left + 10, axes.top + 48, f"critical: {critical.name}", fill=FRONT, size=12)
    return picture.svg()


def speed_distance(
    pair: Succession, second_s: float, first_s: float, dwell_s: float, interval_s: float
) -> str:
    """The second train's speed, its ceiling and what it is shown, over the place."""
    seen = simulate(pair, second_s, first_s, interval_s, dwell_s)
    run, front = pair.run(second_s).nodes, pair.run(first_s).nodes
    length = pair.section.length_m
    at = np.linspace(0.0, length - 0.01, 800)
    limit = 3.6 * ceiling_speed(pair.section.ceiling(), at)
    top = float(max(limit.max(), 3.6 * run.speed_mps.max())) * 1.15
    picture = Picture(900, 460, f"{pair.section.name}: what the second train is shown")
    axes = Axes(picture, (0.0, length), (0.0, top), ("position, m", "speed, km/h"))
    axes.curve(at.tolist(), limit.tolist(), LIMIT, 1.2, "5 3")
    shown = np.minimum(3.6 * seen.log[:, 4], top)
    axes.curve(seen.log[:, 1].tolist(), shown.tolist(), CODE, 2)
    axes.curve(front.position_m.tolist(), (3.6 * front.speed_mps).tolist(), FRONT, 1.2)
    axes.curve(run.position_m.tolist(), (3.6 * run.speed_mps).tolist(), SECOND, 2.4)
    legend: Sequence[tuple[str, str]] = (
        (SECOND, f"second train, {second_s:g} s"),
        (FRONT, f"train in front, {first_s:g} s"),
        (CODE, f"permitted at {interval_s:.1f} s behind it"),
        (LIMIT, "limits, codes and braking (its ceiling)"),
    )
    for index, (ink, words) in enumerate(legend):
        picture.text(axes.left + 12 + 205 * index, axes.top - 6, words, fill=ink)
    return picture.svg()
