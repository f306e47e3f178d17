"""Geometric annotations of one image, whatever data set they come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RailPair:
    """The two rails of a track.

    Attributes:
        left_uv: Left rail, pixels, shape (N, 2), top to bottom.
        right_uv: Right rail, pixels, shape (M, 2), top to bottom.
        track: Name of the track in its data set.
    """

    left_uv: Points
    right_uv: Points
    track: str


@dataclass(frozen=True)
class Shape:
    """A line or an area.

    Attributes:
        label: The data set's own name of what it is.
        points_uv: Pixels, shape (N, 2).
        closed: Whether it is a polygon.
    """

    label: str
    points_uv: Points
    closed: bool


@dataclass(frozen=True)
class Box:
    """An upright box.

    Attributes:
        label: The data set's own name of what it is.
        box_xyxy: Left, top, right, bottom, pixels.
    """

    label: str
    box_xyxy: tuple[float, float, float, float]


@dataclass(frozen=True)
class Annotation:
    """Everything drawn on one image.

    Attributes:
        name: Name of the frame in its data set.
        size_wh: Width and height of the image, pixels.
        rails: Tracks of which both rails are given.
        shapes: Lines and areas, single rails among them.
        boxes: Boxes.
    """

    name: str
    size_wh: tuple[int, int]
    rails: tuple[RailPair, ...]
    shapes: tuple[Shape, ...]
    boxes: tuple[Box, ...]


def rail_pair(one_uv: Points, other_uv: Points, track: str) -> RailPair:
    """Order two rails: each top to bottom, the one further left where they come nearest first."""
    one, other = (line[np.argsort(line[:, 1], kind="stable")] for line in (one_uv, other_uv))
    row = min(one[-1, 1], other[-1, 1])  # the lowest row both reach
    across = [float(np.interp(row, line[:, 1], line[:, 0])) for line in (one, other)]
    return RailPair(one, other, track) if across[0] <= across[1] else RailPair(other, one, track)
