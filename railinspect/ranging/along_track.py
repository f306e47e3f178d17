"""Range of a finding along the track, from the gauge at its foot and from the ground plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from railinspect.camera import Camera
from railinspect.findings import Finding, place_on_track
from railinspect.ranging.fusion import Estimate, Range, combine
from railinspect.ranging.ground_plane import GRADIENT_STD
from railinspect.track.geometry import TrackGeometry


@dataclass(frozen=True)
class RangingSettings:
    """Errors that no calibration states, and the limits of what is reliable.

    Pixel lengths are those of a 640 pixels wide image and scale with the width.

    Attributes:
        foot_std_px: Standard deviation of a foot's row: the segmentation's edge.
        spacing_std_px: Standard deviation of the rails' spacing, smoothed along the track.
        foot_m: Height of the ground a thing stands on above the rail tops, metres: between the
            sleeper's top or the ballast (−0.2) and a crossing's surface (0).
        foot_std_m: Its standard deviation.
        gradient_std: Standard deviation of the mean gradient between camera and foot.
        least_spacing_px: Where the rails are closer than this there is no range.
        worst_rel: Where the relative standard deviation exceeds this there is no range.
        worst_noise_rel: The same for the part that comes from the foot's row alone.
    """

    foot_std_px: float = 0.8
    spacing_std_px: float = 0.35
    foot_m: float = -0.15
    foot_std_m: float = 0.06
    gradient_std: float = GRADIENT_STD
    least_spacing_px: float = 3.5
    worst_rel: float = 0.45
    worst_noise_rel: float = 0.15


def range_of(
    finding: Finding,
    track: TrackGeometry,
    camera: Camera | None = None,
    settings: RangingSettings | None = None,
) -> Range | None:
    """Range of a finding along the track.

    Two instruments see the same foot row. The ground plane turns it into a distance with the
    camera's height and horizon. The gauge corrects that distance by how far apart the rails look
    there: D = f·spacing/w needs neither height nor horizon and so follows gradients. What they
    share (focal length, foot row, height of the ground under the foot) stays correlated.

    Args:
        finding: What to range.
        track: The track it was found on.
        camera: Camera whose standard deviations to use; by default the track's own, which is the
            one to use unless a better calibration of the same camera is at hand.
        settings: Errors and limits.

    Returns:
        The range; where the foot lies below the image's bottom, its upper limit with an interval
        that begins at 0; or None beyond the reliable range: foot at or above the horizon, rails at
        the foot closer than ``least_spacing_px``, or the error above ``worst_rel`` in all or
        ``worst_noise_rel`` from the foot's row.
    """
    settings = settings or RangingSettings()
    path = track.path
    if path is None:
        return None
    seen_by = track.camera
    given = camera if camera is not None else seen_by
    if given.size_wh != seen_by.size_wh:
        given = given.resized(seen_by.size_wh)
    scale = seen_by.size_wh[0] / 640.0
    chainage, _, _ = place_on_track(track, finding.foot_uv[None, :])
    plane_m = float(chainage[0])
    if not math.isfinite(plane_m) or plane_m <= 0 or plane_m > float(path.chainage_m[-1]):
        return None
    half = float(np.interp(plane_m, path.chainage_m, path.half_m))
    metre = float(np.interp(plane_m, path.chainage_m, path.metre_px))
    across = float(np.interp(plane_m, path.chainage_m, path.across_px))
    spacing_px = 2.0 * half * metre
    if 2.0 * half * across < settings.least_spacing_px * scale:
        return None
    height = seen_by.height_m
    below = seen_by.focal_px * height / plane_m
    # On the rails a thing's foot is at their height; elsewhere on the bed below them.
    on_rails = finding.type == "distortion"
    foot_m = 0.0 if on_rails else settings.foot_m
    lower = (height - foot_m) / height
    foot_rel = 0.0 if on_rails else settings.foot_std_m / height
    row_rel = settings.foot_std_px * scale / below
    focal_rel = given.std.focal_px / given.focal_px
    gauge_rel = given.std.gauge_m / given.rail_spacing_m
    shared = {"focal": focal_rel, "row": row_rel, "foot": foot_rel}
    # A calibrated height is its own error; a height measured from the gauge is the gauge's.
    height_rel = given.std.height_m / given.height_m
    height_error = {"height": height_rel} if track.calibrated else {"gauge": gauge_rel}
    plane = Estimate(
        "ground plane",
        plane_m * lower,
        {
            **shared,
            **height_error,
            "horizon": track.horizon_std_px / below,
            "plane": settings.gradient_std * plane_m / height,
        },
    )
    gauge = Estimate(
        "gauge",
        plane_m * lower * given.rail_spacing_m / (2.0 * half),
        {
            # The row counts here too: a foot a row lower is measured against wider rails.
            **shared,
            "gauge": gauge_rel,
            "spacing": settings.spacing_std_px * scale / spacing_px,
        },
    )
    fused = combine([gauge, plane])
    if finding.foot_uv[1] >= seen_by.size_wh[1] - 1:
        # The foot lies below the image: all that is known is an upper limit.
        upper = fused.interval_m[1]
        return Range(
            fused.range_m, fused.range_m / 2, (0.0, upper), f"below the image, {fused.method}"
        )
    if fused.std_m > settings.worst_rel * fused.range_m or row_rel > settings.worst_noise_rel:
        return None
    return fused
