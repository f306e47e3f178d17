"""The track follower: one object per video, one geometry per frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from railinspect.camera import Camera, CameraStd
from railinspect.track import growing
from railinspect.track.begin import Line
from railinspect.track.branches import Branch, find_branches
from railinspect.track.describe import STOPS, Description, describe
from railinspect.track.geometry import (
    FrameLike,
    SegmentationLike,
    TrackGeometry,
    nothing_followed,
)
from railinspect.track.horizon import Measured, prior_horizon
from railinspect.track.inputs import check_masks
from railinspect.track.level import Level
from railinspect.track.search import Candidate, search
from railinspect.track.settings import FollowerSettings
from railinspect.track.settle import settled_on
from railinspect.track.state import FollowerState
from railinspect.track.vanishing import smoothed, vanishing_point

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
        check_masks(segmentation)
        height, width = segmentation.labels.shape
        state = self._fresh_state((width, height), frame)
        camera = self._camera((width, height))
        calibrated = self._given is not None
        if min(width, height) < _LEAST_PX:
            self._state = state.after_loss(self._settings.lost_frames)
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
            likely = self._settings.beginning_weight
            best = max(candidates, key=lambda c: c.growth.support + likely * c.pair.score)
            best, centres, measured = settled_on(
                segmentation.rail_score, best, now, calibrated, self._settings
            )
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
            self._state = state.after_loss(self._settings.lost_frames)
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

    # Result

    def _finish(
        self,
        best: Candidate,
        found: Description,
        measured: Measured | None,
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
        ours = not calibrated or state.frames > 0 or best.pair.score >= settings.followed_beginning
        followed = (
            ours
            and found.rows >= settings.followed_rows
            and found.cover >= settings.followed_cover
            and found.reach_m >= settings.followed_reach_m
            and found.contrast >= settings.followed_contrast
        )
        reason = f"{STOPS[best.growth.stop]} at {found.reach_m:.0f} m"
        if not followed and found.cover < settings.followed_cover:
            reason = f"a rail is seen in only {found.cover:.0%} of the rows; {reason}"
        elif not ours:
            reason = f"a track is seen, but it hardly begins where ours can; {reason}"
        elif not followed and found.contrast < settings.followed_contrast:
            reason = "the rails do not stand out from the ground between them"
        if branches:
            reason += f"; {_assumed(branches[0])}"
        nodes = best.growth.nodes
        curvature = float(nodes[min(6, best.growth.last - 1), growing.KAPPA])
        new = replace(state, pair=best.pair, vanishing_px=vanishing, curvature=curvature, lost=0)
        if not followed:
            self._state = replace(new, lost=state.lost).after_loss(settings.lost_frames)
        else:
            self._state = new.learnt(best.pair, measured, scale, settings)
        left, right = best.pair.left.bottom_px, best.pair.right.bottom_px
        roi_uv = level.to_pixels(np.array([vanishing, (right, bottom), (left, bottom)]))
        return TrackGeometry(
            followed=followed,
            reason=reason,
            left_uv=found.left_uv,
            right_uv=found.right_uv,
            vanishing_uv=roi_uv[0],
            roi_uv=roi_uv,
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


def _assumed(branch: Branch) -> str:
    """Which path was assumed at a switch, in words."""
    other = "right" if branch.side == "left" else "left"
    return (
        f"a track parts to the {branch.side} at {branch.from_m:.0f} m, the path to the {other} of "
        "it is assumed"
    )
