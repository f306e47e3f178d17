"""How sure several looks at one picture are of a body."""

from __future__ import annotations

import numpy as np
import pytest

from railinspect.evaluation.drawn_tracks import Thing, camera, draw
from railinspect.findings import find
from railinspect.findings.looks import blur, looks_of, sureness
from railinspect.fovea import looked_closer
from railinspect.labels import CONSTRUCTION, HUMAN, TRACKBED
from railinspect.segmenter import Segmentation
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower

FOREIGN = Thresholds().foreign
BODY = np.ones((20, 6), bool)
CORNER = (40, 50)
"""Row and column of the body."""


def one(label: int, confidence: float, size_wh: tuple[int, int] = (120, 80)) -> Segmentation:
    shape = size_wh[::-1]
    sure = np.full(shape, round(255 * confidence), np.uint8)
    return Segmentation(np.full(shape, label, np.uint8), sure, np.zeros(shape, np.uint8))


def closer(far: Segmentation, label: int, confidence: float) -> Segmentation:
    """With a closer look at columns 30 to 90 and rows 20 to 70: it holds the body."""
    return looked_closer(far, one(label, confidence, (60, 50)), (30, 20))


def sure_of(seen: Segmentation, low_px: int = 20, corner: tuple[int, int] = CORNER) -> float:
    return sureness(seen, corner, BODY, low_px, FOREIGN)


def test_a_single_look_is_as_sure_as_its_pixels_on_average() -> None:
    seen = one(CONSTRUCTION, 0.6)
    seen.confidence[40:50] = 102
    assert sure_of(seen) == pytest.approx(0.5, abs=0.01)


def test_what_another_look_takes_for_ground_is_less_sure() -> None:
    agreed = sure_of(closer(one(HUMAN, 0.8), CONSTRUCTION, 0.9))
    assert agreed == pytest.approx(0.7, abs=0.01)
    last = agreed
    for ground in (0.3, 0.6, 0.9):
        seen = sure_of(closer(one(TRACKBED, ground), CONSTRUCTION, 0.9))
        assert seen == pytest.approx(agreed - 0.4 * ground / 2, abs=0.01)
        assert seen < last
        last = seen
    # It is the same which of the looks sees the thing.
    assert sure_of(closer(one(CONSTRUCTION, 0.9), TRACKBED, 0.9)) == pytest.approx(last)


def test_only_the_lower_part_says_that_it_stands_there() -> None:
    far = one(CONSTRUCTION, 0.9)
    tall = closer(far, CONSTRUCTION, 0.9)
    for look in (far, tall):
        look.labels[50:] = TRACKBED  # a wall farther on: the track goes on below it
    assert sure_of(tall, low_px=10) == 0.0
    assert sure_of(tall, low_px=20) > 0.0


def test_a_look_that_does_not_hold_the_body_is_not_asked() -> None:
    seen = closer(one(CONSTRUCTION, 0.9), TRACKBED, 1.0)
    beside = sure_of(seen, corner=(0, 0))
    assert beside == pytest.approx(0.7, abs=0.01)
    assert beside > sure_of(seen)


def test_looks_come_closest_first_and_blur_less() -> None:
    seen = closer(one(TRACKBED, 0.9), CONSTRUCTION, 0.9)
    assert [int(look.labels[45, 55]) for look in looks_of(seen)] == [CONSTRUCTION, TRACKBED]
    share = blur(seen, np.array([[10.0, 10.0], [40.0, 30.0], [90.0, 30.0]]))
    assert share == pytest.approx([1.0, np.sqrt(0.5), 1.0])


@pytest.mark.parametrize(("everywhere", "said"), [(True, ["obstruction"]), (False, [])])
def test_a_still_shows_what_the_looks_agree_on(everywhere: bool, said: list[str]) -> None:
    cam = camera((1280, 720))
    crate = Thing(CONSTRUCTION, 30.0, 0.0, 1.2, 1.0)
    bare, with_crate = draw(cam), draw(cam, things=[crate])
    first = with_crate if everywhere else bare
    far = Segmentation(first.labels, np.full_like(first.labels, 240), first.rail_score)
    part = np.s_[200:560, 320:960]
    near = Segmentation(
        np.ascontiguousarray(with_crate.labels[part]),
        np.full((360, 640), 150, np.uint8),
        np.ascontiguousarray(with_crate.rail_score[part]),
    )
    seen = looked_closer(far, near, (320, 200))
    track = TrackFollower(cam).update(seen)
    found = find(seen, track, Thresholds().still())
    assert [f.type for f in found] == said


def test_a_thing_only_the_first_look_saw_is_found_once() -> None:
    cam = camera((1280, 720))
    crate = Thing(CONSTRUCTION, 30.0, 0.0, 1.2, 1.0)
    masks, bare = draw(cam, things=[crate]), draw(cam)
    part = np.s_[200:560, 320:960]
    for close in (masks, bare):
        near = Segmentation(
            np.ascontiguousarray(close.labels[part]),
            np.full((360, 640), 60, np.uint8),
            np.ascontiguousarray(close.rail_score[part]),
        )
        far = Segmentation(masks.labels, np.full_like(masks.labels, 250), masks.rail_score)
        seen = looked_closer(far, near, (320, 200))
        found = find(seen, TrackFollower(cam).update(seen), Thresholds().still())
        assert [f.type for f in found] == ["obstruction"]
