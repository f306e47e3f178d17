"""The track follower: one object per video, one geometry per frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, VOID
from railinspect.track import growing
from railinspect.track.begin import Line, Pair, Prior, find_lines, pair_of, pairs_of
from railinspect.track.centres import Centres, measure_centres
from railinspect.track.describe import STOPS, Description, describe
from railinspect.track.geometry import (
    FrameLike,
    SegmentationLike,
    TrackGeometry,
    nothing_followed,
)
from railinspect.track.growing import Growth, grow
from railinspect.track.horizon import Horizon, fit_growth, prior_horizon
from railinspect.track.level import Level
from railinspect.track.ridges import ridge_points
from railinspect.track.settings import FollowerSettings
from railinspect.track.vanishing import smoothed, vanishing_point

Array = npt.NDArray[np.float64]

_BAND_ROWS = 64
"""Rows sampled for the lines near the camera: more only costs time."""

_LEAST_PX = 16
"""Images narrower or lower than this cannot show a track."""


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


@dataclass(frozen=True)
class _Candidate:
    pair: Pair
    level: Level
    horizon: Horizon
    s_first: float
    growth: Growth


class TrackFollower:
    """Follows the ego track through a video.

    Args:
        camera: The calibrated camera, of any image size; None for an unknown one, of which the
            horizon and the height are measured from the rails (for the standard gauge) and the
            focal length stays a guess with a wide spread.
        settings: Tuning.
    """

    def __init__(
        self, camera: Camera | None = None, settings: FollowerSettings | None = None
    ) -> None:
        self._given = camera
        self._settings = settings or FollowerSettings()
        self._state = FollowerState()

    def state(self) -> FollowerState:
        """Everything carried from frame to frame."""
        return self._state

    def restore(self, state: FollowerState) -> None:
        """Go on from a saved state."""
        self._state = state

    def update(
        self, segmentation: SegmentationLike, frame: FrameLike | None = None
    ) -> TrackGeometry:
        """Follow the track in the next frame.

        Args:
            segmentation: Masks of the frame.
            frame: The frame, for its number: after a jump the track is searched anew.

        Returns:
            The track's geometry; ``followed`` is False, with a reason, where the rails could not
            be followed.

        Raises:
            BadInputError: if the masks are no images of one size, or hold unknown class ids.
        """
        _check(segmentation)
        height, width = segmentation.labels.shape
        state = self._fresh_state((width, height), frame)
        camera = self._camera((width, height))
        calibrated = self._given is not None
        if min(width, height) < _LEAST_PX:
            self._state = self._after_loss(state)
            return nothing_followed(
                camera, f"the image is smaller than {_LEAST_PX} pixels", calibrated
            )
        scale = width / 640.0
        home = state.home or prior_horizon(camera, calibrated)
        home = home.later(self._settings.home_walk_px * scale, self._settings.growth_walk)
        state = replace(state, home=home)
        now = home.swung(self._settings.swing_px * scale)
        candidates, lines = self._candidates(segmentation.rail_score, camera, now, state)
        settled = None
        if candidates:
            best = max(candidates, key=lambda c: c.growth.support + 0.1 * c.pair.score)
            best, centres, measured = self._settled(segmentation.rail_score, best, now)
            found = describe(
                best.level, best.growth, centres, best.s_first, self._settings, calibrated
            )
            settled = None if found is None else (best, found, measured)
        if settled is None:
            self._state = self._after_loss(state)
            tilted = replace(camera, pitch_rad=Level(camera, home.row_px).pitch_rad)
            return nothing_followed(tilted, STOPS[growing.NO_BEGIN], calibrated)
        return self._finish(*settled, lines, state, calibrated)

    # Set-up of a frame

    def _fresh_state(self, size_wh: tuple[int, int], frame: FrameLike | None) -> FollowerState:
        state = self._state
        index = None if frame is None else frame.index
        jumped = index is not None and state.index is not None and not 0 < index - state.index <= 5
        if state.size_wh != size_wh or jumped:
            return FollowerState(size_wh=size_wh, index=index)
        return replace(state, index=index)

    def _camera(self, size_wh: tuple[int, int]) -> Camera:
        if self._given is not None:
            same = self._given.size_wh == size_wh
            return self._given if same else self._given.resized(size_wh)
        settings = self._settings
        camera = Camera.from_field_of_view(size_wh, settings.default_fov_rad, height_m=2.4)
        std = CameraStd(
            focal_px=settings.default_focal_spread * camera.focal_px,
            height_m=0.5,
            pitch_rad=math.radians(2.0),
            roll_rad=math.radians(1.5),
            gauge_m=settings.default_gauge_std_m,
        )
        return replace(camera, std=std)

    def _level(self, camera: Camera, horizon: Horizon) -> Level:
        """This frame's view; an unknown camera gets the height that makes k fit the gauge."""
        level = Level(camera, horizon.row_px)
        if self._given is not None:
            return level
        height = camera.rail_spacing_m * math.cos(level.pitch_rad) / horizon.growth
        relative = math.hypot(horizon.growth_std, camera.std.gauge_m / camera.rail_spacing_m)
        std = replace(camera.std, height_m=relative * height)
        return Level(replace(camera, height_m=height, std=std), horizon.row_px)

    # Beginning points

    def _prior(self, camera: Camera, now: Horizon, state: FollowerState, s_first: float) -> Prior:
        scale = camera.size_wh[0] / 640.0
        row_std = math.hypot(now.row_std_px, 1.5 * scale)
        growth_std = math.hypot(now.growth_std, 0.02)
        if state.frames:
            aside, aside_std = state.aside, math.hypot(0.03, 0.1 / state.frames)
        else:
            aside = camera.offset_m * math.cos(camera.pitch_rad) / camera.height_m
            aside_std = 0.10 if self._given is not None else 0.16
        if state.pair is not None:
            last = state.vanishing_px if state.vanishing_px else state.pair.vanishing_px
            heading, heading_std = last[0], 15.0 * scale
        else:
            heading, heading_std = camera.focal_px * math.tan(camera.yaw_rad), 64.0 * scale
        return Prior(
            now.row_px, row_std, now.growth, growth_std, aside, aside_std, heading, heading_std
        )

    def _candidates(
        self,
        score: npt.NDArray[np.uint8],
        camera: Camera,
        horizon: Horizon,
        state: FollowerState,
    ) -> tuple[list[_Candidate], list[Line]]:
        settings = self._settings
        width, height = camera.size_wh
        scale = width / 640.0
        level = Level(camera, horizon.row_px)
        bottom = level.bottom_px
        s_first = bottom - horizon.row_px
        if s_first < 12:
            return [], []
        stride = max(1, int(settings.band * s_first / _BAND_ROWS))
        top = bottom - settings.band * s_first
        tilt = abs(math.sin(camera.roll_rad)) * width / 2
        first_row = int(max(0.0, height - 1 - settings.band * s_first - tilt))
        points = ridge_points(score, first_row, stride, settings.low, max(4, int(0.12 * width)))
        points = np.hstack([level.from_pixels(points[:, :2]), points[:, 2:], points[:, 1:2]])
        points = points[points[:, 1] >= top]
        rows = max(1, int(settings.band * s_first / stride))
        prior = self._prior(camera, horizon, state, s_first)
        lines = find_lines(
            points,
            bottom,
            top,
            width / 2,
            rows,
            2.5 * scale,
            (prior.heading_px, prior.horizon_px),
            3.0 * prior.heading_std_px + 1.2 * prior.horizon_std_px,
        )
        pairs = [
            pair
            for pair in pairs_of(lines, bottom, prior, limit=6)
            if not _crosses(score, level, pair, bottom, settings.low)
        ][:3]
        if state.pair is not None:
            # Beginning points move by at most Δ_b; where none is found that near, the last stay.
            reach = settings.begin_px * scale
            old = state.pair
            pairs = [
                p
                for p in pairs
                if abs(p.left.bottom_px - old.left.bottom_px) <= reach
                and abs(p.right.bottom_px - old.right.bottom_px) <= reach
            ]
            if not pairs:
                kept = pair_of(
                    replace(old.left, votes=0.1), replace(old.right, votes=0.1), bottom, prior
                )
                pairs = [] if kept is None else [kept]
        found = [self._grown(score, camera, horizon, pair, state, bottom, scale) for pair in pairs]
        return [c for c in found if c is not None], lines

    def _grown(
        self,
        score: npt.NDArray[np.uint8],
        camera: Camera,
        horizon: Horizon,
        pair: Pair,
        state: FollowerState,
        bottom: float,
        scale: float,
    ) -> _Candidate | None:
        """Let a track grow from one pair of beginning points."""
        row_std, growth_std = 4.0 * scale, 0.04 * pair.growth
        # A pair that is too steep is also too high: both errors stem from the same two lines.
        cross = 0.7 * row_std * growth_std
        horizon = horizon.updated(
            pair.vanishing_px[1],
            pair.growth,
            np.array([[row_std**2, cross], [cross, growth_std**2]]),
        )
        level = self._level(camera, horizon)
        s_first = bottom - horizon.row_px
        if s_first < 12:
            return None
        growth = self._grow_from(score, level, pair, bottom, state.curvature)
        if growth.last < 3:
            return None
        return _Candidate(pair, level, horizon, s_first, growth)

    def _grow_from(
        self,
        score: npt.NDArray[np.uint8],
        level: Level,
        pair: Pair,
        bottom: float,
        curvature: float,
    ) -> Growth:
        camera = level.camera
        s_first = bottom - level.horizon_px
        centre_x = (pair.left.bottom_px + pair.right.bottom_px) / 2
        x, y = level.ground_from_level(np.array([centre_x, bottom]))
        spread = (pair.right.bottom_px - pair.left.bottom_px) / 2
        cos_pitch = math.cos(level.pitch_rad)
        half = spread * camera.height_m / (s_first * cos_pitch)
        heading = math.atan(-pair.vanishing_px[0] * cos_pitch / camera.focal_px)
        metre = s_first * cos_pitch / camera.height_m
        scale = camera.size_wh[0] / 640.0
        return grow(
            score,
            level,
            (float(x), float(y), heading, curvature),
            (3.0 * scale / metre, 0.03, 1 / 250),
            half,
            s_first,
            self._settings,
        )

    # Refinement and result

    def _settled(
        self, score: npt.NDArray[np.uint8], best: _Candidate, now: Horizon
    ) -> tuple[_Candidate, Centres, tuple[float, float, Array] | None]:
        """Measure the centres, learn the horizon from them, and grow again if it moved."""
        settings = self._settings
        scale = score.shape[1] / 640.0
        bottom = best.s_first + best.level.horizon_px
        centres = measure_centres(score, best.level, best.growth, best.s_first, settings)
        measured = None
        for _ in range(2):
            measured = self._measured_horizon(best, centres, scale)
            if measured is None:
                break
            # The frame's prior, not the pair's: the same rows must not count twice.
            horizon = now.updated(*measured)
            moved = abs(horizon.row_px - best.level.horizon_px)
            if moved < 0.4 * scale:
                best = replace(best, horizon=horizon)
                break
            level = self._level(best.level.camera, horizon)
            growth = self._grow_from(score, level, best.pair, bottom, 0.0)
            if growth.last < 3:
                break
            best = _Candidate(best.pair, level, horizon, bottom - horizon.row_px, growth)
            centres = measure_centres(score, level, growth, best.s_first, settings)
        return best, centres, measured

    def _measured_horizon(
        self, best: _Candidate, centres: Centres, scale: float
    ) -> tuple[float, float, Array] | None:
        """Horizon and growth from the nearer part of the measured rails."""
        level = best.level
        both = (centres.peak >= self._settings.low).all(axis=1)
        both &= (centres.other < 0.45).all(axis=1)
        rows = level.level_from_ground(centres.path[:, :2])[:, 1]
        s = rows - level.horizon_px
        near = both & (s > 0.25 * best.s_first)
        spacing = 2 * centres.path[:, 3] + centres.offset_m[:, 0] - centres.offset_m[:, 1]
        metre = s * math.cos(level.pitch_rad) / level.camera.height_m
        fit = fit_growth(rows[near], (spacing * metre)[near], 0.7 * scale)
        if fit is None:
            return None
        row, growth, covariance = fit
        # What a straight line cannot know: the plane's own slow bends near the camera.
        floor = np.diag([(0.4 * scale) ** 2, (0.004 * growth) ** 2])
        return row, growth, covariance + floor

    def _finish(
        self,
        best: _Candidate,
        found: Description,
        measured: tuple[float, float, Array] | None,
        lines: list[Line],
        state: FollowerState,
        calibrated: bool,
    ) -> TrackGeometry:
        settings = self._settings
        level = best.level
        scale = level.camera.size_wh[0] / 640.0
        bottom = best.s_first + level.horizon_px
        nearby = [best.pair.left, best.pair.right, *lines]
        point, residual = vanishing_point(nearby, bottom, best.pair.vanishing_px, 4.0 * scale)
        vanishing = smoothed(state.vanishing_px, point, residual / scale**2, settings.psi)
        followed = (
            found.rows >= settings.followed_rows
            and found.cover >= settings.followed_cover
            and found.reach_m >= settings.followed_reach_m
            and found.contrast >= settings.followed_contrast
        )
        reason = f"{STOPS[best.growth.stop]} at {found.reach_m:.0f} m"
        if not followed and found.cover < settings.followed_cover:
            reason = f"a rail is seen in only {found.cover:.0%} of the rows; {reason}"
        elif not followed and found.contrast < settings.followed_contrast:
            reason = "the rails do not stand out from the ground between them"
        nodes = best.growth.nodes
        curvature = float(nodes[min(6, best.growth.last - 1), growing.KAPPA])
        new = replace(state, pair=best.pair, vanishing_px=vanishing, curvature=curvature, lost=0)
        if not followed:
            self._state = self._after_loss(replace(new, lost=state.lost))
        else:
            self._state = self._learnt(new, best, measured, scale)
        begin = level.to_pixels(
            np.array([[best.pair.left.bottom_px, bottom], [best.pair.right.bottom_px, bottom]])
        )
        vanishing_uv = level.to_pixels(np.array(vanishing))
        return TrackGeometry(
            followed=followed,
            reason=reason,
            left_uv=found.left_uv,
            right_uv=found.right_uv,
            vanishing_uv=vanishing_uv,
            roi_uv=np.stack([vanishing_uv, begin[1], begin[0]]),
            reach_m=found.reach_m,
            gaps=found.gaps,
            camera=found.camera,
            path=found.path,
            profile=found.profile,
            horizon_std_px=best.horizon.row_std_px,
            calibrated=calibrated,
            support=best.growth.support,
        )

    def _learnt(
        self,
        state: FollowerState,
        best: _Candidate,
        measured: tuple[float, float, Array] | None,
        scale: float,
    ) -> FollowerState:
        """Move the slow means towards what this frame measured."""
        home = state.home
        if measured is not None and home is not None:
            row, growth, covariance = measured
            swing = np.diag([(self._settings.swing_px * scale) ** 2, (0.01 * growth) ** 2])
            home = home.updated(row, growth, covariance + swing)
        share = 1.0 / min(state.frames + 1, self._settings.memory_frames)
        aside = state.aside + share * (best.pair.aside - state.aside)
        return replace(state, home=home, aside=aside, frames=state.frames + 1)

    def _after_loss(self, state: FollowerState) -> FollowerState:
        """One more frame without a track: after some the place is forgotten, then the camera."""
        lost = state.lost + 1
        if lost <= self._settings.lost_frames:
            return replace(state, lost=lost)
        if lost <= 4 * self._settings.lost_frames:
            return replace(state, lost=lost, pair=None, vanishing_px=None, curvature=0.0)
        return FollowerState(size_wh=state.size_wh, index=state.index)


def _crosses(
    score: npt.NDArray[np.uint8], level: Level, pair: Pair, bottom: float, low: float
) -> bool:
    """Whether both lines go on as rails above the point where they meet: no vanishing point."""
    x, y = pair.vanishing_px
    above = np.linspace(0.1, 0.45, 24) * (bottom - y)
    for line in (pair.left, pair.right):
        uv = level.to_pixels(np.stack([x - line.slope * above, y - above], axis=1))
        c, r = np.round(uv).astype(int).T
        inside = (c >= 0) & (c < score.shape[1]) & (r >= 0) & (r < score.shape[0])
        if np.count_nonzero(inside) < 8:
            return False
        if np.mean(score[r[inside], c[inside]] >= 255 * low) < 0.6:
            return False
    return True


def _check(segmentation: SegmentationLike) -> None:
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
    strange = int(labels[labels != VOID].max(initial=0))
    if strange >= len(CLASSES):
        raise BadInputError(
            f"segmentation holds class id {strange}; ids are 0 to {len(CLASSES) - 1} and {VOID}"
        )
