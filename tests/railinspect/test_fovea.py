"""Closer looks at the middle of a wide picture."""

from __future__ import annotations

import numpy as np

from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.fovea import Fovea
from railinspect.segmenter import Segmentation


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
