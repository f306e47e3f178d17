"""Closer looks at the middle of a wide picture."""

from __future__ import annotations

import numpy as np

from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.fovea import Fovea, for_stills, looked_closer
from railinspect.segmenter import Segmentation, Segmenter
from tests.railinspect.hand_bundle import bundle


class Sized:
    """The size a network sees."""

    input_size_wh = (640, 360)


class Counting:
    """A network that labels a picture with the number of the call; rails are what is red."""

    metadata = Sized()

    def __init__(self) -> None:
        self.seen: list[tuple[int, ...]] = []

    def __call__(self, rgb: np.ndarray) -> Segmentation:
        self.seen.append(rgb.shape)
        plane = np.full(rgb.shape[:2], len(self.seen), np.uint8)
        return Segmentation(plane, plane, np.ascontiguousarray(rgb[..., 0]))


def window(plane: np.ndarray, number: int) -> tuple[int, int, int, int]:
    """Left, top, right and bottom, ends excluded, of what the looks from this one on labelled."""
    rows, columns = np.nonzero(plane >= number)
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


def test_each_look_is_half_as_wide_until_the_network_sees_every_pixel() -> None:
    network, cam = Counting(), camera((1920, 1080))
    found = Fovea(network, cam)(np.zeros((1080, 1920, 3), np.uint8))
    assert network.seen == [(1080, 1920, 3), (540, 960, 3), (270, 480, 3)]
    for number, (wide, tall) in ((2, (960, 540)), (3, (480, 270))):
        left, top, right, bottom = window(found.labels, number)
        assert (right - left, bottom - top) == (wide, tall)
        assert top < cam.horizon_v() < 0.5 * (top + bottom)
        assert abs(0.5 * (left + right) - 960) <= 1  # no track is seen: straight ahead
    assert (found.confidence == found.labels).all()


def test_the_closest_look_goes_where_the_track_runs_on() -> None:
    cam = camera((1920, 1080))
    middles = []
    for curvature in (0.0, -1 / 600):
        rgb = np.repeat(draw(cam, curvature).rail_score[..., None], 3, axis=2)
        left, _, right, _ = window(Fovea(Counting(), cam)(rgb).labels, 3)
        middles.append(0.5 * (left + right))
    assert abs(middles[0] - 960) <= 12
    assert middles[1] - middles[0] > 60


def test_a_narrow_picture_is_looked_at_once() -> None:
    network = Counting()
    Fovea(network, camera((1920, 1080)))(np.zeros((360, 640, 3), np.uint8))
    assert network.seen == [(360, 640, 3)]


def test_a_horizon_near_the_edge_keeps_the_looks_in_the_picture() -> None:
    for pitch in (-25.0, 25.0):
        network = Counting()
        found = Fovea(network, camera((1920, 1080), pitch_deg=pitch))(
            np.zeros((1080, 1920, 3), np.uint8)
        )
        left, top, right, bottom = window(found.labels, 2)
        assert (right - left, bottom - top) == (960, 540)
        assert 0 <= top < bottom <= 1080


def plane(value: int, size_wh: tuple[int, int]) -> np.ndarray:
    return np.full(size_wh[::-1], value, np.uint8)


def test_a_closer_look_keeps_a_little_of_a_rail_it_does_not_see() -> None:
    far = Segmentation(*(plane(value, (80, 40)) for value in (1, 200, 240)))
    near = Segmentation(*(plane(value, (20, 10)) for value in (2, 100, 0)))
    near.rail_score[:, 3] = 250
    seen = looked_closer(far, near, (30, 20))
    part = np.s_[20:30, 30:50]
    assert (seen.labels[part] == 2).all()
    assert (seen.confidence[part] == 100).all()
    assert (seen.rail_score[part][:, 3] == 250).all()
    # Less than half of the closer look's own rail: its width does not grow.
    assert (seen.rail_score[part][:, 4] == round(0.4 * 240)).all()
    assert np.count_nonzero(seen.labels == 2) == 200
    assert seen.closest_xyxy == (30, 20, 50, 30)
    assert seen.before is far
    assert (far.rail_score == 240).all()


def test_without_a_camera_the_track_says_where_the_horizon_is() -> None:
    tops = []
    for pitch in (-6.0, 4.0):
        cam = camera((1920, 1080), pitch_deg=pitch)
        rgb = np.repeat(draw(cam).rail_score[..., None], 3, axis=2)
        with_camera = window(Fovea(Counting(), cam)(rgb).labels, 2)
        without = window(Fovea(Counting())(rgb).labels, 2)
        assert abs(without[1] - with_camera[1]) <= 12
        tops.append(without[1])
    assert abs(tops[1] - tops[0]) > 100


def test_only_a_bundles_network_looks_closer_at_stills() -> None:
    segmenter = Segmenter(bundle())
    assert isinstance(for_stills(segmenter, None), Fovea)
    other = Counting()
    assert for_stills(other, None) is other


def test_close_ups_stay_those_of_the_whole_picture() -> None:
    def whole(track: object) -> str:
        return "whole"

    plane = np.zeros((90, 160), np.uint8)
    far = Segmentation(plane, plane, plane, close_ups=whole)
    part = np.zeros((45, 80), np.uint8)
    near = Segmentation(part, part, part, close_ups=lambda track: "part")
    assert looked_closer(far, near, (20, 10)).close_ups is whole
