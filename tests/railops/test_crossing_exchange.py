"""Prediction from late reports, the message bus, the units, drives and their audit; the command."""

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st

from railops import cli
from railops.crossing import drive
from railops.crossing.audit import audit, cause_of
from railops.crossing.bus import FIELD, PERFECT, WORST, Bus, Link, Message
from railops.crossing.drive import Plan
from railops.crossing.geodesy import Position
from railops.crossing.kalman import Noise, Predictor, Report
from railops.crossing.units import (
    AS_PUBLISHED,
    CAUTIOUS,
    Area,
    CarUnit,
    Centre,
    Station,
    TrainUnit,
)
from railops.errors import DomainError, MeasurementError


@given(st.permutations([Report(t, 1000.0 - 20.0 * t, 20.0) for t in range(6)]))
def test_order_of_arrival_does_not_matter(reports: list[Report]) -> None:
    predictor = Predictor()
    for report in reports:
        predictor.add(report, now_s=6.0)
    found = predictor.estimate(10.0)
    assert found.distance_m == pytest.approx(800.0, abs=1e-6)
    assert found.speed_mps == pytest.approx(20.0)
    assert found.age_s == 5.0


def test_the_filter_is_the_matrix_form() -> None:
    noise = Noise(position_m=4.0, speed_mps=0.5, accel=0.6)
    reports = [Report(0.0, 900.0, 19.0), Report(1.5, 873.0, 20.0), Report(4.0, 820.0, 21.5)]
    predictor = Predictor(noise)
    for report in reports:
        predictor.add(report, 9.0)
    measured = np.diag([noise.position_m**2, noise.speed_mps**2])
    state, spread, at = np.array([900.0, 19.0]), measured.copy(), 0.0
    for now, report in [(1.5, reports[1]), (4.0, reports[2]), (9.0, None)]:
        t = now - at
        move = np.array([[1.0, -t], [0.0, 1.0]])
        grown = noise.accel**2 * np.array([[t**3 / 3, -(t**2) / 2], [-(t**2) / 2, t]])
        state, spread, at = move @ state, move @ spread @ move.T + grown, now
        if report is not None:
            gain = spread @ np.linalg.inv(spread + measured)
            state = state + gain @ (np.array([report.distance_m, report.speed_mps]) - state)
            spread = (np.eye(2) - gain) @ spread
    found = predictor.estimate(9.0)
    np.testing.assert_allclose([found.distance_m, found.speed_mps], state, rtol=1e-12)
    spreads = [found.distance_std_m**2, found.speed_std_mps**2]
    np.testing.assert_allclose(spreads, np.diag(spread), rtol=1e-12)


def test_doubt_grows_with_the_age_of_the_news() -> None:
    predictor = Predictor()
    predictor.add(Report(0.0, 1000.0, 20.0), 1.0)
    spread = [predictor.estimate(now).distance_std_m for now in (0.0, 5.0, 15.0)]
    assert spread[0] == pytest.approx(5.0)
    assert spread[0] < spread[1] < spread[2]


def test_stale_future_and_duplicate_reports_are_refused() -> None:
    predictor = Predictor()
    with pytest.raises(MeasurementError, match="at least one report"):
        predictor.estimate(0.0)
    predictor.add(Report(10.0, 500.0, 20.0), 12.0)
    with pytest.raises(MeasurementError, match="future timestamp"):
        predictor.add(Report(13.0, 500.0, 20.0), 12.0)
    with pytest.raises(MeasurementError, match="stale report"):
        predictor.add(Report(1.0, 500.0, 20.0), 100.0)
    with pytest.raises(DomainError, match="not reported before"):
        predictor.add(Report(10.0, 400.0, 20.0), 12.0)
    with pytest.raises(MeasurementError, match="age of the newest report"):
        predictor.estimate(100.0)


def carried(link: Link, count: int = 400) -> tuple[Bus, list[Message]]:
    env = simpy.Environment()
    bus = Bus(env, link, np.random.default_rng(1))
    received: list[Message] = []
    bus.join("b", received.append)

    def talk() -> Any:
        for _ in range(count):
            bus.send("state", "a", "b")
            yield env.timeout(1.0)

    env.process(talk())
    env.run()
    return bus, received


def test_bus_delays_loses_and_reorders() -> None:
    bus, received = carried(FIELD)
    delays = [t.arrived_s - t.message.sent_s for t in bus.log if t.arrived_s is not None]
    assert 1.0 <= min(delays) < 2.0
    assert 14.0 < max(delays) <= 15.0
    assert 0.01 < 1.0 - len(delays) / 400 < 0.1
    sent = [message.sent_s for message in received]
    assert sent != sorted(sent)
    perfect = [message.sent_s for message in carried(PERFECT)[1]]
    assert perfect == sorted(perfect)
    assert len(perfect) == 400


