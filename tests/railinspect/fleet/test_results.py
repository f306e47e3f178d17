"""Data set, logbook, places and report of a fleet run."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime

import duckdb
import numpy as np
import pyarrow.parquet as pq
import pytest

from railinspect.cli import main
from railinspect.errors import BadInputError
from railinspect.fleet import dataset, fleet_report
from railinspect.fleet.budget import Budget, rate, read_budget
from railinspect.fleet.chosen import Choice, choose
from railinspect.fleet.clips import clip_of, top_events
from railinspect.fleet.coco import read_coco
from railinspect.fleet.drift import blocks_of, drift_of
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.logbook import enter_logbook
from railinspect.fleet.relabel import export_frames
from railinspect.fleet.run import inspect_fleet
from railinspect.fleet.totals import totals_of
from railinspect.fleet.view import view_of
from railinspect.inspect_settings import InspectSettings
from railinspect.labels import HUMAN
from railops.braking import Train
from tests.railinspect.fleet import made_run as made
from tests.railinspect.painted_ride import CAMERA, SPEED_MPS, paint, read_paint, ride, write_video


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A made run with its logbook, data set and report."""
    folder = tmp_path_factory.mktemp("fleet")
    run = made.made_run(folder)
    logbook = made.write_logbook(folder)
    status = main(
        ["fleet", "report", str(run), "--logbook", str(logbook), "--budget-per-hour", "500"]
    )
    assert status == 0
    return folder


@pytest.fixture
def own(base, tmp_path):
    """A copy of it that a test may change."""
    shutil.copytree(base, tmp_path / "own")
    return tmp_path / "own"


def frames_of(run, input_id=made.FIRST):
    return pq.read_table(dataset.table_paths(run, input_id)[0], partitioning=None)


def events_of(run, input_id=made.FIRST):
    return pq.read_table(dataset.table_paths(run, input_id)[1], partitioning=None).to_pylist()


