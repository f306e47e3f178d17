"""Fixes and speeds from the messages of an MCAP log, as ROS 2 writes them.

Read are the message types whose meaning is fixed by their names: ``sensor_msgs/msg/NavSatFix``
for fixes; ``geometry_msgs/msg/TwistStamped``, ``geometry_msgs/msg/TwistWithCovarianceStamped`` and
``nav_msgs/msg/Odometry`` for speeds. Their layout in CDR is fixed as well and is written down here:
the message definitions inside the file are never parsed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

from railinspect.errors import BadInputError
from railinspect.positions.fixes import Fixes, FixList

MAX_RECORD_BYTES: Final = 256 << 20
"""Largest record, and largest chunk once unpacked, that is read."""

FIX_TYPES: Final = ("sensor_msgs/msg/NavSatFix",)
"""Message types read as fixes."""

STATED_SPEED_ERROR_MPS: Final = 0.5
"""Largest error of a speed whose message states no variance."""


@dataclass(frozen=True)
class Message:
    """One message: its topic, its type, the time it was logged (ns since 1970) and its CDR."""

    topic: str
    type: str
    log_ns: int
    data: bytes


class _Bounded:
    """A file that is never asked for more than one record's worth at a time."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        if size > MAX_RECORD_BYTES:
            raise ValueError(f"a record of {size} bytes")
        data = self._file.read(size)
        if len(data) < size:
            raise EOFError("the file ends within a record")
        return data