def units(now: list[float]) -> tuple[Bus, list[Message], Station]:
    class Env:
        @property
        def now(self) -> float:
            return now[0]

        def process(self, generator: Any) -> None:
            generator.close()

    bus = Bus(Env(), PERFECT, np.random.default_rng(0))
    station = Station("1000", bus, {"tracks": 1}, lambda: now[0])
    return bus, [], station


def test_ids_receivers_areas_and_graphs_are_checked() -> None:
    bus, _, _ = units([0.0])
    with pytest.raises(DomainError, match="an id no other unit has"):
        CarUnit("1000", bus, "1000", lambda: 0.0)
    with pytest.raises(DomainError, match="receiver is 77"):
        bus.send("position", "1000", "77")
    with pytest.raises(DomainError, match="at least one track"):
        Station("1001", bus, {"tracks": 0}, lambda: 0.0)
    here = Position(57.0, 24.0)
    with pytest.raises(DomainError, match="do not overlap"):
        Centre("5", bus, (Area("a", here, 100.0), Area("b", here, 100.0)), lambda: 0.0)
    with pytest.raises(DomainError, match="no duplicates"):
        Centre("5", bus, (Area("a", here, 1.0), Area("a", Position(58.0, 24.0), 1.0)), lambda: 0.0)


def test_an_old_state_never_replaces_a_newer_one() -> None:
    now = [20.0]
    bus, _, _ = units(now)
    train = TrainUnit("10", bus, "5", CAUTIOUS, lambda: now[0])
    train.receive(Message("state", "1000", "10", 19.0, {"busy": False, "closed": False}))
    train.receive(
        Message("state", "1000", "10", 12.0, {"busy": True, "closed": False})
    )  # overtaken
    assert not train.must_brake(400.0, 390.0)
    now[0] = 24.5
    assert train.must_brake(400.0, 390.0)
    assert train.brake_reason == "doubt: the newest state is 5.5 s old"


def test_messages_from_the_future_or_nowhere_are_refused_with_a_reason() -> None:
    now = [10.0]
    bus, _, station = units(now)
    station.receive(Message("standing", "100", "1000", 9.0, {"standing": True}))
    station.receive(Message("standing", "100", "1000", 1e6, {"standing": False}))
    assert station.busy()
    assert "standing from 100" in station.refused[0]
    assert "future timestamp" in station.refused[0]
    train = TrainUnit("10", bus, "5", CAUTIOUS, lambda: now[0])
    train.receive(Message("state", "1000", "10", 1e6, {"busy": False, "closed": True}))
    assert train.must_brake(400.0, 390.0)
    assert train.brake_reason == "doubt: no state"
    centre = Centre("5", bus, (Area("1000", Position(57.0, 24.0), 100.0),), lambda: now[0])
    here = {"latitude_deg": 157.0, "longitude_deg": 24.0}
    centre.receive(Message("position", "10", "5", 9.0, here))
    assert "latitude_deg is 157.0 °" in centre.refused[0]
    assert not bus.log


def test_a_stale_or_repeated_position_is_refused_by_the_station() -> None:
    now = [100.0]
    _, _, station = units(now)
    bus_body = {"distance_m": 500.0, "speed_mps": 20.0}
    TrainUnit("10", station._bus, "5", CAUTIOUS, lambda: now[0])
    station.receive(Message("register", "10", "1000", 1.0))
    for sent_s in (99.0, 99.0, 30.0):
        station.receive(Message("position", "10", "1000", sent_s, bus_body))
    repeated, stale = station.refused
    assert "not reported before" in repeated
    assert "stale report" in stale
    assert station.predict("10").age_s == 1.0


def test_the_train_asks_for_closing_once_near_and_until_it_is_closed() -> None:
    now = [10.0]
    bus, _, _ = units(now)
    train = TrainUnit("10", bus, "5", CAUTIOUS, lambda: now[0])
    train.receive(Message("area", "5", "10", 9.0, {"code": "1000"}))

    def asked() -> int:
        return [trace.message.kind for trace in bus.log].count("close")

    train.ask_to_close(1200.0, 20.0, 400.0)  # 40 s before the last braking point
    assert asked() == 0
    train.ask_to_close(1000.0, 20.0, 400.0)
    train.receive(Message("state", "1000", "10", 9.5, {"busy": False, "closed": False}))
    train.ask_to_close(990.0, 20.0, 400.0)
    assert asked() == 2
    train.receive(Message("state", "1000", "10", 9.8, {"busy": False, "closed": True}))
    train.ask_to_close(980.0, 20.0, 400.0)
    assert asked() == 2