def everything(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_frames_have_the_same_columns_in_every_file_and_the_right_values(base):
    run = base / "run"
    first, second = frames_of(run), frames_of(run, made.SECOND)
    assert first.schema.equals(dataset.FRAMES)
    assert second.schema.equals(dataset.FRAMES)
    row = first.slice(100, 1).to_pylist()[0]
    assert (row["input"], row["name"], row["line"]) == (made.FIRST, "ride <&> one", "Main <line>")
    assert (row["index"], row["time_s"], row["status"]) == (100, 10.0, "finding")
    assert row["time_utc"] == datetime(2026, 5, 1, 12, 0, 10, tzinfo=UTC)
    assert row["clock_hour"] == 14
    assert row["duration_s"] == pytest.approx(0.1)
    assert row["way_m"] == pytest.approx(2.0, abs=1e-4)
    assert row["latitude_deg"] == pytest.approx(50 + 200 * made.METRE_DEG, abs=1e-7)
    assert row["horizon_v_px"] == pytest.approx(made.CAMERA.horizon_v(), abs=1.0)
    assert row["spacing_per_row"] == pytest.approx(
        made.CAMERA.rail_spacing_m / made.CAMERA.height_m, rel=0.01
    )
    assert row["findings"][0]["range_low_m"] == 48.0
    assert row["findings"][0]["event_id"] == 1
    assert second["latitude_deg"].null_count == second["way_m"].null_count == len(second)
    assert set(second["line"].to_pylist()) == {"Branch"}


def test_an_events_place_is_its_range_further_along(base):
    located, trespasser = events_of(base / "run")
    assert located["latitude_deg"] == pytest.approx(50 + 250 * made.METRE_DEG, abs=1e-7)
    assert located["place"] == "ahead"
    assert trespasser["latitude_deg"] == pytest.approx(50 + 820 * made.METRE_DEG, abs=1e-7)
    assert trespasser["place"] == "train"
    assert events_of(base / "run", made.SECOND)[0]["place"] is None


def test_adding_an_input_again_changes_nothing(own):
    run = own / "run"
    before = everything(run)
    frames, events = dataset.table_paths(run, made.FIRST)
    for path in (frames, events, run / "report.html"):  # what a killed process leaves
        path.with_name(f".{path.name}.4711.part").write_bytes(b"half a fi")
    for one in finished_inputs(run):
        dataset.add(one.folder, run)
    fleet_report.write(run)
    assert everything(run) == before


def test_a_write_that_fails_leaves_what_was_there(own, monkeypatch):
    run = own / "run"
    before = everything(run)

    def broken(*_):
        yield {}
        raise OSError("disk full")

    monkeypatch.setattr(dataset, "_frame_rows", broken)
    with pytest.raises(OSError, match="disk full"):
        dataset.add(run / "inputs" / made.FIRST, run)
    assert everything(run) == before


def test_runs_lie_beside_each_other_and_are_told_apart(own):
    run = own / "run"
    state = json.loads((run / "fleet.json").read_text())
    (run / "fleet.json").write_text(json.dumps(state | {"run": "other"}))
    dataset.add(run / "inputs" / made.FIRST, run)
    query = f"""SELECT run, count(*) FROM read_parquet('{run}/dataset/frames/*/*.parquet',
        hive_partitioning = true) GROUP BY run ORDER BY run"""
    assert duckdb.sql(query).fetchall() == [(made.RUN_ID, 700), ("other", 600)]


def test_an_input_without_frames_has_empty_tables(own):
    run = own / "run"
    folder = made.write_input(run, "d" * 16, "empty", [], [])
    dataset.add(folder, run)
    assert frames_of(run, "d" * 16).schema.equals(dataset.FRAMES)
    assert len(frames_of(run, "d" * 16)) == 0
    fleet_report.write(run)


def test_times_do_not_span_holes(own):
    run = own / "run"
    frames = [made.frame(0, 0.0), made.frame(1, 0.5), made.frame(2, 100.0), made.frame(3, 100.25)]
    dataset.add(made.write_input(run, "e" * 16, "holes", frames, []), run)
    assert frames_of(run, "e" * 16)["duration_s"].to_pylist() == [0.5, 1.0, 0.25, 0.25]


@pytest.mark.parametrize("bad", ["../../x", "", "a/b", "a" * 65, "x.parquet"])
def test_no_id_leads_out_of_the_folder(own, bad):
    run = own / "run"
    summary = run / "inputs" / made.FIRST / "summary.json"
    summary.write_text(json.dumps(json.loads(summary.read_text()) | {"id": bad}))
    before = set(everything(own))
    with pytest.raises(BadInputError, match="is none a run writes"):
        dataset.add(summary.parent, run)
    assert set(everything(own)) == before


def test_geojson(base):
    document = json.loads((base / "run" / "events.geojson").read_text())
    assert document["type"] == "FeatureCollection"
    one, other = document["features"]
    assert one["geometry"] == {"type": "Point", "coordinates": [8.0, 50.0022483]}
    assert one["id"] == f"{made.FIRST}/1"
    assert one["properties"]["type"] == "obstruction"
    assert one["properties"]["time_utc"] == "2026-05-01T12:00:10+00:00"
    assert other["properties"]["place"] == "train"


def test_without_places_there_is_no_geojson(tmp_path):
    run = made.made_run(tmp_path)
    (run / "events.geojson").write_text("left from before")
    for one in finished_inputs(run):
        dataset.add(one.folder, run)
    fleet_report.write(run)
    assert not (run / "events.geojson").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no column input"),
        ("name,line\nride-2,A\n", "has no column input; known are input, line, vehicle"),
        ("input,speed\nride-2,A\n", r"has unknown columns \['speed'\]"),
        ("input\nnobody\n", "line 2: 'nobody' is no finished input"),
        ("input\nride-2\nride-2\n", "line 3: input ride-2 comes twice"),
        ("input,started\nride-2,2026-05-01T12:00:00\n", "line 2: time .* no clock time"),
        ("input,positions\nride-2,ride.gpx\n", "line 2: positions have clock times; say when"),
        ("input,started,positions\nride-2,2026-05-01T12:00:00Z,x.txt\n", "has an unknown ending"),
        (
            "input,started,positions\nride-2,2026-05-02T12:00:00Z,ride.gpx\n",
            "line 2: positions ride.gpx runs from -86400.0 s .* check when",
        ),
    ],
)
def test_a_bad_logbook_is_one_sentence_and_changes_nothing(own, text, message):
    (own / "bad.csv").write_text(text, encoding="utf-8")
    run = own / "run"
    before = everything(run)
    with pytest.raises(BadInputError, match=message):
        enter_logbook(own / "bad.csv", finished_inputs(run), run)
    assert everything(run) == before


