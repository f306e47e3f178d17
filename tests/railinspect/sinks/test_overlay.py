from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from railinspect.findings import Finding
from railinspect.ranging import Range
from railinspect.records import FrameRecord, LocatedFinding
from railinspect.sinks.overlay import TYPE_RGB, ascii_only, clock, draw_overlay
from railinspect.sinks.overlay_video import fit


@dataclass(frozen=True)
class Advised:
    """As much of an advice as the banner reads."""

    action: str = "service"
    required_m: float = 300.0
    emergency_at_m: float = 250.0
    available_m: float | None = None


def record(status="clear", findings=(), **rest) -> FrameRecord:
    rail = np.array([[300.0, 160.0], [200.0, 359.0]])
    values = {
        "index": 0,
        "time_s": 1.25,
        "status": status,
        "followed": status != "unknown",
        "reason": None,
        "left_uv": rail,
        "right_uv": rail + np.array([40.0, 0.0]),
        "vanishing_uv": np.array([320.0, 150.0]),
        "roi_uv": np.empty((0, 2)),
        "reach_m": 120.0,
        "findings": tuple(findings),
        "advice": None,
    }
    return FrameRecord(**(values | rest))


def person(box, event_id=None, range_=None) -> LocatedFinding:
    finding = Finding("trespasser", np.empty((0, 2)), box, 0.9, np.zeros(2), "painted")
    return LocatedFinding(finding, range_, event_id)


@pytest.fixture
def grey() -> np.ndarray:
    return np.full((360, 640, 3), 100, np.uint8)


def test_the_input_is_not_touched_and_the_rails_are_drawn(grey):
    drawn = draw_overlay(grey, record())
    assert (grey == 100).all()
    assert drawn.shape == grey.shape
    assert drawn[260, 250, 2] > 150  # cyan on the left rail
    assert drawn[260, 250, 0] < 110


def test_unknown_frames_show_no_rails(grey):
    drawn = draw_overlay(grey, record("unknown", reason="the rails cannot be found – at 3 m"))
    assert (drawn[:320] == 100).all()
    assert (drawn[335:] != 100).any()


def test_an_unknown_frame_shows_the_rails_that_are_followed_and_says_why(grey):
    plain = draw_overlay(grey, record("unknown", followed=True))
    assert plain[260, 250, 2] > 150  # cyan on the left rail
    advised = record("unknown", followed=True, advice=Advised())
    told = draw_overlay(grey, replace(advised, reason="perhaps trespasser, only 58 % sure"))
    assert (told[335:] != draw_overlay(grey, advised)[335:]).any()


def test_a_finding_has_a_box_in_its_colour(grey):
    where = Range(42.0, 2.0, (38.0, 46.0), "plane")
    drawn = draw_overlay(grey, record("finding", [person((400.0, 200.0, 440.0, 280.0), 3, where)]))
    assert tuple(drawn[240, 400]) == TYPE_RGB["trespasser"]


def test_boxes_and_labels_outside_the_picture_do_no_harm(grey):
    boxes = [(-50.0, -50.0, 5.0, 5.0), (630.0, 350.0, 900.0, 900.0), (0.0, 0.0, 639.0, 359.0)]
    rails = np.array([[1e9, -1e9], [np.nan, 3.0], [5.0, 5.0]])
    drawn = draw_overlay(grey, record("finding", [person(b) for b in boxes], left_uv=rails))
    assert drawn.shape == grey.shape


def test_labels_of_neighbours_do_not_cover_each_other(grey):
    boxes = [(300.0 + i, 200.0, 310.0 + i, 230.0) for i in range(3)]
    drawn = draw_overlay(grey, record("finding", [person(b, i + 1) for i, b in enumerate(boxes)]))
    tag = (drawn == TYPE_RGB["trespasser"]).all(axis=2)
    rows = np.flatnonzero(tag[:198].any(axis=1))
    assert len(rows) >= 3 * 9  # three tags above each other


def test_a_picture_of_any_size_fits(grey):
    assert fit(grey, (640, 360)) is grey
    assert fit(grey[:-1, :-1], (640, 360)).shape == (360, 640, 3)
    framed = fit(np.full((100, 300, 3), 9, np.uint8), (640, 360))
    assert framed.shape == (360, 640, 3)
    assert (framed[:70] == 0).all()
    assert (framed[180] == 9).all()


def test_text_for_the_fonts_is_ascii():
    assert ascii_only("a – b ≥ 3 ü…") == "a - b >= 3 ?..."
    assert clock(0.0) == "0:00.0"
