"""Fixes from GPX, NMEA and MCAP, hostile ones among them, and the way between them."""

from __future__ import annotations

import contextlib
import math
import struct
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

from railinspect.errors import BadInputError
from railinspect.positions import Fixes, PositionLog, read_fixes
from railinspect.positions.fixes import EARTH_RADIUS_M, steps_m
from railinspect.positions.mcap_log import read_messages
from railinspect.speed_files import read_speed_log

NOON = datetime(2026, 5, 1, 12, 0, 0, tzinfo=UTC)
METRE_DEG = math.degrees(1 / EARTH_RADIUS_M)

HEADER = """std_msgs/Header header
"""
STAMP = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
NAV_SAT_FIX = (
    HEADER
    + """sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
"""
    + STAMP
    + """================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
"""
)
TWIST = """================================================================================
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
TWIST_STAMPED = HEADER + "geometry_msgs/Twist twist\n" + STAMP + TWIST
WITH_COVARIANCE = """===============================================================================
MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance
"""
TWIST_WITH_COVARIANCE = (
    HEADER + "geometry_msgs/TwistWithCovariance twist\n" + STAMP + WITH_COVARIANCE + TWIST
)
ODOMETRY = (
    HEADER
    + """string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
"""
    + STAMP
    + """================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Vector3 position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
    + WITH_COVARIANCE
    + TWIST
)


def header(second, frame="gnss"):
    at = NOON + timedelta(seconds=second)
    stamp = {"sec": int(at.timestamp()), "nanosec": int(at.microsecond * 1000)}
    return {"stamp": stamp, "frame_id": frame}


def twist(speed):
    linear = {"x": 0.6 * speed, "y": 0.8 * speed, "z": 0.0}
    return {"linear": linear, "angular": {"x": 0.0, "y": 0.0, "z": 0.1}}


def with_covariance(speed, variance):
    return {"twist": twist(speed), "covariance": [variance, *[0.0] * 35]}