def test_inputs_of_one_name_are_told_apart_by_id(own):
    run = own / "run"
    made.write_input(run, "d" * 16, "ride-2", [], [])
    (own / "two.csv").write_text("input\nride-2\n")
    with pytest.raises(BadInputError, match=f"may be {'b' * 16}, {'d' * 16}; write the id"):
        enter_logbook(own / "two.csv", finished_inputs(run), run)


def test_totals(base):
    totals = totals_of(base / "run")
    assert totals.all.known_s == pytest.approx(64.0)
    assert totals.all.unknown_s == pytest.approx(6.0)
    assert totals.all.way_m == pytest.approx(1080.0, abs=0.1)
    assert totals.all.wayless_s == pytest.approx(10.0)
    assert {k: v.total_s for k, v in totals.by_hour.items()} == pytest.approx({14: 60.0, 15: 10.0})
    assert set(totals.by_line) == {"Main <line>", "Branch"}
    assert {k: dict(v) for k, v in totals.by_range.items()} == {
        25.0: {"obstruction": 1},
        100.0: {"distortion": 1},
        None: {"trespasser": 1},
    }
    assert dict(totals.reasons_s) == pytest.approx({"only … pixels of rail were seen": 6.0})
    assert set(totals.blocks) == {"Unit 7"}


def test_without_a_clock_the_hour_is_unknown(tmp_path):
    run = made.made_run(tmp_path)
    for one in finished_inputs(run):
        dataset.add(one.folder, run)
    totals = totals_of(run)
    assert set(totals.by_hour) == {None}
    assert sum(totals.by_hour[None].events.values()) == 3
    # Without positions the way comes from the speed, where that is known.
    assert totals.all.way_m == pytest.approx(1080.0)


def test_the_report_says_what_was_seen_and_escapes_names(base):
    page = (base / "run" / "report.html").read_text()
    assert "<b>3 events</b> to look at: 1 distortion, 1 obstruction, 1 trespasser" in page
    assert "6 s (8.6%) are unknown: nothing is claimed" in page
    assert "ride &lt;&amp;&gt; one" in page
    assert "Main &lt;line&gt;" in page
    assert "cut &lt;off&gt;" in page
    for raw in ("<&>", "<line>", "<off>"):
        assert raw not in page
    assert "<td>3 in 0.02 h</td>" in page
    assert '<span class="badge s-clear">kept</span>' in page
    assert "no rate per kilometre" in page
    assert "default-src 'none'" in page
    assert "http" not in page.replace("http-equiv", "")


def test_the_report_of_a_run_without_results_is_a_doubt(tmp_path):
    run = tmp_path / "run"
    (run / "inputs").mkdir(parents=True)
    (run / "fleet.json").write_text(json.dumps({"run": made.RUN_ID, "inputs": []}))
    fleet_report.write(run)
    page = (run / "report.html").read_text()
    assert "No event, but not everything could be inspected" in page
    assert "<b>No event.</b>" not in page


def test_a_thumbnail_outside_the_input_is_not_shown(own):
    run = own / "run"
    (own / "secret.jpg").write_bytes(b"secret")
    lines = made.read_lines(run / "inputs" / made.FIRST / "events.jsonl")
    lines[0]["thumbnail"] = "../../../secret.jpg"
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (run / "inputs" / made.FIRST / "events.jsonl").write_text(text)
    dataset.add(run / "inputs" / made.FIRST, run)
    fleet_report.write(run)
    assert "c2VjcmV0" not in (run / "report.html").read_text()


