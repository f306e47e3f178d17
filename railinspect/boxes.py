"""Axis-aligned boxes in the image: left, top, right, bottom, pixels."""

from __future__ import annotations

Box = tuple[float, float, float, float]


def iou(first: Box, second: Box) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    wide = min(first[2], second[2]) - max(first[0], second[0])
    tall = min(first[3], second[3]) - max(first[1], second[1])
    if wide <= 0 or tall <= 0:
        return 0.0
    shared = wide * tall
    return shared / (area(first) + area(second) - shared)


def overlap_share(first: Box, second: Box) -> float:
    """Share of the smaller box that lies inside the larger one, 0 to 1."""
    wide = min(first[2], second[2]) - max(first[0], second[0])
    tall = min(first[3], second[3]) - max(first[1], second[1])
    smaller = min(area(first), area(second))
    return wide * tall / smaller if wide > 0 and tall > 0 and smaller > 0 else 0.0


def boxes_touch(first: Box, second: Box, slack: float = 0.15) -> bool:
    """Whether two boxes overlap once each has grown by ``slack`` of its size on every side."""
    return _grow_overlap(first, second, slack, 0, 2) and _grow_overlap(first, second, slack, 1, 3)


def columns_touch(first: Box, second: Box, slack: float) -> bool:
    """Whether the boxes' image columns overlap once each has grown by ``slack`` of its width."""
    return _grow_overlap(first, second, slack, 0, 2)


def _grow_overlap(first: Box, second: Box, slack: float, low: int, high: int) -> bool:
    grow_first = slack * (first[high] - first[low])
    grow_second = slack * (second[high] - second[low])
    return (
        first[low] - grow_first <= second[high] + grow_second
        and second[low] - grow_second <= first[high] + grow_first
    )


def area(box: Box) -> float:
    """Area, pixels²; 0 for an empty box."""
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)


def height(box: Box) -> float:
    """Height, pixels."""
    return box[3] - box[1]


def union(first: Box, second: Box) -> Box:
    """Smallest box that holds both."""
    return (
        min(first[0], second[0]),
        min(first[1], second[1]),
        max(first[2], second[2]),
        max(first[3], second[3]),
    )