def read_messages(path: Path, types: tuple[str, ...], what: str) -> Iterator[Message]:
    """The messages of some types in the order of the file; the last chunk may be cut off.

    Args:
        path: The MCAP file.
        types: Names of the message types wanted.
        what: What the file is to the user, for messages.

    Raises:
        BadInputError: if it is no MCAP file, is damaged before any message was read, holds a
            record or an unpacked chunk of more than 256 MiB, or ``mcap`` is not installed.
    """
    try:
        from mcap.exceptions import McapError
        from mcap.records import Channel, Chunk, Schema
        from mcap.records import Message as Record
        from mcap.stream_reader import StreamReader, breakup_chunk
    except ModuleNotFoundError as error:
        raise BadInputError(
            f"{what} needs the MCAP reader; install it with pip install 'railinspect[recordings]'"
        ) from error
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    count = 0
    try:
        with path.open("rb") as file:
            stream: Any = _Bounded(file)
            reader = StreamReader(stream, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
            for outer in reader.records:
                inner: list[Any] = [outer]
                if isinstance(outer, Chunk):
                    inner = breakup_chunk(_unpacked(outer))
                for record in inner:
                    if isinstance(record, Schema):
                        schemas[record.id] = record.name
                    elif isinstance(record, Channel):
                        kind = schemas.get(record.schema_id, "")
                        wanted = kind in types and record.message_encoding == "cdr"
                        channels[record.id] = (record.topic, kind if wanted else "")
                    elif isinstance(record, Record):
                        topic, kind = channels.get(record.channel_id, ("", ""))
                        if kind:
                            count += 1
                            yield Message(topic, kind, record.log_time, record.data)
    except OSError as error:
        raise BadInputError(f"cannot read {what}: {error.strerror or error}") from error
    except (McapError, EOFError, ValueError, MemoryError, struct.error, RuntimeError) as error:
        if isinstance(error, BadInputError):
            raise
        if count == 0:
            said = str(error) or type(error).__name__
            raise BadInputError(f"{what} is not a sound MCAP file: {said}") from error


def _unpacked(chunk: Any) -> Any:
    """The chunk without its compression, unpacked within bounds.

    Raises:
        ValueError: if it is larger than it may be, or packed in an unknown way.
    """
    from mcap.records import Chunk

    if chunk.uncompressed_size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    data = chunk.data
    try:
        if chunk.compression == "zstd":
            import zstandard

            # Read as a stream: the size a frame announces is not believed.
            with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(data) as reader:
                data = reader.read(chunk.uncompressed_size + 1)
        elif chunk.compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            data = LZ4FrameDecompressor().decompress(data, max_length=chunk.uncompressed_size + 1)
        elif chunk.compression:
            raise ValueError(f"a chunk packed with {chunk.compression[:20]!r}")
    except Exception as error:  # the unpackers' own errors have no root in common
        raise ValueError(f"a chunk cannot be unpacked ({error})") from error
    if len(data) != chunk.uncompressed_size:
        raise ValueError("a chunk's size is not what it says")
    return Chunk(
        compression="",
        data=data,
        message_end_time=chunk.message_end_time,
        message_start_time=chunk.message_start_time,
        uncompressed_crc=chunk.uncompressed_crc,
        uncompressed_size=chunk.uncompressed_size,
    )


class Cdr:
    """Reads the members of a message in order (OMG CDR, the plain encoding of ROS 2).

    Args:
        data: The message with its four bytes of header.

    Raises:
        ValueError: if the encoding is another one; by every read, if the message ends before it.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError("a message that is not in plain CDR")
        self._data, self._at = data, 4
        self._order = "<" if data[1] else ">"

    def numbers(self, code: str, count: int = 1) -> tuple[Any, ...]:
        """So many numbers of one type, by its code in :mod:`struct`."""
        size = struct.calcsize(code)
        start = self._at + -(self._at - 4) % size
        self._at = start + size * count
        try:
            return struct.unpack_from(f"{self._order}{count}{code}", self._data, start)
        except struct.error:
            raise ValueError("a message that is cut short") from None

    def skip_text(self) -> None:
        """Pass over a string."""
        (length,) = self.numbers("I")
        self._at += length

    def stamp_s(self, log_ns: int) -> float:
        """Time in a ``std_msgs/msg/Header``, seconds since 1970; when it was logged if it is 0."""
        seconds, nanoseconds = *self.numbers("i"), *self.numbers("I")
        self.skip_text()
        if seconds == 0 and nanoseconds == 0:
            return log_ns * 1e-9
        return float(seconds + nanoseconds * 1e-9)


def read_mcap_fixes(path: Path, what: str, topic: str | None = None) -> Fixes:
    """The fixes of the one topic of ``sensor_msgs/msg/NavSatFix``, in order of time.

    Args:
        path: The MCAP file.
        what: What it is to the user, for messages.
        topic: The topic; needed only where there are several.

    Raises:
        BadInputError: if there is no such topic, or several and none is named.
    """
    found = FixList(what)
    rows = []
    for message in _of_one_topic(path, FIX_TYPES, what, topic):
        try:
            cdr = Cdr(message.data)
            at = cdr.stamp_s(message.log_ns)
            (status,), _ = cdr.numbers("b"), cdr.numbers("H")
            latitude, longitude = cdr.numbers("d", 2)
        except ValueError as error:
            raise BadInputError(f"{what}, topic {message.topic}: {error}") from error
        if status >= 0 and math.isfinite(latitude) and math.isfinite(longitude):
            rows.append((at, (latitude, longitude)))
    for at, place in sorted(rows):
        found.add(at, place, math.nan)
    return found.fixes()


SpeedRows = tuple[list[float], list[float], list[float]]


def read_mcap_speeds(path: Path, what: str, topic: str | None = None) -> SpeedRows:
    """Clock times, speeds and their largest errors, m/s, of the one topic that states speeds.

    The speed is the length of the linear velocity, whatever frame it is given in. Its largest
    error is three standard deviations where the message states a variance, else 0.5 m/s.

    Args:
        path: The MCAP file.
        what: What it is to the user, for messages.
        topic: The topic; needed only where there are several.

    Raises:
        BadInputError: if there is no such topic, or several and none is named.
    """
    rows = []
    for message in _of_one_topic(path, tuple(_VELOCITIES), what, topic):
        try:
            cdr = Cdr(message.data)
            at = cdr.stamp_s(message.log_ns)
            linear, variance = _VELOCITIES[message.type](cdr)
        except ValueError as error:
            raise BadInputError(f"{what}, topic {message.topic}: {error}") from error
        error_mps = 3 * math.sqrt(variance) if variance > 0 else STATED_SPEED_ERROR_MPS
        rows.append((at, math.hypot(*linear), error_mps))
    rows.sort()
    times, speeds, errors = (list(column) for column in zip(*rows, strict=True))
    return times, speeds, errors


Velocity = tuple[tuple[float, ...], float]


def _twist(cdr: Cdr) -> Velocity:
    return cdr.numbers("d", 3), 0.0


def _twist_with_covariance(cdr: Cdr) -> Velocity:
    linear, _, covariance = cdr.numbers("d", 3), cdr.numbers("d", 3), cdr.numbers("d", 36)
    variances = (covariance[0], covariance[7], covariance[14])
    return linear, max((one for one in variances if one > 0), default=0.0)


def _odometry(cdr: Cdr) -> Velocity:
    cdr.skip_text()
    cdr.numbers("d", 3 + 4 + 36)  # the pose and its covariance
    return _twist_with_covariance(cdr)


_VELOCITIES: Final[dict[str, Callable[[Cdr], Velocity]]] = {
    "geometry_msgs/msg/TwistStamped": _twist,
    "geometry_msgs/msg/TwistWithCovarianceStamped": _twist_with_covariance,
    "nav_msgs/msg/Odometry": _odometry,
}

SPEED_TYPES: Final = tuple(_VELOCITIES)
"""Message types read as speeds."""


def _of_one_topic(
    path: Path, types: tuple[str, ...], what: str, topic: str | None
) -> Iterator[Message]:
    """The messages of the topic named, or of the only one there is.

    Raises:
        BadInputError: if there is none, or several and none was named.
    """
    chosen, count = topic, 0
    others: set[str] = set()
    for message in read_messages(path, types, what):
        chosen = chosen or message.topic
        if message.topic == chosen:
            count += 1
            yield message
        elif topic is None:
            raise BadInputError(
                f"{what} has several topics that would do ({chosen}, {message.topic}, …); name one "
                f"as {path.name}::{chosen}"
            )
        else:
            others.add(message.topic)
    if not count:
        there = f"; there is {', '.join(sorted(others)[:10])}" if others else ""
        on = f" on topic {topic}" if topic else ""
        raise BadInputError(f"{what} has no message of {' or '.join(types)}{on}{there}")