def test_without_any_state_the_cautious_train_stops_and_the_published_one_does_not() -> None:
    for policy, brakes in ((CAUTIOUS, True), (AS_PUBLISHED, False)):
        bus, _, _ = units([0.0])
        train = TrainUnit("10", bus, "5", policy, lambda: 0.0)
        assert not train.must_brake(900.0, 400.0)
        assert train.must_brake(410.0, 400.0) is brakes


def test_a_crossing_stays_busy_until_a_newer_report_of_leaving() -> None:
    now = [10.0]
    _, _, station = units(now)
    station.receive(Message("standing", "100", "1000", 8.0, {"standing": True}))
    station.receive(Message("standing", "100", "1000", 5.0, {"standing": False}))  # older
    assert station.busy()
    now[0] = 300.0  # silence is no report of leaving
    assert station.busy()
    station.receive(Message("standing", "100", "1000", 299.0, {"standing": False}))
    assert not station.busy()
    with pytest.raises(DomainError, match="registered train"):
        station.predict("11")


EARLY = Plan(3, 25.0, 2500.0, 20.0, 200.0)
NEVER = Plan(3, 25.0, 2500.0, 5000.0, 1.0)
TOO_LATE = Plan(3, 25.0, 2500.0, 95.0, 60.0)


def test_perfect_radio_stops_before_an_early_stall_and_passes_a_free_crossing() -> None:
    stopped, traces = drive.run(EARLY, PERFECT, AS_PUBLISHED)
    assert (stopped.collided, stopped.passed_s, stopped.brake_reason) == (False, None, "busy")
    assert {trace.message.kind for trace in traces} == {
        "position", "area", "register", "graph", "state", "standing",
    }  # fmt: skip
    passed, traces = drive.run(NEVER, PERFECT, CAUTIOUS)
    assert "close" in {trace.message.kind for trace in traces}
    assert passed.braked_s is None
    # the crossing is asked to close 35 s before the last braking point, to the next full second
    assert passed.closed_s is not None
    assert 0.0 <= passed.closed_s - (passed.last_point_s - 35.0) <= 1.5
    assert passed.passed_s == pytest.approx(100.0, abs=0.3)


def test_a_stall_after_the_last_braking_point_is_no_radios_fault() -> None:
    hit, _ = drive.run(TOO_LATE, PERFECT, CAUTIOUS)
    assert hit.collided
    assert 0.0 < hit.impact_mps <= 25.0
    assert "no radio could have helped" in cause_of(hit, avoidable=False)


def test_silence_stops_the_cautious_train_and_kills_with_the_published_rule() -> None:
    silence = replace(WORST, loss=1.0)
    assert not drive.run(EARLY, silence, CAUTIOUS)[0].collided
    hit, _ = drive.run(EARLY, silence, AS_PUBLISHED)
    assert hit.collided
    assert cause_of(hit, avoidable=True) == (
        "the train was not served before the last braking point: first state never"
    )


def test_causes_name_the_link_that_failed() -> None:
    hit, _ = drive.run(EARLY, replace(WORST, loss=1.0), AS_PUBLISHED)
    served = replace(hit, registered_s=5.0, last_point_s=60.0)
    assert "no report of the standing car" in cause_of(served, True)
    assert "30.0 s after the last" in cause_of(replace(served, station_knew_s=90.0), True)
    heard = replace(served, station_knew_s=50.0)
    assert "no busy signal" in cause_of(heard, True)
    assert "15.0 s after the station knew, 5.0 s after" in cause_of(
        replace(heard, train_knew_s=65.0), True
    )
    # the train knew in time and collided all the same: nothing explains that
    assert cause_of(replace(heard, train_knew_s=55.0), True) == ""


def test_every_avoidable_collision_is_reported() -> None:
    found = audit(8, 40, WORST, AS_PUBLISHED)
    assert found.unreported == 0
    assert len(found.unsafe) == found.collisions
    assert all(entry.cause for entry in found.unsafe)
    assert audit(4, 40, WORST, CAUTIOUS).avoidable == 0


