"""Range from a rectified stereo pair: semi-global matching, then D = l·f/p (001, 3)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.ranging.fusion import Absent, Estimate
from railinspect.ranging.stereo_camera import StereoCamera

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class StereoSettings:
    """How pairs are matched.

    Attributes:
        most_px: Largest disparity looked for, pixels; rounded up to a multiple of 16.
        block_px: Side of the matched blocks, pixels, odd.
        consistent_px: Left–right difference up to which a disparity counts.
        std_px: Standard deviation of a single disparity, pixels.
        correlated_px: Disparities this close say the same: so many pixels' square counts once.
        floor_px: What stays of a region's error however many pixels it has: sub-pixel matching
            prefers whole pixels.
        depth_m: Standard deviation of where within a thing's depth its visible surface lies.
        least_share: Least share of a region that must have a disparity.
    """

    most_px: int = 192
    block_px: int = 3
    consistent_px: float = 1.0
    std_px: float = 0.35
    correlated_px: float = 7.0
    floor_px: float = 0.08
    depth_m: float = 0.12
    least_share: float = 0.08


@dataclass(frozen=True)
class Disparity:
    """Disparities of a pair, in the left image.

    Attributes:
        disparity_px: float32 (H, W); NaN where there is none.
        confidence: 0 … 1 by how well left and right agree, float32 (H, W).
    """

    disparity_px: npt.NDArray[np.float32]
    confidence: npt.NDArray[np.float32]


def match(left: Image, right: Image, settings: StereoSettings | None = None) -> Disparity:
    """Match a rectified pair.

    Args:
        left: Left picture, RGB (H, W, 3) or grey (H, W), uint8.
        right: Right picture of the same size.
        settings: How.

    Raises:
        BadInputError: if the pictures differ in size or kind, or their sides are swapped.
    """
    settings = settings or StereoSettings()
    check_sides(left, right, settings)
    return match_rows(left, right, settings)


def match_rows(left: Image, right: Image, settings: StereoSettings) -> Disparity:
    """The same for a band of rows of a pair whose sides are known to be right."""
    return _matched(*_pair(left, right), settings)


def check_sides(left: Image, right: Image, settings: StereoSettings | None = None) -> None:
    """Refuse a pair that is none.

    Raises:
        BadInputError: if the pictures differ in size or kind, or their sides are swapped.
    """
    if _swapped(*_pair(left, right), settings or StereoSettings()):
        raise BadInputError(
            "the pair's sides are swapped: it matches only with right and left exchanged"
        )


def _pair(left: Image, right: Image) -> tuple[Image, Image]:
    first, second = _grey(left), _grey(right)
    if first.shape != second.shape:
        raise BadInputError(
            f"a stereo pair must have one size; left is {first.shape[1]}x{first.shape[0]}, right "
            f"{second.shape[1]}x{second.shape[0]}"
        )
    return first, second


@dataclass(frozen=True)
class RegionRange:
    """Range of a region of the left picture.

    Attributes:
        range_m: Along the viewing axis, metres.
        disparity_px: Its disparity.
        noise_m: Standard deviation from the matching, metres.
        bias_m: Standard deviation from the calibration, metres.
        share: Share of the region that has a disparity.
    """

    range_m: float
    disparity_px: float
    noise_m: float
    bias_m: float
    share: float

    @property
    def std_m(self) -> float:
        """Noise and bias together, metres."""
        return float(np.hypot(self.noise_m, self.bias_m))

    def estimate(self) -> Estimate:
        """The same for :func:`railinspect.ranging.combine`."""
        return Estimate(
            "stereo",
            self.range_m,
            {"disparity": self.noise_m / self.range_m},
            {"stereo": self.bias_m / self.range_m},
        )


def region_range(
    disparity: Disparity,
    region: npt.NDArray[np.bool_],
    camera: StereoCamera,
    settings: StereoSettings | None = None,
) -> RegionRange | Absent:
    """Range of a region by the densest half of its disparities.

    A region's outline is never exact: what of it shows the background must not pull the range
    away, as it would a mean. The densest half ignores up to half of it.

    Args:
        disparity: Of the pair.
        region: Pixels of the thing, bool (H, W).
        camera: The pair's calibration.
        settings: Errors.
    """
    settings = settings or StereoSettings()
    if region.shape != disparity.disparity_px.shape:
        raise BadInputError(
            f"the region has shape {region.shape}, the disparities {disparity.disparity_px.shape}"
        )
    inside = int(np.count_nonzero(region))
    values = disparity.disparity_px[region]
    values = np.sort(values[np.isfinite(values)])
    if inside == 0 or len(values) < max(4, settings.least_share * inside):
        return Absent("too little of the region could be matched between left and right")
    dense = _densest_half(values)
    middle = float(np.mean(dense))
    if middle + camera.offset_px <= 0:
        return Absent("its disparity is not positive: it is farther than the pair can tell")
    independent = max(1.0, len(dense) / settings.correlated_px**2)
    scatter = max(float(dense.std()) * 2.0, settings.std_px)
    deviation = float(np.hypot(scatter / np.sqrt(independent), settings.floor_px))
    noise = float(np.hypot(camera.noise_m(middle, deviation), settings.depth_m))
    return RegionRange(
        float(camera.range_m(middle)),
        middle,
        noise,
        float(camera.bias_m(middle)),
        len(values) / inside,
    )


def _densest_half(values: npt.NDArray[np.float32]) -> Array:
    """The half of sorted values that lies in the shortest interval."""
    half = (len(values) + 1) // 2
    widths = values[half - 1 :] - values[: len(values) - half + 1]
    first = int(np.argmin(widths))
    return values[first : first + half].astype(np.float64)


def _grey(image: Image) -> Image:
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.size == 0:
        raise BadInputError(
            f"a stereo picture must be uint8 of shape (H, W) or (H, W, 3), not {image.dtype} of "
            f"shape {image.shape}"
        )
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def _matched(left: Image, right: Image, settings: StereoSettings) -> Disparity:
    """Both directions, the left one checked against the right one."""
    found = _search(left, right, settings)
    mirrored = _search(right[:, ::-1].copy(), left[:, ::-1].copy(), settings)[:, ::-1]
    height, width = left.shape
    columns = np.arange(width, dtype=np.float32)[None, :] - found
    rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    # Nearest, not linear: across an edge the mean of two disparities belongs to neither.
    back = cv2.remap(
        np.ascontiguousarray(mirrored),
        columns,
        rows,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=-1.0,
    )
    apart = np.abs(found - back)
    good = (found > 0) & (back > 0) & (apart <= settings.consistent_px)
    disparity = np.where(good, found, np.float32(np.nan)).astype(np.float32)
    confidence = np.where(good, 1.0 - apart / (2.0 * settings.consistent_px), 0.0)
    return Disparity(disparity, confidence.astype(np.float32))


def _search(left: Image, right: Image, settings: StereoSettings) -> npt.NDArray[np.float32]:
    """Semi-global matching; −1 where nothing is found."""
    most = min(settings.most_px, max(16, left.shape[1] - settings.block_px))
    count = -(-most // 16) * 16
    area = settings.block_px**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=count,
        blockSize=settings.block_px,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=-1,
        preFilterCap=31,
        uniquenessRatio=5,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    # Without room to the left the first columns would have nothing to be matched with.
    padded = [cv2.copyMakeBorder(i, 0, 0, count, 0, cv2.BORDER_REPLICATE) for i in (left, right)]
    raw = matcher.compute(*padded)[:, count:]
    return np.where(raw > 0, raw.astype(np.float32) / 16.0, np.float32(-1.0))


def _swapped(left: Image, right: Image, settings: StereoSettings) -> bool:
    """Whether the pair matches far better the other way round; judged on small pictures."""
    scale = min(1.0, 320.0 / left.shape[1])
    small = [
        np.asarray(cv2.resize(i, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        for i in (left, right)
    ]
    reach = StereoSettings(most_px=max(16, int(settings.most_px * scale)), block_px=5)
    as_given = np.isfinite(_matched(small[0], small[1], reach).disparity_px).mean()
    exchanged = np.isfinite(_matched(small[1], small[0], reach).disparity_px).mean()
    return bool(exchanged > 0.15 and exchanged > 2.0 * as_given)