def test_what_is_worst_comes_first():
    common = {"input": "a", "doubt": None}
    events = [
        {**common, "id": 1, "advice": "warn", "confidence": 0.9},
        {**common, "id": 2, "advice": "emergency", "confidence": 0.5, "doubt": "moves along"},
        {**common, "id": 3, "advice": None, "confidence": 1.0},
        {**common, "id": 4, "advice": "emergency", "confidence": 0.4},
        {**common, "id": 5, "advice": "emergency", "confidence": 0.6},
    ]
    assert [event["id"] for event in top_events(events, 4)] == [5, 4, 1, 3]


def test_a_clip_shows_the_moment_of_confirmation(tmp_path):
    pictures = [paint() for _ in range(60)]
    for index in range(30, 60):  # from 3 s on the picture is dark
        pictures[index] = pictures[index] // 4
    video = write_video(tmp_path / "ride.mp4", pictures, rate=10.0)
    frames = [made.frame(i, i / 10) for i in range(2)]
    folder = made.write_input(tmp_path, made.FIRST, "ride", frames, [], address=str(video))
    one = FinishedInput.read(folder)
    film = clip_of(made.event(1, 2.8), one)  # confirmed at 3 s, so the clip begins at 2 s
    assert film == clip_of(made.event(1, 2.8), one)
    (tmp_path / "clip.mp4").write_bytes(film)
    import av

    with av.open(str(tmp_path / "clip.mp4")) as container:
        shown = [f.to_ndarray(format="gray").mean() for f in container.decode(video=0)]
    assert 28 <= len(shown) <= 31
    assert min(shown[:9]) > 2 * max(shown[12:])
    (tmp_path / "ride.mp4").write_bytes(video.read_bytes()[:500])
    assert clip_of(made.event(1, 2.8), one) is None
    video.unlink()
    assert clip_of(made.event(1, 2.8), one) is None


def test_what_the_engine_writes_can_be_used(tmp_path):
    for name in ("one", "two"):
        write_video(tmp_path / f"{name}.mp4", ride([40.0 if name == "one" else 30.0], 32))
    run = tmp_path / "run"
    settings = InspectSettings(camera=CAMERA, train=Train(speed_mps=SPEED_MPS))
    inputs = [str(tmp_path / f"{name}.mp4") for name in ("one", "two")]
    inspect_fleet(inputs, run, lambda: read_paint, settings, engine="serial")
    assert main(["fleet", "report", str(run), "--json"]) == 0
    tables = [events_of(run, one.counts.id) for one in finished_inputs(run)]
    assert sorted(event["type"] for rows in tables for event in rows) == ["trespasser"] * 2
    totals = totals_of(run)
    assert totals.all.total_s == pytest.approx(2 * 32 / 12.5)
    assert totals.all.way_m == pytest.approx(SPEED_MPS * totals.all.known_s)
    page = (run / "report.html").read_text()
    assert page.count("<video") == 2
    assert str(tmp_path) not in page
    chosen = choose(run, Choice(events=2, unknown=0))
    done = export_frames(run, chosen, tmp_path / "out", read_paint)
    assert (done.pictures, done.missing) == (2, ())
    # What is seen best is on the picture that is exported.
    for one in read_coco(tmp_path / "out" / "coco.json"):
        assert (one.mask == HUMAN).sum() > 200


# Bounds of a Poisson mean at 95 %: 0 → (0, 3.688879), 1 → (0.025318, 5.571643),
# 5 → (1.623486, 11.668332), 10 → (4.795389, 18.390356). Garwood's table.
@pytest.mark.parametrize(
    ("alarms", "low", "high"),
    [
        (0, 0.0, 3.688879),
        (1, 0.025318, 5.571643),
        (5, 1.623486, 11.668332),
        (10, 4.795389, 18.390356),
    ],
)
def test_rates_have_garwoods_bounds(alarms, low, high):
    one = rate(alarms, 2.0)
    assert (one.low * 2, one.high * 2) == pytest.approx((low, high), abs=1e-6)


