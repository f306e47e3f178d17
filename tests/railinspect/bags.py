"""Bags written by an independent encoder, for tests and for the documentation's examples."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

HEADER = """\
std_msgs/Header header
{}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
DEFINITIONS = {
    "sensor_msgs/msg/Image": HEADER.format(
        "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data"
    ),
    "sensor_msgs/msg/CompressedImage": HEADER.format("string format\nuint8[] data"),
    "std_msgs/msg/String": "string data",
}

START_NS = 1_777_636_800_123_456_789


def header(stamp_ns: int) -> dict[str, Any]:
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    return {"stamp": stamp, "frame_id": "cab"}


def raw(rgb: np.ndarray, stamp_ns: int, encoding: str = "rgb8", padding: int = 0) -> dict[str, Any]:
    """An Image message; rows may be padded."""
    pixels = {"rgb8": rgb, "bgr8": rgb[..., ::-1], "mono8": rgb[..., 0]}.get(encoding)
    if encoding == "mono16":
        pixels = (rgb[..., 0].astype("<u2") * 257).view(np.uint8)
    rows = np.ascontiguousarray(pixels).reshape(len(rgb), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    return {
        "header": header(stamp_ns),
        "height": rgb.shape[0],
        "width": rgb.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": rows.shape[1],
        "data": rows.tobytes(),
    }


def compressed(rgb: np.ndarray, stamp_ns: int, suffix: str = ".png") -> dict[str, Any]:
    data = cv2.imencode(suffix, rgb[..., ::-1])[1].tobytes()
    return {"header": header(stamp_ns), "format": f"rgb8; {suffix[1:]} compressed", "data": data}


Row = tuple[str, str, Mapping[str, Any], int]  # topic, type, message, log time in ns


def write_mcap(
    path: Path, rows: Iterable[Row], compression: CompressionType = CompressionType.ZSTD
) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=20_000, compression=compression)
        schemas: dict[str, Any] = {}
        for topic, type_, message, log_ns in rows:
            if type_ not in schemas:
                schemas[type_] = writer.register_msgdef(type_, DEFINITIONS[type_])
            writer.write_message(topic, schemas[type_], message, log_time=log_ns)
        writer.finish()
    return path


def write_db3(path: Path, rows: Sequence[Row]) -> Path:
    """The same as a SQLite bag, with the bytes the independent encoder makes."""
    buffer = BytesIO()
    temporary = path.with_suffix(".mcap-for-db3")
    write_mcap(temporary, rows)
    buffer.write(temporary.read_bytes())
    temporary.unlink()
    base = sqlite3.connect(path)
    base.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
        "serialization_format TEXT, offered_qos_profiles TEXT)"
    )
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB)"
    )
    topics: dict[str, int] = {}
    buffer.seek(0)
    for schema, channel, message in make_reader(buffer).iter_messages(log_time_order=False):
        if channel.topic not in topics:
            topics[channel.topic] = len(topics) + 1
            base.execute(
                "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')",
                (topics[channel.topic], channel.topic, schema.name),
            )
        base.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            (topics[channel.topic], message.log_time, message.data),
        )
    base.commit()
    base.close()
    return path
