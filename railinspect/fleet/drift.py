"""Whether a camera moved in its mounting over a run, seen from the rails alone.

A minute's median of three numbers stands for the camera: the row in which the rails meet (pitch),
the column of the vanishing point (yaw; curves to both sides leave its median alone), and the pixels
by which the rails part per row (height over gauge). The trend over the minutes is Theil and Sen's
with its 99 % interval; it is called drift where the interval excludes zero and the change over the
time seen is large enough to matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.stats import theilslopes

Array = npt.NDArray[np.float64]

BLOCK_S: Final = 60.0
"""One median is taken over so much media time, seconds."""

MIN_FRAMES: Final = 10
"""Fewer frames in a block say nothing."""

MIN_BLOCKS: Final = 5
"""Fewer blocks have no trend."""

MAX_BLOCKS: Final = 400
"""Of more blocks, evenly spread ones are taken: the estimator's cost grows as their square."""

MATTERS: Final[Mapping[str, float]] = {
    "horizon_v_px": 2.0,
    "vanishing_u_px": 3.0,
    "spacing_per_row": 0.01,
}
"""Least change that is called drift: pixels for pictures 720 rows high, the spacing's relative."""

_SCALE_ROWS: Final = 720


@dataclass(frozen=True)
class Block:
    """One minute of one input.

    Attributes:
        at_s: Clock time of its start where it is known, else seconds of footage so far.
        size_wh: Size of the pictures, pixels.
        medians: Median of each quantity of ``MATTERS``; NaN where too few frames have it.
    """

    at_s: float
    size_wh: tuple[int, int]
    medians: Mapping[str, float]


@dataclass(frozen=True)
class Drift:
    """The trend of one quantity.

    Attributes:
        quantity: One of ``MATTERS``.
        first: Median over the first tenth of the blocks (at least one).
        last: Median over the last tenth.
        change: Trend times the time from the first block to the last, in the quantity's unit.
        change_low: Lower bound of that change, 99 %.
        change_high: Upper bound.
        blocks: How many blocks it rests on.
        drifts: Whether that is called drift; None where there are too few blocks to say.
    """

    quantity: str
    first: float
    last: float
    change: float
    change_low: float
    change_high: float
    blocks: int
    drifts: bool | None


def blocks_of(
    time_s: Array, columns: Mapping[str, Array], size_wh: tuple[int, int], zero_s: float
) -> list[Block]:
    """The minutes of one input.

    Args:
        time_s: Media times of its frames, seconds, shape (N,).
        columns: The quantities of each frame, NaN where unknown, each of shape (N,).
        size_wh: Size of its pictures, pixels.
        zero_s: What is added to media time, seconds.
    """
    number = np.floor(time_s / BLOCK_S).astype(np.int64)
    blocks = []
    for which in np.unique(number):
        inside = number == which
        medians = {}
        for name, values in columns.items():
            known = values[inside]
            known = known[np.isfinite(known)]
            medians[name] = float(np.median(known)) if known.size >= MIN_FRAMES else np.nan
        blocks.append(Block(zero_s + float(which) * BLOCK_S, size_wh, medians))
    return blocks


def drift_of(blocks: Sequence[Block]) -> list[Drift]:
    """The trends of one camera, one per quantity that is known at all.

    Args:
        blocks: Its minutes; only those with the size of most of them are taken.
    """
    if not blocks:
        return []
    sizes = [block.size_wh for block in blocks]
    size = max(sorted(set(sizes)), key=sizes.count)
    chosen = sorted((b for b in blocks if b.size_wh == size), key=lambda block: block.at_s)
    found = []
    for name, matters in MATTERS.items():
        pairs = [(b.at_s, b.medians[name]) for b in chosen if np.isfinite(b.medians[name])]
        if pairs:
            at_s, values = np.array(pairs).T
            least = matters * size[1] / _SCALE_ROWS
            if name == "spacing_per_row":
                least = matters * float(np.median(values))
            found.append(_trend(name, at_s, values, least))
    return found


def _trend(name: str, at_s: Array, values: Array, least: float) -> Drift:
    tenth = max(values.size // 10, 1)
    first, last = float(np.median(values[:tenth])), float(np.median(values[-tenth:]))
    span_s = float(at_s[-1] - at_s[0])
    if values.size < MIN_BLOCKS or span_s <= 0:
        unknown = float("nan")
        return Drift(name, first, last, unknown, unknown, unknown, values.size, None)
    taken = np.unique(np.linspace(0, values.size - 1, min(values.size, MAX_BLOCKS)).astype(int))
    slope, _, low, high = theilslopes(values[taken], at_s[taken], 0.99)
    change, low, high = (float(s) * span_s for s in (slope, low, high))
    drifts = bool((low > 0 or high < 0) and abs(change) >= least)
    return Drift(name, first, last, change, low, high, values.size, drifts)
