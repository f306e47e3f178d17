"""The foot's row found in the picture, where coarse masks put it into the shadow or the shin."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from railinspect import labels
from railinspect.camera import Camera
from railinspect.evaluation.drawn_tracks import Thing, draw
from railinspect.findings import Finding, find
from railinspect.ranging import FrameRanging, Range, RangingSettings
from railinspect.ranging.foot import _beyond, refine_foot
from railinspect.track import TrackFollower

LAST_ROW = 600
METRE_PX = 60.0
HORIZON_V = 440.0
BOX = (900, 520, 960, LAST_ROW)


def ballast(shade: np.ndarray | float = 0.0) -> np.ndarray:
    """Ballast with sleepers, in shade by as much as is given."""
    rgb = np.full((1080, 1920, 3), (120, 112, 104), float)
    rgb[np.arange(1080) // 7 % 2 == 0] += 18.0
    return rgb * (1.0 - np.asarray(shade)[..., None])


def noisy(rgb: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.clip(rgb + rng.normal(0, 6, rgb.shape), 0, 255).astype(np.uint8)


def picture(colour: tuple[int, int, int]) -> np.ndarray:
    """A thing on ballast with a soft shadow below it."""
    shade = np.zeros((1080, 1920))
    cv2.ellipse(shade, (930, LAST_ROW), (55, 16), 0, 0, 360, 0.6, -1)
    rgb = ballast(cv2.GaussianBlur(shade, (0, 0), 7.0))
    left, top, right, bottom = BOX
    rgb[top : bottom + 1, left : right + 1] = colour
    return noisy(rgb)


def coarse(bottom: int) -> tuple[np.ndarray, Finding]:
    left, top, right, _ = BOX
    masks = np.full((1080, 1920), labels.TRACKBED, np.uint8)
    masks[top : bottom + 1, left : right + 1] = labels.CONSTRUCTION
    outline = np.array([(left, top), (right, top), (right, bottom), (left, bottom)], float)
    foot = np.array([930.0, bottom + 0.5])
    box = (float(left), float(top), float(right), float(bottom))
    return masks, Finding("obstruction", outline, box, 0.9, foot, "")


@pytest.mark.parametrize("off", [-14, -4, 0, 5, 10])
@pytest.mark.parametrize("colour", [(200, 40, 30), (60, 90, 160), (235, 235, 230)])
def test_the_foot_is_where_the_thing_ends(colour: tuple[int, int, int], off: int) -> None:
    masks, finding = coarse(LAST_ROW + off)
    found = refine_foot(picture(colour), masks, finding, METRE_PX, HORIZON_V)
    assert found is not None
    row, std_px, above_px, below_px = found
    assert row == pytest.approx(LAST_ROW + 0.5, abs=1.01)
    assert 0.25 < std_px < 9.0
    assert 0.5 <= above_px < 30.0
    assert 0.5 <= below_px < 30.0


def test_what_looks_like_the_ground_leaves_the_foot_open() -> None:
    masks, finding = coarse(LAST_ROW)
    clear = refine_foot(picture((200, 40, 30)), masks, finding, METRE_PX, HORIZON_V)
    alike = refine_foot(noisy(ballast()), masks, finding, METRE_PX, HORIZON_V)
    assert clear is not None
    assert alike is not None
    assert alike[1] > 2.0 * clear[1]


def test_a_mask_that_goes_on_into_the_shadow_stands_higher() -> None:
    masks, finding = coarse(LAST_ROW + 22)  # a third of a metre of it
    found = refine_foot(picture((200, 40, 30)), masks, finding, METRE_PX, HORIZON_V)
    assert found is not None
    assert found.row == pytest.approx(LAST_ROW + 0.5, abs=1.01)


def test_what_the_picture_leaves_open_is_in_the_reach() -> None:
    # A coat's hem, and shoes that are nearly as grey as the ballast: the foot is one or the other.
    masks, finding = coarse(LAST_ROW)
    rgb = picture((200, 40, 30))
    clear = refine_foot(rgb, masks, finding, METRE_PX, HORIZON_V)
    rgb[LAST_ROW + 1 : LAST_ROW + 12, 915:946] = (150, 60, 50)
    open_ = refine_foot(rgb, masks, finding, METRE_PX, HORIZON_V)
    assert clear is not None
    assert open_ is not None
    assert open_.row - open_.above_px <= LAST_ROW + 0.5
    assert open_.row + open_.below_px >= LAST_ROW + 11.5
    assert open_.above_px + open_.below_px > clear.above_px + clear.below_px


def test_people_whose_legs_the_masks_miss_stand_lower() -> None:
    # The mask ends 1.3 m below the head; the trousers are a little darker than the coat.
    masks, finding = coarse(LAST_ROW)
    rgb = picture((200, 40, 30))
    legs = LAST_ROW + 52  # 1.67 m below the head, in metres of that row
    rgb[LAST_ROW : legs + 1, 915:946] = (178, 34, 26)
    person = dataclasses.replace(finding, type="trespasser")
    found = refine_foot(rgb, masks, person, METRE_PX, HORIZON_V)
    assert found is not None
    assert found[0] == pytest.approx(legs + 0.5, abs=1.01)
    # Where the picture shows nothing, people are as tall as people are.
    blind = refine_foot(noisy(ballast()), masks, person, METRE_PX, HORIZON_V)
    thing = refine_foot(noisy(ballast()), masks, finding, METRE_PX, HORIZON_V)
    assert blind is not None
    assert thing is not None
    assert thing[0] < LAST_ROW + 10 < LAST_ROW + 20 < blind[0]


def test_the_reach_leaves_out_a_fortieth_to_each_side() -> None:
    even = np.full(5, 0.2)
    assert _beyond(even, 2, 1) + _beyond(even, 2, -1) == pytest.approx(0.95 * 5)
    sharp = np.array([0.01, 0.98, 0.01])
    assert _beyond(sharp, 1, 1) == pytest.approx(0.5 - 0.015 / 0.98)
    skewed = np.array([0.01, 0.01, 0.01, 0.57, 0.4])
    assert _beyond(skewed, 3, 1) == pytest.approx(1.5 - 0.005 / 0.01)
    assert _beyond(skewed, 3, -1) == pytest.approx(1.5 - 0.025 / 0.4)


def test_people_stand_lower_than_their_masks_end_and_things_where_they_do() -> None:
    # A picture that shows nothing, and a box cut off by it, of which no height follows.
    masks, finding = coarse(LAST_ROW)
    thing = dataclasses.replace(finding, box_xyxy=(900.0, 0.0, 960.0, float(LAST_ROW)))
    person = dataclasses.replace(thing, type="trespasser")
    blank = np.full((1080, 1920, 3), 112, np.uint8)
    of_thing = refine_foot(blank, masks, thing, METRE_PX, HORIZON_V)
    of_person = refine_foot(blank, masks, person, METRE_PX, HORIZON_V)
    assert of_thing is not None
    assert of_person is not None
    assert of_thing.row == pytest.approx(LAST_ROW + 0.5, abs=1.5)
    assert of_person.row == pytest.approx(LAST_ROW + 0.5 + 0.091 * METRE_PX, abs=2.0)


def test_a_thing_at_the_edge_of_the_picture_is_left_as_it_is() -> None:
    masks, finding = coarse(LAST_ROW)
    low = dataclasses.replace(finding, foot_uv=np.array([930.0, 1079.5]))
    assert refine_foot(picture((200, 40, 30)), masks, low, METRE_PX, HORIZON_V) is None


def test_ranges_take_the_row_from_the_picture() -> None:
    cam = Camera((1280, 720), 2000.0, (639.5, 359.5), 2.5, pitch_rad=0.03)
    masks = draw(cam, 0.0, things=[Thing(labels.CONSTRUCTION, 40.0, 0.0, 0.9, 1.0)])
    track = TrackFollower(cam).update(masks)
    (finding,) = find(masks, track)
    rgb = np.full((720, 1280, 3), (120, 112, 104), np.uint8)
    rgb[masks.labels == labels.CONSTRUCTION] = (200, 40, 30)
    settings = RangingSettings(stands_on_m=0.0)
    # Masks that reach 8 px below the thing, into its shadow.
    low = dataclasses.replace(finding, foot_uv=finding.foot_uv + np.array([0.0, 8.0]))
    blind = FrameRanging(track, segmentation=masks, settings=settings).measure(low)
    seeing = FrameRanging(track, segmentation=masks, settings=settings, rgb=rgb).measure(low)
    assert isinstance(blind, Range)
    assert isinstance(seeing, Range)
    assert blind.range_m < 38.5
    assert seeing.range_m == pytest.approx(40.0, rel=0.01)


def test_a_height_ends_at_the_foot_the_picture_shows() -> None:
    cam = Camera((1280, 720), 2000.0, (639.5, 359.5), 2.5, pitch_rad=0.03)
    masks = draw(cam, 0.0, things=[Thing(labels.HUMAN, 40.0, 0.0, 0.6, 1.66)])
    track = TrackFollower(cam).update(masks)
    (finding,) = find(masks, track)
    rgb = np.full((720, 1280, 3), (120, 112, 104), np.uint8)
    rgb[masks.labels == labels.HUMAN] = (200, 40, 30)
    # A mask that ends a fifth of a metre above the shoes.
    left, top, right, bottom = finding.box_xyxy
    short = dataclasses.replace(
        finding,
        foot_uv=finding.foot_uv - np.array([0.0, 10.0]),
        box_xyxy=(left, top, right, bottom - 10.0),
    )
    settings = RangingSettings(stands_on_m=0.0)
    blind = FrameRanging(track, segmentation=masks, settings=settings).measure(short)
    seeing = FrameRanging(track, segmentation=masks, settings=settings, rgb=rgb).measure(short)
    assert isinstance(blind, Range)
    assert isinstance(seeing, Range)
    by_height = {
        name: next(r.range_m for r in found.readings if r.method == "person's height")
        for name, found in (("blind", blind), ("seeing", seeing))
    }
    assert by_height["blind"] > 44.0
    assert by_height["seeing"] == pytest.approx(40.0, rel=0.02)
