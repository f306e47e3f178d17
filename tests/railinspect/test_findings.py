"""Findings on tracks and things whose truth is known in metres."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from railinspect import labels
from railinspect.evaluation.answers import inspect_still
from railinspect.evaluation.drawn_tracks import (
    Masks,
    Thing,
    camera,
    draw,
)
from railinspect.findings import find
from railinspect.labels import GAUGES_M
from railinspect.thresholds import Thresholds
from railinspect.track import Gap, TrackFollower
from tests.railinspect.judged import clear, judge

slow = settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])


# Things


@pytest.mark.parametrize(
    ("label", "kind"),
    [
        (labels.HUMAN, "trespasser"),
        (labels.CAR, "obstruction"),
        (labels.TRUCK, "obstruction"),
        (labels.CONSTRUCTION, "obstruction"),
        (labels.FENCE, "obstruction"),
        (labels.POLE, "obstruction"),
        (labels.TRAFFIC_SIGN, "obstruction"),
        (labels.ON_RAILS, "obstruction"),
    ],
)
@pytest.mark.parametrize("range_m", [15.0, 40.0, 80.0])
def test_things_on_the_track_are_found(label: int, kind: str, range_m: float) -> None:
    masks = draw(camera(), 0.0, things=[Thing(label, range_m, 0.2, 0.9, 1.7)])
    geometry, found = judge(masks, camera())
    assert [f.type for f in found] == [kind]
    finding = found[0]
    foot = geometry.camera.ground(finding.foot_uv)
    assert foot[0] == pytest.approx(range_m, rel=0.06)
    assert foot[1] == pytest.approx(0.2, abs=0.35)
    left, top, right, bottom = finding.box_xyxy
    assert left < finding.foot_uv[0] < right
    assert top < bottom
    assert bottom == pytest.approx(finding.foot_uv[1], abs=2)
    assert finding.polygon_uv.shape[1] == 2
    assert 0 < finding.confidence <= 1
    assert "centre line" in finding.evidence


@pytest.mark.parametrize(
    ("thing", "inside"),
    [
        (Thing(labels.CONSTRUCTION, 30.0, 1.2, 0.6, 1.0), True),
        (Thing(labels.CONSTRUCTION, 30.0, 2.6, 0.6, 1.0), False),
        (Thing(labels.CONSTRUCTION, 30.0, -2.6, 0.6, 3.0), False),
        (Thing(labels.HUMAN, 30.0, 1.5, 0.5, 1.8), True),
        (Thing(labels.HUMAN, 30.0, -2.7, 0.5, 1.8), False),
        (Thing(labels.POLE, 60.0, 3.2, 0.3, 8.0), False),
        (Thing(labels.ON_RAILS, 60.0, 4.2, 3.0, 3.8), False),
    ],
)
def test_the_envelope_is_metric(thing: Thing, inside: bool) -> None:
    for cam in (camera(), camera(fov_deg=35), camera(height_m=1.8), camera(gauge_m=1.0)):
        _, found = judge(draw(cam, 0.0, things=[thing]), cam)
        assert bool(found) == inside, (cam, found)


def test_the_envelope_is_a_threshold() -> None:
    masks = draw(camera(), 0.0, things=[Thing(labels.CONSTRUCTION, 30.0, 2.6, 0.6, 1.0)])
    assert judge(masks, camera(), Thresholds(clearance_m=3.2))[1]


def test_what_hangs_over_the_track_is_no_obstacle() -> None:
    masks = draw(camera(), 0.0)
    marks = masks.labels.copy()
    horizon = int(camera().horizon_v())
    marks[horizon - 60 : horizon - 50, 150:500] = labels.POLE  # a gantry's beam
    marks[: horizon - 50, 318:321] = labels.POLE  # a wire down to it
    assert judge(dataclasses.replace(masks, labels=marks), camera())[1] == ()


def test_a_log_that_runs_into_a_railing_beside_the_track_is_an_obstacle() -> None:
    masks = draw(camera(), 0.0, things=[Thing(labels.CONSTRUCTION, 24.0, -1.2, 2.6, 0.4)])
    marks = masks.labels.copy()
    ahead = np.arange(24.0, 6.0, -0.2)
    rail = np.stack([ahead, np.full_like(ahead, -2.55), np.zeros_like(ahead)], axis=1)
    uv = np.round(camera().project(rail)).astype(int)
    uv[:, 1] = 360 - np.round((360 - uv[:, 1]) * np.linspace(1.0, 0.0, len(uv))).astype(int)
    for (u, v), (_, end) in pairwise(uv):
        marks[v : min(end, 359) + 1, u : u + 3] = labels.FENCE
    _, found = judge(dataclasses.replace(masks, labels=marks), camera())
    assert [f.type for f in found] == ["obstruction"]


def test_a_mast_in_front_of_the_curve_behind_it_is_no_obstacle() -> None:
    # The mast stands 3 m inside a left-hand curve and covers the track farther on.
    mast = Thing(labels.POLE, 35.0, 3.0, 0.35, 8.0)
    geometry, found = judge(draw(camera(), 1 / 250, things=[mast]), camera())
    assert found == ()
    assert geometry.path is not None


def test_a_platform_edge_along_the_track_is_no_obstacle() -> None:
    masks = draw(camera(), 0.0)
    cam = camera()
    edge = np.arange(4.0, 150.0, 0.5)
    inner = cam.project(np.stack([edge, 0 * edge + 1.75, 0 * edge + 0.0], 1))
    upper = cam.project(np.stack([edge, 0 * edge + 1.75, 0 * edge + 0.76], 1))
    marks = masks.labels.copy()
    import cv2

    outline = np.round(np.concatenate([inner, upper[::-1]])).astype(np.int32)
    cv2.fillPoly(marks, [outline], int(labels.CONSTRUCTION))
    assert judge(dataclasses.replace(masks, labels=marks), cam)[1] == ()


def test_arms_and_bags_belong_to_the_person() -> None:
    masks = draw(
        camera(),
        0.0,
        things=[
            Thing(labels.HUMAN, 20.0, 0.25, 0.18, 1.7),
            Thing(labels.HUMAN, 20.0, -0.1, 0.18, 1.7),
        ],
    )
    marks = masks.labels.copy()
    rows, cols = np.nonzero(marks == labels.HUMAN)
    marks[rows.min() + 8 : rows.min() + 24, cols.min() - 6 : cols.max() + 7] = labels.HUMAN
    _, found = judge(dataclasses.replace(masks, labels=marks), camera())
    assert [f.type for f in found] == ["trespasser"]


def test_person_and_crate_are_two_findings_nearest_first() -> None:
    masks = draw(
        camera(),
        0.0,
        things=[
            Thing(labels.HUMAN, 22.0, -0.4, 0.5, 1.7),
            Thing(labels.CONSTRUCTION, 45.0, 0.4, 0.8, 0.8),
        ],
    )
    _, found = judge(masks, camera())
    assert [f.type for f in found] == ["trespasser", "obstruction"]


@pytest.mark.parametrize(("shirt", "kind"), [(0.5, "trespasser"), (0.9, "obstruction")])
def test_a_person_parts_of_whom_read_as_a_thing_is_a_person(shirt: float, kind: str) -> None:
    masks = draw(camera(), 0.0, things=[Thing(labels.HUMAN, 20.0, 0.2, 0.6, 1.8)])
    marks = masks.labels.copy()
    rows, cols = np.nonzero(marks == labels.HUMAN)
    height = rows.max() - rows.min() + 1
    # Its middle and lower part: nothing of the person stands on the ground any more.
    first = rows.max() + 1 - round(shirt * height)
    marks[first : rows.max() + 1, cols.min() : cols.max() + 1] = labels.CONSTRUCTION
    _, found = judge(dataclasses.replace(masks, labels=marks), camera())
    assert kind in [f.type for f in found]
    assert ("trespasser" in [f.type for f in found]) == (kind == "trespasser")


def beside(masks: Masks, label: int, box: tuple[int, int, int, int]) -> Masks:
    """The masks with a rectangle (left, top, right, bottom) of a class painted over them."""
    left, top, right, bottom = box
    marks = masks.labels.copy()
    marks[top:bottom, left:right] = label
    return dataclasses.replace(masks, labels=marks)


@pytest.mark.parametrize("hand", [1, -1])
def test_an_animal_with_two_legs_outside_the_envelope_is_an_obstacle(hand: int) -> None:
    legs = [Thing(labels.CONSTRUCTION, 14.0, hand * aside, 0.2, 1.2) for aside in (0.8, 1.9)]
    masks = draw(camera(), 0.0, things=legs)
    _, cols = np.nonzero(masks.labels == labels.CONSTRUCTION)
    top = int(np.nonzero(masks.labels == labels.CONSTRUCTION)[0].min())
    masks = beside(masks, labels.CONSTRUCTION, (cols.min(), top - 8, cols.max() + 1, top + 12))
    _, found = judge(masks, camera())
    assert [f.type for f in found] == ["obstruction"]
    left, _, right, _ = found[0].box_xyxy
    assert right - left >= cols.max() - cols.min() - 25  # the body and not one leg


def test_a_car_does_not_hang_over_the_mast_before_it() -> None:
    mast = Thing(labels.POLE, 12.0, 2.0, 0.3, 6.0)
    masks = draw(camera(), 0.0, things=[mast, Thing(labels.CAR, 26.0, 1.0, 1.7, 1.5)])
    rows, cols = np.nonzero(masks.labels == labels.CAR)
    first = int(np.nonzero(masks.labels == labels.POLE)[1].min())
    # A wall behind both makes one region of them.
    masks = beside(masks, labels.CONSTRUCTION, (first, rows.min() - 9, cols.max(), rows.min() + 1))
    _, found = judge(masks, camera())
    assert [f.type for f in found] == ["obstruction"]
    assert found[0].evidence.startswith(("car", "construction"))


def test_a_runner_stands_where_the_body_is() -> None:
    foot = Thing(labels.HUMAN, 16.0, 1.8, 0.1, 1.7)
    masks = draw(camera(), 0.0, things=[foot])
    rows, cols = np.nonzero(masks.labels == labels.HUMAN)
    assert judge(masks, camera())[1] == ()
    upper = (cols.max(), rows.min(), cols.max() + 16, rows.max() - 14)
    _, found = judge(beside(masks, labels.HUMAN, upper), camera())
    assert [f.type for f in found] == ["trespasser"]


@pytest.mark.parametrize("crest", [True, False])
def test_a_mast_behind_a_crest_is_no_obstacle(crest: bool) -> None:
    masks = draw(camera(), 0.0)
    uv = camera().project(np.array([[60.0, -1.0, 0.0], [60.0, -1.3, 0.0]]))
    (left, foot), (right, _) = np.round(uv).astype(int)
    score, marks = masks.rail_score.copy(), masks.labels.copy()
    if crest:
        score[:foot], marks[:foot] = 0, labels.VEGETATION
    masks = Masks(marks, masks.confidence, score)
    _, found = judge(beside(masks, labels.POLE, (left, foot - 60, right + 1, foot)), camera())
    assert bool(found) is not crest


@pytest.mark.parametrize(
    ("label", "range_m", "ground_px", "seen"),
    [
        (labels.CONSTRUCTION, 75.0, 0, False),  # a wall that stands farther on
        (labels.CONSTRUCTION, 75.0, 12, True),  # the ground goes on beside it
        (labels.CONSTRUCTION, 45.0, 0, True),  # near enough to count all the same
        (labels.ON_RAILS, 75.0, 0, True),  # trains stand on tracks
    ],
)
def test_a_wall_behind_a_far_crest_is_doubtful(
    label: int, range_m: float, ground_px: int, seen: bool
) -> None:
    masks = draw(camera(), 0.0)
    left, right = camera().project(np.array([[range_m, 1.2, 0.0], [range_m, -1.2, 0.0]]))
    foot = int(left[1])
    score, marks = masks.rail_score.copy(), masks.labels.copy()
    score[:foot], marks[:foot] = 0, labels.VEGETATION  # there the ground ends
    marks[foot - ground_px : foot] = labels.TERRAIN
    masks = Masks(marks, masks.confidence, score)
    block = (int(left[0]), foot - 30, int(right[0]), foot + 3)
    masks = beside(masks, label, block)
    _, found = judge(masks, camera())
    (wall,) = found
    assert wall.type == "obstruction"
    assert (wall.doubt is None) is seen
    answer = inspect_still(masks, camera())
    assert answer.said == ("obstruction" if seen else "unknown")
    assert seen or answer.reason.endswith(f"{wall.evidence}, {wall.doubt}")


# Interruptions


def test_a_hole_in_both_rails_with_rails_beyond_is_an_obstruction() -> None:
    masks = clear(0.0)
    score, marks = masks.rail_score.copy(), masks.labels.copy()
    score[235:260] = 0
    marks[235:260][np.isin(marks[235:260], labels.RAILS)] = labels.TERRAIN
    _, found = judge(Masks(marks, masks.confidence, score), camera())
    assert [f.type for f in found] == ["obstruction"]
    assert "interrupted" in found[0].evidence
    assert found[0].foot_uv[1] == pytest.approx(260, abs=3)


def test_rails_the_growing_missed_are_no_hole() -> None:
    masks = clear(0.0)
    geometry, _ = judge(masks, camera())
    hole = Gap("both", 20.0, 26.0, 240.0, 222.0, True)
    missed = dataclasses.replace(geometry, gaps=(hole,))
    assert find(masks, missed) == ()
    assert geometry.profile is not None
    peak = geometry.profile.smooth_peak.copy()
    peak[(geometry.profile.chainage_m > 19) & (geometry.profile.chainage_m < 27)] = 0.0
    profile = dataclasses.replace(geometry.profile, smooth_peak=peak)
    found = find(masks, dataclasses.replace(missed, profile=profile))
    assert [f.type for f in found] == ["obstruction"]


def test_a_short_hole_is_the_segmentations_own() -> None:
    masks = clear(0.0)
    score = masks.rail_score.copy()
    score[240:245] = 0
    assert judge(dataclasses.replace(masks, rail_score=score), camera())[1] == ()


# Properties


@slow
@given(
    radius=st.floats(200, 3000),
    hand=st.sampled_from([-1, 0, 1]),
    gauge=st.sampled_from(sorted(GAUGES_M.values())),
    height=st.floats(1.5, 4.0),
    pitch=st.floats(-5, 5),
    roll=st.floats(-3, 3),
    fov=st.floats(35, 80),
    calibrated=st.booleans(),
)
def test_a_clear_track_never_yields_a_finding(
    radius: float,
    hand: int,
    gauge: float,
    height: float,
    pitch: float,
    roll: float,
    fov: float,
    calibrated: bool,
) -> None:
    cam = camera((640, 360), fov, height, pitch, roll, gauge_m=gauge)
    _, found = judge(draw(cam, hand / radius), cam if calibrated else None)
    assert found == ()


@slow
@given(
    hand=st.sampled_from([-1, 0, 1]),
    label=st.sampled_from([labels.HUMAN, labels.CAR, labels.CONSTRUCTION]),
    range_m=st.floats(12, 60),
    aside=st.floats(-1.2, 1.2),
    width=st.floats(0.4, 2.0),
    tall=st.floats(0.8, 3.0),
    calibrated=st.booleans(),
)
def test_a_thing_on_the_track_never_leaves_a_frame_clear(
    hand: int,
    label: int,
    range_m: float,
    aside: float,
    width: float,
    tall: float,
    calibrated: bool,
) -> None:
    masks = draw(camera(), hand / 400, things=[Thing(label, range_m, aside, width, tall)])
    geometry, found = judge(masks, camera() if calibrated else None)
    assert found or not geometry.followed


@slow
@given(
    curvature=st.floats(-1 / 250, 1 / 250),
    range_m=st.floats(12, 60),
    aside=st.floats(-1.2, 1.2),
)
def test_mirroring_mirrors_the_findings(curvature: float, range_m: float, aside: float) -> None:
    masks = draw(camera(), curvature, things=[Thing(labels.CONSTRUCTION, range_m, aside, 0.8, 1.0)])
    one, other = judge(masks, camera())[1], judge(masks.mirrored(), camera())[1]
    assert [f.type for f in one] == [f.type for f in other]
    for a, b in zip(one, other, strict=True):
        left, top, right, bottom = b.box_xyxy
        assert a.box_xyxy == pytest.approx((639 - right, top, 639 - left, bottom), abs=2)
        assert a.confidence == pytest.approx(b.confidence, abs=0.05)


def test_without_a_track_there_are_no_findings() -> None:
    masks = Masks(*(np.zeros((40, 60), np.uint8),) * 3)
    geometry = TrackFollower().update(masks)
    assert find(masks, geometry) == ()
    assert not geometry.followed
