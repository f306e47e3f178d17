"""The animated pages of two rooms open in a real browser, run their scripts, and show a picture."""

import re

import cv2
import numpy as np

from railops.headway import Succession, find_section
from railops.headway.animate import animation
from railops.pilot import Mission, simulate
from railops.pilot.page import write_page
from tests.browser import browse, needs_browser

pytestmark = needs_browser


def test_the_mission_page_draws_both_vehicles_and_the_obstacle(tmp_path):
    page = write_page(simulate(Mission(), 500), tmp_path / "mission.html")
    target = tmp_path / "mission.png"
    browse(page, f"--screenshot={target}", at="40")
    picture = cv2.cvtColor(cv2.imread(str(target)), cv2.COLOR_BGR2RGB)
    # Train green, pilot vehicle amber, obstacle red.
    for colour, least in (((46, 139, 87), 900), ((208, 138, 0), 60), ((192, 57, 43), 300)):
        close = np.abs(picture.astype(int) - colour).max(axis=2) < 12
        assert close.sum() > least, colour
    # At 40 s the train with a pilot vehicle stands half-way; the two others are far beyond it.
    green = np.abs(picture.astype(int) - (46, 139, 87)).max(axis=2) < 12
    rows = np.flatnonzero(green.sum(axis=1) > 20)
    fronts = [int(np.flatnonzero(green[row]).max()) for row in (rows[0], rows[-1])]
    assert fronts[0] + 200 < fronts[1]


def test_the_animated_section_says_where_a_code_was_met(tmp_path):
    page = tmp_path / "run.html"
    pair = Succession(find_section("zhengzhou"))
    page.write_text(animation(pair, 100.0, 110.0, 20.0, 90.0), encoding="utf-8")
    document = browse(page, "--dump-dom", at="150")
    said = re.search(r'<p id="now" class="bad">(.*?)</p>', document, re.S)
    assert said is not None
    assert re.fullmatch(
        r"The second train runs at 5\d km/h, permitted 40 km/h\. "
        r"It met a code below its speed at 13\d\.\d+ s\.",
        said[1],
    )
    assert '<output id="clock">150.0 s</output>' in document
