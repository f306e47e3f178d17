"""What the follower carries from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from railinspect.track.begin import Pair
from railinspect.track.horizon import Horizon, Measured
from railinspect.track.settings import FollowerSettings


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

    def learnt(
        self, pair: Pair, measured: Measured | None, scale: float, settings: FollowerSettings
    ) -> FollowerState:
        """The slow means moved towards what a followed frame measured.

        Args:
            pair: The frame's beginning points.
            measured: What its rails say of the horizon.
            scale: Image width over 640 pixels.
            settings: Tuning.
        """
        home = self.home
        if measured is not None and home is not None:
            row, growth, covariance = measured
            own = (settings.swing_px * scale) ** 2, (0.01 * growth) ** 2
            swing = np.array([[own[0], 0.0], [0.0, own[1]]])
            home = home.updated(row, growth, covariance + swing)
        share = 1.0 / min(self.frames + 1, settings.memory_frames)
        aside = self.aside + share * (pair.aside - self.aside)
        return replace(self, home=home, aside=aside, frames=self.frames + 1)

    def after_loss(self, lost_frames: int) -> FollowerState:
        """One more frame without a track: after some the place is forgotten, then the camera."""
        lost = self.lost + 1
        if lost <= lost_frames:
            return replace(self, lost=lost)
        if lost <= 4 * lost_frames:
            return replace(self, lost=lost, pair=None, vanishing_px=None, curvature=0.0)
        return FollowerState(size_wh=self.size_wh, index=self.index)
