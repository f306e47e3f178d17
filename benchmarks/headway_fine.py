"""An independent simulation of two trains: small steps, brute force, none of the room's own code.

It reads only the numbers in a section (limits, gradients, circuits, codes) and shares no function
with ``railops.headway`` or ``railops.traction``: ceiling on a 0.1 m grid, explicit midpoint steps
of 0.01 s, gradients as the mean over points along the train, codes by their definition, cut-off
and interval by bisection. Slow and plain on purpose.
"""

from __future__ import annotations

import bisect
from typing import Any

import numba
import numpy as np

DT, DS = 0.01, 0.1


def code_table(protection: Any) -> np.ndarray:
    """Code in m/s for train circuit i and tail circuit k; k = n is beyond the last."""
    circuits = protection.circuits
    n = len(circuits)
    table = np.zeros((n, n + 1))
    for i in range(n):
        for k in range(i + 1, n + 1):
            tail_start = circuits[k][0] if k < n else circuits[-1][1]
            if protection.codes:
                fitting = [v for free, v in protection.codes if free <= k - i - 1]
            else:
                fitting = [
                    v
                    for v in protection.steps_kmh
                    if circuits[i][1]
                    + v / 3.6 * protection.design_delay_s
                    + (v / 3.6) ** 2 / (2 * protection.design_decel_mps2)
                    + protection.overlap_m
                    <= tail_start + 1e-6
                ]
            table[i, k] = max(fitting, default=0.0) / 3.6
    return table


