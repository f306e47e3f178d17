"""The page is built from a run folder, escapes what comes from outside and loads nothing."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from railinspect.batch import inspect_inputs
from railinspect.inspect_settings import InspectSettings
from railops.braking import Train
from tests.railinspect.painted_ride import CAMERA, paint, read_paint, ride, write_video

SETTINGS = InspectSettings(camera=CAMERA, train=Train(speed_mps=20.0), overlay=False)
EVIL = "<script>alert(1)<&'\".mp4"


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> str:
    base = tmp_path_factory.mktemp("page")
    pictures = ride([50.0], 30) + [paint(rails=False)] * 12
    video = write_video(base / EVIL, pictures)
    inspect_inputs([video], base / "out", read_paint, SETTINGS)
    return (base / "out" / "report.html").read_text(encoding="utf-8")


class Tags(HTMLParser):
    """Collects start tags and checks that they nest."""

    void = frozenset({"meta", "img", "br", "rect", "line", "circle"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.void:
            assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))


def test_the_page_is_well_formed_and_loads_nothing(page):
    parsed = Tags(page)
    assert parsed.open == []
    for tag, attributes in parsed.tags:
        assert tag not in ("script", "link", "iframe", "object", "embed")
        for name in ("src", "href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("data:image/jpeg;base64,", "#"))
        assert not any(name.startswith("on") for name in attributes)
    assert "default-src 'none'" in page
    assert "http://" not in page
    assert "https://" not in page


def test_file_names_are_escaped(page):
    assert "<script>" not in page
    assert "&lt;script&gt;alert(1)&lt;&amp;&#x27;&quot;.mp4" in page


def test_the_event_table_says_type_range_time_and_advice(page):
    table = page[page.index('id="events"') : page.index("</table>")]
    assert table.count("<tr id=") == 1
    assert "trespasser" in table
    assert re.search(r"\d+\.\d m<small>\d+\.\d to \d+\.\d m</small>", table)
    assert "emergency" in table
    assert "data:image/jpeg;base64," in table


def test_unknown_frames_are_listed_with_their_reason(page):
    part = page[page.index('id="unknown"') :]
    assert "frames (" in page  # the verdict's share
    assert "<td>12</td>" in part or "<td>11</td>" in part


def test_the_timeline_shows_status_and_events(page):
    assert 'class="s-clear"' in page
    assert 'class="s-unknown"' in page
    assert 'href="#event-1"' in page


def test_a_run_without_events_says_so_and_keeps_its_table(tmp_path):
    video = write_video(tmp_path / "clear.mp4", [paint()] * 10)
    inspect_inputs([video], tmp_path / "out", read_paint, SETTINGS)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "No event." in page
    assert 'id="events"' in page
    assert "No event was confirmed." in page


def test_no_event_in_the_dark_is_not_sold_as_clear(tmp_path):
    video = write_video(tmp_path / "dark.mp4", [paint(rails=False)] * 10)
    inspect_inputs([video], tmp_path / "out", read_paint, SETTINGS)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "not everything could be inspected" in page
    assert "10 frames (100.0%) are unknown" in page


def test_a_camera_that_moved_is_said_at_the_head(tmp_path):
    tilted = replace(CAMERA, pitch_rad=CAMERA.pitch_rad - math.radians(0.6))
    video = write_video(tmp_path / "ride.mp4", [paint()] * 104)
    inspect_inputs([video], tmp_path / "out", read_paint, replace(SETTINGS, camera=tilted))
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    (one,) = run["inputs"]
    assert run["counts"]["drift_frames"] == one["drift_frames"] == 5
    assert "pitch has moved" in one["camera_drift"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "pitch has moved by +0.6" in page[: page.index("<svg")]
    assert "Said in 5 frames" in page
