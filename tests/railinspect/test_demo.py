"""The demo's judge, and the demo itself on a short ride with an oracle for a segmenter."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect import cli
from railinspect.demo import Judgement, judge, place_m, run_demo
from railinspect.errors import OutputError
from railinspect.labels import RAILS
from railinspect.ride_file import RidePlan
from railinspect.scenes import demo_settings
from railinspect.segmenter import Segmentation, Segmenter
from railinspect.video import open_source

SPEED = 20.0


def planted(kind, at, length=1.0):
    return {"id": 1, "type": kind, "chainage_m": at, "length_m": length}


def event(number, kind, at, range_m=10.0):
    """An event that was closest at ``range_m`` and lies at chainage ``at``."""
    return {
        "id": number,
        "type": kind,
        "closest_range_m": range_m,
        "closest_time_s": (at - range_m) / SPEED,
    }


def counts(verdict):
    found, confused = len(verdict.found), len(verdict.confused)
    return found, confused, len(verdict.unseen), len(verdict.false_events)


def test_the_place_of_an_event_is_the_train_s_plus_its_range():
    assert place_m(event(1, "x", 250.0, 30.0), SPEED) == pytest.approx(250.0)
    assert place_m({"closest_range_m": None}, SPEED) is None


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        ([], (0, 0, 1, 0)),
        ([event(1, "obstruction", 200.0)], (1, 0, 0, 0)),
        ([event(1, "obstruction", 190.5)], (1, 0, 0, 0)),
        ([event(1, "obstruction", 189.5)], (0, 0, 1, 1)),  # 10 m is the tolerance
        ([event(1, "obstruction", 214.5)], (1, 0, 0, 0)),  # it ends at 205 m
        ([event(1, "obstruction", 215.5)], (0, 0, 1, 1)),
        ([event(1, "trespasser", 200.0)], (0, 1, 0, 0)),  # there, but misnamed
        ([event(1, "obstruction", 200.0), event(2, "obstruction", 203.0)], (1, 0, 0, 1)),
        ([event(1, "trespasser", 200.0), event(2, "obstruction", 206.0)], (1, 0, 0, 1)),
        ([{**event(1, "obstruction", 200.0), "closest_range_m": None}], (0, 0, 1, 1)),
    ],
)
def test_the_rule_case_by_case(events, expected):
    assert counts(judge([planted("obstruction", 200.0, 5.0)], events, SPEED)) == expected


@given(
    st.lists(st.tuples(st.sampled_from("dot"), st.floats(0, 500)), max_size=6),
    st.lists(st.tuples(st.sampled_from("dot"), st.floats(0, 500)), max_size=8),
)
def test_nothing_is_counted_twice(truths, sightings):
    truth = [planted(kind, at) for kind, at in truths]
    events = [event(i, kind, at) for i, (kind, at) in enumerate(sightings)]
    found, confused, unseen, false = counts(judge(truth, events, SPEED))
    assert found + confused + unseen == len(truth)
    assert found + confused + false == len(events)


@given(st.lists(st.floats(0, 2000), unique=True, max_size=6))
def test_perfect_events_are_all_found(places):
    places = [at for i, at in enumerate(places) if all(abs(at - p) > 25 for p in places[:i])]
    truth = [planted("obstruction", at) for at in places]
    events = [event(i, "obstruction", at + 3) for i, at in enumerate(reversed(places))]
    assert counts(judge(truth, events, SPEED)) == (len(truth), 0, 0, 0)


def test_the_bar_is_nine_of_ten_and_one_false_event():
    def passed(found, missed, false, confused=0):
        pair = ({}, {})
        return Judgement((pair,) * found, (pair,) * confused, ({},) * missed, ({},) * false).passed

    assert passed(9, 1, 1)
    assert passed(10, 1, 0)  # the demo's eleven
    assert not passed(9, 2, 0)
    assert not passed(8, 2, 0)
    assert not passed(9, 0, 0, confused=2)  # misnamed is not found
    assert not passed(10, 0, 2)


@pytest.mark.parametrize(("passed", "status"), [(True, 0), (False, 1)])
@pytest.mark.parametrize("as_json", [True, False])
def test_a_demo_below_its_bar_exits_with_one(
    passed, status, as_json, tmp_path, monkeypatch, capsys
):
    document = {
        "anomalies": [],
        "false": [],
        "found": 0,
        "planted": 0,
        "missed": 0,
        "false_events": 0,
        "frames": 1,
        "frames_per_s": 1.0,
        "paths": {},
        "passed": passed,
        "bar": {"found_share": 0.9, "false_events": 1},
    }
    monkeypatch.setattr("railinspect.cli._segmenter", lambda options: None)
    monkeypatch.setattr("railinspect.cli._print_paths", lambda paths: None)
    monkeypatch.setattr("railinspect.demo.run_demo", lambda *args, **rest: document)
    command = ["demo", "--out", str(tmp_path / "x"), *(["--json"] if as_json else [])]
    assert cli.main(command) == status
    printed = capsys.readouterr().out
    assert ("below the bar: 90 % found, at most 1 false" in printed) == (not passed and not as_json)


PLAN = RidePlan(
    3,
    demo_settings((640, 360)),
    speed_mps=25.0,
    duration_s=14.0,
    frame_rate=6.0,
    anomaly_count=2,
)


class Oracle:
    """Answers with the labels the world was drawn with, frame after frame."""

    def __init__(self) -> None:
        self._labels: list[np.ndarray] = []

    def render(self, plan: RidePlan, workers: int):
        """In place of the renderer: the same pictures, but their labels are kept."""
        ride = plan.ride()
        for index in range(len(ride)):
            picture = ride.frame(index)
            self._labels.append(picture.labels)
            yield picture.rgb

    def __call__(self, rgb):
        labels = self._labels.pop(0)
        assert labels.shape == rgb.shape[:2]
        score = np.where(np.isin(labels, RAILS), 240, 5).astype(np.uint8)
        return Segmentation(labels, np.full(labels.shape, 230, np.uint8), score)


def test_the_demo_renders_inspects_and_judges(tmp_path, monkeypatch, capsys):
    oracle = Oracle()
    monkeypatch.setattr("railinspect.cli._segmenter", lambda options: oracle)
    monkeypatch.setattr("railinspect.ride_file.rendered", oracle.render)
    monkeypatch.setattr(
        "railinspect.demo.run_demo",
        lambda out, segmenter, _, quiet: run_demo(out, segmenter, PLAN, quiet=quiet),
    )
    out = tmp_path / "demo"
    assert cli.main(["demo", "--out", str(out), "--json"]) == 0
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert document["planted"] == 2
    assert document["found"] + document["missed"] == 2
    assert document["found"] == 2
    assert document["false_events"] <= 1
    assert document["passed"] is True
    assert document["frames"] == 84
    assert document["frames_per_s"] > 0
    assert len(document["anomalies"]) == 2
    truth = json.loads((out / "truth.json").read_text())
    assert [t["type"] for t in truth["planted"]] == [a["type"] for a in document["anomalies"]]
    frames = list(open_source(out / "ride.mp4"))
    assert len(frames) == 84
    assert frames[-1].time_s == pytest.approx(83 / 6, abs=1e-3)
    for name in ("report.html", "camera.yaml", "demo.json", "overlay/ride.mp4"):
        assert (out / name).exists()
    with pytest.raises(OutputError, match="already holds a run"):
        run_demo(out, oracle, PLAN, quiet=True)


def test_a_bad_seed_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Segmenter, "default", staticmethod(lambda threads=None: None))
    assert cli.main(["demo", "--out", str(tmp_path / "x"), "--seed", "-1"]) == 2
    assert "give a whole number of at least 0" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