def grids(section: Any, table: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ceiling to the stop, ceiling without it, and line resistance per mass, on the DS grid."""
    length, train = section.length_m, section.stock.length_m
    at = np.arange(0.0, length + 1500.0, DS)
    limit = np.full(at.size, np.inf)
    pieces = list(section.limits_kmh)
    for index, (start, speed) in enumerate(pieces):
        low = -np.inf if index == 0 else start
        high = pieces[index + 1][0] if index + 1 < len(pieces) else np.inf
        under = (at >= low) & (at - train < high)
        limit[under] = np.minimum(limit[under], speed / 3.6)
    away, ahead = limit.copy(), limit.copy()
    if table is not None:
        starts = [start for start, _ in section.protection.circuits]
        circuit = np.clip(np.searchsorted(starts, at + 1e-9, side="right") - 1, 0, None)
        ahead = np.minimum(ahead, table[circuit, -1])
        away = np.minimum(away, table[:, -1].max())
    to_stop = np.sqrt(2 * section.stock.brake_mps2 * np.maximum(length - at, 0.0))
    ahead = np.minimum(ahead, to_stop)
    for values in (ahead, away):
        for index in range(at.size - 2, -1, -1):
            reachable = np.sqrt(values[index + 1] ** 2 + 2 * section.stock.brake_mps2 * DS)
            values[index] = min(values[index], reachable)
    ahead = np.minimum(ahead, to_stop)  # the grid does not know the last centimetres
    points = np.linspace(0.0, max(train, 1.0), 401)[:-1] + max(train, 1.0) / 800

    def piecewise(pairs: Any, x: np.ndarray) -> np.ndarray:
        starts = np.array([start for start, _ in pairs])
        return np.array([v for _, v in pairs])[
            np.clip(np.searchsorted(starts, x, "right") - 1, 0, None)
        ]

    coarse = at[::10]
    under = coarse[:, None] - points[None, :]
    slope = piecewise(section.line.gradients, under)
    radius = piecewise(section.line.curves, under)
    weight = 9.80665 * (np.sin(np.arctan(slope)) + 0.7 / radius)
    return ahead, away, np.interp(at, coarse, weight.mean(axis=1))


@numba.njit(cache=True)
def ride(
    start: float, end: float, cut: float, ceiling: np.ndarray, weight: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions and speeds every DT, and the arrival time (inf if stuck)."""
    accel, power, c0, c1, c2, gamma = p
    steps = 60000
    s_of, v_of = np.empty(steps), np.empty(steps)
    s, v = start, 0.0
    for i in range(steps):
        s_of[i], v_of[i] = s, v
        if s >= end - 0.5 and ceiling[int(end / DS) + 1] == 0.0:
            rest = 2 * (end - s) / v
            for j in range(i, min(i + int(rest / DT) + 2, steps)):
                part = min((j - i) * DT, rest)
                v_of[j] = v * (1 - part / rest)
                s_of[j] = s + part * v - 0.5 * part * part * v / rest
            return s_of[: j + 1], v_of[: j + 1], i * DT + rest
        if s >= end:
            return s_of[: i + 1], v_of[: i + 1], i * DT
        half_s, half_v = s, v
        for stage in range(2):
            effort = 0.0
            if half_s < cut:
                effort = accel if half_v * accel <= power else power / half_v
            index = int(half_s / DS)
            a = effort - (c0 + c1 * half_v + c2 * half_v**2 + weight[index]) / (1 + gamma)
            if stage == 0:
                half_s, half_v = s + 0.5 * DT * v, v + 0.5 * DT * a
        s, v = s + DT * half_v, v + DT * a
        place = s / DS
        index = int(place)
        low, high = ceiling[index] ** 2, ceiling[index + 1] ** 2
        top = np.sqrt(low + (place - index) * (high - low))
        v = min(v, top)
        if v < 0.9 and i * DT > 5.0 and s < end - 5.0:
            return s_of[: i + 1], v_of[: i + 1], np.inf
    return s_of, v_of, np.inf


@numba.njit(cache=True)
def fits(
    interval: float,
    s2: np.ndarray,
    v2: np.ndarray,
    front: np.ndarray,
    delay: float,
    train: float,
    edges: np.ndarray,
    table: np.ndarray,
    block: np.ndarray,
    slack: float,
) -> bool:
    """Whether the second train is never shown less than it runs at."""
    margin, decel, reaction, stop = block
    for i in range(s2.size - 1):
        if stop - s2[i] < 1e-3:
            break
        j = round((i * DT + interval - delay) / DT)
        tail = front[min(max(j, 0), front.size - 1)] - train if j >= 0 else -train
        if table.size > 0:
            circuit = np.searchsorted(edges, s2[i], side="right") - 1
            tail_circuit = np.searchsorted(edges, tail, side="right") - 1
            code = table[circuit, tail_circuit] if tail_circuit > circuit else 0.0
            if v2[i] > code + slack or code == 0.0:
                return False
        else:
            needed = min(s2[i] + v2[i] * reaction + v2[i] ** 2 / (2 * decel), stop)
            known = np.searchsorted(edges, tail - margin, side="right") - 1
            if known < 0 or (edges[known] < needed - 0.01 and edges[known] < stop - 1e-6):
                return False
    return True


def interval_s(
    section: Any, second_s: float, first_s: float, dwell_s: float, slack_mps: float = 0.02
) -> float:
    """The shortest interval, s, by bisection on the verdict of the simulation."""
    protection, stock = section.protection, section.stock
    kind = type(protection).__name__
    table = code_table(protection) if kind == "TrackCircuits" else None
    ahead, away, weight = grids(section, table)
    p = np.array(
        [
            stock.effort.accel_mps2,
            stock.effort.power_w_per_kg,
            stock.davis.c0,
            stock.davis.c1,
            stock.davis.c2,
            stock.rotating,
        ]
    )

    def regulated(wanted: float) -> tuple[np.ndarray, np.ndarray]:
        low, high = 0.0, section.length_m
        for _ in range(40):
            middle = 0.5 * (low + high)
            s, v, time = ride(0.0, section.length_m, middle, ahead, weight, p)
            low, high = (middle, high) if time > wanted else (low, middle)
        return s, v

    s1, _ = regulated(first_s)
    s2, v2 = regulated(second_s)
    s3, _, _ = ride(section.length_m, section.length_m + 1490.0, np.inf, away, weight, p)
    standing = np.full(round((first_s + dwell_s) / DT) - s1.size, section.length_m)
    front = np.concatenate([s1, standing, s3])
    if table is not None:
        edges = np.array([start for start, _ in protection.circuits] + [protection.circuits[-1][1]])
        block = np.array([0.0, 1.0, 0.0, section.length_m])
    else:
        if kind == "FixedBlock":
            edges = np.array([start for start, _ in protection.blocks] + [protection.blocks[-1][1]])
            margin = protection.overlap_m
        else:
            edges = np.append(
                np.arange(0.0, section.length_m - 1e-9, protection.report_m), section.length_m
            )
            margin = protection.margin_m
        block = np.array([margin, protection.decel_mps2, protection.reaction_s, section.length_m])
    codes = table if table is not None else np.zeros((0, 0))

    class Fits:
        def __getitem__(self, hundredths: int) -> bool:
            return bool(
                fits(
                    hundredths * DT,
                    s2,
                    v2,
                    front,
                    protection.delay_s,
                    stock.length_m,
                    edges,
                    codes,
                    block,
                    slack_mps,
                )
            )

        def __len__(self) -> int:
            return 60_000

    return bisect.bisect_left(Fits(), True) * DT
