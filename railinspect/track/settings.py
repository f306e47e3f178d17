"""Every number the track follower is tuned by, with its unit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class FollowerSettings:
    """Settings of :class:`railinspect.track.TrackFollower`.

    Pixel lengths are those of a 640 pixels wide image and scale with the width.

    Attributes:
        default_fov_rad: Horizontal field of view assumed for a camera nobody calibrated.
        default_focal_spread: One standard deviation of that camera's focal length, relative;
            0.25 puts fields of view of 35° to 80° at two standard deviations.
        default_gauge_std_m: Standard deviation of the gauge of an uncalibrated camera's track.
        low: Rail probability below which a pixel is no rail.
        seen: Mean rail probability along a window from which a rail counts as seen there.
        band: Beginning points and vanishing point come from this lowest share of the rows
            between the horizon and the bottom.
        begin_px: Δ_b of the paper: how far a beginning point may move from frame to frame.
        lost_frames: After so many frames without a followed track it is searched anew.
        swing_px: Standard deviation of the horizon's swing about its mean (pitching vehicle).
        home_walk_px: Random walk of that mean per frame.
        growth_walk: Random walk of ln k per frame: heights and gauges hardly change.
        memory_frames: Frames the mean offset of the centre line is taken over.
        psi: ψ of (42), 1/px².
        shrink: Each growing window ends at this share of its own distance from the horizon, pixels.
        step_px: Lateral sampling step of the growing windows.
        search_px: Least half-width of the lateral search.
        curvature_walk: Random walk of the curvature along the track, 1/m per √m.
        bend_walk: The same where the rails were lost: a buckled track's curvature changes so fast,
        bend_shrink: and each window is then this short, so that it holds a small part of a bend;
        bend_gain: it is taken if it comes farther and sees so much more of the rails, mean
            probability.
        gap_m: Longest stretch without any rail the growing crosses.
        gap_share: Longest such stretch as a share of the range at which it begins.
        near_gap: Share of the lowest rows that may be hidden (bonnet, wiper, text).
        beginning_weight: Of several tracks that were grown the one is followed whose rails are seen
            best, as a share, plus this much of how credible its beginning is: a thing on our track
            hides its rails, and those of the track beside it are in full view.
        lone_votes: A line that says by itself, for a known camera, where the track begins is seen
            in this share of the rows near the camera;
        lone_gap_share: the other rail may then be hidden so much longer, as ``gap_share``.
        min_spacing_px: Rails closer than this, across, can no longer be told apart.
        max_reach_m: Growing ends here.
        followed_rows: A followed track spans at least this share of the rows between the
            bottom of the image and the horizon,
        followed_cover: has each rail seen in at least this share of those rows,
        followed_reach_m: reaches at least this far,
        followed_contrast: has rails whose probability exceeds that of the ground between them by
            at least this,
        followed_beginning: and the first time, for a known camera, begins where ours may with at
            least this score (:func:`railinspect.track.begin.pair_of`); below 0 the place speaks
            more against it than the rails in view for it.
        curvature_std: Standard deviation of a track's curvature, 1/m.
        curvature_rate: Standard deviation of its change per metre, over 10 m, 1/m²: the sharpest
            transitions of a 200 m curve reach it, a ripple exceeds it many times.
        unknown_focal: With an unknown focal length distances along the track may be wrong by
            this factor, curvatures by its square and their change by its cube.
        switch_m: Another track's rail closer than this beside one of ours makes a switch,
        switch_score: if its probability reaches this over three rows.
        switch_reach_m: So far before and behind a switch says a rail's place nothing about its
            shape: the blades lie too close to the rails to be told apart.
        fine_reach_m: Half-width of the search for each rail's centre around the grown path.
    """

    default_fov_rad: float = math.radians(54.4)
    default_focal_spread: float = 0.25
    default_gauge_std_m: float = 0.045
    low: float = 0.30
    seen: float = 0.25
    band: float = 0.65
    begin_px: float = 12.0
    lost_frames: int = 8
    swing_px: float = 3.0
    home_walk_px: float = 0.1
    growth_walk: float = 3e-4
    memory_frames: int = 60
    psi: float = 0.05
    shrink: float = 0.90
    step_px: float = 0.5
    search_px: float = 3.0
    curvature_walk: float = 4e-4
    bend_walk: float = 8e-3
    bend_shrink: float = 0.95
    bend_gain: float = 0.03
    gap_m: float = 60.0
    gap_share: float = 1.0
    near_gap: float = 0.35
    beginning_weight: float = 0.3
    lone_votes: float = 0.4
    lone_gap_share: float = 4.0
    min_spacing_px: float = 3.5
    max_reach_m: float = 400.0
    followed_rows: float = 0.70
    followed_cover: float = 0.60
    followed_reach_m: float = 15.0
    followed_contrast: float = 0.25
    followed_beginning: float = 0.0
    curvature_std: float = 1 / 150
    curvature_rate: float = 1.2e-4
    unknown_focal: float = 1.4
    switch_m: float = 1.0
    switch_score: float = 0.30
    switch_reach_m: float = 6.0
    fine_reach_m: float = 0.35

    def for_bends(self) -> FollowerSettings:
        """The settings with which a track that was lost is grown once more."""
        return replace(self, curvature_walk=self.bend_walk, shrink=self.bend_shrink)

    def for_lone_rails(self) -> FollowerSettings:
        """The settings with which a track grows of which one rail alone is seen near the camera."""
        return replace(self, gap_share=self.lone_gap_share)

    def stiffness(self, calibrated: bool) -> tuple[float, float]:
        """Standard deviations of the smooth track's curvature (1/m) and its change (1/m²)."""
        factor = 1.0 if calibrated else self.unknown_focal
        return self.curvature_std * factor**2, self.curvature_rate * factor**3
