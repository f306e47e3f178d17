"""One anomaly in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FindingType = Literal["distortion", "obstruction", "trespasser"]


@dataclass(frozen=True)
class Finding:
    """One anomaly in one frame.

    Attributes:
        type: What it is.
        polygon_uv: Its outline, input pixels, shape (K, 2).
        box_xyxy: Its box, input pixels.
        confidence: 0 to 1.
        foot_uv: Where it meets the ground on the track, input pixels, shape (2,).
        evidence: What was measured, in words with units.
        doubt: Why there may be nothing; None for what is sure. What is doubtful is no event, and
            the track it seems to stand on is not clear.
        place_rel: Standard deviation of its place along the track as a share of the range, where
            close-ups alone show it and no foot is seen; 0 where one is.
    """

    type: FindingType
    polygon_uv: Array
    box_xyxy: tuple[float, float, float, float]
    confidence: float
    foot_uv: Array
    evidence: str
    doubt: str | None = None
    place_rel: float = 0.0
