"""The report opens in a real browser without a network, shows its table, and looks like a page."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from railinspect.batch import inspect_inputs
from railinspect.inspect_settings import InspectSettings
from railops.braking import Train
from tests.browser import browse, needs_browser
from tests.railinspect.painted_ride import CAMERA, paint, read_paint, ride, write_video

pytestmark = needs_browser


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    base = tmp_path_factory.mktemp("browser")
    pictures = ride([50.0, 110.0], 60) + [paint(rails=False)] * 10
    video = write_video(base / "cab & <ride>.mp4", pictures)
    settings = InspectSettings(camera=CAMERA, train=Train(speed_mps=20.0), overlay=False)
    inspect_inputs([video], base / "out", read_paint, settings)
    # Alone in another folder it must still be whole.
    alone = base / "alone" / "report.html"
    alone.parent.mkdir()
    shutil.copy(base / "out" / "report.html", alone)
    return alone


def test_the_browser_finds_the_event_table(report):
    document = browse(report, "--dump-dom")
    table = re.search(r'<table id="events">.*?</table>', document, re.S)
    assert table is not None
    assert len(re.findall(r'<tr id="event-\d+">', table[0])) == 2
    assert table[0].count("<img") == 2
    assert "<title>RailInspect: cab &amp; &lt;ride&gt;.mp4</title>" in document


def test_the_screenshot_shows_a_page(report):
    target = report.parent / "screenshot.png"
    browse(report, f"--screenshot={target}")
    picture = cv2.cvtColor(cv2.imread(str(target)), cv2.COLOR_BGR2RGB)
    assert picture.shape == (1500, 1280, 3)
    # The pink of trespassers, the red of frames with findings and dark text are all there.
    for colour, least in (((235, 70, 150), 300), ((222, 72, 78), 2000), ((28, 36, 48), 300)):
        close = np.abs(picture.astype(int) - colour).max(axis=2) < 12
        assert close.sum() > least, colour
    kept = os.environ.get("RAILINSPECT_SCREENSHOT")
    if kept:
        shutil.copy(target, kept)
