from __future__ import annotations

import numpy as np
import pytest

from railinspect.camera import Camera
from railinspect.pipeline import Inspector
from railinspect.ranging import along_track
from railinspect.ranging.foot import refine_foot
from railinspect.video import Frame
from railinspect.warmup import drawn_track, warm_up
from railops.braking import Train


def test_the_drawn_track_takes_every_step_of_the_loop():
    """Whatever is compiled on first use is reached: following, finding, ranging, deciding."""
    camera = Camera.from_field_of_view((640, 360), np.radians(50.0), 2.6, pitch_rad=0.045)
    drawn = drawn_track(camera)
    inspector = Inspector(lambda rgb: drawn, camera, Train(speed_mps=20.0))
    blank = np.zeros((360, 640, 3), np.uint8)
    records = [inspector.feed(Frame(i, 0.04 * i, blank)) for i in range(5)]
    assert records[-1].followed
    assert records[-1].findings[0].range is not None
    assert records[-1].advice is not None


def test_warming_up_looks_the_foot_up_in_the_picture(monkeypatch: pytest.MonkeyPatch):
    found = []

    def noted(*arguments):
        found.append(refine_foot(*arguments))
        return found[-1]

    monkeypatch.setattr(along_track, "refine_foot", noted)
    warm_up.cache_clear()
    warm_up()
    assert any(row is not None for row in found)


def test_warming_up_needs_nothing_and_is_done_once_per_process():
    warm_up.cache_clear()
    warm_up()
    warm_up()
    assert warm_up.cache_info().misses == 1
