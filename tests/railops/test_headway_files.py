"""Files, store, tables and other formats: round trips, and complaints that name the place."""

import json

import numpy as np
import pyarrow.parquet
import pytest

from railops.errors import DomainError, FileError
from railops.headway import (
    FixedBlock,
    MovingBlock,
    Section,
    Stock,
    TrackCircuits,
    characteristic,
    content_hash,
    find_section,
    load_section,
    save_section,
)
from railops.headway.interchange import osrd_section, railtoolkit_path, railtoolkit_train
from railops.headway.lines import load_line
from railops.headway.published import ZHENGZHOU
from railops.headway.store import Store
from railops.headway.tables import as_text, read_csv, write_csv, write_parquet

GOOD = """\
length_m: 700
gradients: [[0, 0.0], [300, -0.01]]
limits_kmh: [[0, 80]]
run_times_s: {from: 60, to: 70, step: 5}
dwell: {mean_s: 20, std_s: 3}
stock: {length_m: 120, brake_mps2: 0.9, effort: {accel_mps2: 1.0, power_w_per_kg: 12}}
protection:
  kind: track_circuits
  circuits:
    - [-150, 30]
    - [30, 330]
    - [330, 800]
    - [800, 1100]
    - [1100, 1500]
  codes: [[0, 0], [1, 40], [2, 80]]
"""


