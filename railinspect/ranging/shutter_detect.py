"""Beacons and stripes found in a rolling-shutter picture, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.ranging.robust_line import robust_line
from railinspect.ranging.rolling_shutter import ShutterSensor
from railinspect.ranging.speed import Speed

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Stripe:
    """An upright stripe as the shutter slants it.

    Attributes:
        rows: Rows it is seen in, shape (N,).
        centres_px: Its centre in each, pixels from the axis, shape (N,).
        scatter_px: Scatter of the centres about a steady motion, pixels on the axis.
    """

    rows: Array
    centres_px: Array
    scatter_px: float

    @property
    def shift_px(self) -> float:
        """Shift s between first and last row, pixels, from a parabola through all of them."""
        ends = np.polyval(np.polyfit(self.rows, self.centres_px, 2), self.rows[[0, -1]])
        return float(ends[1] - ends[0])

    def speed(self, range_m: float, sensor: ShutterSensor) -> Speed:
        """Lateral speed of the stripe, positive to the right.

        (14) assumes the stripe to start on the axis. Here every row's centre becomes a place
        D·slope, and the speed is the line through the places over time, wherever it starts.

        Args:
            range_m: Distance D of the stripe, metres.
            sensor: The sensor.
        """
        place = range_m * sensor.slope(self.centres_px)
        time = self.rows * sensor.row_s
        (speed, at), spread = np.polyfit(time, place, 1), np.ptp(time)
        residual = place - speed * time - at
        deviation = float(residual.std()) * np.sqrt(12.0 / len(time)) / spread
        return Speed(float(speed), float(deviation))


def find_stripe(image: Image, sensor: ShutterSensor, least_rows: int = 20) -> Stripe:
    """The brightest slanting stripe of a picture.

    Args:
        image: Grey picture, shape (H, W), of the sensor's size.
        sensor: The sensor.
        least_rows: Fewest rows it must be seen in.

    Raises:
        BadInputError: if the picture has another size or shows no stripe.
    """
    grey = _contrast(image, sensor)
    high = float(np.percentile(grey.max(axis=1), 95))
    if high < 12.0:
        raise BadInputError("no stripe stands out from the picture")
    bright = np.where(grey > 0.35 * high, grey, 0.0)
    total = bright.sum(axis=1)
    rows = np.flatnonzero(total > 0.3 * np.median(total[total > 0]))
    if len(rows) < least_rows:
        raise BadInputError(f"the stripe is seen in {len(rows)} rows; it takes {least_rows}")
    columns = np.arange(image.shape[1]) - sensor.centre_uv[0]
    centres = (bright[rows] @ columns) / total[rows]
    # Places move in a straight line, pixels with this lens not always. First a line without the
    # rows that saw something else, then the rows near it.
    places = sensor.slope(centres)
    slope, at = robust_line(rows.astype(float), places, 6)
    off = (places - slope * rows - at) / sensor.pixel_rad
    scatter = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    near = np.abs(off - np.median(off)) <= max(6.0 * scatter, 1.5)
    return Stripe(rows[near].astype(float), centres[near], scatter)


def find_beacons(image: Image, sensor: ShutterSensor) -> Array:
    """The four beacons of a picture.

    Args:
        image: Grey picture, shape (H, W), of the sensor's size.
        sensor: The sensor.

    Returns:
        Upper left, upper right, lower left, lower right, pixels, shape (4, 2).

    Raises:
        BadInputError: if the picture has another size or shows no such four.
    """
    grey = _contrast(image, sensor)
    high = float(grey.max())
    mask = (grey > 0.25 * high).astype(np.uint8)
    count, marks, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    sizes = stats[1:, cv2.CC_STAT_AREA]
    if high < 12.0 or count < 5:
        raise BadInputError(f"four beacons are needed, {max(count - 1, 0)} bright spots are seen")
    largest = 1 + np.argsort(-sizes)[:4]
    if stats[largest, cv2.CC_STAT_AREA].min() < 0.3 * stats[largest, cv2.CC_STAT_AREA].max():
        raise BadInputError("four beacons of one size are needed; the bright spots differ too much")
    corners = []
    for mark in largest:
        left, top, wide, tall = stats[mark, :4]
        part = np.s_[max(0, top - 2) : top + tall + 2, max(0, left - 2) : left + wide + 2]
        weight = np.where((marks[part] == mark) | (marks[part] == 0), grey[part], 0.0)
        v, u = np.mgrid[part]
        corners.append([(weight * u).sum() / weight.sum(), (weight * v).sum() / weight.sum()])
    by_row = np.array(sorted(corners, key=lambda corner: corner[1]))
    upper, lower = (pair[np.argsort(pair[:, 0])] for pair in (by_row[:2], by_row[2:]))
    return np.concatenate([upper, lower])


def _contrast(image: Image, sensor: ShutterSensor) -> Array:
    """The picture less its background."""
    if image.ndim != 2 or image.shape != sensor.size_wh[::-1]:
        raise BadInputError(
            f"the picture has shape {image.shape}; the sensor delivers grey pictures of shape "
            f"{sensor.size_wh[::-1]}"
        )
    grey = image.astype(float)
    low, noise = float(np.median(grey)), 1.4826 * float(np.median(np.abs(grey - np.median(grey))))
    return np.maximum(grey - low - 3.0 * noise, 0.0)
