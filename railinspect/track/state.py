"""What the follower carries from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

from railinspect.track.begin import Pair
from railinspect.track.horizon import Horizon


@dataclass(frozen=True)
class FollowerState:
    """What the follower carries from frame to frame; all of it, so it can be saved.

    Attributes:
        size_wh: Image size the state belongs to, pixels; None before the first frame.
        home: Horizon and spacing growth about which the vehicle swings.
        aside: Mean offset of the centre line near the camera, pixels per row.
        frames: Followed frames that ``home`` and ``aside`` were learnt from.
        pair: Ego rails' lines near the camera at the last frame they were found.
        vanishing_px: Smoothed vanishing point, levelled pixels.
        curvature: Curvature near the camera, 1/m.
        lost: Frames since the track was last followed.
        index: Number of the last frame, where frames were numbered.
    """

    size_wh: tuple[int, int] | None = None
    home: Horizon | None = None
    aside: float = 0.0
    frames: int = 0
    pair: Pair | None = None
    vanishing_px: tuple[float, float] | None = None
    curvature: float = 0.0
    lost: int = 0
    index: int | None = None
