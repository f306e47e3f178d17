"""The fleet report opens in a real browser without a network, and its clips can be decoded."""

from __future__ import annotations

import re

import cv2
import pytest

from railinspect.fleet import dataset, fleet_report
from railinspect.fleet.finished import finished_inputs
from railinspect.fleet.logbook import enter_logbook
from tests.browser import browse, needs_browser
from tests.railinspect.fleet import made_run as made
from tests.railinspect.painted_ride import paint, write_video

pytestmark = needs_browser


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    base = tmp_path_factory.mktemp("browser")
    run = made.made_run(base)
    video = write_video(base / "ride.mp4", [paint([40.0 - i]) for i in range(40)], rate=10.0)
    frames = [made.frame(i, i / 10) for i in range(40)]
    events = [made.event(1, 1.5, "trespasser", advice="emergency")]
    made.write_input(run, "d" * 16, "filmed", frames, events, address=str(video))
    enter_logbook(made.write_logbook(base), finished_inputs(run), run)
    for one in finished_inputs(run):
        dataset.add(one.folder, run)
    fleet_report.write(run)
    return run / "report.html"


def test_the_browser_shows_every_table(report):
    document = browse(report, "--dump-dom")
    found = re.findall(r'<table id="(\w+)"', document)
    assert found == [
        "rates",
        "types",
        "ranges",
        "lines",
        "hours",
        "reasons",
        "cameras",
        "finished",
        "bad",
    ]
    assert document.count("<video") == 1
    assert document.count("<figure") == 4


def test_the_screenshot_shows_a_page(report):
    target = report.parent / "screenshot.png"
    browse(report, f"--screenshot={target}")
    picture = cv2.imread(str(target))
    assert picture.shape == (1500, 1280, 3)
    # The pink of trespassers is there, and something of the film or its poster: painted sky.
    for bgr, least in (((150, 70, 235), 300), ((225, 180, 150), 300)):
        close = (abs(picture.astype(int) - bgr).max(axis=2) < 14).sum()
        assert close > least, bgr
