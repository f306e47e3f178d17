"""Several looks at one image: mirrored, and in windows of it, merged by a vote.

It works on what a checkpoint and a bundle both hand out, so that both give the same numbers. At
zoom z the image is seen in overlapping windows of 1/z of its width and height, each stretched to
the network's size: a zoom above one is a sliding window over a larger image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np

from fscnn.models.decision import RAIL_FROM
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, RAIL_EMBEDDED, RAIL_RAISED
from railinspect.railsem import Image
from railinspect.segmenter import Segmentation

Segment = Callable[[Image], Segmentation]

OVERLAP = 0.25
"""Least share of a window's side that its neighbour sees too."""


def windows(width: int, height: int, zoom: float) -> Iterator[tuple[int, int, int, int]]:
    """Left, top, width and height of windows that cover an image, evenly spread, pixels.

    >>> list(windows(100, 50, 1))
    [(0, 0, 100, 50)]
    >>> [left for left, top, w, h in windows(100, 50, 2) if top == 0]
    [0, 25, 50]
    """
    sides = [max(1, round(side / zoom)) for side in (width, height)]
    starts = []
    for whole, side in zip((width, height), sides, strict=True):
        count = 1 + math.ceil((whole - side) / (side * (1 - OVERLAP)) - 1e-9)
        starts.append([round(v) for v in np.linspace(0, whole - side, count)])
    for top in starts[1]:
        for left in starts[0]:
            yield left, top, sides[0], sides[1]


def views(segment: Segment, zooms: Sequence[float] = (1.0,), flip: bool = False) -> Segment:
    """A segmentation that looks at each image several times.

    Rail scores are averaged, and a pixel is rail as for a single look. Of the other classes, and of
    the two kinds of rail, the one with the most confidence over all looks wins; the confidence is
    the mean over all looks of what those that said so were sure of.

    Args:
        segment: The single look.
        zooms: Magnifications, each at least 1.
        flip: Look at each window mirrored too.

    Raises:
        BadInputError: if there is no zoom or one is below 1.
    """
    if not zooms or min(zooms) < 1:
        raise BadInputError(f"zooms must be at least 1, got {list(zooms)}")
    if tuple(zooms) == (1.0,) and not flip:
        return segment

    def run(rgb: Image) -> Segmentation:
        height, width = rgb.shape[:2]
        votes = np.zeros((len(CLASSES), height, width), np.float32)
        rails = np.zeros((height, width), np.float32)
        looks = np.zeros((height, width), np.float32)
        for zoom in zooms:
            for left, top, w, h in windows(width, height, zoom):
                place = (slice(top, top + h), slice(left, left + w))
                part = np.ascontiguousarray(rgb[place])
                for mirrored in (False, True)[: 1 + flip]:
                    found = segment(cv2.flip(part, 1) if mirrored else part)
                    maps = [found.labels, found.confidence, found.rail_score]
                    if mirrored:
                        maps = [m[:, ::-1] for m in maps]
                    rows, columns = np.mgrid[place]
                    votes[maps[0], rows, columns] += maps[1]
                    rails[place] += maps[2]
                    looks[place] += 1
        rail_score = np.rint(rails / looks).astype(np.uint8)
        is_rail = rail_score >= RAIL_FROM
        kind = RAIL_RAISED + (votes[RAIL_EMBEDDED] > votes[RAIL_RAISED])
        labels = np.where(is_rail, kind, votes[:RAIL_RAISED].argmax(0)).astype(np.uint8)
        sure = np.take_along_axis(votes, labels[None].astype(np.intp), 0)[0] / looks
        return Segmentation(labels, np.rint(sure).astype(np.uint8), rail_score)

    return run
