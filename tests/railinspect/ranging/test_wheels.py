"""Vehicles stand on their wheels, logs across the rails, everything else on the bed."""

from __future__ import annotations

import numpy as np
import pytest

from railinspect import labels
from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.findings import Finding
from railinspect.ranging import FrameRanging, RangingSettings
from railinspect.ranging.ground_level import BED_M, thickness
from railinspect.ranging.wheels import wheels_row
from railinspect.track import TrackFollower

METRE_PX = 60.0


def car(foot_v: float) -> tuple[np.ndarray, Finding]:
    """A car across the track, wheels outside the envelope; its foot is given."""
    masks = np.full((400, 600), labels.TRACKBED, np.uint8)
    masks[200:250, 150:410] = labels.CAR
    for left in (175, 350):
        masks[250:265, left : left + 36] = labels.CAR
    outline = np.array([(220, 200), (340, 200), (340, 250), (220, 250)], float)
    box = (220.0, 200.0, 340.0, 249.0)
    return masks, Finding("obstruction", outline, box, 0.9, np.array([280.0, foot_v]), "")


@pytest.mark.parametrize("foot_v", [249.5, 256.0])
@pytest.mark.parametrize("seen", [slice(0, 280), slice(280, 600)])
def test_the_wheels_are_lower_than_the_body(foot_v: float, seen: slice) -> None:
    masks, _ = car(foot_v)
    other = slice(280, 600) if seen.start == 0 else slice(0, 280)
    masks[250:, other] = labels.TRACKBED
    assert wheels_row(masks, labels.CAR, (280.0, foot_v), METRE_PX) == 264.5


def test_what_has_nothing_below_it_keeps_its_foot() -> None:
    masks, _ = car(249.5)
    masks[250:] = labels.TRACKBED
    assert wheels_row(masks, labels.CAR, (280.0, 249.5), METRE_PX) == 249.5
    # A car that stands nearer, beside the track, is another one.
    masks[250:330, 560:] = labels.CAR
    assert wheels_row(masks, labels.CAR, (280.0, 249.5), METRE_PX) == 249.5


def test_a_trunk_is_as_thick_as_it_is_below_its_branches() -> None:
    masks = np.zeros((60, 120), np.uint8)
    masks[40:50, 10:110] = labels.CONSTRUCTION
    masks[10:40, 50:56] = labels.CONSTRUCTION  # a branch
    masks[0:40, 100:110] = labels.CONSTRUCTION  # a wall it joins in the picture
    assert thickness(masks, labels.CONSTRUCTION, (10, 0, 109, 49)) == 10
    assert np.isinf(thickness(masks, labels.HUMAN, (10, 0, 109, 49)))


def test_a_trunk_across_the_rails_lies_higher_than_a_block() -> None:
    cam = camera((1280, 720))
    drawn = draw(cam, 0.0)
    track = TrackFollower(cam).update(drawn)
    assert track.path is not None
    row = 480
    metre = float(np.interp(row, track.path.uv[::-1, 1], track.path.metre_px[::-1]))
    levels = []
    for tall_m in (0.5, 1.5):
        masks = drawn.labels.copy()
        top, left, right = round(row - tall_m * metre), round(640 - metre), round(640 + metre)
        masks[top : row + 1, left : right + 1] = labels.CONSTRUCTION
        box = (float(left), float(top), float(right), float(row))
        outline = np.array([(left, top), (right, top), (right, row), (left, row)], float)
        finding = Finding("obstruction", outline, box, 0.9, np.array([640.0, row + 0.5]), "")
        seen = type(drawn)(masks, drawn.confidence, drawn.rail_score)
        ranging = FrameRanging(track, segmentation=seen, settings=RangingSettings(bed_std_m=0.0))
        found = ranging.measure(finding)
        levels.append({reading.method: reading.range_m for reading in found.readings})
    higher = levels[0]["ground plane"] / levels[1]["ground plane"]
    height = cam.height_m
    assert higher == pytest.approx((height - 0.5 * BED_M) / (height - BED_M), rel=1e-6)
