"""The second look at the middle of a wide picture."""

from __future__ import annotations

import numpy as np

from railinspect.evaluation.drawn_tracks import camera
from railinspect.fovea import Fovea
from railinspect.segmenter import Segmentation


class Counting:
    """A network that labels a picture with the number of the call."""

    metadata = "the bundle's"

    def __init__(self) -> None:
        self.seen: list[tuple[int, ...]] = []

    def __call__(self, rgb: np.ndarray) -> Segmentation:
        self.seen.append(rgb.shape)
        plane = np.full(rgb.shape[:2], len(self.seen), np.uint8)
        return Segmentation(plane, plane, plane)


def test_the_middle_of_a_wide_picture_comes_from_the_closer_look() -> None:
    network, cam = Counting(), camera((1920, 1080))
    fovea = Fovea(network, cam)
    found = fovea(np.zeros((1080, 1920, 3), np.uint8))
    assert network.seen == [(1080, 1920, 3), (540, 960, 3)]
    left, top, right, bottom = fovea.window(1920, 1080)
    assert top < cam.horizon_v() < 0.5 * (top + bottom)
    assert abs(0.5 * (left + right) - 960) <= 1
    for plane in (found.labels, found.confidence, found.rail_score):
        assert (plane[top:bottom, left:right] == 2).all()
        assert int((plane == 2).sum()) == 960 * 540
    assert fovea.metadata == "the bundle's"


def test_a_narrow_picture_is_looked_at_once() -> None:
    network = Counting()
    Fovea(network, camera((1920, 1080)))(np.zeros((360, 640, 3), np.uint8))
    assert network.seen == [(360, 640, 3)]


def test_a_horizon_near_the_edge_keeps_the_window_in_the_picture() -> None:
    for pitch in (-25.0, 25.0):
        left, top, right, bottom = Fovea(Counting(), camera((1920, 1080), pitch_deg=pitch)).window(
            1920, 1080
        )
        assert (right - left, bottom - top) == (960, 540)
        assert 0 <= top < bottom <= 1080
