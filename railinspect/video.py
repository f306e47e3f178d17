"""Frames in order from a video file; and the door to every recording, :func:`open_source`.

A video's times are its own presentation timestamps.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
import numpy.typing as npt

from railinspect.bags import BagSource, bag_files
from railinspect.errors import BadInputError
from railinspect.image_folder import FolderSource, ImageSource
from railinspect.images import IMAGE_SUFFIXES, check_size
from railinspect.source import Break, Frame, Source

__all__ = ["Break", "Frame", "Source", "open_source", "rgb_of"]


def open_source(
    path: str | Path,
    folder_rate_hz: float | None = None,
    decoder_threads: int = 2,
    topic: str | None = None,
) -> Source:
    """Open a video file, a bag of messages, a folder of images or a single image.

    Args:
        path: The file or folder. Files ending in an image suffix are images, those ending in
            ``.mcap`` or ``.db3`` and folders that hold such files are bags; all others are opened
            as video.
        folder_rate_hz: Frames per second of an image folder, > 0. By default the times are those
            in the file names where every name has one, else index / 10 s.
        decoder_threads: Threads that decode a video; more than two would only add latency beside
            the segmenter's own.
        topic: Topic of a bag's pictures; None takes the only one there is.

    Returns:
        The source, with its first picture's size already checked.

    Raises:
        BadInputError: if nothing can be read; the message is one sentence.
    """
    path = Path(path)
    if folder_rate_hz is not None and not (math.isfinite(folder_rate_hz) and folder_rate_hz > 0):
        raise BadInputError(f"folder rate is {folder_rate_hz} frames/s; give a positive number")
    if not path.exists():
        raise BadInputError(f"input {path} does not exist; check the spelling of the path")
    if path.is_dir():
        bag = bag_files(path)
        if bag:
            return BagSource(path, bag, topic)
        return FolderSource(path, folder_rate_hz)
    if not path.is_file():
        raise BadInputError(f"input {path} is neither a file nor a folder; give a recording")
    if path.stat().st_size == 0:
        raise BadInputError(f"input {path} is empty (0 bytes); copy the recording again")
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return ImageSource(path)
    if bag_files(path):
        return BagSource(path, [path], topic)
    return _VideoSource(path, decoder_threads)


class _VideoSource(Source):
    kind = "video"

    def __init__(self, path: Path, threads: int) -> None:
        super().__init__(path)
        self._threads = threads
        self._first_s: float | None = None
        self._first: Frame | None = None
        self._frames = self._decode()
        self._open()

    def _open(self) -> None:
        try:
            self._container = av.open(str(self.path), mode="r", metadata_errors="replace")
        except (av.FFmpegError, OSError, ValueError) as error:
            raise BadInputError(_why_not_video(self.path)) from error
        try:
            self._open_stream()
        except BaseException:
            self._container.close()
            raise

    def clock(self) -> tuple[float, float] | None:
        first, last_dts = self._first, -math.inf
        times: list[float] = []
        for packet in self._packets():
            if packet.pts is None or packet.time_base is None:
                return None
            if packet.dts is not None and packet.dts < last_dts:
                return None  # the clock was set back on the way
            last_dts = last_dts if packet.dts is None else packet.dts
            times.append(float(packet.pts * packet.time_base))
        times.sort()
        if first is None or first.time_s not in times or any(a >= b for a, b in pairwise(times)):
            return None
        return first.time_s, times[-1]

    def seek(self, time_s: float, remember: int = 0) -> list[float]:
        first_s = self._first_s
        if first_s is None or time_s <= first_s:
            return []
        if not self._go_to(time_s, first_s):
            self.close()
            self._open()
            return []
        assert self._first is not None
        reached_s = self._first.time_s
        times: list[float] = []
        for packet in self._packets(reached_s - (remember + 1) * self._step_s) if remember else ():
            if packet.pts is not None and packet.time_base is not None:
                times.append(float(packet.pts * packet.time_base))
                if times[-1] > reached_s + 1.0:  # pictures are reordered by less
                    break
        return sorted(time for time in times if first_s <= time < reached_s)[-remember:]

    def _go_to(self, time_s: float, first_s: float) -> bool:
        """Stand before a frame at or before a time; False if that did not surely work."""
        time_base = self._stream.time_base
        if time_base is None:
            return False
        self._frames.close()
        self.breaks, self.break_count = [], 0
        try:
            self._container.seek(round(time_s / time_base), stream=self._stream)
        except av.FFmpegError:
            return False
        self._frames = self._decode()
        self._first = next(self._frames, None)
        return self._first is not None and first_s <= self._first.time_s <= time_s

    def _packets(self, from_s: float = -math.inf) -> Iterator[av.Packet[Any]]:
        """The recording's packets, from about a time on, as far as they can be read; undecoded."""
        with (
            contextlib.suppress(av.FFmpegError),
            av.open(str(self.path), mode="r", metadata_errors="replace") as container,
        ):
            stream = container.streams.video[0]
            if self._first_s is not None and from_s > self._first_s and stream.time_base:
                container.seek(round(from_s / stream.time_base), stream=stream)
            for packet in container.demux(stream):
                if packet.size:
                    yield packet

    def _open_stream(self) -> None:
        if not self._container.streams.video:
            raise BadInputError(f"{self.path} holds no video stream; give a recording with one")
        self._stream = stream = self._container.streams.video[0]
        stream.thread_type = "AUTO"
        stream.codec_context.thread_count = self._threads
        if stream.codec_context.width and stream.codec_context.height:
            check_size((stream.codec_context.width, stream.codec_context.height), str(self.path))
        rate = stream.average_rate or stream.guessed_rate
        self._step_s = 1 / float(rate) if rate else 1 / 25
        if stream.duration and stream.time_base:
            self.duration_s = float(stream.duration * stream.time_base)
        elif self._container.duration:
            self.duration_s = self._container.duration / 1_000_000
        self.frames_expected = stream.frames or (
            round(self.duration_s / self._step_s) if self.duration_s else None
        )
        self._frames = self._decode()
        try:
            self._first = next(self._frames)
        except StopIteration:
            why = self.breaks[-1].reason if self.breaks else "it contains no picture"
            raise BadInputError(
                f"no frame of {self.path} can be decoded ({why}); record or copy it again"
            ) from None
        self.size_wh = (self._first.rgb.shape[1], self._first.rgb.shape[0])

    def __iter__(self) -> Iterator[Frame]:
        first, self._first = self._first, None
        if first is not None:
            yield first
        yield from self._frames

    def close(self) -> None:
        self._frames.close()
        self._container.close()

    def _decode(self) -> Generator[Frame, None, None]:
        """Decode packet by packet, so one damaged packet does not end the recording."""
        index, last_s, damaged = 0, 0.0, 0
        for decoded in self._pictures():
            rgb = None if decoded is None else rgb_of(decoded, self._stream)
            if decoded is None or rgb is None:
                damaged += 1
                continue
            if damaged:
                self._note_damage(damaged, last_s, index - 1)
                damaged = 0
            time_s = decoded.time
            if time_s is None:
                time_s = last_s + self._step_s if index else 0.0
            elif index and time_s <= last_s:  # a broken clock must not run backwards
                time_s = last_s + self._step_s / 100
            self._first_s = time_s if self._first_s is None else self._first_s
            yield Frame(index, float(time_s), rgb, bool(decoded.is_corrupt))
            index, last_s = index + 1, float(time_s)
        missing_s = (self.duration_s or 0.0) - (last_s - (self._first_s or 0.0) + self._step_s)
        if index and missing_s > max(2.5 * self._step_s, 0.02 * (self.duration_s or 0.0)):
            reason = (
                f"the recording announces {self.duration_s:.2f} s but its pictures end "
                f"{missing_s:.2f} s earlier"
            )
            self.note_break(last_s, index - 1, reason)
        elif damaged:
            self._note_damage(damaged, last_s, index - 1)

    def _note_damage(self, count: int, time_s: float, frame_index: int) -> None:
        noun = "packet" if count == 1 else "packets"
        self.note_break(time_s, frame_index, f"{count} damaged {noun} could not be decoded")

    def _pictures(self) -> Iterator[av.VideoFrame | None]:
        """Decoded frames; None for each packet that cannot be decoded."""
        packets = self._container.demux(self._stream)
        while True:
            try:
                packet = next(packets)
            except StopIteration:
                return
            except av.FFmpegError:
                # The demuxer cannot go on: hand out what the decoder still holds.
                with contextlib.suppress(av.FFmpegError):
                    yield from self._stream.codec_context.decode(None)
                yield None
                return
            try:
                yield from packet.decode()
            except av.FFmpegError:
                yield None


