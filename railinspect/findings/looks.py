"""What several looks at one picture say of a body: how sure the segmentation is of it.

Each closer look (:mod:`railinspect.fovea`) sees fewer of the things that are not there in the look
before, and invents others: of a patch of ballast that fills it, or of a blurred picture. What one
look takes for a thing and the others for ground is less sure than what all of them see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from railinspect.labels import GROUND, HUMAN, RAILS
from railinspect.track.geometry import SegmentationLike

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_PEAK_EXCESS = 0.2
"""So much is the 95th percentile of the confidence over its mean, of most bodies: what several
looks say and what one says are held against the same thresholds."""

_GROUND_WEIGHT = 0.4
"""How much of the looks' mean confidence in ground counts against a body."""

_LEAST_INSIDE = 0.5
"""A look says something of a body if this share of it lies inside the look."""


def looks_of(segmentation: SegmentationLike) -> Iterator[SegmentationLike]:
    """The picture as seen with all looks, without the closest, and so on to the first alone."""
    look: SegmentationLike | None = segmentation
    while look is not None:
        yield look
        look = getattr(look, "before", None)  # what is no ``Segmentation`` is a single look


def sureness(
    segmentation: SegmentationLike,
    corner_vu: tuple[int, int],
    body: Bools,
    low_px: int,
    foreign: tuple[int, ...],
) -> float:
    """How sure the segmentation is of a body, 0…1.

    Of a single look it is the mean confidence over the body's pixels. Of several it is what the
    look that is surest of a thing says (the share of the body it takes for what has no business on
    a track, times the 95th percentile of its confidence there, less ``_PEAK_EXCESS``), less
    ``_GROUND_WEIGHT`` of the looks' mean confidence in ground. Only the body's lower part counts
    there: behind it the track must be hidden, a wall farther on rises above it.

    Args:
        segmentation: With all its looks.
        corner_vu: Row and column of the body's upper left pixel.
        body: Its pixels, shape (rows, columns).
        low_px: Height of the lower part that counts with several looks, pixels.
        foreign: Classes that have no business on a track, besides people.
    """
    top, left = corner_vu
    window = np.s_[top : top + body.shape[0], left : left + body.shape[1]]
    if getattr(segmentation, "before", None) is None:
        return float(segmentation.confidence[window][body].mean()) / 255
    cut = max(0, body.shape[0] - max(1, low_px))
    body, corner_vu = body[cut:], (top + cut, left)
    window = np.s_[top + cut : top + cut + body.shape[0], left : left + body.shape[1]]
    thing, ground = np.zeros(256, bool), np.zeros(256, bool)
    thing[[*foreign, HUMAN]] = True
    ground[[*GROUND, *RAILS]] = True
    things, grounds = [], []
    for look in looks_of(segmentation):
        if not _lies_in(look, corner_vu, body):
            continue
        labels = look.labels[window][body]
        confidence = look.confidence[window][body]
        sees = thing[labels]
        peak = float(np.percentile(confidence[sees], 95.0)) / 255 if sees.any() else 0.0
        things.append(peak * float(sees.mean()))
        grounds.append(float(np.mean(confidence * ground[labels])) / 255)
    sure = max(things) - _PEAK_EXCESS - _GROUND_WEIGHT * float(np.mean(grounds))
    return min(1.0, max(0.0, sure))


def _lies_in(look: SegmentationLike, corner_vu: tuple[int, int], body: Bools) -> bool:
    """Whether a body lies mostly inside the part of the picture that the look is of."""
    box = getattr(look, "closest_xyxy", None)
    if box is None:
        return True
    (top, left), (x0, y0, x1, y1) = corner_vu, box
    inside = body[max(0, y0 - top) : max(0, y1 - top), max(0, x0 - left) : max(0, x1 - left)]
    return bool(np.count_nonzero(inside) >= _LEAST_INSIDE * np.count_nonzero(body))


def blur(segmentation: SegmentationLike, uv: Array) -> Array:
    """How blurred the rails are at places of the picture, as a share of the first look's blur.

    A look of half the width has half the blur of its own pixels, but the closer a look, the less of
    what it sees is sharp: the square root of the widths' ratio.

    Args:
        segmentation: With all its looks.
        uv: Places, pixels, shape (N, 2).

    Returns:
        0…1, 1 where only the first look was, shape (N,).
    """
    share = np.ones(len(uv))
    for look in reversed(list(looks_of(segmentation))):  # the closest last
        box = getattr(look, "closest_xyxy", None)
        if box is not None:
            inside = ((uv >= box[:2]) & (uv < box[2:])).all(axis=1)
            share[inside] = math.sqrt((box[2] - box[0]) / segmentation.labels.shape[1])
    return share
