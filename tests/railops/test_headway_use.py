"""Using characteristics: worked example, both printed tables, the line, calibration, output."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railops.cli import main
from railops.errors import DomainError, RailOpsError
from railops.headway import (
    Plan,
    Section,
    Succession,
    Unknowns,
    calibrate,
    characteristic,
    choose_run_time,
    find_section,
    load_section,
    regulate_line,
)
from railops.headway.animate import animation
from railops.headway.draw import heat_map, speed_distance, surface, time_distance
from railops.headway.published import MOSCOW, ZHENGZHOU
from railops.headway.stairway import stairway
from railops.traction import Davis
from tests.railops.test_files_with_errors import INFRASTRUCTURE
from tests.railops.test_headway_files import PATH, TRAIN


def test_worked_example():
    # 18:20:00 in front, 18:21:45 ours, 5 s late, 3 s predicted: 106 > 105, then 104 < 105.
    order = choose_run_time(ZHENGZHOU, 120, 120, 105, late_s=5, front_delay_s=3)
    assert [(t.run_s, t.required_s, t.feasible) for t in order.trials] == [
        (115.0, 106.0, False),
        (120.0, 104.0, True),
    ]
    assert (order.run_s, order.feasible, order.hold_s, order.delay_left_s) == (120, True, 0, 5)


@pytest.mark.parametrize(
    ("published", "name", "count", "bar_s"),
    [(MOSCOW, "moscow", 15, 1.0), (ZHENGZHOU, "zhengzhou", 36, 3.0)],
)
def test_calibrated_sections_reproduce_the_printed_tables(published, name, count, bar_s):
    assert int(np.sum(~np.isnan(published.interval_s()))) == count
    section = find_section(name)
    assert 0.6 <= section.stock.brake_mps2 <= 1.2
    assert 0.7 <= section.stock.effort.accel_mps2 <= 1.4
    table = characteristic(section, published.second_s.tolist(), published.first_s.tolist())
    residual = table.interval_s(20.0) - published.interval_s()
    assert float(np.sqrt(np.nanmean(residual**2))) <= bar_s


@pytest.mark.parametrize("published", [MOSCOW, ZHENGZHOU])
def test_printed_tables_are_the_run_time_in_front_plus_one_function(published):
    rest = published.after_s - published.first_s[None, :]
    assert np.all(np.nanmax(rest, axis=1) - np.nanmin(rest, axis=1) <= 1.0)  # rounding twice
    assert np.all(np.diff(np.nanmean(rest, axis=1)) < 0.0)  # slower behind: shorter


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 200.0), st.floats(0.0, 60.0), st.floats(60.0, 200.0))
def test_more_room_or_less_delay_never_hurts(late, front_delay, interval):
    order = choose_run_time(ZHENGZHOU, 110, 120, interval, late, front_delay_s=front_delay)
    roomier = choose_run_time(ZHENGZHOU, 110, 120, interval + 7.0, late, front_delay_s=front_delay)
    # The paper's rule lengthens before it holds, so only a feasible order can be compared: near a
    # jump, a short hold and a fast run may arrive before a long run that needs no hold.
    if order.feasible:
        assert roomier.feasible
        assert roomier.run_s <= order.run_s
    assert order.feasible == (order.hold_s == 0.0)
    assert interval + order.hold_s >= order.required_s - 1e-9


def test_lookup_between_columns_takes_the_longer_and_rows_do_not_interpolate():
    assert ZHENGZHOU.required_s(100, 112) == ZHENGZHOU.required_s(100, 115) == 101.0
    assert ZHENGZHOU.required_s(130, 95) == 94.0  # none printed: the next faster stands in
    with pytest.raises(DomainError, match="run time is 112 s; expected one of 95, 100, 105"):
        ZHENGZHOU.required_s(112, 120)
    with pytest.raises(DomainError, match="in front is 90 s; expected 95 … 130 s"):
        ZHENGZHOU.required_s(100, 90)
    with pytest.raises(DomainError, match="late_s is -1 s"):
        choose_run_time(ZHENGZHOU, 120, 120, 100, late_s=-1)
    with pytest.raises(DomainError, match="planned run time is 200 s; expected at most 130 s"):
        choose_run_time(ZHENGZHOU, 120, 200, 100)


def test_a_line_keeps_every_interval():
    tables = [ZHENGZHOU, MOSCOW]
    trains = [
        Plan(0.0, (120, 153), (20, 20)),
        Plan(100.0, (120, 153), (20, 20), late_s=5.0, dwell_delay_s=(3.0, 0.0)),
        Plan(190.0, (120, 153), (20, 20)),
    ]
    passages = regulate_line(tables, trains)
    assert len(passages) == 6
    for item in passages[2:]:
        ahead = passages[2 * (item.train - 1) + item.section]
        delay = trains[item.train - 1].dwell_delay_s
        dwell = 20.0 + (delay[item.section] if delay else 0.0)
        run = item.arrive_s - item.depart_s
        needed = tables[item.section].required_s(run, ahead.arrive_s - ahead.depart_s, dwell)
        assert item.depart_s - ahead.depart_s >= needed - 1e-9
    with pytest.raises(DomainError, match=r"trains\[0\].dwell_s is 1 values; expected one per sec"):
        regulate_line(tables, [Plan(0.0, (120, 153), (20,))])


def test_the_critical_block_touches():
    pair = Succession(find_section("zhengzhou"))
    blocks, critical = stairway(pair, 95.0, 130.0, 20.0)
    assert critical.slack_s == 0.0
    assert min(block.slack_s for block in blocks) == 0.0
    needed = [block.needed_s for block in blocks]
    assert needed == sorted(needed)


def test_calibration_finds_what_made_a_table():
    truth = Unknowns(length_m=1450.0, pitch_m=110.0)
    section = replace(truth.section((0.0, 40.0, 60.0, 70.0, 80.0)), name="truth")
    times = Succession(section).regulator.shortest_s + np.array([3.0, 8.0, 14.0, 21.0])
    table = characteristic(section, times.round(1).tolist())
    bounds = {"length_m": (1400.0, 1500.0), "delay_s": (0.5, 5.0)}
    found = calibrate(table, bounds, truth, generations=5, seed=3)
    assert found.rms_s < 0.2
    by_name = {item.name: item for item in found.estimates}
    assert by_name["length_m"].value == pytest.approx(1450.0, abs=8.0)
    assert by_name["length_m"].verdict == "identified"
    again = calibrate(table, bounds, truth, generations=5, seed=3)
    assert again.rms_s == found.rms_s
    with pytest.raises(DomainError, match="unknown is colour; expected one of length_m"):
        calibrate(table, {"colour": (0.0, 1.0)})
    with pytest.raises(DomainError, match=r"length_m is 5 … 5; expected a lower bound below"):
        calibrate(table, {"length_m": (5.0, 5.0)})
    with pytest.raises(RailOpsError, match="no section within the bounds can be run"):
        calibrate(table, {"length_m": (4000.0, 4100.0)}, generations=1)


def test_pictures_are_complete_svg_without_network():
    pair = Succession(find_section("zhengzhou"))
    table = characteristic(pair.section)
    arguments = (pair, 100.0, 120.0, 20.0, 110.0)
    for svg in (
        heat_map(table),
        surface(table),
        heat_map(ZHENGZHOU),
        surface(ZHENGZHOU),
        time_distance(*arguments),
        speed_distance(*arguments),
    ):
        assert svg.startswith("<svg")
        assert svg.endswith("</svg>\n")
        assert "nan" not in svg
        assert set(re.findall(r"https?://[^\"]+", svg)) == {"http://www.w3.org/2000/svg"}


def test_the_animated_page_carries_its_data():
    pair = Succession(Section(1500.0))
    page = animation(pair, 110.0, 115.0, 20.0, 40.0)
    assert "http" not in page
    data = json.loads(re.search(r"const data = (.*);\n", page)[1])
    assert data["violation"] is not None
    assert len(data["front"]) == len(data["second"]) == len(data["permitted"])


def run(capsys, *words):
    status = main(["headway", *map(str, words)])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_commands(capsys, tmp_path):
    status, out, _ = run(
        capsys, "characteristic", "zhengzhou", "--json", "--csv", tmp_path / "t.csv",
        "--parquet", tmp_path / "t.parquet", "--plots", tmp_path / "plots",
        "--store", tmp_path / "s.db", "--dwell", 25,
    )  # fmt: skip
    document = json.loads(out)
    assert status == 0
    assert len(document["intervals"]) == 64
    assert len(document["files"]) == 6
    status, out, _ = run(
        capsys, "check", "published-zhengzhou", "--front-run", 120, "--planned-run", 120,
        "--front-departure", "18:20:00", "--planned-departure", "18:21:40",
        "--departure", "18:21:45", "--front-delay", 3,
    )  # fmt: skip
    assert status == 0
    assert "needs 106.0 s: 105.0 s < 106.0 s, not feasible" in out
    assert "order 120 s" in out
    line = tmp_path / "line.yaml"
    line.write_text(
        "sections: [published-zhengzhou]\ntrains:\n"
        "  - {depart_s: 0, run_s: [120], dwell_s: [20]}\n"
        "  - {depart_s: 60, run_s: [120], dwell_s: [20]}\n"
    )
    status, out, _ = run(capsys, "line", line, "--json")
    assert status == 1
    assert json.loads(out)["held"] == 1
    page = tmp_path / "a.html"
    words = ("--second-run", 100, "--front-run", 110, "--out", page)
    status, out, _ = run(capsys, "animate", "zhengzhou", *words)
    assert status == 0
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("name", "published", "bar_s"), [("moscow", MOSCOW, 1.0), ("zhengzhou", ZHENGZHOU, 3.0)]
)
def test_calibrate_command_in_short(name, published, bar_s, capsys, tmp_path):
    """Two unknowns free, the others as in the built-in section, to either printed table."""
    section, davis = find_section(name), Davis()
    stock, protection = section.stock, section.protection
    first = protection.circuits[0]
    fixed = {
        "length_m": section.length_m,
        "accel_mps2": stock.effort.accel_mps2,
        "power_w_per_kg": stock.effort.power_w_per_kg,
        "resistance": stock.davis.c0 / davis.c0,
        "brake_mps2": stock.brake_mps2,
        "train_m": stock.length_m,
        "pitch_m": first[1] - first[0],
        "offset_m": first[1] % (first[1] - first[0]),
        "design_decel_mps2": protection.design_decel_mps2,
        "design_delay_s": protection.design_delay_s,
    }
    words = [f"--fix={key}={value}" for key, value in fixed.items()]
    out = tmp_path / "fitted.yaml"
    words += ["--generations", 4, "--seed", 1, "--out", out, "--json"]
    status, text, _ = run(capsys, "calibrate", f"published-{name}", *words)
    document = json.loads(text)
    assert status == 0
    assert document["rms_s"] <= bar_s
    assert [item["name"] for item in document["estimates"]] == ["overlap_m", "delay_s"]
    for item in document["estimates"]:
        low, high = item["bounds"]
        assert low <= item["equally_good"][0] <= item["value"] <= item["equally_good"][1] <= high
    assert np.isfinite(np.array(document["residual_s"], float)).sum() == np.sum(
        ~np.isnan(published.interval_s())
    )
    fitted = load_section(out)
    table = characteristic(fitted, published.second_s.tolist(), published.first_s.tolist())
    residual = table.interval_s(20.0) - published.interval_s()
    assert np.sqrt(np.nanmean(residual**2)) == pytest.approx(document["rms_s"], abs=1e-9)


def test_convert_command(capsys, tmp_path):
    path, train, infra = (tmp_path / name for name in ("path.yaml", "train.yaml", "infra.json"))
    path.write_text(PATH, encoding="utf-8")
    train.write_text(TRAIN, encoding="utf-8")
    infra.write_text(json.dumps(INFRASTRUCTURE), encoding="utf-8")
    out = tmp_path / "out.yaml"
    status, text, _ = run(capsys, "convert", path, "--train", train, "--out", out)
    assert status == 0
    assert "hilly, 2000 m, shortest run time" in text
    assert load_section(out).stock.length_m == 80.0
    words = ("--tracks=t0,-t1", "--from-m", 100, "--to-m", 1600, "--out", out)
    status, text, _ = run(capsys, "convert", infra, *words, "--json")
    assert status == 0
    assert json.loads(text)["length_m"] == 1500.0
    status, _, error = run(capsys, "convert", infra, "--tracks", "t0", "--out", out)
    assert status == 2
    assert "--to-m is missing; expected the next stop" in error
    status, _, error = run(capsys, "characteristic", out, "--run-times", "1000,1001")
    assert status == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("characteristic", "zhengzhou", "--run-times", "50,100"), "run time over zhengzhou is 50"),
        (("characteristic", "zhengzhou", "--dwell", "-1"), "dwell_s is -1.0 s"),
        (("characteristic", "zhengzhou", "--dwell", "1", "--probability", "0.9"), "no --dwell"),
        (("calibrate", "published-moscow", "--fix", "colour=1"), "colour is none of length_m"),
        (("calibrate", "published-moscow", "--fix", "train_m"), "expected NAME=VALUE"),
        (("calibrate", "nowhere.csv"), "cannot read nowhere.csv"),
    ],
)
def test_commands_say_what_is_wrong(capsys, words, message):
    status, out, err = run(capsys, *words)
    assert status == 2
    assert not out
    assert message in err
    assert err.count("\n") == 1


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_characteristic_is_linear_in_the_dwell(one, other):
    table = characteristic(Section(1500.0), [100.0, 110.0], name_critical=False)
    dwell = table.linear_from_s.max() + np.array([one, other])
    difference = table.interval_s(float(dwell[1])) - table.interval_s(float(dwell[0]))
    assert difference == pytest.approx(np.full((2, 2), dwell[1] - dwell[0]), abs=1e-9)
