"""The scale fitted to the whole track: it needs neither the camera's height nor level ground."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from railinspect import labels
from railinspect.camera import Camera
from railinspect.evaluation.drawn_tracks import Thing, camera, draw
from railinspect.findings import find
from railinspect.ranging.along_track import FrameRanging, RangingSettings
from railinspect.ranging.error_budget import budget, reliable_range
from railinspect.ranging.fusion import Absent, Range
from railinspect.ranging.ground_level import BED_M, UNSEEN, ground_level
from railinspect.ranging.scale_fit import KNOTS_M, bend_basis, solve
from railinspect.ranging.track_scale import ScaleSettings, TrackScale, fit_scale
from railinspect.track import TrackFollower
from railinspect.track.smooth import centre_bases

SIZE = (1280, 720)
SETTINGS = ScaleSettings(spacing_std_px=0.2)


def fitted(cam: Camera, given: Camera, curvature: float = 0.0) -> TrackScale:
    scale = fit_scale(TrackFollower(given).update(draw(cam, curvature)), SETTINGS)
    assert scale is not None
    return scale


@pytest.mark.parametrize("range_m", [12.0, 30.0, 60.0, 90.0])
@pytest.mark.parametrize("curvature", [0.0, 1 / 500])
def test_points_of_the_track_are_where_they_are(range_m: float, curvature: float) -> None:
    cam = camera(SIZE)
    scale = fitted(cam, cam, curvature)
    bend = curvature * range_m
    x = range_m if curvature == 0 else np.sin(bend) / curvature
    y = 0.0 if curvature == 0 else (1 - np.cos(bend)) / curvature
    found = scale.at(cam.project([x, y, 0.0]))
    assert found is not None
    assert found.range_m == pytest.approx(range_m, rel=0.01)
    assert abs(found.range_m / range_m - 1) < 3 * found.fit_rel + 0.003


def test_a_curve_is_longer_than_its_chord() -> None:
    cam = camera(SIZE, 65.0)
    scale = fitted(cam, cam, 1 / 250)
    for along in (40.0, 60.0, 80.0):
        ahead = 250 * np.sin(along / 250)  # 78.6 m for 80 m of arc
        assert scale.chainage_at(ahead) == pytest.approx(along, abs=0.25 * (along - ahead) + 0.05)
    straight = fitted(cam, cam)
    assert straight.chainage_at(80.0) == pytest.approx(80.0, abs=0.1)


def test_a_wrong_height_does_not_matter() -> None:
    cam = camera(SIZE)
    wrong = dataclasses.replace(cam, height_m=0.9 * cam.height_m)
    scale = fitted(cam, wrong)
    assert scale.height_m == pytest.approx(cam.height_m, rel=0.01)
    found = scale.at(cam.project([50.0, 0.0, 0.0]))
    assert found is not None
    assert found.range_m == pytest.approx(50.0, rel=0.01)


@pytest.mark.parametrize("bend", [2e-4, -2e-4])
def test_a_vertical_curve_is_followed(bend: float) -> None:
    # z = bend·x²/2 exactly, spacing with a pixel of noise per third row: the solver by itself.
    rng = np.random.default_rng(0)
    x = np.geomspace(6.0, 150.0, 300)
    t = (2.5 - 0.5 * bend * x**2) / x + 0.004
    apart = 3000 * 1.507 / x
    noisy = apart + rng.normal(0, 0.5, len(x))
    settings = ScaleSettings(curvature_std=2e-4)
    found, covariance, _ = solve(
        3000 * 1.507 / noisy, t, noisy, np.full(len(x), 0.5), 2.4, settings.spread, 4.0
    )
    assert found[0] == pytest.approx(0.004, abs=4 * np.sqrt(covariance[0, 0]))
    assert found[1] == pytest.approx(2.5, abs=4 * np.sqrt(covariance[1, 1]))
    basis = centre_bases(np.array([100.0]), KNOTS_M)[0][:, 2:]
    assert float((basis @ found[2:])[0]) == pytest.approx(0.5 * bend * 1e4, abs=0.25)


def test_the_bend_at_one_place_is_that_of_the_integrated_hats() -> None:
    x = np.array([0.5, 49.0, 50.0, 51.0, 131.7, 320.0, 449.0, 700.0])
    basis, lean = np.empty(len(KNOTS_M)), np.empty(len(KNOTS_M))
    all_basis, all_lean = centre_bases(x, KNOTS_M)
    for at, one, slope in zip(x, all_basis, all_lean, strict=True):
        bend_basis(float(at), basis, lean)
        np.testing.assert_allclose(basis, one[2:], rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(lean, slope[2:], rtol=1e-10, atol=1e-9)


def test_behind_a_crest_the_nearer_ground_counts_and_beyond_it_nothing() -> None:
    cam = camera(SIZE)
    scale = fitted(cam, cam)
    assert scale.at(np.array([640.0, cam.horizon_v() - 5])) is None
    assert scale.at(np.array([640.0, cam.horizon_v() + 1.5])) is None


def test_what_surrounds_the_foot_says_how_high_it_stands() -> None:
    foot = (50.0, 40.5)
    for label, expected in ((labels.TRACKBED, BED_M), (labels.ROAD, 0.0)):
        masks = np.full((100, 100), label, np.uint8)
        level, std = ground_level(masks, foot, 12.0)
        assert level == expected
        assert 0 < std < 0.05
    mixed = np.full((100, 100), labels.TRACKBED, np.uint8)
    mixed[:, :50] = labels.ROAD
    level, std = ground_level(mixed, foot, 12.0)
    assert BED_M < level < 0
    assert std > 0.05
    assert ground_level(None, foot, 12.0) == UNSEEN
    assert ground_level(np.full((100, 100), 255, np.uint8), foot, 12.0) == UNSEEN


def test_sizes_are_a_second_opinion() -> None:
    cam = camera(SIZE)
    masks = draw(cam, 0.0, things=[Thing(labels.HUMAN, 40.0, 0.2, 0.5, 1.7)])
    track = TrackFollower(cam).update(masks)
    (finding,) = find(masks, track)
    found = FrameRanging(track, settings=RangingSettings(stands_on_m=0.0)).measure(finding)
    assert isinstance(found, Range)
    by_name = {reading.method: reading for reading in found.readings}
    assert set(by_name) == {"gauge", "ground plane", "person's height"}
    assert by_name["person's height"].range_m == pytest.approx(40.0, rel=0.08)
    assert all(reading.agrees for reading in found.readings)
    assert found.range_m == pytest.approx(40.0, rel=0.02)  # a row is 1.2 %
    assert found.std_m == pytest.approx(np.hypot(found.noise_m, found.bias_m), rel=1e-6)
    # Crouching at the same place: half the height. The rails are believed, the size disagrees.
    left, _, right, bottom = finding.box_xyxy
    height = bottom - finding.box_xyxy[1]
    crouched = dataclasses.replace(finding, box_xyxy=(left, bottom - 0.4 * height, right, bottom))
    again = FrameRanging(track, settings=RangingSettings(stands_on_m=0.0)).measure(crouched)
    assert isinstance(again, Range)
    assert again.range_m == pytest.approx(40.0, rel=0.03)
    assert not {r.method: r for r in again.readings}["person's height"].agrees


def test_absence_has_a_reason() -> None:
    cam = camera(SIZE)
    masks = draw(cam, 0.0, things=[Thing(labels.CAR, 30.0, 0.0, 1.8, 1.5)])
    track = TrackFollower(cam).update(masks)
    (finding,) = find(masks, track)
    ranging = FrameRanging(track)
    high = dataclasses.replace(finding, foot_uv=np.array([640.0, 20.0]))
    found = ranging.measure(high)
    assert isinstance(found, Absent)
    assert "horizon" in found.reason
    lost = FrameRanging(dataclasses.replace(track, path=None)).measure(finding)
    assert isinstance(lost, Absent)
    assert "no track" in lost.reason


def test_the_budget_grows_with_range_and_ends() -> None:
    cam = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5)
    errors = [budget(cam, r).std_m for r in (10.0, 50.0, 100.0, 200.0)]
    assert errors == sorted(errors)
    assert 0 < reliable_range(camera()) < reliable_range(cam)
    blind = dataclasses.replace(cam, std=dataclasses.replace(cam.std, focal_px=1500.0))
    assert reliable_range(blind) == 0.0


def test_the_budget_knows_the_feet_of_finer_pictures() -> None:
    # Shadows and legs: 0.01 m and 0.085 m of height over a camera 2.68 m above the bed, 3.2 %.
    cam = Camera((1920, 1080), 3000.0, (959.5, 539.5), 2.5)
    assert budget(cam, 30.0).noise["row"] == pytest.approx(np.hypot(0.01, 0.085) / 2.68, rel=0.02)
    sharp = budget(cam, 30.0, RangingSettings.sharp(1920)).noise["row"]
    assert sharp == pytest.approx(30.0 / (3000 * 2.68) / np.sqrt(12), rel=0.01)
    assert budget(cam, 30.0, RangingSettings(bed_std_m=0.0)).bias["level"] == 0.0


def test_rounding_has_no_tails() -> None:
    cam = Camera((1280, 720), 2000.0, (639.5, 359.5), 2.5, pitch_rad=0.03)
    masks = draw(cam, 0.0, things=[Thing(labels.CONSTRUCTION, 60.0, 0.0, 0.9, 1.0)])
    track = TrackFollower(cam).update(masks)
    (finding,) = find(masks, track)
    even = dataclasses.replace(RangingSettings.sharp(1280), bed_std_m=0.0)
    wide = []
    for settings in (even, dataclasses.replace(even, foot_even=False)):
        found = FrameRanging(track, segmentation=masks, settings=settings).measure(finding)
        assert isinstance(found, Range)
        wide.append(found.interval_m[1] - found.interval_m[0])
    # The row is most of the error; 0.95·√3 of its standard deviation hold 95 %, not 1.96.
    assert 0.95 * 3**0.5 / 1.96 <= wide[0] / wide[1] < 0.97
