"""Speed from one frame: what a rolling shutter does to moving beacons and stripes.

A CMOS sensor reads its rows one after the other, t_c apart. Beacons that approach while the rows
are read appear with a wider lower base than upper base; a vertical stripe that moves sideways
appears slanted. Both are measured in the picture and turned into metres per second.

    closing   D = l/tan φ for each base, Δt = t_c·h, v = (D₁ − D₂)/Δt          [001, (5), (11), (1)]
    lateral   v = D·tan(s·β)/(h·t_c)                                               [001, (14)]

The paper takes the angle as linear in the pixel (s·β). A pinhole lens is not: over 43° the same
speed gives 988 px instead of 796 px. The lens is therefore always stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.ranging.goniometric import angle_error
from railinspect.ranging.speed import Speed, finite_difference

Array = npt.NDArray[np.float64]

LensModel = Literal["angle-linear", "pinhole"]


@dataclass(frozen=True)
class ShutterSensor:
    """A camera that reads its rows one after the other.

    Attributes:
        size_wh: Width and height, pixels.
        pixel_rad: Field of view β of one pixel (on the axis), radians.
        row_s: Time t_c between rows, s.
        lens: How an angle becomes pixels.
        step_rad: Least angle Δω that is told apart, radians; half a pixel in the paper.
    """

    size_wh: tuple[int, int] = (1024, 1024)
    pixel_rad: float = 0.94e-3
    row_s: float = 1e-4
    lens: LensModel = "angle-linear"
    step_rad: float = 0.47e-3

    def __post_init__(self) -> None:
        for name in ("pixel_rad", "row_s", "step_rad"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadInputError(f"sensor {name} is {value}; give a positive number")
        if self.lens not in ("angle-linear", "pinhole"):
            raise BadInputError(f"sensor lens is {self.lens!r}; give 'angle-linear' or 'pinhole'")

    @property
    def centre_uv(self) -> tuple[float, float]:
        """Pixel of the axis."""
        return (self.size_wh[0] - 1) / 2, (self.size_wh[1] - 1) / 2

    def pixels(self, slope: npt.ArrayLike) -> Array:
        """Pixels from the axis of something whose lateral distance is ``slope`` times its range."""
        slopes = np.asarray(slope, float)
        angle = np.arctan(slopes) if self.lens == "angle-linear" else slopes
        return np.asarray(angle / self.pixel_rad, np.float64)

    def slope(self, pixels: npt.ArrayLike) -> Array:
        """Undo :meth:`pixels`."""
        scaled = np.asarray(pixels, float) * self.pixel_rad
        return np.asarray(np.tan(scaled) if self.lens == "angle-linear" else scaled, np.float64)


def blur_range_error(range_m: float, base_m: float, step_rad: float) -> float:
    """σ_D of a base of known length, (8), metres.

    Example:
        >>> round(blur_range_error(20.0, 2.5, 0.47e-3), 3)
        0.076
    """
    return angle_error(range_m, base_m, 0.0, step_rad).from_angle_m


def lateral_speed(range_m: float, shift_px: float, rows: float, sensor: ShutterSensor) -> float:
    """V = D·tan(s·β)/(h·t_c), (14), m/s; with a pinhole lens tan(s·β) becomes s·β.

    Args:
        range_m: Distance D of the stripe, metres, > 0.
        shift_px: Shift s of the stripe between its first and last row, pixels.
        rows: Rows h between them, > 0.
        sensor: The sensor.

    Example:
        >>> round(lateral_speed(1.0, 796, 836, ShutterSensor()), 2)
        11.1
    """
    if not (rows > 0 and range_m > 0):
        raise BadInputError(f"rows {rows} and range {range_m} m must be positive")
    return range_m * float(sensor.slope(shift_px)) / (rows * sensor.row_s)


def lateral_error(
    range_m: float,
    shift_px: float,
    rows: float,
    sensor: ShutterSensor,
    range_error_m: float = 0.0,
    roll_rad: float = 0.0,
) -> float:
    """Error of the lateral speed, (16), m/s; without range error and roll that is (15).

    Args:
        range_m: Distance D at which stripes are meant to hang, metres.
        shift_px: Shift s, pixels.
        rows: Rows h.
        sensor: The sensor.
        range_error_m: Spread ΔD of their distance, metres.
        roll_rad: Roll α of the car, radians.

    Example:
        >>> sensor = ShutterSensor()
        >>> round(lateral_error(1.0, 796, 836, sensor), 4)
        0.0105
        >>> round(lateral_error(1.0, 796, 836, sensor, 0.01, math.radians(1)), 3)
        0.123
    """
    step_px = sensor.step_rad / sensor.pixel_rad
    seen = float(sensor.slope(shift_px + step_px))
    true = float(sensor.slope(shift_px))
    cosine = math.cos(roll_rad)
    return ((range_m + range_error_m) * seen - range_m * cosine * true) / (
        cosine * rows * sensor.row_s
    )


@dataclass(frozen=True)
class Beacons:
    """Four beacons as a rectangle at right angles to the way they come.

    Attributes:
        base_m: Width l_M of the upper and of the lower base, metres.
        rise_m: Height between the bases, metres.
        radius_m: Radius of a beacon, metres.
    """

    base_m: float = 2.5
    rise_m: float = 1.5
    radius_m: float = 0.06


def closing_speed(
    corners_uv: Array, beacons: Beacons, sensor: ShutterSensor, step_px: float = 0.05
) -> Speed:
    """Closing speed from the four beacons of one frame.

    Args:
        corners_uv: Upper left, upper right, lower left, lower right beacon, pixels, shape (4, 2).
        beacons: Their arrangement.
        sensor: The sensor.
        step_px: Standard deviation of a beacon's place, pixels.

    Returns:
        The speed, positive when they come nearer.

    Raises:
        BadInputError: if a base has no width or both lie in the same rows.
    """
    if corners_uv.shape != (4, 2):
        raise BadInputError(f"four beacons are needed, not an array of shape {corners_uv.shape}")
    centre_u, _ = sensor.centre_uv
    slopes = sensor.slope(corners_uv[:, 0] - centre_u)
    widths = slopes[[1, 3]] - slopes[[0, 2]]
    if not (widths > 0).all():
        raise BadInputError("a base between two beacons has no width; are left and right swapped?")
    upper, lower = corners_uv[:2, 1].mean(), corners_uv[2:, 1].mean()
    if lower - upper < 2:
        raise BadInputError(
            "both bases lie in the same rows; the shutter shows no time between them"
        )
    ranges = beacons.base_m / widths
    errors = ranges / widths * step_px * math.sqrt(2) * sensor.pixel_rad
    return finite_difference(
        float(ranges[0]),
        float(ranges[1]),
        float(lower - upper) * sensor.row_s,
        float(errors[0]),
        float(errors[1]),
    )
