"""Raw messages of one topic from an MCAP file or a SQLite bag, within bounded memory.

A file may claim any size: no record, chunk or message beyond the limits is read, and nothing is
unpacked further than it says and the limit allows.
"""

from __future__ import annotations

import contextlib
import io
import sqlite3
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from railinspect.errors import BadInputError

if TYPE_CHECKING:
    from mcap.records import Chunk
    from mcap.summary import Summary

MAX_MESSAGE_BYTES: Final = 320 * 1024 * 1024
"""Largest message read, bytes: 100 million pixels of three bytes."""

MAX_CHUNK_BYTES: Final = 512 * 1024 * 1024
"""Largest chunk of messages unpacked, bytes; recorders write a few million."""

_SCANNED: Final = 64
"""Without an index so many chunks are searched for topics."""


class BagError(BadInputError):
    """A bag that cannot be read on."""


@dataclass(frozen=True)
class Channel:
    """A topic and its message type, such as ``sensor_msgs/msg/Image``."""

    topic: str
    type: str


@dataclass(frozen=True)
class Message:
    """One message as recorded; ``log_ns`` is the recorder's Unix time, nanoseconds."""

    type: str
    log_ns: int
    data: bytes


class McapReader:
    """Reads an MCAP file from front to back, so that one cut off is read as far as it goes.

    Args:
        path: The file.

    Raises:
        BadInputError: if the package ``mcap`` is missing or the file is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        try:
            import mcap.reader  # noqa: F401  # only whether it is there
        except ImportError as error:
            raise BadInputError(
                f"reading {path} needs the package mcap; install railinspect[recordings]"
            ) from error
        self._path = path
        self._file = path.open("rb")
        if self._file.read(8) != b"\x89MCAP0\r\n":
            self._file.close()
            raise BadInputError(f"{path} is not an MCAP file, whatever its name says")
        self._summary = self._read_summary()

    def _read_summary(self) -> Summary | None:
        """The index at the file's end, or None where it is missing or damaged."""
        from mcap.reader import SeekingReader

        self._file.seek(0)
        try:
            reader = SeekingReader(self._file, record_size_limit=MAX_CHUNK_BYTES)
            return reader.get_summary()
        except Exception:  # whatever a damaged index raises: the data before it may be sound
            return None

    def channels(self) -> list[Channel]:
        """Topics of the file; without an index those of its first 64 chunks."""
        summary = self._summary
        found: dict[int, tuple[str, int]] = {}
        types: dict[int, str] = {}
        if summary is not None and summary.channels:
            found = {key: (one.topic, one.schema_id) for key, one in summary.channels.items()}
            types = {key: one.name for key, one in summary.schemas.items()}
        else:
            with contextlib.suppress(BagError):
                for record in self._records(_SCANNED):
                    kind = type(record).__name__
                    if kind == "Schema":
                        types[record.id] = record.name
                    elif kind == "Channel":
                        found[record.id] = (record.topic, record.schema_id)
        return [Channel(topic, types.get(schema, "?")) for topic, schema in found.values()]

    def count(self, topic: str) -> int | None:
        """How many messages the index announces; None without one."""
        if self._summary is None or self._summary.statistics is None:
            return None
        counts = self._summary.statistics.channel_message_counts
        return sum(
            counts.get(key, 0) for key, one in self._summary.channels.items() if one.topic == topic
        )

    def span_ns(self) -> tuple[int, int] | None:
        """The recorder's times of the first and the last message of any topic, as announced."""
        statistics = self._summary.statistics if self._summary else None
        if statistics is None or not statistics.message_count:
            return None
        return statistics.message_start_time, statistics.message_end_time

    def messages(self, topic: str) -> Iterator[Message]:
        """The topic's messages in the order they were recorded.

        Raises:
            BagError: where the file breaks off or is damaged.
        """
        types: dict[int, str] = {}
        wanted: dict[int, str] = {}
        for record in self._records():
            kind = type(record).__name__
            if kind == "Schema":
                types[record.id] = record.name
            elif kind == "Channel" and record.topic == topic:
                wanted[record.id] = types.get(record.schema_id, "?")
            elif kind == "Message" and record.channel_id in wanted:
                yield Message(wanted[record.channel_id], record.log_time, record.data)

    def _records(self, chunks: int | None = None) -> Iterator[Any]:
        """Schemas, channels and messages from front to back, of at most so many chunks."""
        from mcap.exceptions import McapError
        from mcap.records import Chunk, Footer
        from mcap.stream_reader import StreamReader

        self._file.seek(0)
        reader = StreamReader(self._file, emit_chunks=True, record_size_limit=MAX_CHUNK_BYTES)
        seen, ended = 0, False
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    seen += 1
                    yield from _unpacked(record)
                    if seen == chunks:
                        return
                else:
                    ended = ended or isinstance(record, Footer)
                    yield record
        except BagError:
            raise
        except (McapError, OSError, ValueError, struct.error, MemoryError) as error:
            if ended:
                return
            raise BagError(f"{self._path.name} breaks off or is damaged ({_why(error)})") from error

    def close(self) -> None:
        """Release the file."""
        self._file.close()