def write(folder, text, name="section.yaml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_and_written_back(tmp_path):
    section = load_section(write(tmp_path, GOOD))
    assert section.run_times_s == (60.0, 65.0, 70.0)
    assert section.protection.circuits[1] == (30.0, 330.0)
    assert section.line.gradients == ((0.0, 0.0), (300.0, -0.01))
    for protection in (section.protection, MovingBlock(), FixedBlock(((-50, 400), (400, 900)))):
        other = section.with_protection(protection)
        save_section(other, tmp_path / "again.yaml", "a note\nof two lines")
        assert load_section(tmp_path / "again.yaml") == other


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[330, 800]", "[340, 800]", r"line 12: protection.circuits\[2\] is \[340, 800\] m; "
         r"expected a start at 330 m, where the one before ends \(it leaves a gap of 10 m\)"),
        ("[330, 800]", "[320, 800]", r"line 12: .*it overlaps the one before by 10 m"),
        ("[330, 800]", "[330, 300]", r"line 12: .*an end beyond its start"),
        ("[[0, 0], [1, 40]", "[[1, 40]", r"line 15: .*codes\[0\] is .* \(a table without stop\)"),
        ("[1, 40], [2, 80]", "[1, 40], [2, 30]", r"line 15: .*no lower speed than the entry"),
        ("codes: [[0, 0], [1, 40], [2, 80]]", "steps_kmh: [40, 80]", r"line 15: .*0 km/h among"),
        ("codes:", "steps_kmh: [0, 40]\n  codes:", "either codes or steps_kmh, not both"),
        ("length_m: 700", "length_m: -700", r"line 1: length_m is -700.*a number in \(0, 50000\]"),
        ("length_m: 700\n", "", "length_m is missing"),
        ("length_m: 120", "length_m: 900", r"line 6: stock.length_m is 900 m; expected a train s"),
        ("length_m: 120", "length_m: long", r"line 6: stock.length_m is long m"),
        ("brake_mps2", "brakes", r"line 6: stock: unknown key 'brakes'; known: \['brake_mps2'"),
        ("kind: track_circuits", "kind: magic", r"line 8: protection.kind is 'magic'"),
        ("[[0, 80]]", "[[0, 800]]", r"line 3: limits_kmh\[0\] speed is 800.0 km/h"),
        ("[[0, 80]]", "[[0, 80], [0, 60]]", r"line 3: limits_kmh\[1\] position is 0 m"),
        ("[[0, 80]]", "fast", "line 3: limits_kmh is fast; expected a list of"),
        ("step: 5", "step: -5", "line 4: run_times_s: from, to and step must be numbers"),
        ("{from: 60, to: 70, step: 5}", "[70, 60]", r"line 4: run_times_s\[1\] is 60 s; expected"),
        ("[300, -0.01]", "[300, -10]", "line 2: gradients is|gradient is -10.0 m/m"),
        ("    - [800, 1100]\n    - [1100, 1500]\n", "", r"no code ever lets a train into circuits"),
        ("    - [-150, 30]\n", "", r"line 10: protection.circuits\[0\] is from 30 m"),
        ("mean_s: 20", "mean_s: -1", r"line 5: dwell.mean_s is -1 s"),
        (GOOD, "- 1", "must hold a mapping"),
        (GOOD, "a: [", "cannot read .*section.yaml"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(FileError, match=message) as caught:
        load_section(write(tmp_path, GOOD.replace(old, new)))
    assert "\n" not in str(caught.value)


def test_a_missing_file_lists_the_built_in_sections():
    with pytest.raises(FileError, match=r"no section file nowhere; built in are \['moscow', 'zh"):
        find_section("nowhere")


def test_built_in_sections_load_and_run():
    for name in ("moscow", "zhengzhou"):
        section = find_section(name)
        assert section.name == name
        assert np.all(np.isfinite(characteristic(section).interval_s()))


def test_store_versions_by_content(tmp_path):
    with Store(tmp_path / "sections.db") as store:
        first = Section(1500.0, name="A")
        table, fresh = store.characteristic(first, [100.0, 110.0])
        assert fresh
        store.put(Section(1500.0, name="A"))
        assert len(store.versions("A")) == 1
        changed = Section(1510.0, name="A")
        store.put(changed)
        assert [v.hash for v in store.versions("A")] == [content_hash(first), content_hash(changed)]
        assert store.section(content_hash(changed)) == changed
        with pytest.raises(FileError, match="no section with the hash 00"):
            store.section("00")
    with Store(tmp_path / "sections.db") as store:
        again, fresh = store.characteristic(first, [110.0])
        assert not fresh
        assert again.interval_s(33.0) == pytest.approx(table.interval_s(33.0)[1:, 1:], abs=0.0)
        _, fresh = store.characteristic(first, [105.0, 110.0])
        assert fresh
    (tmp_path / "text.db").write_text("this is no database, but it is long enough to look at")
    with pytest.raises(FileError, match=r"cannot open .*text\.db as a database"):
        Store(tmp_path / "text.db")


def test_tables_round_trip(tmp_path):
    write_csv(ZHENGZHOU, tmp_path / "t.csv")
    again = read_csv(tmp_path / "t.csv")
    assert np.array_equal(again.interval_s(), ZHENGZHOU.interval_s(), equal_nan=True)
    write_parquet(ZHENGZHOU, tmp_path / "t.parquet", 30.0)
    rows = pyarrow.parquet.read_table(tmp_path / "t.parquet").to_pylist()
    assert len(rows) == 36
    assert rows[0] == {
        "interval_s": 104.0, "run_s": 130.0, "front_run_s": 130.0, "dwell_s": 30.0,
        "linear_from_dwell_s": 0.0,
    }  # fmt: skip
    assert "94.0" in as_text(ZHENGZHOU)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "line 1: missing columns"),
        ("interval_s,run_s,front_run_s,dwell_s\n1,2,x,4\n", "line 2: .* are not all numbers"),
        ("interval_s,run_s,front_run_s,dwell_s\n-1,2,3,4\n", "line 2: times must be positive"),
        ("interval_s,run_s,front_run_s,dwell_s\n90,inf,3,4\n", "line 2: times must be positive"),
        ("interval_s,run_s,front_run_s,dwell_s\n90,nan,3,4\n", "line 2: times must be positive"),
        ("interval_s,run_s,front_run_s,dwell_s\n", "has no rows"),
        ("interval_s,run_s,front_run_s,dwell_s\n9,2,3,4\n9,2,4,5\n", "mixes dwells"),
    ],
)
def test_wrong_tables(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        read_csv(write(tmp_path, text, "t.csv"))


def test_line_file(tmp_path):
    text = (
        "sections: [published-zhengzhou]\ntrains:\n  - {depart_s: 0, run_s: [120], dwell_s: [20]}\n"
    )
    line = load_line(write(tmp_path, text))
    assert line.trains[0].run_s == (120,)
    for old, new, message in (
        ("published-zhengzhou", "nowhere", r"line 1: sections\[0\]: no section 'nowhere'"),
        ("run_s: [120]", "run_s: [120, 1]", r"line 3: trains\[0\].run_s is 2 values"),
        ("depart_s", "departs", r"line 3: trains\[0\]: unknown key 'departs'"),
        ("trains", "trams", "trains is missing"),
    ):
        with pytest.raises(FileError, match=message):
            load_line(write(tmp_path, text.replace(old, new)))


PATH = """\
schema: https://railtoolkit.org/schema/running-path.json
schema_version: "2022.05"
paths:
  - name: hilly
    id: hilly
    characteristic_sections:
      - [1000.0, 80, 0.0]
      - [1500.0, 60, 5.0]
      - [3000.0, 60, 0.0]
"""
TRAIN = """\
schema: https://railtoolkit.org/schema/rolling-stock.json
schema_version: "2022.05"
trains:
  - {name: unit, id: unit, formation: [car, car]}
vehicles:
  - {name: car, id: car, vehicle_type: multiple unit, length: 40, mass: 50, a_braking: -0.6,
     rotation_mass: 1.08, base_resistance: 2.0, rolling_resistance: 1.0, air_resistance: 3.0,
     tractive_effort: [[0, 54000], [36, 54000], [72, 27000], [108, 18000]]}
"""


def test_railtoolkit(tmp_path):
    stock = railtoolkit_train(write(tmp_path, TRAIN, "train.yaml"))
    assert stock.length_m == 80.0
    assert stock.effort.accel_mps2 == pytest.approx(1.0)
    assert stock.effort.power_w_per_kg == pytest.approx(10.0)
    assert stock.davis.c0 == pytest.approx(2e-3 * 9.80665)
    assert stock.brake_mps2 == 0.6
    section = railtoolkit_path(write(tmp_path, PATH, "path.yaml"), "hilly", stock)
    assert section.length_m == 2000.0
    assert section.limits_kmh == ((0.0, 80.0), (500.0, 60.0))
    assert section.line.gradients[1] == pytest.approx((500.0, 0.005), rel=1e-4)
    later = PATH.replace("2022.05", "2024.07").replace(
        "- [1000.0, 80, 0.0]\n      - [1500.0, 60, 5.0]\n      - [3000.0, 60, 0.0]",
        "- {position: 1000, speed: 80}\n      - {position: 1500, speed: 60, resistance: 5}\n"
        "      - {position: 3000, speed: 60}",
    )
    assert railtoolkit_path(write(tmp_path, later, "later.yaml"), stock=stock) == section
    with pytest.raises(FileError, match="has no path flat; it has"):
        railtoolkit_path(tmp_path / "path.yaml", "flat")
    broken = write(tmp_path, PATH.replace("[1500.0, 60, 5.0]", "[1500.0, 60]"), "broken.yaml")
    with pytest.raises(FileError, match=r"characteristic_sections\[1\] is \[1500.0, 60\]"):
        railtoolkit_path(broken)
    with pytest.raises(FileError, match=r"train\.yaml: train unit lacks 'mass'"):
        railtoolkit_train(write(tmp_path, TRAIN.replace("mass: 50, ", ""), "train.yaml"))


def test_osrd(tmp_path):
    infra = {
        "track_sections": [
            {"id": "t0", "length": 1000.0,
             "slopes": [{"begin": 200, "end": 600, "gradient": -10}], "curves": []},
            {"id": "t1", "length": 1500.0, "slopes": [],
             "curves": [{"begin": 0, "end": 500, "radius": -400}]},
        ],
        "speed_sections": [{"id": "v", "speed_limit": 15.0, "track_ranges": [
            {"track": "t1", "begin": 0, "end": 1500, "applicable_directions": "BOTH"}]},
            {"id": "w", "speed_limit": 5.0, "track_ranges": [
            {"track": "t1", "begin": 0, "end": 1500, "applicable_directions": "STOP_TO_START"}]}],
        "detectors": [{"id": f"d{i}", "track": "t0", "position": 250.0 * i} for i in range(1, 4)]
        + [{"id": f"e{i}", "track": "t1", "position": 300.0 * i} for i in range(1, 5)],
    }  # fmt: skip
    path = write(tmp_path, json.dumps(infra), "infra.json")
    section = osrd_section(path, ["t0", "t1"], 100.0, 1600.0)
    assert section.length_m == 1500.0
    assert section.line.gradients == ((0.0, 0.0), (100.0, -0.01), (500.0, 0.0))
    assert section.limits_kmh == ((0.0, 80.0), (900.0, 54.0), (2400.0, 80.0))
    assert section.protection.blocks[:2] == ((-100.0, 150.0), (150.0, 400.0))
    back = osrd_section(path, ["-t1", "-t0"], 0.0, 2000.0, steps_kmh=(0, 40, 80))
    assert isinstance(back.protection, TrackCircuits)
    assert (1900.0, 0.01) in back.line.gradients  # 600 m from its begin, now climbing
    assert back.limits_kmh == ((0.0, 18.0), (1500.0, 80.0))  # the limit of the other direction
    with pytest.raises(FileError, match="has no track t9"):
        osrd_section(path, ["t9"], 0.0, 100.0)
    with pytest.raises(FileError, match="as RailJSON infrastructure"):
        osrd_section(write(tmp_path, "{}", "x.json"), ["t0"], 0.0, 100.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stock(length_m=0.0), r"length_m is 0.0 m; expected a number in \(0, 2000\] m"),
        (lambda: FixedBlock(()), "blocks is empty; expected at least one"),
        (lambda: FixedBlock((1, 2)), r"blocks is \(1, 2\); expected a list of \[start_m, end_m\]"),
        (lambda: MovingBlock(report_m=0.0), "report_m is 0.0 m"),
        (lambda: Section(500.0, FixedBlock(((0, 400),))), r"protection.blocks\[0\] is to 400 m"),
        (lambda: TrackCircuits(((0, 9),), codes=((0, 0),)), "a code above 0 km/h as its last"),
    ],
)
def test_wrong_values(make, message):
    with pytest.raises(DomainError, match=message):
        make()
