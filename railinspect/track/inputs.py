"""Whether masks are masks: sizes, types and class ids, before anything is measured in them."""

from __future__ import annotations

import numpy as np

from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, VOID
from railinspect.track.geometry import SegmentationLike


def check_masks(segmentation: SegmentationLike) -> None:
    """Refuse what is no segmentation.

    Raises:
        BadInputError: if the masks are no images of one size, or hold unknown class ids.
    """
    labels, score = segmentation.labels, segmentation.rail_score
    for name, plane in (("labels", labels), ("rail_score", score)):
        if plane.ndim != 2 or plane.dtype != np.uint8 or plane.size == 0:
            raise BadInputError(
                f"segmentation {name} must be a non-empty uint8 image (H, W), "
                f"not {plane.dtype} of shape {plane.shape}"
            )
    if labels.shape != score.shape:
        raise BadInputError(
            f"segmentation planes differ in size: labels {labels.shape}, rail_score {score.shape}"
        )
    strange = int(labels.max())
    if strange == VOID:
        strange = int(labels[labels != VOID].max(initial=0))
    if strange >= len(CLASSES):
        raise BadInputError(
            f"segmentation holds class id {strange}; ids are 0 to {len(CLASSES) - 1} and {VOID}"
        )
