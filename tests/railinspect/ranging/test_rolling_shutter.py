"""The rolling-shutter sensor: rendered row by row, detected, and turned back into a speed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from railinspect.errors import BadInputError
from railinspect.ranging.rolling_shutter import (
    Beacons,
    LensModel,
    ShutterSensor,
    closing_speed,
    lateral_speed,
)
from railinspect.ranging.shutter_detect import find_beacons, find_stripe
from railinspect.ranging.shutter_scene import render_beacons, render_stripe

LENSES: list[LensModel] = ["angle-linear", "pinhole"]
WIDE = ShutterSensor(size_wh=(1600, 1024))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("speed", [11.11, 3.0, -8.0, 0.0])
def test_lateral_speed_of_a_stripe(lens: LensModel, speed: float) -> None:
    sensor = dataclasses.replace(WIDE, lens=lens)
    image = render_stripe(sensor, speed, 1.0, np.random.default_rng(1), start_m=-speed * 0.04)
    found = find_stripe(image, sensor).speed(1.0, sensor)
    assert found.speed_mps == pytest.approx(speed, abs=0.02)


def test_equation_14_where_the_stripe_starts_on_the_axis() -> None:
    sensor = dataclasses.replace(WIDE, size_wh=(1800, 1024))
    image = render_stripe(sensor, 11.11, 1.0, np.random.default_rng(2))
    stripe = find_stripe(image, sensor)
    rows = stripe.rows[-1] - stripe.rows[0]
    assert rows == pytest.approx(2 * math.atan(0.5) / 0.94e-3, abs=12)  # 1 m at 1 m
    assert lateral_speed(1.0, stripe.shift_px, rows, sensor) == pytest.approx(11.11, rel=0.02)


def test_the_wrong_lens_gives_the_wrong_speed() -> None:
    pinhole = dataclasses.replace(WIDE, lens="pinhole")
    image = render_stripe(pinhole, 11.11, 1.0, np.random.default_rng(3), start_m=-0.4)
    stripe = find_stripe(image, pinhole)
    assert abs(stripe.speed(1.0, pinhole).speed_mps - 11.11) < 0.02
    assert abs(stripe.speed(1.0, WIDE).speed_mps - 11.11) > 0.3


def test_the_papers_error_under_roll_and_spread() -> None:
    rng = np.random.default_rng(4)
    errors = []
    for k in range(4):
        roll = math.radians(1.0) * math.sin(2 * math.pi * 0.7 * 1.3 * k)
        away = 1.0 + float(rng.uniform(0, 0.01))
        image = render_stripe(WIDE, 11.11, away, rng, start_m=-0.45, roll_rad=roll)
        errors.append(find_stripe(image, WIDE).speed(1.0, WIDE).speed_mps - 11.11)
    assert max(abs(e) for e in errors) <= 0.13


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("speed", [2.0, -1.0, 6.0])
def test_closing_speed_of_beacons(lens: LensModel, speed: float) -> None:
    sensor = ShutterSensor(lens=lens, row_s=1.5e-3)
    beacons = Beacons(radius_m=0.1)
    image = render_beacons(sensor, speed, 20.0, np.random.default_rng(5), beacons)
    found = closing_speed(find_beacons(image, sensor), beacons, sensor)
    assert found.speed_mps == pytest.approx(speed, abs=0.15)
    assert abs(found.speed_mps - speed) < 3 * found.std_mps


def test_what_is_not_there_is_not_measured() -> None:
    sensor = ShutterSensor(size_wh=(320, 240))
    dark = np.full((240, 320), 20, np.uint8)
    with pytest.raises(BadInputError, match="no stripe"):
        find_stripe(dark, sensor)
    with pytest.raises(BadInputError, match="four beacons"):
        find_beacons(dark, sensor)
    with pytest.raises(BadInputError, match="has shape"):
        find_beacons(dark[:100], sensor)
    corners = np.array([[10.0, 10], [30, 10], [10, 40], [30, 40]])
    with pytest.raises(BadInputError, match="left and right swapped"):
        closing_speed(corners[[1, 0, 3, 2]], Beacons(), sensor)
    with pytest.raises(BadInputError, match="same rows"):
        closing_speed(corners[[0, 1, 0, 1]], Beacons(), sensor)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_absurd_sensors_are_refused(bad: float) -> None:
    with pytest.raises(BadInputError, match="row_s"):
        ShutterSensor(row_s=bad)
