"""The commands: one JSON document, one sentence for bad input, figures that are written."""

import json
import subprocess
import sys

import pytest

from railops.cli import main

SHORT = """
speed: [[0, 0], [2000, 20], [38000, 20], [40000, 0]]
gradients: [[0, 0.0], [15000, 0.01], [20000, -0.008]]
curves: [[0, .inf], [18000, 900], [19000, .inf]]
tunnels: [[22000, 23000, 2.0]]
"""


@pytest.fixture
def route(tmp_path):
    path = tmp_path / "route.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return str(path)


def test_plan_prints_one_document_and_draws(route, tmp_path, capsys):
    figure = tmp_path / "plan.png"
    arguments = ["pilot", "plan", "--route", route, "--open-from-m", "5000", "--json"]
    arguments += ["--far-gap-m", "1200", "--points", "11", "--figure", str(figure)]
    code = main(arguments)
    document = json.loads(capsys.readouterr().out)
    assert code == 0
    assert set(document["legs"]) == {"opening", "closing"}
    assert document["legs"]["opening"]["reintegration"]["end_gap_m"] < 0.1
    assert len(document["reference"]["gap_m"]) == 11
    assert figure.stat().st_size > 10_000


def test_track_fails_its_check_with_status_one(route, tmp_path, capsys):
    figure = tmp_path / "track.png"
    arguments = ["pilot", "track", "--route", route, "--rough", "--most-m", "0.001", "--json"]
    code = main([*arguments, "--figure", str(figure)])
    document = json.loads(capsys.readouterr().out)
    assert code == 1
    assert document["largest_error_m"] > 0.001
    assert figure.exists()


def test_mission_speaks_to_people_and_machines(tmp_path, capsys):
    page = tmp_path / "mission.html"
    assert main(["pilot", "mission", "--missions", "500", "--page", str(page)]) == 0
    assert "train stops in" in capsys.readouterr().out
    assert page.exists()
    assert main(["pilot", "mission", "--missions", "500", "--json"]) == 0
    systems = json.loads(capsys.readouterr().out)["systems"]
    assert systems["pilot"]["train_stops"]["value"] > systems["driver"]["train_stops"]["value"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "--longest-m", "3000"], "out of reach within the section"),
        (["plan", "--route", "nowhere.yaml"], "nowhere.yaml"),
        (["mission", "--missions", "0"], "missions is 0"),
        (["mission", "--gap-m", "-5"], "gap_m is -5"),
    ],
)
def test_bad_input_is_one_sentence_and_status_two(arguments, message, capsys):
    assert main(["pilot", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_unknown_keys_of_a_route_are_refused(tmp_path, capsys):
    path = tmp_path / "route.yaml"
    path.write_text("speed: [[0, 20], [50000, 20]]\nspeeds: 3\n", encoding="utf-8")
    assert main(["pilot", "plan", "--route", str(path)]) == 2
    assert "unknown keys ['speeds']" in capsys.readouterr().err


def test_missions_need_neither_casadi_nor_matplotlib():
    probe = (
        "import sys; from railops.pilot import Mission, simulate; simulate(Mission(), 10); "
        "print(sorted({'casadi', 'matplotlib'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
    control = probe.replace("import sys;", "import sys, casadi;")
    run = subprocess.run(
        [sys.executable, "-c", control], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "['casadi']"
