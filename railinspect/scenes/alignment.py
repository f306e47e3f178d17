"""The track in plan and profile: curvature and gradient along the chainage, seen from a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STEP_M = 0.5
"""Spacing of the local tables along the chainage, metres."""

TURN_LIMIT_RAD = 1.25
"""Heading change after which a view's track is given up: it has left every field of view."""


@dataclass(frozen=True)
class Alignment:
    """Piecewise-linear curvature (so transitions are clothoids) and gradient of one track.

    Attributes:
        curvature_m: Knots of the curvature: chainage, metres, ascending.
        curvature_per_m: Curvature at the knots, 1/m, positive to the left.
        gradient_m: Knots of the gradient: chainage, metres, ascending.
        gradient: Gradient at the knots, rise over run, positive uphill.
    """

    curvature_m: Array
    curvature_per_m: Array
    gradient_m: Array
    gradient: Array

    def local(self, chainage_m: float, ahead_m: float, behind_m: float = 15.0) -> LocalTrack:
        """The centre line as seen from a point on it, in that point's tangent frame.

        Args:
            chainage_m: Where the observer stands, metres.
            ahead_m: How far the tables reach, metres.
            behind_m: How far they reach back, metres; a multiple of ``STEP_M``.
        """
        along = np.arange(-behind_m, ahead_m + STEP_M, STEP_M)
        at = chainage_m + along
        here = round(behind_m / STEP_M)
        curvature = np.interp(at, self.curvature_m, self.curvature_per_m)
        rise = np.interp(at, self.gradient_m, self.gradient)
        heading = _integral(curvature)
        heading -= heading[here]
        z = _integral(rise - rise[here])
        x, y = _integral(np.cos(heading)), _integral(np.sin(heading))
        last = len(along)
        turned = np.flatnonzero(np.abs(heading) > TURN_LIMIT_RAD)
        if len(turned) and turned[-1] > here:
            last = int(turned[turned > here][0])
        cut = slice(0, last)
        return LocalTrack(
            along[cut],
            x[cut] - x[here],
            y[cut] - y[here],
            z[cut] - z[here],
            heading[cut],
        )

    def heading(self, chainage_m: float) -> float:
        """Heading at a chainage against that at 0, radians, positive to the left."""
        along = np.linspace(0.0, chainage_m, max(2, int(abs(chainage_m) / STEP_M)))
        curvature = np.interp(along, self.curvature_m, self.curvature_per_m)
        return float(np.trapezoid(curvature, along))


@dataclass(frozen=True)
class LocalTrack:
    """Centre line tables in the observer's frame; all arrays have one length N.

    Attributes:
        along_m: Distance along the track from the observer, metres, step ``STEP_M``.
        x_m: World x, metres.
        y_m: World y, metres.
        z_m: Height of the rail tops, metres.
        heading_rad: Heading against the observer's tangent, radians, positive to the left.
    """

    along_m: Array
    x_m: Array
    y_m: Array
    z_m: Array
    heading_rad: Array

    def to_world(self, along_m: npt.ArrayLike, left_m: npt.ArrayLike, up_m: npt.ArrayLike) -> Array:
        """World points of track coordinates, shape (..., 3); ends are extended straight."""
        along, left, up = np.broadcast_arrays(
            np.asarray(along_m, float), np.asarray(left_m, float), np.asarray(up_m, float)
        )
        inside = np.clip(along, self.along_m[0], self.along_m[-1])
        beyond = along - inside
        heading = np.interp(inside, self.along_m, self.heading_rad)
        cos, sin = np.cos(heading), np.sin(heading)
        x = np.interp(inside, self.along_m, self.x_m) + beyond * cos - left * sin
        y = np.interp(inside, self.along_m, self.y_m) + beyond * sin + left * cos
        z = np.interp(inside, self.along_m, self.z_m) + up
        return np.stack([x, y, z], axis=-1)


def _integral(values: Array) -> Array:
    out = np.empty_like(values)
    out[0] = 0.0
    np.cumsum((values[1:] + values[:-1]) * (STEP_M / 2), out=out[1:])
    return out