def _why(error: BaseException) -> str:
    return " ".join((str(error) or type(error).__name__).split())[:200]


def _unpacked(chunk: Chunk) -> Iterator[Any]:
    """The records of a chunk."""
    from mcap.exceptions import EndOfFile
    from mcap.stream_reader import StreamReader

    data = _decompressed(chunk)
    stream = io.BytesIO(data)
    reader = StreamReader(stream, skip_magic=True, record_size_limit=MAX_MESSAGE_BYTES)
    try:
        yield from reader.records
    except EndOfFile:
        if stream.tell() < len(data):
            raise


def _decompressed(chunk: Chunk) -> bytes:
    """A chunk's bytes, never more than it announces and the limit allows.

    Raises:
        BagError: if it announces too much, or holds something else than it announces.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise BagError(
            f"a chunk claims {size} bytes unpacked; at most {MAX_CHUNK_BYTES} are accepted"
        )
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        import zstandard

        try:
            with zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(
                chunk.data
            ) as packed:
                data = packed.read(size + 1)
        except zstandard.ZstdError as error:
            raise BagError(f"a chunk cannot be unpacked ({_why(error)})") from error
    elif chunk.compression == "lz4":
        import lz4.frame

        try:
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        except (RuntimeError, EOFError) as error:
            raise BagError(f"a chunk cannot be unpacked ({_why(error)})") from error
    else:
        raise BagError(f"a chunk is compressed by {chunk.compression[:20]!r}, not zstd or lz4")
    if len(data) != size:
        raise BagError(f"a chunk announces {size} bytes unpacked and holds others")
    return bytes(data)


class Sqlite3Reader:
    """Reads a ROS 2 bag in SQLite, the recorder's format before MCAP, without writing to it.

    Args:
        path: The file.

    Raises:
        BadInputError: if it is no such bag.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with path.open("rb") as file:
            if file.read(16) != b"SQLite format 3\0":
                raise BadInputError(f"{path} is not a SQLite bag, whatever its name says")
        # Frames are read in another thread than the one that opened the bag, never in both.
        self._base = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True, check_same_thread=False
        )
        try:
            self._base.execute("PRAGMA trusted_schema = OFF")
            self._base.execute("PRAGMA cell_size_check = ON")
            self._base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES)
            rows = self._base.execute(
                "SELECT name FROM sqlite_master WHERE type = 'table' AND name IN "
                "('topics', 'messages')"
            ).fetchall()
            if len(rows) != 2:  # views of these names could compute anything
                raise BadInputError(f"{path} is a SQLite file but no ROS 2 bag")
            self._topics = self._base.execute(
                "SELECT id, name, type, serialization_format FROM topics LIMIT 10000"
            ).fetchall()
        except sqlite3.Error as error:
            self.close()
            raise BadInputError(f"{path} is a damaged SQLite bag ({error})") from error
        except BaseException:
            self.close()
            raise

    def channels(self) -> list[Channel]:
        """Topics of the bag."""
        return [
            Channel(str(name), str(type_)) for _, name, type_, form in self._topics if form == "cdr"
        ]

    def count(self, topic: str) -> int | None:
        """How many messages there are; None, since counting them reads the whole file."""
        return None

    def span_ns(self) -> tuple[int, int] | None:
        """Unknown without reading the whole file."""
        return None

    def messages(self, topic: str) -> Iterator[Message]:
        """The topic's messages in the order they were recorded.

        Raises:
            BagError: where the file is damaged.
        """
        types = {key: str(type_) for key, name, type_, _ in self._topics if name == topic}
        try:
            rows = self._base.execute("SELECT id, topic_id, timestamp FROM messages ORDER BY id")
            for key, topic_id, log_ns in rows:
                if topic_id not in types:
                    continue
                (data,) = self._base.execute(
                    "SELECT data FROM messages WHERE id = ?", (key,)
                ).fetchone()
                if isinstance(data, bytes) and isinstance(log_ns, int):
                    yield Message(types[topic_id], log_ns, data)
        except (sqlite3.Error, TypeError, MemoryError) as error:
            raise BagError(f"{self._path.name} is damaged ({_why(error)})") from error

    def close(self) -> None:
        """Release the file."""
        self._base.close()
