"""Calibration of a camera from a ride: no board, no ruler, only the track ahead.

Three things of known size lie ahead of every train. In the levelled view the rails' spacing grows
as w = k·(Y − Y_h): its zero is the horizon, which gives the pitch, and its slope
k = spacing·cos θ/h the height above the rails. Sleepers lie every L metres; at s = Y − Y_h pixels
below the horizon the ground is x = f·h'/s away (h' above the sleepers), so the picture between the
rails is periodic in 1/s with the period L/(f·h'): that gives the focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError
from railinspect.ranging.ground_level import BED_M
from railinspect.ranging.robust_line import robust_line
from railinspect.track.follower import TrackFollower
from railinspect.track.geometry import SegmentationLike, TrackGeometry
from railinspect.track.level import Level

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

SLEEPER_M, SLEEPER_STD_M = 0.60, 0.006
"""Spacing of sleepers on main lines, metres: 0.60 m nearly everywhere in Europe."""

FIELD_OF_VIEW_RAD = (math.radians(15), math.radians(110))
"""Horizontal fields of view looked for."""

_PHASES = 512
_LEAST_FRAMES = 20


@dataclass(frozen=True)
class RideCalibration:
    """What a ride gave.

    Attributes:
        camera: The camera with the deviation of everything estimated.
        frames: Frames that took part.
        contrast: How far the sleepers' period stands out: power over the median power.
    """

    camera: Camera
    frames: int
    contrast: float


class RideCalibrator:
    """Collects a ride frame by frame; :meth:`result` is the camera as known so far.

    Args:
        size_wh: Size of the frames, pixels.
        gauge_m: Track gauge, metres.
        sleeper_m: Spacing of the sleepers, metres.
        sleeper_std_m: Its standard deviation: a bias of the focal length.
        gauge_std_m: Standard deviation of the gauge.
    """

    def __init__(
        self,
        size_wh: tuple[int, int],
        gauge_m: float = 1.435,
        sleeper_m: float = SLEEPER_M,
        sleeper_std_m: float = SLEEPER_STD_M,
        gauge_std_m: float = 0.003,
    ) -> None:
        if not (math.isfinite(sleeper_m) and 0.3 < sleeper_m < 1.2):
            raise BadInputError(f"sleeper_m is {sleeper_m}; sleepers lie 0.3 to 1.2 m apart")
        self._size_wh = size_wh
        self._gauge = gauge_m
        self._sleeper = sleeper_m
        self._sleeper_rel = sleeper_std_m / sleeper_m
        self._gauge_std = gauge_std_m
        self._follower = TrackFollower(None)
        self._focals = _focals(size_wh[0])
        self._power = np.zeros(len(self._focals))
        self._horizons: list[tuple[float, float]] = []
        self._peaks: list[float] = []

    def update(self, segmentation: SegmentationLike, rgb: Image) -> TrackGeometry:
        """Take in the next frame.

        Args:
            segmentation: Masks of the frame.
            rgb: The frame, uint8 (H, W, 3).
        """
        if (rgb.shape[1], rgb.shape[0]) != self._size_wh:
            raise BadInputError(
                f"the frame is {rgb.shape[1]}x{rgb.shape[0]}, the calibration is for "
                f"{self._size_wh[0]}x{self._size_wh[1]}"
            )
        track = self._follower.update(segmentation)
        line = _growth(track)
        if line is not None:
            self._horizons.append(line)
            power = self._sleepers(track, rgb, line)
            if power is not None:
                self._power += power
                self._peaks.append(float(self._focals[int(np.argmax(power))]))
        return track

    def result(self) -> RideCalibration:
        """The camera as known so far.

        Raises:
            BadInputError: if too few frames showed rails and sleepers.
        """
        count = len(self._horizons)
        if count < _LEAST_FRAMES or len(self._peaks) < _LEAST_FRAMES:
            raise BadInputError(
                f"rails were measured in {count} frames and sleepers in {len(self._peaks)}; at "
                f"least {_LEAST_FRAMES} are needed: calibrate on open, straight track in daylight"
            )
        rows, growths = np.array(self._horizons).T
        row, growth = float(np.median(rows)), float(np.median(growths))
        focal, contrast = _peak(self._focals, self._power)
        width = self._size_wh[0]
        focal_rel = math.hypot(self._sleeper_rel, _spread(np.log(self._peaks)), 0.004)
        if contrast < 2.0:  # no period stands out: the focal length stays a guess
            focal, focal_rel = width / 2 / math.tan(math.radians(27.2)), 0.25
        pitch = -math.atan(row / focal)
        height = (self._gauge + 0.072) * math.cos(pitch) / growth
        # Frames of one ride share its gradients: a hundred are worth ten.
        independent = math.sqrt(max(1.0, count / 10.0))
        std = CameraStd(
            focal_px=focal_rel * focal,
            height_m=height
            * math.hypot(
                1.4826 * _mad(np.log(growths)) / independent,
                self._gauge_std / self._gauge,
                0.003,
            ),
            pitch_rad=math.hypot(
                1.4826 * _mad(rows) / independent / focal, abs(pitch) * focal_rel, 3e-4
            ),
            roll_rad=math.radians(0.5),
            gauge_m=self._gauge_std,
        )
        camera = Camera(
            self._size_wh,
            focal,
            ((width - 1) / 2, (self._size_wh[1] - 1) / 2),
            height,
            pitch_rad=pitch,
            gauge_m=self._gauge,
            std=std,
        )
        return RideCalibration(camera, count, contrast)

    def _sleepers(
        self, track: TrackGeometry, rgb: Image, line: tuple[float, float]
    ) -> Array | None:
        """Power of the sleepers' period at every focal length, from one frame."""
        row, growth = line
        level = Level.of(track.camera)
        profile = _between_rails(track, rgb)
        if profile is None:
            return None
        v, grey = profile
        centre = np.full_like(v, track.camera.principal_uv[0])
        s = level.from_pixels(np.stack([centre, v], axis=1))[:, 1] - row
        near = s > 0.25 * s.max()
        if np.count_nonzero(near) < 60:
            return None
        inverse = 1.0 / s[near][::-1] if s[0] < s[-1] else 1.0 / s[near]
        values = grey[near][::-1] if s[0] < s[-1] else grey[near]
        grid = np.linspace(inverse[0], inverse[-1], _PHASES)
        even = np.interp(grid, inverse, values)
        even = even - np.convolve(np.pad(even, 24, mode="edge"), np.ones(49) / 49, "valid")
        if even.std() < 0.3:  # grey levels: too dark, too bright or out of focus
            return None
        even *= np.hanning(_PHASES) / even.std()
        height = (self._gauge + 0.072) / growth - BED_M
        angle = 2j * math.pi * np.outer(self._focals * height / self._sleeper, grid)
        power = np.abs(np.exp(angle) @ even) ** 2
        return np.asarray(power / power.sum(), np.float64)