def odometry(second, speed, variance=0.01):
    pose = {
        "position": {"x": 1.0, "y": 2.0, "z": 3.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    return {
        "header": header(second, "odom"),
        "child_frame_id": "base",
        "pose": {"pose": pose, "covariance": [0.0] * 36},
        "twist": with_covariance(speed, variance),
    }


def nav_sat_fix(second, lat, lon, status=0, frame="gnss"):
    return {
        "header": header(second, frame),
        "status": {"status": status, "service": 1},
        "latitude": lat,
        "longitude": lon,
        "altitude": 12.0,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
    }


def write_mcap(path, kind, definition, messages, topic="/t", compression=CompressionType.ZSTD):
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        schema = writer.register_msgdef(kind, definition)
        for name, message in messages if topic is None else [(topic, m) for m in messages]:
            writer.write_message(name, schema, message, log_time=5)
        writer.finish()
    return path


def write_fixes(path, messages, **rest):
    return write_mcap(path, "sensor_msgs/msg/NavSatFix", NAV_SAT_FIX, messages, **rest)


@pytest.mark.parametrize("frame", ["", "a", "gnss", "a longer name of a frame"])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_mcap_fixes_are_what_the_writer_wrote(tmp_path, compression, frame):
    rows = [nav_sat_fix(t, 50.0 + t, -8.0 - t, frame=frame) for t in range(3)]
    rows.insert(1, nav_sat_fix(0.5, 0.0, 0.0, status=-1))
    path = write_fixes(tmp_path / "a.mcap", rows, compression=compression)
    fixes = read_fixes(path)
    assert fixes.unix_s.tolist() == [NOON.timestamp() + t for t in range(3)]
    assert fixes.latitude_deg.tolist() == [50.0, 51.0, 52.0]
    assert fixes.longitude_deg.tolist() == [-8.0, -9.0, -10.0]
    assert np.isnan(fixes.speed_mps).all()


@pytest.mark.parametrize(
    ("kind", "definition", "row", "error"),
    [
        ("nav_msgs/msg/Odometry", ODOMETRY, odometry, 0.3),
        (
            "geometry_msgs/msg/TwistStamped",
            TWIST_STAMPED,
            lambda t, v: {"header": header(t), "twist": twist(v)},
            0.5,
        ),
        (
            "geometry_msgs/msg/TwistWithCovarianceStamped",
            TWIST_WITH_COVARIANCE,
            lambda t, v: {"header": header(t), "twist": with_covariance(v, 0.04)},
            0.6,
        ),
    ],
)
def test_mcap_speeds(tmp_path, kind, definition, row, error):
    path = write_mcap(tmp_path / "a.mcap", kind, definition, [row(t, 10.0 + t) for t in range(4)])
    log = read_speed_log(path, NOON)
    assert log.span_s == (0.0, 3.0)
    assert log.at(2.0).speed_mps == pytest.approx(12.0)
    assert log.at(2.0).error_mps == pytest.approx(error)
    with pytest.raises(BadInputError, match=r"say when .* --started 2026-05-01T12:00:00Z"):
        read_speed_log(path)


def test_a_topic_is_named_where_there_are_several(tmp_path):
    rows = [(f"/{name}", odometry(t, v)) for t in (0, 1) for name, v in (("a", 10.0), ("b", 20.0))]
    path = write_mcap(tmp_path / "two.mcap", "nav_msgs/msg/Odometry", ODOMETRY, rows, topic=None)
    with pytest.raises(BadInputError, match=r"\(/a, /b, …\); name one as two.mcap::/a"):
        read_speed_log(path, NOON)
    assert read_speed_log(f"{path}::/b", NOON).at(0.0).speed_mps == pytest.approx(20.0)
    with pytest.raises(BadInputError, match="on topic /c; there is /a, /b"):
        read_speed_log(f"{path}::/c", NOON)
    with pytest.raises(BadInputError, match="has no message of sensor_msgs/msg/NavSatFix"):
        read_fixes(path)


def test_a_message_is_read_in_either_byte_order_and_by_its_log_time_without_stamp():
    from railinspect.positions.mcap_log import Cdr

    # Stamp, frame "g", status and service from offset 14, the place from 24.
    body = struct.pack(">iII2sbxH6x", 0, 0, 2, b"g\0", 0, 1)
    cdr = Cdr(b"\0\0\0\0" + body + struct.pack(">dd", 1.5, -2.5))
    assert cdr.stamp_s(7_000_000_000) == 7.0
    assert (cdr.numbers("b"), cdr.numbers("H")) == ((0,), (1,))
    assert cdr.numbers("d", 2) == (1.5, -2.5)
    with pytest.raises(ValueError, match="cut short"):
        cdr.numbers("d")


def test_a_log_that_breaks_off_is_read_up_to_there(tmp_path):
    rows = [nav_sat_fix(t, 50.0, 8.0) for t in range(20000)]
    path = write_fixes(tmp_path / "a.mcap", rows, compression=CompressionType.NONE)
    path.write_bytes(path.read_bytes()[:-600_000])
    assert 100 < len(read_fixes(path).unix_s) < 20000


def packed(record, payload):
    return struct.pack("<BQ", record, len(payload)) + payload


MAGIC = b"\x89MCAP0\r\n"


def chunk(compression, data, size):
    name = compression.encode()
    return packed(
        6,
        struct.pack("<QQQI", 0, 0, size, 0)
        + struct.pack("<I", len(name))
        + name
        + struct.pack("<Q", len(data))
        + data,
    )


def bomb():
    import zstandard

    return zstandard.ZstdCompressor(level=19).compress(bytes(300 << 20))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a sound MCAP file"),
        (b"not an mcap file at all, not at all", "not a sound MCAP file"),
        (MAGIC + struct.pack("<BQ", 6, 1 << 60), "not a sound MCAP file"),
        (MAGIC + struct.pack("<BQI", 4, 1 << 20, 0xFFFFFFFF), "not a sound MCAP file"),
        (MAGIC + chunk("zstd", b"nonsense", 100), "cannot be unpacked"),
        (MAGIC + chunk("brotli", b"nonsense", 100), "cannot be unpacked"),
        (MAGIC + chunk("lz4", b"nonsense", 100), "cannot be unpacked"),
        (MAGIC + chunk("zstd", b"", 1 << 50), "a chunk of 1125899906842624 bytes"),
    ],
)
def test_a_hostile_mcap_is_one_sentence(tmp_path, content, message):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=message):
        read_fixes(path)


def test_a_chunk_that_unpacks_to_more_than_it_says_is_refused_without_unpacking_it(tmp_path):
    import tracemalloc

    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + chunk("zstd", bomb(), 1000))
    tracemalloc.start()
    with pytest.raises(BadInputError, match="size is not what it says"):
        list(read_messages(path, ("x",), "positions bomb.mcap"))
    assert tracemalloc.get_traced_memory()[1] < 20 << 20
    tracemalloc.stop()


def sentence(body):
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n"


def rmc(time="120000.00", lat="5657.0000,N", lon="02406.0000,E", knots="38.88", date="010526"):
    return sentence(f"GNRMC,{time},A,{lat},{lon},{knots},084.4,{date},,,A")


