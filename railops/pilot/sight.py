"""Where the straight-line ranging from the mother train to the pilot vehicle sees it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from railops.errors import check_range
from railops.pilot.reference import Reference
from railops.pilot.route import Route

Array = npt.NDArray[np.float64]

_GRID_M = 25.0
_SAMPLES = 24


def in_sight(route: Route, reference: Reference, clear_m: float) -> tuple[Array, Array]:
    """Whether the chord between the two vehicles stays within the cleared strip.

    The ranging device looks along the straight line between them (Section II-B); on a curve the
    track leaves that chord sideways, by x²/(8ρ) on a circle, and beyond the cleared strip stand
    trees, cuttings and tunnel walls. The side of a curve is not known (see
    :class:`railops.traction.Line`), so successive curves are taken to bend the same way, which is
    the cautious reading.

    Args:
        route: The trip.
        reference: The gap.
        clear_m: Half-width of the strip free of obstacles to sight, metres.

    Returns:
        Mother-train positions every 25 m, and 1.0 where the pilot vehicle is in sight.
    """
    check_range("clear_m", clear_m, 0.0, 1e4, "m", above=True)
    first, *_, last = route.mother.position_m
    at = np.arange(first, last + _GRID_M, _GRID_M)
    starts = np.array([start for start, _ in route.line.curves])
    bends = np.array([1.0 / radius for _, radius in route.line.curves])
    far = last + float(reference.gap_m.max()) + _GRID_M
    fine = np.arange(first, far + 10.0, 10.0)
    bend = bends[np.clip(np.searchsorted(starts, fine, "right") - 1, 0, None)]
    heading = np.concatenate([[0.0], np.cumsum(bend[:-1] * 10.0)])
    offset = np.concatenate([[0.0], np.cumsum(heading[:-1] * 10.0 + 50.0 * bend[:-1])])

    gap = reference.at(at)[0]
    share = np.linspace(0.0, 1.0, _SAMPLES)
    ahead = at[:, None] + gap[:, None] * share  # (N, samples)
    side = np.interp(ahead, fine, offset)
    straight = side[:, :1] + (side[:, -1:] - side[:, :1]) * share
    return at, (np.abs(side - straight).max(axis=1) <= clear_m).astype(float)
