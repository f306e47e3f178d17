"""Frames of a rolling-shutter sensor, rendered row by row with the truth known.

Each row is exposed at its own time: beacons have come nearer and stripes have moved on by then.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from railinspect.ranging.rolling_shutter import Beacons, ShutterSensor

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_DARK, _BRIGHT = 24.0, 225.0


def render_stripe(
    sensor: ShutterSensor,
    speed_mps: float,
    range_m: float,
    rng: np.random.Generator,
    *,
    start_m: float = 0.0,
    width_m: float = 0.03,
    length_m: float = 1.0,
    roll_rad: float = 0.0,
    exposure_s: float = 1e-4,
    noise: float = 2.0,
) -> Image:
    """A bright upright stripe beside the track as a sensor looking sideways reads it.

    Args:
        sensor: The sensor.
        speed_mps: Speed of the stripe against the sensor, m/s, positive to the right.
        range_m: Distance of the wall the stripe is on, metres.
        rng: Source of the sensor's noise.
        start_m: Where the stripe is against the axis when the first row of it is read, metres.
        width_m: Width of the stripe, metres.
        length_m: Height of the stripe about the axis, metres.
        roll_rad: Roll of the car: it turns the axis of a sensor looking sideways up or down.
        exposure_s: Exposure time of a row, s.
        noise: Standard deviation of the sensor's noise, grey levels.

    Returns:
        Grey picture, shape (H, W).
    """
    width, height = sensor.size_wh
    centre_u, centre_v = sensor.centre_uv
    rows = np.arange(height)
    up = -sensor.slope(rows - centre_v)  # of each row's ray, against the tilted axis
    cos, sin = math.cos(roll_rad), math.sin(roll_rad)
    y = range_m * (up * cos + sin) / (cos - up * sin)
    depth = range_m * cos + y * sin
    on = np.abs(y) <= length_m / 2
    first = rows[on][0] if on.any() else 0
    light = np.zeros((height, width))
    instants = np.linspace(-0.5, 0.5, 5) * exposure_s
    for instant in instants:
        x = start_m + speed_mps * ((rows - first) * sensor.row_s + instant)
        left = sensor.pixels((x - width_m / 2) / depth) + centre_u
        right = sensor.pixels((x + width_m / 2) / depth) + centre_u
        light += _covered(left, right, width) * on[:, None] / len(instants)
    return _developed(light, rng, noise)


def render_beacons(
    sensor: ShutterSensor,
    closing_mps: float,
    range_m: float,
    rng: np.random.Generator,
    beacons: Beacons | None = None,
    noise: float = 2.0,
) -> Image:
    """Four bright beacons ahead as a sensor that approaches them reads them.

    Args:
        sensor: The sensor.
        closing_mps: Closing speed, m/s.
        range_m: Range when the first row is read, metres.
        rng: Source of the sensor's noise.
        beacons: Their arrangement, centred on the axis.
        noise: Standard deviation of the sensor's noise, grey levels.

    Returns:
        Grey picture, shape (H, W).
    """
    beacons = beacons or Beacons()
    width, height = sensor.size_wh
    centre_u, centre_v = sensor.centre_uv
    rows = np.arange(height)
    away = range_m - closing_mps * rows * sensor.row_s
    light = np.zeros((height, width))
    for x in (-beacons.base_m / 2, beacons.base_m / 2):
        for y in (-beacons.rise_m / 2, beacons.rise_m / 2):
            # Part of the disc a row cuts, averaged over the row's own height.
            for part in np.linspace(-0.4, 0.4, 5):
                over = sensor.slope(rows + part - centre_v) * away - y
                half = np.sqrt(np.maximum(beacons.radius_m**2 - over**2, 0.0))
                left = sensor.pixels((x - half) / away) + centre_u
                right = sensor.pixels((x + half) / away) + centre_u
                light += _covered(left, right, width) * (half > 0)[:, None] / 5
    return _developed(light, rng, noise)


def _covered(left: Array, right: Array, width: int) -> Array:
    """Share of each pixel of each row between two edges, shape (H, W)."""
    columns = np.arange(width)[None, :]
    high = np.minimum(columns + 0.5, right[:, None])
    low = np.maximum(columns - 0.5, left[:, None])
    return np.asarray(np.clip(high - low, 0.0, 1.0), np.float64)


def _developed(light: Array, rng: np.random.Generator, noise: float) -> Image:
    grey = _DARK + (_BRIGHT - _DARK) * np.minimum(light, 1.0)
    grey += rng.normal(0.0, noise, light.shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)
