"""Other paths the train could take: tracks that part from the followed one at a switch.

Which way the points lie is rarely to be seen from the masks. The follower therefore assumes one
path and keeps every other one that parts from it as a branch, grown like the path itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from railinspect.track import growing
from railinspect.track.growing import Growth, grow
from railinspect.track.level import Level
from railinspect.track.settings import FollowerSettings

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_OFFSETS_M: Final = np.arange(0.4, 1.31, 0.06)
"""How far aside a second pair of rails is looked for, metres: nearer it is not told apart from
the own one, farther its one rail would lie on the own track's other rail."""

_LEAST_PX: Final = 4.0
_LEAST_WINDOWS: Final = 3
_LEAST_PARTING: Final = 0.008
_LEAST_APART_M: Final = 1.2


@dataclass(frozen=True)
class Branch:
    """A track that parts from the followed one.

    Attributes:
        side: To which side it parts.
        from_m: Ground distance ahead where it is first told apart, metres.
        centre_uv: Its centre line, input pixels, near to far, shape (N, 2).
        support: Mean rail probability along its rails, 0..1.
    """

    side: Literal["left", "right"]
    from_m: float
    centre_uv: Array
    support: float


def find_branches(
    score: Image, level: Level, growth: Growth, settings: FollowerSettings
) -> tuple[Branch, ...]:
    """Tracks that part from a grown one, nearest first.

    Args:
        score: Soft rail probability, shape (H, W).
        level: The levelled view the growth is in.
        growth: The followed track.
        settings: Tuning.
    """
    nodes = growth.nodes[: growth.last]
    scale = score.shape[1] / 640.0
    metre = nodes[:, growing.S] * math.cos(level.pitch_rad) / level.camera.height_m
    nodes = nodes[metre * _OFFSETS_M[0] >= _LEAST_PX * scale]
    if len(nodes) < _LEAST_WINDOWS:
        return ()
    found = []
    for hand, side in ((1.0, "left"), (-1.0, "right")):
        pair = _pair_score(score, level, nodes, hand * _OFFSETS_M)
        best = pair.argmax(axis=1)
        seen = pair[np.arange(len(nodes)), best] >= settings.switch_score
        if np.count_nonzero(seen) < _LEAST_WINDOWS:
            continue
        x, aside = nodes[seen, growing.X], _OFFSETS_M[best[seen]]
        parting = float(np.polyfit(x, aside, 1)[0])
        if parting < _LEAST_PARTING:
            continue  # it joins, runs beside, or is no track
        first = int(np.flatnonzero(seen)[0])
        grown = _grown(score, level, nodes[first], hand * float(aside[0]), hand * parting, settings)
        branch = _branch(level, nodes, grown, side)  # type: ignore[arg-type]  # left or right
        if branch is not None:
            found.append(branch)
    return tuple(sorted(found, key=lambda b: b.from_m))


def _pair_score(score: Image, level: Level, nodes: Array, offsets_m: Array) -> Array:
    """The weaker rail's probability of a pair this far aside of each node, shape (N, K)."""
    psi = nodes[:, growing.PSI]
    normal = np.stack([-np.sin(psi), np.cos(psi)], axis=1)
    rails = []
    for side in (1.0, -1.0):
        across = offsets_m[None, :] + side * nodes[:, growing.HALF, None]
        places = nodes[:, None, [growing.X, growing.Y]] + across[..., None] * normal[:, None]
        u, v = np.moveaxis(level.pixels(places), -1, 0)
        inside = (u >= 0) & (u <= score.shape[1] - 1) & (v >= 0) & (v <= score.shape[0] - 1)
        row = np.where(inside, np.round(np.nan_to_num(v)), 0).astype(int)
        column = np.where(inside, np.round(np.nan_to_num(u)), 0).astype(int)
        rails.append(np.where(inside, score[row, column] / 255.0, 0.0))
    return np.minimum(rails[0], rails[1])


def _grown(
    score: Image,
    level: Level,
    node: Array,
    aside_m: float,
    parting: float,
    settings: FollowerSettings,
) -> Growth:
    psi = float(node[growing.PSI])
    x = float(node[growing.X]) - aside_m * math.sin(psi)
    y = float(node[growing.Y]) + aside_m * math.cos(psi)
    return grow(
        score,
        level,
        (x, y, psi + math.atan(parting), float(node[growing.KAPPA])),
        (0.08, 0.02, 1 / 300),
        float(node[growing.HALF]),
        float(node[growing.S]),
        settings,
    )


def _branch(
    level: Level, nodes: Array, growth: Growth, side: Literal["left", "right"]
) -> Branch | None:
    """The growth as a branch, unless it came back to the followed track or soon ended."""
    kept = growth.nodes[: growth.last]
    if len(kept) < _LEAST_WINDOWS:
        return None
    hand = 1.0 if side == "left" else -1.0
    main = np.interp(kept[:, growing.X], nodes[:, growing.X], nodes[:, growing.Y])
    apart = hand * (kept[:, growing.Y] - main)
    shared = kept[:, growing.X] <= nodes[-1, growing.X]
    if not shared.any() or apart[shared].max() < _LEAST_APART_M or apart[shared].min() < 0:
        return None
    sight = kept[:, [growing.LEFT, growing.RIGHT]]
    return Branch(
        side,
        float(kept[0, growing.X]),
        level.pixels(kept[:, [growing.X, growing.Y]]),
        float(np.maximum(sight, 0.0).mean()),
    )