def test_a_drive_is_kept(tmp_path: Path) -> None:
    result, traces = drive.run(EARLY, FIELD, CAUTIOUS)
    drive.save(tmp_path / "drive.db", result, traces)
    with closing(sqlite3.connect(tmp_path / "drive.db")) as connection:
        assert connection.execute("SELECT count(*) FROM message").fetchone() == (len(traces),)
        (summary,) = connection.execute("SELECT summary FROM drive").fetchone()
    assert json.loads(summary)["plan"]["seed"] == 3


SITUATION = ["80", "40", "0", "0", "1000", "500", "20", "50"]


def test_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    memory = str(tmp_path / "immune.db")
    drawing = tmp_path / "space.png"
    train = ["crossing", "train", memory, "--json", "--drawing", str(drawing)]
    assert cli.main(train) == 0
    assert drawing.stat().st_size > 10_000
    assert json.loads(capsys.readouterr().out)["coverage"]["low"] > 0.95
    assert cli.main(["crossing", "assess", *SITUATION, "--memory", memory, "--json"]) == 1
    judged = json.loads(capsys.readouterr().out)
    assert judged["alarm"] is True
    assert judged["collision_probability"] == pytest.approx(0.546, abs=0.001)
    assert cli.main(["crossing", "react", *SITUATION]) == 0
    assert "car -10.0 km/h" in capsys.readouterr().out
    record = str(tmp_path / "drive.db")
    assert cli.main(["crossing", "simulate", "--drives", "2", "--record", record, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unreported"] == 0
    assert cli.main(["crossing", "experiment", "--attempts", "1", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["comparisons"]) == 8
    assert list(document["tables"]) == [f"4.{number}" for number in range(1, 8)]
    assert [len(rows) for rows in document["tables"].values()] == [20, 20, 20, 4, 4, 4, 4]


def test_bad_input_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["crossing", "assess", "180", *SITUATION[1:]]) == 2
    assert "train_speed_kmh is 180.0 km/h" in capsys.readouterr().err
    assert cli.main(["crossing", "react", *SITUATION, "--car-age-s", "-3"]) == 2
    assert "from the future" in capsys.readouterr().err
    missing = str(tmp_path / "none.db")
    assert cli.main(["crossing", "assess", *SITUATION, "--memory", missing]) == 2
    assert "train one first" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ["train", "MEMORY"],
        ["react", *SITUATION],
        ["simulate", "--drives", "1"],
        ["experiment", "--attempts", "1"],
    ],
    ids=lambda command: command[0],
)
def test_a_seed_below_zero_is_one_sentence(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(tmp_path / "m.db") if word == "MEMORY" else word for word in command]
    assert cli.main(["crossing", *words, "--seed", "-1"]) == 2
    assert "seed is -1; expected a whole number in [0, 2^63]" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[[1, 2], [3]]",
        "[null]",
        '[{"a": 1}]',
        '[["80", "40", "0", "0", "1000", "500", "20", "50"]]',
        "[[NaN, 0, 0, 0, 0, 0, 0, 0]]",
        f"[[1{'0' * 400}, 0, 0, 0, 0, 0, 0, 0]]",
        f"[[{'1' * 5000}, 0, 0, 0, 0, 0, 0, 0]]",
        "[" * 100_000,
        "[" * 900 + "]" * 900,
    ],
    ids=range(11),
)
def test_safe_situations_that_are_none_are_one_sentence(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "safe.json"
    path.write_text(text)
    assert cli.main(["crossing", "train", str(tmp_path / "m.db"), "--safe", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "safe.json" in said


@pytest.mark.parametrize(
    ("about", "centres", "radii"),
    [
        ("nonsense", b"", b""),
        ("[1]", bytes(64), bytes(8)),
        ('{"method": "x", "seed": 1}', bytes(64), bytes(8)),
        ('{"self_radius": 0.2, "method": "x", "seed": 1}', bytes(63), bytes(8)),
        ('{"self_radius": 0.2, "method": "x", "seed": 1}', bytes(64), bytes(8)),
        ('{"self_radius": 0.2, "method": "x", "seed": 1, "units": "x"}', bytes(64), b"\x01" * 8),
        ("{}", "text", 7),
    ],
    ids=range(7),
)
def test_a_spoilt_memory_is_one_sentence(
    about: str, centres: object, radii: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "immune.db"
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE detector_set (id INTEGER, about, centres, radii)")
        row = (1, about, centres, radii)
        connection.execute("INSERT INTO detector_set VALUES (?, ?, ?, ?)", row)
    assert cli.main(["crossing", "assess", *SITUATION, "--memory", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "as immune memory" in said