def test_nmea_fixes(tmp_path):
    path = tmp_path / "a.nmea"
    path.write_text(
        "log started\n"
        + sentence("GPGGA,115959.00,5657.0,N,02406.0,E,1,08,1.0,10,M,,M,,")
        + sentence("GPRMC,115959.00,V,,,,,,,010526,,,N")
        + "1777636800.1 "
        + rmc()
        + rmc(time="120001.50", lat="5630.0000,S", lon="17930.0000,W", knots="")
        + rmc(time="120002.00").replace("5657", "5658")  # its check sum is now wrong
        + rmc(time="120003.00")
        + "$GPRMC,1200"
    )
    fixes = read_fixes(path)
    assert (fixes.unix_s - NOON.timestamp()).tolist() == [0.0, 1.5, 3.0]
    assert fixes.latitude_deg.tolist() == pytest.approx([56.95, -56.5, 56.95])
    assert fixes.longitude_deg.tolist() == pytest.approx([24.1, -179.5, 24.1])
    assert fixes.speed_mps[0] == pytest.approx(20.0, abs=0.01)
    assert np.isnan(fixes.speed_mps[1])


def test_nmea_speeds(tmp_path):
    path = tmp_path / "a.nmea"
    path.write_text(rmc() + rmc(time="120001.00"))
    assert read_speed_log(path, NOON).at(0.5).speed_mps == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no RMC sentence"),
        (sentence("GPGGA,115959.00,5657.0,N,02406.0,E,1,08,1.0,10,M,,M,,"), "has no RMC sentence"),
        (rmc().replace("5657", "5658") + rmc()[:40], "2 of 2 RMC sentences are damaged"),
        (rmc(lat="9957.0000,N"), "fix 1: latitude is 99.95°; expected −90 to 90"),
        (rmc(time="126000.00"), "1 of 1 RMC sentences are damaged"),
        (rmc(date="310226"), "1 of 1 RMC sentences are damaged"),
        (rmc(lat="5657.0000,E"), "1 of 1 RMC sentences are damaged"),
        ("$" + "RMC" * 100_000, "has no RMC sentence"),
    ],
)
def test_a_bad_nmea_log_is_one_sentence(tmp_path, text, message):
    path = tmp_path / "bad.nmea"
    path.write_text(text)
    with pytest.raises(BadInputError, match=message):
        read_fixes(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<!DOCTYPE gpx [<!ENTITY a "b">]><gpx>&a;</gpx>', "declares a document type"),
        ('<!DOCTYPE gpx SYSTEM "file:///etc/passwd"><gpx/>', "declares a document type"),
        ("<kml/>", "its root is <kml>"),
        ("<gpx>" + "<a>" * 100, "more than 64 deep"),
        ("<gpx>&b;</gpx>", "undefined entity"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_hostile_xml_is_refused_in_any_encoding(tmp_path, text, message, encoding):
    path = tmp_path / "bad.gpx"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{text}', encoding=encoding)
    with pytest.raises(BadInputError, match=message):
        read_fixes(path)


def straight(seconds=10, speed=20.0, lat=50.0):
    """A log straight north."""
    time_s = np.arange(seconds + 1.0)
    north = lat + METRE_DEG * speed * time_s
    return PositionLog("a log", time_s, north, np.full(time_s.size, 8.0))


def test_places_along_the_way():
    log = straight()
    assert log.at(2.5).latitude_deg == pytest.approx(50.0 + 50 * METRE_DEG, abs=1e-9)
    assert log.at(10.0).latitude_deg == log.latitude_deg[-1]
    assert log.at(10.01) is None
    assert log.at(-0.01) is None
    assert log.ahead(2.5, 30.0).latitude_deg == pytest.approx(50.0 + 80 * METRE_DEG, abs=1e-9)
    assert log.ahead(0.0, 0.0) == log.at(0.0)
    assert log.ahead(9.0, 21.0) is None
    assert log.way_m(2.0, 7.5) == pytest.approx((110.0, 5.5))
    assert log.way_m(-5.0, 50.0) == pytest.approx((200.0, 10.0))


def test_the_antimeridian_is_no_obstacle():
    log = PositionLog(
        "a log", [0.0, 1.0], [0.0, 0.0], [180 - 10 * METRE_DEG, -180 + 10 * METRE_DEG]
    )
    assert log.way_m(0.0, 1.0) == pytest.approx((20.0, 1.0))
    assert log.ahead(0.25, 10.0).longitude_deg == pytest.approx(-180 + 5 * METRE_DEG, abs=2e-9)


def test_ahead_follows_the_curve_the_train_took():
    angle = np.linspace(0.0, math.pi / 2, 500)
    north, east = 300 * np.sin(angle), 300 * (1 - np.cos(angle))
    log = PositionLog("a curve", np.arange(500) * 0.1, north * METRE_DEG, east * METRE_DEG)
    place = log.ahead(0.0, 150.0)
    expected = (300 * math.sin(0.5), 300 * (1 - math.cos(0.5)))
    assert place.latitude_deg / METRE_DEG == pytest.approx(expected[0], abs=0.1)
    assert place.longitude_deg / METRE_DEG == pytest.approx(expected[1], abs=0.1)


def test_a_tunnel_is_a_gap():
    log = PositionLog("a log", [0, 1, 21, 22], [0.0, 0.001, 0.021, 0.022], [0.0] * 4)
    assert log.at(11.0) is None
    assert log.at(21.0).latitude_deg == 0.021
    assert log.ahead(0.5, 200.0) is None
    assert log.ahead(0.5, 40.0) is not None
    assert log.way_m(0.0, 22.0) == pytest.approx((0.002 / METRE_DEG, 2.0))


def test_a_standing_train_has_a_place_and_a_way_ahead():
    log = PositionLog("a log", [0, 1, 2, 3], [0.0, 0.0, 0.0, 0.001], [0.0] * 4)
    assert log.ahead(1.5, 0.0).latitude_deg == 0.0
    assert log.ahead(1.0, 50.0).latitude_deg == pytest.approx(50 * METRE_DEG, abs=1e-9)


@given(st.floats(-85, 85), st.floats(-180, 180), st.floats(0, 8), st.floats(0, 30))
def test_ahead_lies_as_far_along_as_asked(lat, lon, time_s, distance_m):
    time = np.arange(11.0)
    east = METRE_DEG / math.cos(math.radians(lat)) * 20 * time
    log = PositionLog("a log", time, np.full(11, lat), (lon + east + 180) % 360 - 180)
    here, there = log.at(time_s), log.ahead(time_s, distance_m)
    got = steps_m(
        np.array([here.latitude_deg, there.latitude_deg]),
        np.array([here.longitude_deg, there.longitude_deg]),
    )
    assert got[0] == pytest.approx(distance_m, abs=1e-3)


def test_the_part_of_a_log_within_a_recording():
    time = NOON.timestamp() + np.arange(1000.0)
    fixes = Fixes("positions a.gpx", time, np.linspace(50, 51, 1000), np.zeros(1000), time * np.nan)
    log = PositionLog.within(fixes, NOON.timestamp() + 100.0, 0.0, 50.0)
    assert (log.time_s[0], log.time_s[-1]) == (-10.0, 170.0)
    with pytest.raises(BadInputError, match=r"runs from -3600.0 s to -2601.0 s .* when it started"):
        PositionLog.within(fixes, NOON.timestamp() + 3600.0, 0.0, 50.0)
    with pytest.raises(BadInputError, match=r"fix 2: its time does not come after"):
        PositionLog("a log", [0, 0], [1, 2], [3, 4])


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """One sound log of each kind, as bytes."""
    base = tmp_path_factory.mktemp("sound")
    rows = [nav_sat_fix(t, 50.0, 8.0) for t in range(20)]
    files = {
        kind: write_fixes(base / f"{kind}.mcap", rows, compression=compression).read_bytes()
        for kind, compression in (("lz4.mcap", CompressionType.LZ4), ("mcap", CompressionType.NONE))
    }
    point = '<trkpt lat="50" lon="8"><time>2026-05-01T12:00:00Z</time></trkpt>'
    files["gpx"] = f"<gpx><trk><trkseg>{point * 5}</trkseg></trk></gpx>".encode()
    files["nmea"] = (rmc() * 5).encode()
    return files


@pytest.mark.parametrize("kind", ["lz4.mcap", "mcap", "gpx", "nmea"])
@given(damage=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), max_size=8))
def test_a_damaged_log_is_read_or_refused(sound, tmp_path_factory, kind, damage):
    data = bytearray(sound[kind])
    for share, byte in damage:
        data[int(share * len(data))] = byte
    path = tmp_path_factory.getbasetemp() / f"damaged.{kind}"
    path.write_bytes(bytes(data))
    with contextlib.suppress(BadInputError):  # any other error fails the test
        fixes = read_fixes(path)
        assert (np.abs(fixes.latitude_deg) <= 90).all()
        assert (np.abs(fixes.longitude_deg) <= 180).all()
