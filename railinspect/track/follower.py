"""The track follower: one object per video, one geometry per frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera, CameraStd
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, VOID
from railinspect.track import growing
from railinspect.track.begin import Line
from railinspect.track.branches import Branch, find_branches
from railinspect.track.centres import Centres, measure_centres
from railinspect.track.describe import STOPS, Description, describe
from railinspect.track.geometry import (
    FrameLike,
    SegmentationLike,
    TrackGeometry,
    nothing_followed,
)
from railinspect.track.horizon import Horizon, fit_growth, prior_horizon
from railinspect.track.level import Level
from railinspect.track.search import Candidate, grow_from, search, view_of
from railinspect.track.settings import FollowerSettings
from railinspect.track.state import FollowerState
from railinspect.track.vanishing import smoothed, vanishing_point

Array = npt.NDArray[np.float64]

_LEAST_PX = 16
"""Images narrower or lower than this cannot show a track."""


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
        candidates, lines = search(
            segmentation.rail_score, camera, calibrated, now, state, self._settings
        )
        settled = None
        if candidates:
            best = max(candidates, key=lambda c: c.growth.support + 0.1 * c.pair.score)
            best, centres, measured = self._settled(segmentation.rail_score, best, now)
            found = describe(
                segmentation.rail_score,
                best.level,
                best.growth,
                centres,
                best.s_first,
                self._settings,
                calibrated,
            )
            settled = None if found is None else (best, found, measured)
        if settled is None:
            self._state = self._after_loss(state)
            tilted = replace(camera, pitch_rad=Level(camera, home.row_px).pitch_rad)
            return nothing_followed(tilted, STOPS[growing.NO_BEGIN], calibrated)
        branches: tuple[Branch, ...] = ()
        if settled[1].at_switch:
            best = settled[0]
            branches = find_branches(
                segmentation.rail_score, best.level, best.growth, self._settings
            )
        return self._finish(*settled, lines, branches, state, calibrated)

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

    # Refinement and result

    def _settled(
        self, score: npt.NDArray[np.uint8], best: Candidate, now: Horizon
    ) -> tuple[Candidate, Centres, tuple[float, float, Array] | None]:
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
            level = view_of(best.level.camera, self._given is not None, horizon)
            growth = grow_from(score, level, best.pair, bottom, 0.0, settings)
            if growth.last < 3:
                break
            best = Candidate(best.pair, level, horizon, bottom - horizon.row_px, growth)
            centres = measure_centres(score, level, growth, best.s_first, settings)
        return best, centres, measured

    def _measured_horizon(
        self, best: Candidate, centres: Centres, scale: float
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
        best: Candidate,
        found: Description,
        measured: tuple[float, float, Array] | None,
        lines: list[Line],
        branches: tuple[Branch, ...],
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
        if branches:
            reason += f"; {_assumed(branches[0])}"
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
            branches=branches,
        )

    def _learnt(
        self,
        state: FollowerState,
        best: Candidate,
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


def _assumed(branch: Branch) -> str:
    """Which path was assumed at a switch, in words."""
    other = "right" if branch.side == "left" else "left"
    return (
        f"a track parts to the {branch.side} at {branch.from_m:.0f} m, the path to the {other} of "
        "it is assumed"
    )


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
    strange = int(labels.max())
    if strange == VOID:
        strange = int(labels[labels != VOID].max(initial=0))
    if strange >= len(CLASSES):
        raise BadInputError(
            f"segmentation holds class id {strange}; ids are 0 to {len(CLASSES) - 1} and {VOID}"
        )
