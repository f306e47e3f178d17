"""Range of a finding along the track: every instrument that sees it, combined."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.findings import Finding
from railinspect.labels import HUMAN
from railinspect.ranging.at_foot import commonest_class, foot_place
from railinspect.ranging.foot import FootRow, refine_foot
from railinspect.ranging.fusion import Z95, Absent, Estimate, Range, combine
from railinspect.ranging.ground_level import BED_STD_M, ground_level, lying_level
from railinspect.ranging.ground_plane import GRADIENT_STD, VERTICAL_CURVATURE_STD
from railinspect.ranging.known_sizes import KNOWN_SIZES, WHEELED
from railinspect.ranging.stereo_view import StereoView
from railinspect.ranging.track_scale import ScaleSettings, TrackScale, fit_scale
from railinspect.ranging.wheels import wheels_row
from railinspect.track.geometry import SegmentationLike, TrackGeometry
from railinspect.track.level import Level

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_EVEN95 = 0.95 * math.sqrt(3.0)
"""97.5 % quantile of an even distribution of standard deviation 1."""

COARSE_PX = 1000
"""From this width on the shipped network's masks are coarser than the picture, pixels."""


@dataclass(frozen=True)
class RangingSettings:
    """Errors that no calibration states, and the limits of what is reliable.

    Pixel lengths are those of a 640 pixels wide image and scale with the width, because the
    shipped network sees the image at that width; for masks of the image's own resolution give
    :meth:`sharp`.

    Attributes:
        foot_std_px: Standard deviation of a foot's row: the segmentation's edge.
        foot_even: Whether that is rounding alone: any error within half a pixel is as likely.
        foot_mask_m: The same of a foot where the picture is finer than the masks and does not show
            it, metres of the thing's height: shadows and shins are taken for it.
        wheels_m: The same of a vehicle's wheels.
        foot_picture_m: What a foot that the picture shows is off besides its own uncertainty.
        foot_along_m: Standard deviation of where along the track the visible foot lies against
            the thing's near end: a stride, a slanting log, a rounded stone.
        stands_on_m: Height of what all things stand on against the rail tops, metres, where that
            is known; None judges it by what surrounds each foot.
        bed_std_m: Standard deviation of the bed's height against the rail tops, metres; 0 where
            the line's rails are known.
        extent_std_px: Standard deviation of a thing's height or width.
        scale: What the fit of the track's scale expects.
        gradient_std: Standard deviation of the gradient at the camera against the plane assumed.
        least_spacing_px: Where the rails are closer than this there is no range.
        worst_rel: Where the relative standard deviation exceeds this there is no range.
        worst_noise_rel: The same for noise alone.
    """

    foot_std_px: float = 0.8
    foot_even: bool = False
    foot_mask_m: float = 0.20
    wheels_m: float = 0.10
    foot_picture_m: float = 0.01
    foot_along_m: float = 0.065
    stands_on_m: float | None = None
    bed_std_m: float = BED_STD_M
    extent_std_px: float = 1.5
    scale: ScaleSettings = ScaleSettings()  # noqa: RUF009  # frozen
    gradient_std: float = GRADIENT_STD
    least_spacing_px: float = 3.5
    worst_rel: float = 0.45
    worst_noise_rel: float = 0.15

    @staticmethod
    def sharp(width_px: int) -> RangingSettings:
        """For masks that are true to the pixel at the image's own width."""
        pixel = 640.0 / width_px
        return RangingSettings(
            foot_std_px=pixel / math.sqrt(12.0),
            foot_even=True,
            foot_mask_m=0.0,
            wheels_m=0.0,
            foot_picture_m=0.0,
            extent_std_px=pixel,
            least_spacing_px=3.5 * pixel,
            scale=ScaleSettings(spacing_std_px=0.58 * pixel),
        )


