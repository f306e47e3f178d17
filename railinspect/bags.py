"""Frames from recorded messages: MCAP files and ROS 2 bags with a topic of pictures.

A frame's time is the camera's own, from the message's header; where that is empty, the time at
which the recorder wrote the message.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Final

from railinspect.bag_readers import (
    BagError,
    Channel,
    McapReader,
    Message,
    Sqlite3Reader,
)
from railinspect.errors import BadInputError
from railinspect.image_folder import natural_key
from railinspect.ros_images import IMAGE_TYPES, Picture, decode_picture
from railinspect.source import Frame, Source

BAG_SUFFIXES: Final = (".mcap", ".db3")
"""File name endings read as bags, lower case."""

_PACKED: Final = (".mcap.zstd", ".db3.zstd")
_LARGEST_NS: Final = 2**63


def bag_files(path: Path) -> list[Path]:
    """The files of a bag in order: the file itself, or those directly in a folder; else none.

    What a folder's ``metadata.yaml`` lists is not followed: it could name any file.
    """
    if path.is_dir():
        files = [f for f in path.iterdir() if f.suffix.lower() in BAG_SUFFIXES and f.is_file()]
        if not files and any(f.name.lower().endswith(_PACKED) for f in path.iterdir()):
            raise BadInputError(
                f"the files of bag {path} are compressed as a whole; decompress them with zstd -d "
                "first"
            )
        return sorted(files, key=lambda file: natural_key(file.name))
    return [path] if path.suffix.lower() in BAG_SUFFIXES else []


class BagSource(Source):
    """The pictures of one topic of a bag.

    Args:
        path: What the user named.
        files: The bag's files, in order.
        topic: The topic; None takes the only one with pictures.

    Raises:
        BadInputError: if there is no such topic, or no picture in it can be read.
    """

    kind = "bag"

    def __init__(self, path: Path, files: list[Path], topic: str | None) -> None:
        super().__init__(path)
        self._readers: list[McapReader | Sqlite3Reader] = []
        self._frames = self._read()
        try:
            self._readers += [self._reader(file) for file in files]
            self._begin(topic)
        except BaseException:
            self.close()
            raise

    def _begin(self, topic: str | None) -> None:
        self.topic = self._choose(topic)
        counts = [reader.count(self.topic) for reader in self._readers]
        known = [count for count in counts if count is not None]
        self.frames_expected = sum(known) if len(known) == len(counts) else None
        spans = [span for reader in self._readers if (span := reader.span_ns()) is not None]
        if spans:
            self.duration_s = (max(s[1] for s in spans) - min(s[0] for s in spans)) * 1e-9
        self._first = next(self._frames, None)
        if self._first is None:
            why = self.breaks[0].reason if self.breaks else "it holds no message"
            raise BadInputError(
                f"no picture of topic {self.topic} in {self.path} can be read: {why}"
            )
        self.size_wh = (self._first.rgb.shape[1], self._first.rgb.shape[0])

    @staticmethod
    def _reader(path: Path) -> McapReader | Sqlite3Reader:
        return McapReader(path) if path.suffix.lower() == ".mcap" else Sqlite3Reader(path)

    def _choose(self, wanted: str | None) -> str:
        found: dict[str, Channel] = {}
        for reader in self._readers:
            found |= {channel.topic: channel for channel in reader.channels()}
        pictures = sorted(name for name, one in found.items() if one.type in IMAGE_TYPES)
        listed = ", ".join(pictures[:20]) or "none"
        if wanted is not None:
            if wanted not in pictures:
                raise BadInputError(
                    f"{self.path} has no pictures on topic {wanted!r}; its picture topics: {listed}"
                )
            return wanted
        if not pictures:
            types = sorted({one.type for one in found.values()})
            raise BadInputError(
                f"{self.path} holds no topic of {' or '.join(sorted(IMAGE_TYPES))}, only "
                f"{', '.join(types[:10])[:300] or 'nothing readable'}"
            )
        if len(pictures) > 1:
            raise BadInputError(
                f"{self.path} holds {len(pictures)} topics of pictures ({listed}); choose one with "
                "--topic"
            )
        return pictures[0]

    def __iter__(self) -> Iterator[Frame]:
        first, self._first = self._first, None
        if first is not None:
            yield first
        yield from self._frames

    def close(self) -> None:
        """Release the files."""
        self._frames.close()
        for reader in self._readers:
            reader.close()

    def _read(self) -> Generator[Frame, None, None]:
        index, first_ns, last_ns = 0, 0, 0
        for message in self._messages():
            last_s = (last_ns - first_ns) * 1e-9
            if isinstance(message, str):
                self.note_break(last_s, index - 1, message)
                continue
            try:
                picture = decode_picture(message.data, message.type)
            except BadInputError as error:
                self.note_break(last_s, index - 1, f"skipped one message: {error}")
                continue
            if index == 0:
                self.stamped_by = "message header" if picture.stamp_ns else "recorder"
            stamp_ns = self._stamp(picture, message)
            if not 0 < stamp_ns < _LARGEST_NS or (index and stamp_ns <= last_ns):
                self.note_break(
                    last_s, index - 1, "skipped one picture that is not later than the one before"
                )
                continue
            first_ns = stamp_ns if index == 0 else first_ns
            yield Frame(index, round((stamp_ns - first_ns) * 1e-9, 9), picture.rgb, False, stamp_ns)
            index, last_ns = index + 1, stamp_ns

    def _stamp(self, picture: Picture, message: Message) -> int:
        return picture.stamp_ns if self.stamped_by == "message header" else message.log_ns

    def _messages(self) -> Iterator[Message | str]:
        """The topic's messages, and a sentence for each file that breaks off."""
        for reader in self._readers:
            try:
                yield from reader.messages(self.topic)
            except BagError as error:
                yield str(error)
