"""Every query of docs/fleet-results.md runs, and says of a made run what is true of it."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import duckdb
import pytest

from railinspect.fleet import fleet_report
from railinspect.fleet.finished import finished_inputs
from railinspect.fleet.logbook import enter_logbook
from tests.railinspect.fleet import made_run as made

PAGE = Path(__file__).parents[3] / "docs" / "fleet-results.md"
QUERIES = re.findall(r"```sql\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What each query of the page answers, in order."""
    base = tmp_path_factory.mktemp("queries")
    run = made.made_run(base)
    enter_logbook(made.write_logbook(base), finished_inputs(run), run)
    fleet_report.write(run)
    connection = duckdb.connect()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(run)
        return [connection.sql(query).fetchall() for query in QUERIES]


def test_every_query_of_the_page_is_checked_here(answers):
    assert len(QUERIES) == len(answers) == 6


def test_events_by_line_and_type(answers):
    assert answers[0] == [
        ("Branch", "distortion", 1, 120.0),
        ("Main <line>", "obstruction", 1, 30.0),
        ("Main <line>", "trespasser", 1, None),
    ]


def test_known_time_and_rates(answers):
    branch, main = answers[1]
    assert branch[:2] == (made.RUN_ID, "Branch")
    assert branch[2:] == (pytest.approx(10 / 3600), None, None, 1, pytest.approx(360.0))
    known_h, share, known_km, events, per_hour = main[2:]
    assert (known_h, share) == (pytest.approx(54 / 3600), pytest.approx(0.1))
    assert (known_km, events, per_hour) == (pytest.approx(1.08), 2, pytest.approx(2 / 54 * 3600))


def test_where_the_rails_are_lost(answers):
    # From 600 m to 720 m north of the start.
    assert [row[:2] for row in sorted(answers[2])] == [(50.005, 8.0), (50.006, 8.0)]
    assert sum(row[2] for row in answers[2]) == pytest.approx(6.0)
    assert all(row[3].endswith("pixels of rail were seen") for row in answers[2])


def test_the_ranges_of_an_event(answers):
    assert len(answers[3]) == 11
    assert answers[3][0] == (made.FIRST, 1, 10.0, 50.0, 48.0, 52.0)
    assert answers[3][-1][:4] == (made.FIRST, 1, 11.0, 30.0)


def test_events_by_hour_and_range(answers):
    assert answers[4] == [(14, "below 50 m", 1), (14, "not known", 1), (15, "50 to 150 m", 1)]


def test_the_minutes_of_a_camera(answers):
    camera, minute, horizon, column, spacing = answers[5][0]
    assert (camera, minute) == ("Unit 7", datetime(2026, 5, 1, 12, 0))
    assert horizon == pytest.approx(made.CAMERA.horizon_v(), abs=1.0)
    assert column == pytest.approx(319.5, abs=0.1)
    assert spacing == pytest.approx(made.CAMERA.rail_spacing_m / made.CAMERA.height_m, rel=0.01)
