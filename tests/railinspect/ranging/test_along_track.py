"""Ranges of things whose true chainage is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from railinspect import labels
from railinspect.camera import Camera, CameraStd
from railinspect.evaluation.drawn_tracks import Thing, camera, draw
from railinspect.findings import Finding, find
from railinspect.ranging import Range, RangingSettings, range_of
from railinspect.track import TrackFollower, TrackGeometry

# The synthetic things stand on the plane of the rail tops.
ON_PLANE = RangingSettings(stands_on_m=0.0)


def ranged(
    cam: Camera, given_camera: Camera | None, curvature: float, thing: Thing
) -> tuple[Range | None, Finding, TrackGeometry]:
    masks = draw(cam, curvature, things=[thing])
    follower = TrackFollower(given_camera)
    for _ in range(4):
        geometry = follower.update(masks)
    (finding,) = find(masks, geometry)
    return range_of(finding, geometry, settings=ON_PLANE), finding, geometry


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(
    range_m=st.floats(12, 70),
    aside=st.floats(-0.8, 0.8),
    radius=st.sampled_from([np.inf, 900.0, -500.0, 300.0]),
    height=st.floats(2.0, 3.8),
    fov=st.floats(40, 65),
    pitch=st.floats(-2, 4),
)
def test_truth_lies_in_the_interval(
    range_m: float, aside: float, radius: float, height: float, fov: float, pitch: float
) -> None:
    cam = camera((640, 360), fov, height, pitch)
    thing = Thing(labels.CONSTRUCTION, range_m, aside, 0.9, 1.0)
    try:
        found, _, _ = ranged(cam, cam, 1 / radius, thing)
    except ValueError:
        return  # not found at all: not ranging's business
    if found is None:
        return
    assert found.interval_m[0] * 0.99 <= range_m <= found.interval_m[1] * 1.01
    if not found.method.startswith("below the image"):
        assert found.range_m == pytest.approx(range_m, rel=0.08)


def test_a_foot_below_the_image_gives_an_upper_limit() -> None:
    cam = camera()
    found, _, _ = ranged(cam, cam, 0.0, Thing(labels.CAR, 5.0, 0.0, 1.8, 1.5))
    assert found is not None
    assert found.method.startswith("below the image")
    assert found.interval_m[0] == 0.0
    assert found.range_m > 5.0


@pytest.mark.parametrize("range_m", [15.0, 30.0, 60.0])
def test_both_instruments_take_part_and_agree(range_m: float) -> None:
    cam = camera()
    found, _, _ = ranged(cam, cam, 0.0, Thing(labels.CAR, range_m, 0.0, 1.8, 1.5))
    assert found is not None
    assert "gauge" in found.method
    assert found.range_m == pytest.approx(range_m, rel=0.03)
    assert found.std_m / found.range_m < 0.08


def test_an_unknown_focal_length_is_in_the_interval() -> None:
    cam = camera(fov_deg=70)
    found, _, _ = ranged(cam, None, 0.0, Thing(labels.CAR, 30.0, 0.0, 1.8, 1.5))
    assert found is not None
    assert found.std_m / found.range_m > 0.2
    assert found.interval_m[0] < 30 < found.interval_m[1]


def test_errors_of_the_calibration_are_carried() -> None:
    cam = camera()
    vague = dataclasses.replace(cam, std=CameraStd(focal_px=0.1 * cam.focal_px, gauge_m=0.045))
    thing = Thing(labels.CAR, 30.0, 0.0, 1.8, 1.5)
    sharp, _, _ = ranged(cam, cam, 0.0, thing)
    wide, _, _ = ranged(cam, vague, 0.0, thing)
    assert sharp is not None
    assert wide is not None
    assert wide.std_m / wide.range_m > 0.1 > sharp.std_m / sharp.range_m


def test_a_thing_on_the_bed_is_farther_than_its_row_says() -> None:
    # Feet 0.15 m below the rails, camera 2.8 m above them: 2.95/2.8 of the plane's distance.
    cam = camera()
    masks = draw(cam, 0.0, things=[Thing(labels.CAR, 30.0, 0.0, 1.8, 1.5)])
    geometry = TrackFollower(cam).update(masks)
    (finding,) = find(masks, geometry)
    on_plane = range_of(finding, geometry, settings=ON_PLANE)
    on_bed = range_of(finding, geometry)
    assert on_plane is not None
    assert on_bed is not None
    assert on_bed.range_m / on_plane.range_m == pytest.approx(2.95 / 2.8, rel=0.01)


def at_row(geometry: TrackGeometry, row: float) -> Finding:
    foot = np.array(
        [float(np.interp(row, geometry.path.uv[::-1, 1], geometry.path.uv[::-1, 0])), row]
    )
    return Finding("obstruction", np.array([foot]), (0, 0, 1, 1), 0.9, foot, "")


def test_no_range_above_the_horizon_or_beyond_the_reliable_range() -> None:
    cam = camera()
    geometry = TrackFollower(cam).update(draw(cam, 0.0))
    horizon = cam.horizon_v()
    assert range_of(at_row(geometry, horizon - 5), geometry) is None
    assert range_of(at_row(geometry, horizon + 1), geometry) is None
    assert range_of(at_row(geometry, horizon + 40), geometry) is not None


def test_uncertainty_grows_with_range() -> None:
    cam = camera()
    geometry = TrackFollower(cam).update(draw(cam, 0.0))
    rows = cam.horizon_v() + np.array([150.0, 80.0, 40.0, 20.0])
    found = [range_of(at_row(geometry, row), geometry) for row in rows]
    assert all(f is not None for f in found)
    stds = [f.std_m for f in found if f is not None]
    ranges = [f.range_m for f in found if f is not None]
    assert stds == sorted(stds)
    assert ranges == sorted(ranges)


def test_without_a_track_there_is_no_range() -> None:
    cam = camera()
    geometry = TrackFollower(cam).update(draw(cam, 0.0))
    finding = at_row(geometry, 300.0)
    assert range_of(finding, dataclasses.replace(geometry, path=None)) is None


def test_range_is_along_the_curve() -> None:
    cam = camera(fov_deg=65)
    found, _, geometry = ranged(cam, cam, 1 / 200, Thing(labels.CAR, 48.0, 0.0, 1.8, 1.5))
    assert found is not None
    assert found.range_m == pytest.approx(48.0, rel=0.06)
    assert geometry.path is not None