def rgb_of(
    picture: av.VideoFrame, stream: av.video.stream.VideoStream
) -> npt.NDArray[np.uint8] | None:
    """Square-pixel RGB in display orientation, shape (H, W, 3); None if it cannot be had."""
    width, height = picture.width, picture.height
    aspect = stream.sample_aspect_ratio
    if aspect and 0.25 < aspect < 4 and aspect != 1:
        width = max(1, round(width * aspect))
    try:
        check_size((width, height), "the picture")
        converted = picture.reformat(width=width, height=height, format="rgb24")
    except (BadInputError, av.FFmpegError):
        return None  # a damaged stream may announce any size on the way
    rgb = cast(npt.NDArray[np.uint8], converted.to_ndarray())
    quarter_turns = round(picture.rotation / 90) % 4  # counterclockwise
    if quarter_turns:
        rgb = np.ascontiguousarray(np.rot90(rgb, quarter_turns))
    return rgb


def _why_not_video(path: Path) -> str:
    """One sentence on why the demuxers refuse a file, from its first bytes."""
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        return f"cannot read {path}: {error.strerror}"
    if head[4:8] == b"ftyp":
        return (
            f"{path} is an MP4 or MOV whose index (moov) is missing, so it was cut off before the "
            "recorder closed it; repair it with the recorder's own tool, or record to MKV"
        )
    if head and not any(byte < 9 for byte in head):
        return f"{path} is text, not a video, whatever its name says; give a recording"
    return f"{path} is not a video this program can read; convert it to MP4 (H.264) first"
