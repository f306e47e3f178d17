"""Speed logs: what they say between entries and beyond them, and how their files are read."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.errors import BadInputError
from railinspect.speed_files import constant_speed_mps, read_speed_log
from railinspect.speed_log import CHANGE_MPS2, SpeedLog

NOON = datetime(2026, 5, 1, 12, 0, 0, tzinfo=UTC)


@given(
    st.lists(st.floats(-CHANGE_MPS2, CHANGE_MPS2), min_size=4, max_size=40),
    st.integers(1, 12),
    st.floats(0.0, 1.0),
)
def test_the_error_covers_every_drive_a_train_can_make(accelerations, every, share):
    # A drive in steps of 0.25 s, of which the log holds each n-th moment only.
    speed = np.maximum(20.0 + 0.25 * np.cumsum([0.0, *accelerations]), 0.0)
    times = 0.25 * np.arange(speed.size)
    kept = np.unique([*range(0, speed.size, every), speed.size - 1])
    log = SpeedLog("drive", times[kept], speed[kept])
    at = share * times[-1]
    read = log.at(at)
    assert read is not None
    assert abs(read.speed_mps - np.interp(at, times, speed)) <= read.error_mps + 1e-9


def test_entries_are_exact_and_their_own_errors_stay():
    log = SpeedLog("log", [0.0, 1.0, 2.0], [10.0, 11.0, 11.5], [0.2, 0.4, 0.1])
    assert (log.at(1.0).speed_mps, log.at(1.0).error_mps) == (11.0, 0.4)
    # Half-way on a slope of 0.5: min((1.5 + 0.5)·0.5, (1.5 − 0.5)·0.5) = 0.5 on top of 0.4.
    assert log.at(1.5).speed_mps == pytest.approx(11.25)
    assert log.at(1.5).error_mps == pytest.approx(0.9)


def test_beyond_the_span_and_in_long_gaps_nothing_is_known():
    log = SpeedLog("log", [5.0, 6.0, 30.0], [10.0, 10.0, 10.0])
    assert log.at(4.999) is None
    assert log.at(30.001) is None
    assert log.at(math.nan) is None
    assert log.at(18.0) is None
    assert log.at(30.0).speed_mps == 10.0


@pytest.mark.parametrize(
    ("text", "mps"),
    [
        ("20", 20.0),
        ("20m/s", 20.0),
        (" 72 km/h ", 20.0),
        ("0", 0.0),
        ("1e1", 10.0),
        ("x.csv", None),
    ],
)
def test_constants(text, mps):
    assert constant_speed_mps(text) == mps


@pytest.mark.parametrize("text", ["200", "-1", "600km/h"])
def test_constants_out_of_range_are_refused_with_their_unit(text):
    with pytest.raises(BadInputError, match=r"give 0 to 150 m/s .* 72km/h is km/h"):
        constant_speed_mps(text)


def csv_file(tmp_path, text, name="log.csv"):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / name


def test_csv_in_media_time(tmp_path):
    log = read_speed_log(csv_file(tmp_path, "time_s,speed_kmh\n0,72\n1,75.6\n"))
    assert log.at(0.0).speed_mps == pytest.approx(20.0)
    assert log.span_s == (0.0, 1.0)
    assert log.highest_mps == pytest.approx(21.0)


def test_csv_with_other_columns_semicolons_errors_and_a_mark_at_its_start(tmp_path):
    text = "\ufeffnote; time_s ;speed_mps;error_mps\nx;0;20;0.3\ny;1;20;0.5\n"
    assert read_speed_log(csv_file(tmp_path, text)).at(1.0).error_mps == 0.5


@pytest.mark.parametrize("column", ["unix_s", "time_utc"])
def test_csv_in_clock_time(tmp_path, column):
    times = [NOON + timedelta(seconds=10 + i) for i in range(3)]
    cells = [str(t.timestamp()) if column == "unix_s" else t.isoformat() for t in times]
    path = csv_file(tmp_path, f"{column},speed_mps\n" + "".join(f"{c},20\n" for c in cells))
    assert read_speed_log(path, NOON).span_s == pytest.approx((10.0, 12.0))
    with pytest.raises(
        BadInputError, match=r"--started, for example --started 2026-05-01T12:00:10"
    ):
        read_speed_log(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has the columns none; it needs one of time_s"),
        (
            "t,v\n0,1\n",
            r"has the columns t, v; it needs one of time_s, unix_s, time_utc and one of",
        ),
        ("time_s,speed_mps\n0,20\n", "fewer than two entries"),
        ("time_s,speed_mps\n0,20\n0,21\n", "time 0 s does not come after the entry before"),
        ("time_s,speed_mps\n1,20\n0,21\n", "time 0 s does not come after the entry before"),
        ("time_s,speed_mps\n0,20\n1,-2\n", "speed -2 m/s at 1 s; expected 0 to 150 m/s"),
        ("time_s,speed_mps\n0,20\n1,300\n", r"speed 300 m/s at 1 s; .* is called speed_kmh"),
        ("time_s,speed_mps\n0,20\n1,nan\n", "line 3: speed_mps is 'nan'; expected a number"),
        ("time_s,speed_mps\n0,20\n1,\n", "line 3: speed_mps is ''; expected a number"),
        ("time_s,speed_mps\n0,20\n1\n", "line 3: speed_mps is None; expected a number"),
        ("time_s,speed_mps,error_mps\n0,20,0\n1,20,-1\n", "at 1 s is negative or no number"),
        ("time_utc,speed_mps\n2026-05-01T12:00:00,20\n", "expected a time with its zone"),
    ],
)
def test_a_bad_csv_is_one_sentence(tmp_path, text, message):
    with pytest.raises(BadInputError, match=message):
        read_speed_log(csv_file(tmp_path, text))


def gpx(points, stated=False, version="1/1"):
    rows = "".join(
        f'<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><time>{time.isoformat()}</time>'
        + (f"<speed>{speed}</speed>" if stated else "")
        + "</trkpt>"
        for time, lat, lon, speed in points
    )
    return (
        f'<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/{version}">'
        f"<trk><trkseg>{rows}</trkseg></trk></gpx>"
    )


def drive(seconds=30, radius_m=500.0):
    """Fixes each second of a train that speeds up on a curve: 10 m/s and 0.5 m/s² more."""
    metre = math.degrees(1 / 6_371_008.8)
    points = []
    for t in range(seconds):
        s = 10.0 * t + 0.25 * t * t
        east, north = radius_m * math.sin(s / radius_m), radius_m * (1 - math.cos(s / radius_m))
        lat = 56.95 + north * metre
        lon = 24.1 + east * metre / math.cos(math.radians(56.95))
        points.append((NOON + timedelta(seconds=t), lat, lon, 10.0 + 0.5 * t))
    return points


@pytest.mark.parametrize("stated", [False, True])
def test_gpx_speeds_lie_within_their_error(tmp_path, stated):
    path = tmp_path / "ride.gpx"
    path.write_text(gpx(drive(), stated), encoding="utf-8")
    log = read_speed_log(path, NOON - timedelta(seconds=5))
    assert log.span_s == pytest.approx((5.0, 34.0))
    for t in np.arange(0.0, 29.0, 0.5):
        read = log.at(5.0 + t)
        assert abs(read.speed_mps - (10.0 + 0.5 * t)) <= read.error_mps
        assert read.error_mps < 5.0
    middle = log.at(20.0)
    assert middle.speed_mps == pytest.approx(17.5, abs=0.05)


def test_gpx_noise_errs_to_the_fast_side(tmp_path):
    rng = np.random.default_rng(1)
    metre = math.degrees(1 / 6_371_008.8)
    points = [
        (t, lat + metre * rng.normal(0, 0.3), lon + metre * rng.normal(0, 0.3), v)
        for t, lat, lon, v in drive()
    ]
    path = tmp_path / "ride.gpx"
    path.write_text(gpx(points), encoding="utf-8")
    log = read_speed_log(path, NOON)
    high = [log.at(float(t)).speed_mps - (10.0 + 0.5 * t) for t in range(1, 29)]
    assert np.mean(high) > -0.1
    assert all(log.at(float(t)).error_mps >= abs(high[t - 1]) for t in range(1, 29))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<gpx>", "is not a GPX file"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><gpx/>", "declares a document type"),
        (gpx([]), "fewer than two track points"),
        (gpx(drive(1)), "fewer than two track points"),
        (gpx(drive()).replace("+00:00", ""), "track point 1: needs lat, lon and a time"),
        (gpx(drive()).replace('lat="', 'la="', 1), "track point 1: needs lat, lon"),
        (gpx(drive()[::-1]), "time 2: .* does not come after the one before"),
    ],
)
def test_a_bad_gpx_is_one_sentence(tmp_path, text, message):
    path = tmp_path / "bad.gpx"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError, match=message):
        read_speed_log(path, NOON)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.mcap", "cannot read speed log"),
        ("none.nmea", "cannot read speed log"),
        ("fast", "is neither a speed .* nor a .csv or .gpx, .nmea, .mcap file"),
        ("none.csv", "cannot read speed log"),
    ],
)
def test_other_files_are_refused(tmp_path, name, message):
    with pytest.raises(BadInputError, match=message):
        read_speed_log(tmp_path / name)


def test_a_start_is_refused_where_it_has_no_meaning(tmp_path):
    path = csv_file(tmp_path, "time_s,speed_mps\n0,20\n1,20\n")
    with pytest.raises(BadInputError, match="in media time already"):
        read_speed_log(path, NOON)
