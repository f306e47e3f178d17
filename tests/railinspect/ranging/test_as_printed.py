"""Source 001: its Table 1 and Figs. 6–7 as printed, and what consistent units make of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from railinspect.ranging import as_printed
from railinspect.ranging.goniometric import angle_error
from railinspect.ranging.rolling_shutter import (
    ShutterSensor,
    blur_range_error,
    lateral_error,
    lateral_speed,
)
from railinspect.ranging.speed import finite_difference, minimum_interval
from railinspect.ranging.stereo_camera import StereoCamera

STEP = 0.47e-3  # Δω, rad
SENSOR = ShutterSensor()

# Table 1: instrument, D₁, σ_D1, D₂, σ_D2, Δt, σ_v as printed.
TABLE_1 = [
    ("stereo", 20.0, 0.72, 18.0, 0.59, 1.0, 0.93),
    ("goniometer", 20.0, 0.67, 18.0, 0.61, 1.0, 0.90),
    ("blur sensor", 20.0, 0.08, 19.6, 0.07, 0.2, 0.53),
]
PRINTED = {
    "stereo": lambda d: as_printed.stereo_error(d, 2.5, 0.1, STEP),
    "goniometer": lambda d: as_printed.goniometer_error(d, 2.7, 0.1, STEP),
    "blur sensor": lambda d: blur_range_error(d, 2.5, STEP),
}


@pytest.mark.parametrize(("name", "d1", "s1", "d2", "s2", "dt", "sv"), TABLE_1)
def test_table_1_as_printed(
    name: str, d1: float, s1: float, d2: float, s2: float, dt: float, sv: float
) -> None:
    error = PRINTED[name]
    # Printed to a hundredth; the stereo row is cut off, not rounded.
    assert error(d1) == pytest.approx(s1, abs=0.0065)
    assert error(d2) == pytest.approx(s2, abs=0.0065)
    # σ_v follows from the printed σ_D by (10); the paper cut off its third decimal.
    speed = finite_difference(d1, d2, dt, s1, s2)
    assert speed.speed_mps == pytest.approx(2.0)
    assert speed.std_mps == pytest.approx(sv, abs=0.0065)


def test_consistent_units_turn_the_ranking_round() -> None:
    # The parallax of one step is f·Δω on the sensor: in pixels of angle, f = 1/Δω steps.
    stereo = StereoCamera(1.0 / STEP, 2.5, (0.0, 0.0))
    errors = [float(stereo.noise_m(stereo.focal_px * 2.5 / d, 1.0)) for d in (20.0, 18.0)]
    assert errors == pytest.approx([0.0752, 0.0609], abs=2e-4)
    stereo_speed = finite_difference(20.0, 18.0, 1.0, *errors).std_mps
    assert stereo_speed == pytest.approx(0.0968, abs=5e-4)
    gonio = [angle_error(d, 2.7, 0.1, STEP) for d in (20.0, 18.0)]
    assert [g.std_m for g in gonio] == pytest.approx([0.744, 0.669], abs=1e-3)
    assert [g.worst_m for g in gonio] == pytest.approx([0.815, 0.727], abs=1e-3)
    assert stereo_speed < 0.53 < finite_difference(20, 18, 1, *(g.std_m for g in gonio)).std_mps


def test_figure_6() -> None:
    # (15) grows with the speed: Δω/cos²(sβ) per row time.
    errors = []
    for speed in np.arange(1.0, 12.0):
        shift = math.atan(speed * 836 * 1e-4) / SENSOR.pixel_rad
        errors.append(lateral_error(1.0, shift, 836, SENSOR))
        by_hand = STEP * (1 + math.tan(shift * SENSOR.pixel_rad) ** 2) / (836 * 1e-4)
        assert errors[-1] == pytest.approx(by_hand, rel=1e-3)
    assert errors == sorted(errors)
    assert lateral_speed(1.0, 796, 836, SENSOR) == pytest.approx(11.104, abs=5e-4)
    assert lateral_error(1.0, 796, 836, SENSOR) == pytest.approx(0.0105, abs=5e-5)


def test_figure_7() -> None:
    # 45 s at 40 km/h: roll of 1° at 0.7 Hz, stripes 0 … 0.01 m too far, (16).
    rng = np.random.default_rng(7)
    times = np.arange(0.0, 45.0, 0.1)
    errors = [
        lateral_error(
            1.0,
            796,
            836,
            SENSOR,
            float(rng.uniform(0, 0.01)),
            math.radians(1.0) * math.sin(2 * math.pi * 0.7 * t),
        )
        for t in times
    ]
    assert max(errors) <= 0.13
    worst = lateral_error(1.0, 796, 836, SENSOR, 0.01, math.radians(1.0))
    assert worst == pytest.approx(0.123, abs=1e-3)
    assert max(errors) > 0.9 * worst


def test_a_pinhole_lens_gives_988_pixels() -> None:
    pinhole = ShutterSensor(lens="pinhole")
    slope = 11.11 * 836e-4
    assert float(pinhole.pixels(slope)) == pytest.approx(988, abs=0.5)
    assert float(SENSOR.pixels(slope)) == pytest.approx(796.4, abs=0.5)


def test_minimum_interval_of_the_blur_sensor() -> None:
    assert minimum_interval(0.076, 2.0) == pytest.approx(0.038)
