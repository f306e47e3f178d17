"""A stereo pair as one instrument among the others, in a frame and along a recording."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from railinspect import labels
from railinspect.batch import inspect_inputs
from railinspect.errors import BadInputError
from railinspect.evaluation.drawn_tracks import Thing, camera, draw
from railinspect.findings import find
from railinspect.inspect_settings import InspectSettings
from railinspect.pipeline import Inspector
from railinspect.ranging import Absent, FrameRanging, Range, RangingSettings
from railinspect.ranging.stereo_camera import StereoCamera
from railinspect.ranging.stereo_view import StereoView
from railinspect.right_pictures import RightPictures
from railinspect.track import TrackFollower
from railinspect.video import Frame, open_source
from tests.railinspect.painted_ride import CAMERA, paint, read_paint
from tests.railinspect.ranging.test_stereo import pair

CAM = camera()
PAIR = StereoCamera(CAM.focal_px, 1.2, CAM.principal_uv)
ON_PLANE = RangingSettings(stands_on_m=0.0)


def textured(range_m: float, size: tuple[int, int] = (360, 640)) -> tuple[np.ndarray, np.ndarray]:
    """A pair that shows everything at one distance."""
    left, right = pair(np.full(size, PAIR.focal_px * PAIR.baseline_m / range_m))
    return tuple(np.repeat(one[..., None], 3, axis=2) for one in (left, right))


def test_stereo_takes_part_and_carries_a_thing_the_rails_cannot() -> None:
    masks = draw(CAM, 0.0, things=[Thing(labels.CONSTRUCTION, 40.0, 0.0, 0.9, 1.5)])
    track = TrackFollower(CAM).update(masks)
    (finding,) = find(masks, track)
    view = StereoView(*textured(40.0), PAIR)
    alone = FrameRanging(track, settings=ON_PLANE).measure(finding)
    both = FrameRanging(track, settings=ON_PLANE, stereo=view).measure(finding)
    assert isinstance(alone, Range)
    assert isinstance(both, Range)
    stereo = {reading.method: reading for reading in both.readings}["stereo"]
    assert stereo.range_m == pytest.approx(40.0, rel=0.02)
    assert both.std_m < alone.std_m
    lost = dataclasses.replace(track, path=None, profile=None)
    assert isinstance(FrameRanging(lost).measure(finding), Absent)
    by_pair = FrameRanging(lost, stereo=view).measure(finding)
    assert isinstance(by_pair, Range)
    assert by_pair.method == "stereo"
    assert by_pair.range_m == pytest.approx(40.0, rel=0.02)


def test_a_pair_that_shows_nothing_leaves_the_others() -> None:
    masks = draw(CAM, 0.0, things=[Thing(labels.CONSTRUCTION, 40.0, 0.0, 0.9, 1.5)])
    track = TrackFollower(CAM).update(masks)
    (finding,) = find(masks, track)
    grey = np.full((360, 640, 3), 90, np.uint8)
    found = FrameRanging(track, settings=ON_PLANE, stereo=StereoView(grey, grey, PAIR))
    alone = FrameRanging(track, settings=ON_PLANE).measure(finding)
    assert found.measure(finding) == alone


def test_the_inspector_uses_the_right_picture_and_checks_its_side_once() -> None:
    person = paint([40.0])
    segmentation = read_paint(person)
    left, right = textured(40.0)
    inspector = Inspector(read_paint, CAMERA, stereo=PAIR)
    (found,) = inspector.feed(Frame(0, 0.0, left), segmentation, right).findings
    assert found.range is not None
    assert "stereo" in {reading.method for reading in found.range.readings}
    (found,) = inspector.feed(Frame(1, 0.08, left), segmentation).findings
    assert found.range is not None
    assert "stereo" not in {reading.method for reading in found.range.readings}
    with pytest.raises(BadInputError, match="swapped"):
        Inspector(read_paint, CAMERA, stereo=PAIR).feed(Frame(0, 0.0, right), segmentation, left)
    with pytest.raises(BadInputError, match="one size"):
        Inspector(read_paint, CAMERA, stereo=PAIR).feed(
            Frame(0, 0.0, left), segmentation, right[:300]
        )


def folder(base: Path, name: str, grey_levels: dict[int, int]) -> Path:
    """A folder of flat pictures named after their index, at 10 Hz by default."""
    path = base / name
    path.mkdir()
    for index, level in grey_levels.items():
        cv2.imwrite(str(path / f"{index:04d}.png"), np.full((40, 60, 3), level, np.uint8))
    return path


def test_right_pictures_are_found_by_their_time(tmp_path: Path) -> None:
    right = RightPictures(open_source(folder(tmp_path, "right", {0: 10, 1: 20, 2: 30}), 10.0))
    first, lost, last = (right.at(time_s) for time_s in (0.0, 0.05, 0.2))
    assert first is not None
    assert last is not None
    assert (int(first.mean()), lost, int(last.mean())) == (10, None, 30)
    assert right.at(0.3) is None
    right.close()


def test_a_right_recording_needs_one_input_and_a_calibration(tmp_path: Path) -> None:
    left = folder(tmp_path, "left", {0: 10})
    right = folder(tmp_path, "right", {0: 10})
    with pytest.raises(BadInputError, match="calibration"):
        inspect_inputs([left], tmp_path / "a", read_paint, InspectSettings(right=right))
    with pytest.raises(BadInputError, match="fits one input, not 2"):
        inspect_inputs(
            [left, left], tmp_path / "b", read_paint, InspectSettings(right=right, stereo=PAIR)
        )