class FrameRanging:
    """Ranges of one frame's findings; the track's scale is fitted once for all of them.

    Args:
        track: The track of the frame.
        camera: Camera whose standard deviations to use; by default the track's own, which is the
            one to use unless a better calibration of the same camera is at hand.
        segmentation: Masks of the frame: what surrounds a foot says how high it stands, and the
            class of a thing how large it is. Without them both are guessed, with wider errors.
        settings: Errors and limits.
        stereo: The stereo pair whose left picture is the frame: one more instrument, and the only
            one where the rails give no scale.
        rgb: The picture, uint8 (H, W, 3): where the masks are coarser than it, feet are looked up
            in it. Needs the masks.
    """

    def __init__(
        self,
        track: TrackGeometry,
        camera: Camera | None = None,
        segmentation: SegmentationLike | None = None,
        settings: RangingSettings | None = None,
        stereo: StereoView | None = None,
        rgb: Image | None = None,
    ) -> None:
        self._track = track
        self._rgb = rgb
        self._stereo = stereo
        given = camera if camera is not None else track.camera
        same = given.size_wh == track.camera.size_wh
        self._given = given if same else given.resized(track.camera.size_wh)
        self._labels = None if segmentation is None else segmentation.labels
        self._settings = settings or RangingSettings()

    @cached_property
    def scale(self) -> TrackScale | None:
        """The fitted row-to-range scale; None where too little of the track is seen."""
        return fit_scale(self._track, self._settings.scale)

    def measure(self, finding: Finding) -> Range | Absent:
        """Range of a finding along the track, or the reason why there is none.

        The track's scale and the ground plane both turn the foot's row into a distance; what is
        known of the thing's size and a stereo pair are further opinions. What they share (focal
        length, foot row, height of the ground under the foot) stays correlated.

        Returns:
            The range; where the foot lies below the image's bottom, its upper limit with an
            interval that begins at 0; or the reason why there is none.
        """
        on_ground = self._on_ground(finding)
        pair = self._by_stereo(finding)
        estimates, tails = ([], {}) if isinstance(on_ground, Absent) else on_ground
        if pair is not None:
            estimates = [*estimates, pair]
        elif isinstance(on_ground, Absent):
            return on_ground
        fused = combine(estimates, tails)
        if finding.foot_uv[1] >= self._track.camera.size_wh[1] - 1 and pair is None:
            return _at_most(fused)
        if fused.std_m > self._settings.worst_rel * fused.range_m:
            return Absent(
                f"its error of {fused.std_m / fused.range_m:.0%} is beyond what is useful"
            )
        if fused.noise_m > self._settings.worst_noise_rel * fused.range_m:
            return Absent(
                f"its noise of {fused.noise_m / fused.range_m:.0%} is beyond the reliable range"
            )
        return fused

    def _on_ground(
        self, finding: Finding
    ) -> tuple[list[Estimate], dict[str, tuple[float, float]]] | Absent:
        """What the foot's place on the track says, and the thing's size beside it.

        With it the reach of those errors that are not normal, as :func:`.combine` takes it.
        """
        track, settings = self._track, self._settings
        path = track.path
        if path is None:
            return Absent("no track was found, so there is no scale")
        px = track.camera.size_wh[0] / 640.0
        foot_uv = float(finding.foot_uv[0]), float(finding.foot_uv[1])
        plane_m, spacing_px, metre = foot_place(track, *foot_uv)
        if not (math.isfinite(plane_m) and plane_m > 0):
            return Absent("the foot lies at or above the horizon")
        if plane_m > float(path.chainage_m[-1]):
            return Absent("the foot lies beyond the track that is seen")
        if spacing_px < settings.least_spacing_px * px:
            return Absent(
                f"the rails at the foot are {spacing_px:.1f} px apart, too close to measure"
            )
        foot_std_px = settings.foot_std_px * px
        tails = {"row": (_EVEN95, _EVEN95)} if settings.foot_even else {}
        left, top, right, bottom = finding.box_xyxy
        box = float(left), float(top), float(right), float(bottom)
        kind = -1 if self._labels is None else commonest_class(self._labels, box)
        row = foot_uv[1]
        no_foot = finding.place_rel > 0.0  # whatever the masks show at its place
        if self._labels is not None and kind in WHEELED and not no_foot:
            row = wheels_row(self._labels, kind, foot_uv, metre)
        if self._rgb is not None and self._rgb.shape[1] >= COARSE_PX and not no_foot:
            seen = self._row_in_picture(finding, kind, metre)
            if seen is None:
                mask_m = settings.wheels_m if kind in WHEELED else settings.foot_mask_m
                foot_std_px = math.hypot(foot_std_px, mask_m * metre)
            else:
                own = settings.foot_picture_m * metre
                foot_std_px = math.hypot(seen.std_px, own)
                tails = {
                    "row": (
                        math.hypot(seen.below_px, Z95 * own) / foot_std_px,
                        math.hypot(seen.above_px, Z95 * own) / foot_std_px,
                    )
                }
                row = seen.row
        if row != foot_uv[1]:  # no second search of the track: the plane's rows are known
            horizon = self._track.camera.horizon_v(foot_uv[0])
            plane_m *= (foot_uv[1] - horizon) / max(1.0, row - horizon)
            foot_uv = foot_uv[0], row
        # On the rails a thing's foot is at their height; elsewhere on what surrounds it.
        level, level_std = (0.0, 0.0)
        if finding.type != "distortion":
            level, level_std = self._level(foot_uv, box, kind, metre)
        plane = self._by_plane(plane_m, level, level_std, foot_std_px)
        gauge = self._by_gauge(foot_uv, level, level_std, foot_std_px)
        # A size is an opinion beside the rails', never in place of it: what is half hidden looks
        # smaller and so farther than it is.
        size = None
        if gauge is not None and not no_foot:
            size = self._by_size(finding, kind, foot_uv[1], foot_std_px)
        estimates = [e for e in (gauge, plane, size) if e is not None]
        if no_foot:
            place = {"place": finding.place_rel}
            estimates = [replace(e, errors={**e.errors, **place}) for e in estimates]
        return estimates, tails

    def _row_in_picture(self, finding: Finding, kind: int, metre_px: float) -> FootRow | None:
        """Row of the foot as the picture shows it; None where it does not."""
        if self._rgb is None or self._labels is None or finding.type == "distortion":
            return None
        if kind in WHEELED:
            return None  # between the wheels the body ends above the ground
        horizon = self._track.camera.horizon_v(float(finding.foot_uv[0]))
        return refine_foot(self._rgb, self._labels, finding, metre_px, horizon)

    def _by_stereo(self, finding: Finding) -> Estimate | None:
        """The pair's range of the thing, brought from the viewing axis onto the track."""
        if self._stereo is None or finding.type == "distortion":
            return None
        found = self._stereo.range_of(finding)
        if isinstance(found, Absent):
            return None
        camera = self._track.camera
        row = float(Level.of(camera).from_pixels(finding.foot_uv[None, :])[0, 1])
        pitch = camera.pitch_rad
        ahead = math.cos(pitch) - row / camera.focal_px * math.sin(pitch)
        x = found.range_m * ahead
        along = x if self.scale is None else self.scale.chainage_at(x)
        return replace(found, range_m=along).estimate() if along > 0 else None

    def _by_gauge(
        self,
        foot_uv: tuple[float, float],
        level_m: float,
        level_std_m: float,
        foot_std_px: float,
    ) -> Estimate | None:
        """The rails' spacing, over the whole track, at the foot's row."""
        foot = None if self.scale is None else self.scale.at(foot_uv, level_m)
        if foot is None:
            return None
        given, settings = self._given, self._settings
        return Estimate(
            "gauge",
            foot.range_m,
            {
                "row": foot_std_px * foot.row_rel_per_px,
                "along": settings.foot_along_m / foot.range_m,
                "spacing": foot.fit_rel,
            },
            {
                "focal": given.std.focal_px / given.focal_px,
                "gauge": given.std.gauge_m / given.rail_spacing_m,
                "level": level_std_m * foot.slope_per_m,
            },
        )

    def _by_plane(
        self, plane_m: float, level_m: float, level_std_m: float, foot_std_px: float
    ) -> Estimate:
        """The camera's height over the plane of the rails, at the frame's horizon."""
        track, given, settings = self._track, self._given, self._settings
        height = track.camera.height_m
        below = track.camera.focal_px * height / plane_m
        # A calibrated height is its own error; a height measured from the gauge is the gauge's.
        if track.calibrated:
            height_error = {"height": given.std.height_m / given.height_m}
        else:
            height_error = {"gauge": given.std.gauge_m / given.rail_spacing_m}
        slope = math.hypot(settings.gradient_std, 0.5 * VERTICAL_CURVATURE_STD * plane_m)
        return Estimate(
            "ground plane",
            plane_m * (height - level_m) / height,
            {
                "row": foot_std_px / below,
                "along": settings.foot_along_m / plane_m,
                "horizon": track.horizon_std_px / below,
                "plane": slope * plane_m / height,
            },
            {
                "focal": given.std.focal_px / given.focal_px,
                "level": level_std_m / height,
                **height_error,
            },
        )

    def _by_size(
        self, finding: Finding, kind: int, foot_v: float, foot_std_px: float
    ) -> Estimate | None:
        """What is known of the thing's size; a height ends at the foot, wherever that was found."""
        if finding.type == "trespasser":
            kind = HUMAN
        known = KNOWN_SIZES.get(kind) if finding.type != "distortion" else None
        if known is None:
            return None
        left, top, right, bottom = finding.box_xyxy
        width, height = self._given.size_wh
        if left <= 1 or top <= 1 or right >= width - 2 or bottom >= height - 2:
            return None  # cut off by the image's edge
        extent = foot_v + 0.5 - top if known.upright else right - left + 1.0
        px = width / 640.0
        if extent < 6.0 * px:
            return None
        errors = {"extent": self._settings.extent_std_px * px / extent}
        if known.upright:
            errors["row"] = foot_std_px / extent
        return Estimate(
            known.name,
            known.size_m * self._given.focal_px / extent,
            errors,
            {
                "size": known.std_m / known.size_m,
                "focal": self._given.std.focal_px / self._given.focal_px,
            },
            opinion=True,
        )

    def _level(
        self,
        foot_uv: tuple[float, float],
        box_xyxy: tuple[float, float, float, float],
        kind: int,
        metre_px: float,
    ) -> tuple[float, float]:
        """Height of what the thing stands on against the rail tops, and its deviation, metres."""
        if self._settings.stands_on_m is not None:
            return self._settings.stands_on_m, 0.0
        level = ground_level(self._labels, foot_uv, metre_px, self._settings.bed_std_m)
        wide = box_xyxy[2] - box_xyxy[0] + 1.0
        if self._labels is None or kind in WHEELED:
            return level
        if wide <= self._given.rail_spacing_m * metre_px:
            return level
        return lying_level(self._labels, kind, box_xyxy, level)


def _at_most(fused: Range) -> Range:
    """The foot lies below the image: all that is known is an upper limit."""
    return Range(
        fused.range_m,
        fused.range_m / 2,
        (0.0, fused.interval_m[1]),
        f"below the image, {fused.method}",
        fused.noise_m,
        fused.range_m / 2,
        fused.readings,
    )


def range_of(
    finding: Finding,
    track: TrackGeometry,
    camera: Camera | None = None,
    settings: RangingSettings | None = None,
) -> Range | None:
    """Range of a single finding; see :class:`FrameRanging`, which serves all of a frame.

    Returns:
        The range, or None beyond the reliable range.
    """
    found = FrameRanging(track, camera, settings=settings).measure(finding)
    return found if isinstance(found, Range) else None
