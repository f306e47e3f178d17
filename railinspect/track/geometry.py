"""What the track follower hands on: the ego track of one frame, in pixels and in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.track.branches import Branch

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]


class SegmentationLike(Protocol):
    """The three planes of a segmentation this room reads, all of shape (H, W), uint8."""

    @property
    def labels(self) -> Image:
        """RailSem19 class ids; 255 void."""

    @property
    def confidence(self) -> Image:
        """Confidence of the class, 0..255."""

    @property
    def rail_score(self) -> Image:
        """Soft rail probability, 0..255."""


class FrameLike(Protocol):
    """The part of a frame this room reads."""

    @property
    def index(self) -> int:
        """Number of the frame in its video."""


@dataclass(frozen=True)
class TrackPath:
    """Centre line of the track on the plane of the rail tops, in the world frame of its camera.

    One sample per image row or finer, by rising chainage; it starts at the image's bottom and goes
    on beyond the last sight, straight in curvature, where ``seen`` is False.

    Attributes:
        xy_m: World (x, y), metres, shape (M, 2).
        heading_rad: Direction against world x, positive to the left, shape (M,).
        half_m: Half the distance of the two rails' centre lines as seen on the plane, shape (M,).
        chainage_m: Distance along the track from under the camera, shape (M,).
        uv: Pixel of the centre line, shape (M, 2).
        metre_px: Pixels per metre across the track, shape (M,).
        across_px: The same, measured at right angles to the track as it runs through the image:
            what a metre beside the track takes up where the track turns sideways. Shape (M,).
        seen: Whether the rails were followed up to this sample, shape (M,).
    """

    xy_m: Array
    heading_rad: Array
    half_m: Array
    chainage_m: Array
    uv: Array
    metre_px: Array
    across_px: Array
    seen: Bools


@dataclass(frozen=True)
class RailProfile:
    """Both rails' measured places against the smooth track, one entry per sampled row.

    Columns are left and right rail.

    Attributes:
        chainage_m: Distance along the track, metres, shape (M,).
        residual_m: Measured minus smooth track, metres across, positive to the left; NaN where
            the rail was not seen. Shape (M, 2).
        metre_px: Pixels per metre across, shape (M,).
        peak: Rail probability at the centre, 0..1; −1 outside the image. Shape (M, 2).
        smooth_peak: Rail probability where the smooth track has each rail, 0..1. Shape (M, 2).
        doubtful: Another rail-like run lies beside it or it is unusually wide: such a sample says
            nothing about the rail's shape. Shape (M, 2).
        at_switch: Another track's rail lies beside ours here or a few metres on: one rail alone
            may have been mistaken for it. Shape (M,).
        uv: Pixel of each rail, shape (M, 2, 2).
        noise_px: Scatter of neighbouring residuals, pixels: what the segmentation itself adds.
    """

    chainage_m: Array
    residual_m: Array
    metre_px: Array
    peak: Array
    smooth_peak: Array
    doubtful: Bools
    at_switch: Bools
    uv: Array
    noise_px: float


@dataclass(frozen=True)
class Gap:
    """A stretch where one or both rails are missing.

    Attributes:
        rail: Which rail.
        from_m: Chainage of its beginning, metres.
        to_m: Chainage of its end, metres.
        from_v: Image row of its beginning (the lower one), pixels.
        to_v: Image row of its end, pixels.
        continued: Whether the rail was found again beyond it.
    """

    rail: Literal["left", "right", "both"]
    from_m: float
    to_m: float
    from_v: float
    to_v: float
    continued: bool


@dataclass(frozen=True)
class TrackGeometry:
    """The ego track of one frame.

    Attributes:
        followed: Both rails were followed far enough to vouch for the track (see
            ``FollowerSettings.followed_*``). A frame that is not followed is unknown, never clear.
        reason: Why the rails could not be followed, or why the growing stopped where it did.
        left_uv: Left rail head, input pixels, top to bottom, shape (N, 2).
        right_uv: Right rail head, likewise.
        vanishing_uv: Vanishing point of the track near the camera, input pixels, shape (2,).
        roi_uv: Region of interest: vanishing point and the two beginning points, shape (3, 2),
            or (0, 2) where there are none.
        reach_m: Chainage up to which the rails are followed, metres.
        gaps: Stretches where a rail is missing.
        camera: The camera of this frame: pitch, yaw and offset as measured, height too if the
            camera was not calibrated; its world frame is the one ``path`` is in.
        path: Centre line on the ground; None where no track was found at all.
        profile: Rails against the smooth track; None likewise.
        horizon_std_px: Standard deviation of this frame's horizon row, pixels.
        calibrated: Whether the camera was given, not guessed.
        support: Mean rail probability along both rails, 0..1.
        branches: Tracks that part from this one ahead, nearest first: this one is assumed to be
            the train's path, and ``reason`` says so.
    """

    followed: bool
    reason: str | None
    left_uv: Array
    right_uv: Array
    vanishing_uv: Array | None
    roi_uv: Array
    reach_m: float | None
    gaps: tuple[Gap, ...]
    camera: Camera
    path: TrackPath | None
    profile: RailProfile | None
    horizon_std_px: float
    calibrated: bool
    support: float
    branches: tuple[Branch, ...] = ()


def nothing_followed(camera: Camera, reason: str, calibrated: bool) -> TrackGeometry:
    """The geometry of a frame without any track."""
    none = np.empty((0, 2))
    return TrackGeometry(
        followed=False,
        reason=reason,
        left_uv=none,
        right_uv=none,
        vanishing_uv=None,
        roi_uv=none,
        reach_m=None,
        gaps=(),
        camera=camera,
        path=None,
        profile=None,
        horizon_std_px=float("inf"),
        calibrated=calibrated,
        support=0.0,
    )
