"""The Rerun file holds every frame's picture, rails, findings and ranges at its media time."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter

import pytest

pytest.importorskip("rerun", reason="rerun-sdk (170 MB) is not installed: pip install '.[rerun]'")

from railinspect.batch import inspect_inputs
from railinspect.errors import OutputError
from railinspect.inspect_settings import InspectSettings
from railinspect.sinks.rerun_file import RerunFile, opened_viewer
from tests.railinspect.painted_ride import CAMERA, read_paint, ride, write_video


def test_what_was_written_is_read_back(tmp_path):
    video = write_video(tmp_path / "a b.mp4", ride([40.0], frames=12))
    settings = InspectSettings(camera=CAMERA, overlay=False)
    path = tmp_path / "a.rrd"
    with opened_viewer(path) as viewer:
        summary = inspect_inputs([video], tmp_path / "run", read_paint, settings, viewer=viewer)
    assert summary.events == 1
    # The viewer's own reader says what the file holds: chunks of rows, one entity each.
    read = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(path)]
    printed = subprocess.run(read, capture_output=True, text=True, check=True).stdout
    rows: Counter[str] = Counter()
    for found in re.finditer(r"with (\d+) rows .* - (/\S*(?:\\ \S*)*) - data columns", printed):
        rows[found[2].removeprefix("/a\\ b/")] += int(found[1])
    assert rows["picture"] == rows["picture/rails"] == rows["picture/findings"] == 12
    assert rows["status"] == 12
    assert rows["range_m/event-1"] == 12 - 3  # from its confirmation on


def test_an_existing_file_is_kept(tmp_path):
    (tmp_path / "a.rrd").write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        RerunFile(tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes() == b"mine"
    with pytest.raises(OutputError, match="existing folder"):
        RerunFile(tmp_path / "none" / "a.rrd")


def test_none_is_wanted():
    with opened_viewer(None) as viewer:
        assert viewer is None