def _growth(track: TrackGeometry, most_m: float = 30.0) -> tuple[float, float] | None:
    """Horizon row and growth of the rails' spacing from the rails near the camera."""
    path, profile = track.path, track.profile
    if not track.followed or path is None or profile is None:
        return None
    used = np.isfinite(profile.residual_m).all(axis=1) & ~profile.doubtful.any(axis=1)
    used &= ~profile.at_switch
    used &= profile.chainage_m < most_m
    if np.count_nonzero(used) < 20:
        return None
    rails = Level.of(track.camera).from_pixels(profile.uv[used])
    rows, apart = rails[:, :, 1].mean(axis=1), np.abs(rails[:, 1, 0] - rails[:, 0, 0])
    slope, at = robust_line(rows, apart, 4)
    return (-at / slope, slope) if slope > 0.05 else None


def _between_rails(track: TrackGeometry, rgb: Image) -> tuple[Array, Array] | None:
    """Rows and mean brightness of the middle between the rails, top to bottom."""
    left, right = track.left_uv, track.right_uv
    if len(left) < 10 or len(right) < 10:
        return None
    first = int(max(left[0, 1], right[0, 1])) + 1
    last = int(min(left[-1, 1], right[-1, 1], rgb.shape[0] - 1))
    if last - first < 60:
        return None
    rows = np.arange(first, last + 1)
    a = np.interp(rows, left[:, 1], left[:, 0])
    b = np.interp(rows, right[:, 1], right[:, 0])
    share = np.linspace(0.2, 0.8, 25)
    columns = np.round(a[:, None] + share * (b - a)[:, None]).astype(int)
    columns = np.clip(columns, 0, rgb.shape[1] - 1)
    grey = rgb[rows[:, None], columns].mean(axis=(1, 2))
    return rows.astype(float), grey