def test_a_budget_is_open_where_the_interval_holds_it():
    assert rate(0, 1.0).against(3.0) == "open"
    assert rate(0, 1.0).still_needed(3.0) == pytest.approx(0.22963, abs=1e-5)
    assert rate(0, 1.3).against(3.0) == "kept"
    assert rate(10, 1.0).against(4.0) == "broken"
    assert rate(10, 0.0).against(1e9) == "open"
    with pytest.raises(BadInputError, match="budget per_km is 0; give a positive number"):
        Budget(per_km=0)


def test_a_budget_stays_with_its_run(own, capsys):
    run = own / "run"
    assert main(["fleet", "report", str(run), "--budget-per-km", "0.1", "--json"]) == 0
    assert read_budget(run) == Budget(500.0, 0.1)
    assert json.loads(capsys.readouterr().out)["paths"]["places"]


def minutes(camera_of, rng, count=30, noise_px=0.5):
    blocks = []
    for minute in range(count):
        views = []
        for _ in range(12):
            camera = camera_of(minute)
            row = {"followed": True, "rails": made.rails(camera, noise_px, rng)}
            view = view_of(row)
            views.append((view.horizon_v_px, view.spacing_per_row))
        horizon, spacing = np.array(views).T
        columns = {
            "horizon_v_px": horizon,
            "spacing_per_row": spacing,
            "vanishing_u_px": np.full(12, 320.0),
        }
        blocks += blocks_of(np.arange(12) * 5.0, columns, made.SIZE_WH, 60.0 * minute)
    return blocks


def test_a_camera_that_tilts_drifts_and_one_that_shakes_does_not():
    from dataclasses import replace

    rng = np.random.default_rng(5)
    shaking = minutes(lambda _: replace(made.CAMERA, pitch_rad=0.045 + rng.normal(0, 0.002)), rng)
    assert {one.quantity: one.drifts for one in drift_of(shaking)} == {
        "horizon_v_px": False,
        "vanishing_u_px": False,
        "spacing_per_row": False,
    }
    # 5 mrad over half an hour: 686 px · 0.005 · cos⁻² ≈ 3.4 px up.
    tilting = minutes(lambda m: replace(made.CAMERA, pitch_rad=0.045 + 0.005 * m / 29), rng)
    found = {one.quantity: one for one in drift_of(tilting)}
    assert found["horizon_v_px"].drifts
    assert found["horizon_v_px"].change == pytest.approx(-3.44, abs=0.4)
    assert found["horizon_v_px"].change_low < -3.44 < found["horizon_v_px"].change_high
    lower = minutes(lambda m: replace(made.CAMERA, height_m=2.6 - 0.1 * m / 29), rng)
    assert {one.quantity: one.drifts for one in drift_of(lower)}["spacing_per_row"]


def test_a_crest_far_ahead_moves_the_horizon_little():
    rails = made.rails()
    for line in rails.values():
        for index in range(15):  # of 40 points, those beyond 23 m lie up to 3 px higher
            line[index][1] -= 0.2 * (15 - index)
    view = view_of({"followed": True, "rails": rails})
    assert view.horizon_v_px == pytest.approx(made.CAMERA.horizon_v(), abs=0.5)


def test_five_minutes_are_needed_to_speak_of_drift():
    rng = np.random.default_rng(5)
    assert all(one.drifts is None for one in drift_of(minutes(lambda _: made.CAMERA, rng, 4)))
    assert drift_of([]) == []


def test_the_way_through_tables_does_not_depend_on_order(own):
    run = own / "run"
    before = (run / "report.html").read_bytes()
    shutil.rmtree(run / "dataset")
    dataset.add(finished_inputs(run)[1].folder, run)
    fleet_report.write(run)  # adds what is missing
    assert (run / "report.html").read_bytes() == before
    assert not list(run.rglob("*.part"))
