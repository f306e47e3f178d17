"""RailSem19's nineteen classes, their colours, and the groups the rest of the package asks for.

Class names, order and colours are those of RailSem19's ``rs19-config.json`` (Zendel et al.,
"RailSem19: A Dataset for Semantic Rail Scene Understanding", CVPR Workshops 2019).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

CLASSES: Final[tuple[str, ...]] = (
    "road",
    "sidewalk",
    "construction",
    "tram-track",
    "fence",
    "pole",
    "traffic-light",
    "traffic-sign",
    "vegetation",
    "terrain",
    "sky",
    "human",
    "rail-track",
    "car",
    "truck",
    "trackbed",
    "on-rails",
    "rail-raised",
    "rail-embedded",
)
"""Class names; the position is the class id stored in masks."""

(
    ROAD,
    SIDEWALK,
    CONSTRUCTION,
    TRAM_TRACK,
    FENCE,
    POLE,
    TRAFFIC_LIGHT,
    TRAFFIC_SIGN,
    VEGETATION,
    TERRAIN,
    SKY,
    HUMAN,
    RAIL_TRACK,
    CAR,
    TRUCK,
    TRACKBED,
    ON_RAILS,
    RAIL_RAISED,
    RAIL_EMBEDDED,
) = range(len(CLASSES))

VOID: Final = 255
"""Mask value of pixels that belong to no class and count nowhere."""

RAILS: Final[tuple[int, ...]] = (RAIL_RAISED, RAIL_EMBEDDED)
"""The two rail classes whose union the project reports as rail IoU."""

GROUND: Final[tuple[int, ...]] = (
    ROAD,
    SIDEWALK,
    TRAM_TRACK,
    VEGETATION,
    TERRAIN,
    RAIL_TRACK,
    TRACKBED,
    RAIL_RAISED,
    RAIL_EMBEDDED,
)
"""Classes a free track may show between and beside its rails."""

GAUGES_M: Final[dict[str, float]] = {
    "standard": 1.435,
    "russian": 1.520,
    "iberian": 1.668,
    "metre": 1.000,
}
"""Track gauges by name, metres between the inner faces of the two heads."""

RAIL_HEAD_WIDTH_M: Final = 0.072
"""Width of a rail head (60E1), metres; the two head centre lines lie gauge + this apart."""

PALETTE: Final[npt.NDArray[np.uint8]] = np.array(
    [
        (128, 64, 128),
        (244, 35, 232),
        (70, 70, 70),
        (192, 0, 128),
        (190, 153, 153),
        (153, 153, 153),
        (250, 170, 30),
        (220, 220, 0),
        (107, 142, 35),
        (152, 251, 152),
        (70, 130, 180),
        (220, 20, 60),
        (230, 150, 140),
        (0, 0, 142),
        (0, 0, 70),
        (90, 40, 40),
        (0, 80, 100),
        (0, 254, 254),
        (0, 68, 63),
    ],
    dtype=np.uint8,
)
"""RGB colour of each class, shape (19, 3)."""


def colourise(labels: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Paint a mask with the RailSem19 colours; void and unknown ids are black.

    Args:
        labels: Class ids, shape (H, W).

    Returns:
        RGB image, shape (H, W, 3).
    """
    table = np.zeros((256, 3), np.uint8)
    table[: len(CLASSES)] = PALETTE
    return table[labels]