def _focals(width: int) -> Array:
    low, high = (width / 2 / math.tan(angle / 2) for angle in FIELD_OF_VIEW_RAD[::-1])
    return np.geomspace(low, high, 600)


def _peak(focals: Array, power: Array) -> tuple[float, float]:
    """Place of the highest power, by a parabola through it, and its height over the median."""
    top = int(np.argmax(power[1:-1])) + 1
    a, b, c = power[top - 1 : top + 2]
    shift = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c < 0 else 0.0
    step = math.log(focals[1] / focals[0])
    return float(focals[top]) * math.exp(shift * step), float(power[top] / np.median(power))


def _mad(values: Array) -> float:
    return float(np.median(np.abs(values - np.median(values))))


def _spread(values: Array) -> float:
    """Standard error of the place around which most values lie."""
    near = values[np.abs(values - np.median(values)) < 0.1]
    return 1.0 if len(near) < 5 else 1.4826 * _mad(near) / math.sqrt(max(1.0, len(near) / 10.0))


@dataclass(frozen=True)
class Drift:
    """How far the camera has moved from its calibration.

    Attributes:
        pitch_rad: Mean pitch less the calibrated one.
        height_rel: Mean height over the calibrated one, less 1.
        alarm: What to say, or None while everything is as it was.
    """

    pitch_rad: float
    height_rel: float
    alarm: str | None


class DriftMonitor:
    """Watches pitch and height of a calibrated camera while riding.

    The vehicle pitches and the line climbs, so only means over ``window`` frames count.

    Args:
        camera: The calibrated camera.
        window: Frames the means run over.
        pitch_rad: Least drift of the pitch that is one.
        height_rel: Least drift of the height, relative.
    """

    def __init__(
        self,
        camera: Camera,
        window: int = 100,
        pitch_rad: float = math.radians(0.25),
        height_rel: float = 0.03,
    ) -> None:
        self._camera = camera
        self._window = window
        self._limits = (
            max(pitch_rad, 3.0 * camera.std.pitch_rad),
            max(height_rel, 3.0 * camera.std.height_m / camera.height_m),
        )
        self._seen: list[tuple[float, float]] = []

    def update(self, track: TrackGeometry) -> Drift | None:
        """Take in a frame; None until the window is full."""
        line = _growth(track)
        if line is None:
            return None
        camera = track.camera
        pitch = -math.atan(line[0] / camera.focal_px)
        height = camera.rail_spacing_m * math.cos(pitch) / line[1]
        self._seen = [*self._seen[-self._window + 1 :], (pitch, height)]
        if len(self._seen) < self._window:
            return None
        pitches, heights = np.array(self._seen).T
        tilted = float(np.median(pitches)) - self._camera.pitch_rad
        raised = float(np.median(heights)) / self._camera.height_m - 1.0
        said = []
        if abs(tilted) > self._limits[0]:
            said.append(f"the camera's pitch has moved by {math.degrees(tilted):+.2f}°")
        if abs(raised) > self._limits[1]:
            said.append(f"its height or the gauge by {raised:+.1%}")
        alarm = " and ".join(said) + " since its calibration; calibrate anew" if said else None
        return Drift(tilted, raised, alarm)


def with_ride(board: Camera, ride: Camera) -> Camera:
    """The inside of a board calibration with the pitch and height of a ride.

    The ride's focal length is not needed then: pitch and height follow from the board's.
    """
    if board.size_wh != ride.size_wh:
        ride = ride.resized(board.size_wh)
    row = ride.focal_px * math.tan(ride.pitch_rad)
    pitch = math.atan(row / board.focal_px)
    std = replace(
        ride.std,
        focal_px=board.std.focal_px,
        pitch_rad=ride.std.pitch_rad * ride.focal_px / board.focal_px,
    )
    return replace(board, height_m=ride.height_m, pitch_rad=pitch, std=std)
