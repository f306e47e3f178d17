"""Frames from a folder of pictures, or from a single one."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from railinspect.errors import BadInputError
from railinspect.image_times import Stamps, read_times, stamps_from_names, times_file
from railinspect.images import IMAGE_SUFFIXES, read_image
from railinspect.source import Frame, Source

DEFAULT_FOLDER_RATE_HZ: Final = 10.0
"""Frames per second of an image folder whose rate is neither given nor in its file names."""


class ImageSource(Source):
    """A single picture, at 0 s.

    Args:
        path: The picture.

    Raises:
        BadInputError: if it cannot be read.
    """

    kind = "image"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._rgb = read_image(path)
        self.size_wh = (self._rgb.shape[1], self._rgb.shape[0])
        self.frames_expected, self.duration_s = 1, 0.0

    def __iter__(self) -> Iterator[Frame]:
        yield Frame(0, 0.0, self._rgb)

    def close(self) -> None:
        """Nothing is open."""


class FolderSource(Source):
    """The pictures directly in a folder, in order of time where times are known, else of name.

    Args:
        path: The folder.
        rate_hz: Frames per second; None takes the times from ``times.csv`` or ``timestamps.csv``
            in the folder, else from the names where all have one, else 10 per second.

    Raises:
        BadInputError: if there is no picture, or the times cannot be used.
    """

    kind = "folder"

    def __init__(self, path: Path, rate_hz: float | None) -> None:
        super().__init__(path)
        try:
            files = [f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES]
        except OSError as error:
            raise BadInputError(f"cannot list folder {path}: {error.strerror}") from error
        if not files:
            raise BadInputError(
                f"folder {path} holds no image ({', '.join(IMAGE_SUFFIXES)}); give the folder that "
                "directly contains the frames"
            )
        self._files = sorted(files, key=lambda file: natural_key(file.name))
        self._stamps_ns: list[int] | None = None
        self._times_s = self._times(rate_hz)
        first = read_image(self._files[0])
        self.size_wh = (first.shape[1], first.shape[0])
        self.frames_expected = len(self._files)
        self.duration_s = self._times_s[-1] - self._times_s[0]

    def _times(self, rate_hz: float | None) -> list[float]:
        """Media times of the files, which a CSV file may bring into another order."""
        listed = None if rate_hz else times_file(self.path)
        if listed is not None:
            return self._listed_times(listed)
        stamps = None if rate_hz else stamps_from_names([file.stem for file in self._files])
        if stamps is not None:
            self._note_stamps(stamps, "the file names")
            return stamps.seconds(stamps.times_ns[0])
        step_s = 1 / (rate_hz or DEFAULT_FOLDER_RATE_HZ)
        return [index * step_s for index in range(len(self._files))]

    def _listed_times(self, path: Path) -> list[float]:
        times, column = read_times(path)
        unlisted = [file.name for file in self._files if file.name not in times]
        if unlisted:
            raise BadInputError(
                f"{path} does not list {unlisted[0]!r} ({len(unlisted)} of {len(self._files)} "
                "pictures are missing in it); complete it, or give --rate"
            )
        self._files.sort(key=lambda file: times[file.name])
        times_ns = tuple(times[file.name] for file in self._files)
        for one, next_one in pairwise(self._files):
            if times[one.name] == times[next_one.name]:
                raise BadInputError(
                    f"{path} gives {one.name!r} and {next_one.name!r} the same time; correct it, "
                    "or give --rate"
                )
        stamps = Stamps(times_ns, is_clock=column != "time_s")
        missing = len(times) - len(self._files)
        since_ns = times_ns[0] if stamps.is_clock else 0
        seconds = stamps.seconds(since_ns)
        if missing:
            self.note_break(
                seconds[-1], len(self._files) - 1, f"{missing} pictures in {path.name} are missing"
            )
        self._note_stamps(stamps, path.name)
        return seconds

    def _note_stamps(self, stamps: Stamps, origin: str) -> None:
        if stamps.is_clock:
            self._stamps_ns, self.stamped_by = list(stamps.times_ns), origin

    def clock(self) -> tuple[float, float] | None:
        """Times of the first and the last picture, seconds."""
        return self._times_s[0], self._times_s[-1]

    def seek(self, time_s: float, remember: int = 0) -> list[float]:
        """Leave out pictures before a media time."""
        left_out = max(bisect_right(self._times_s, time_s) - 1, 0)
        times = self._times_s[max(left_out - remember, 0) : left_out]
        self._files, self._times_s = self._files[left_out:], self._times_s[left_out:]
        if self._stamps_ns is not None:
            self._stamps_ns = self._stamps_ns[left_out:]
        return times

    def __iter__(self) -> Iterator[Frame]:
        index, last_s = 0, self._times_s[0]
        stamps: Sequence[int | None] = self._stamps_ns or [None] * len(self._files)
        for file, time_s, stamp_ns in zip(self._files, self._times_s, stamps, strict=True):
            try:
                rgb = read_image(file)
            except BadInputError as error:
                self.note_break(last_s, index - 1, f"skipped one file: {error}")
                continue
            yield Frame(index, time_s, rgb, stamp_ns=stamp_ns)
            index, last_s = index + 1, time_s

    def close(self) -> None:
        """Nothing is open."""


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key by which ``frame2`` comes before ``frame10``.

    Example:
        >>> sorted(["f10.png", "f2.png", "F1.png"], key=natural_key)
        ['F1.png', 'f2.png', 'f10.png']
    """
    parts = re.split(r"([0-9]+)", name.casefold())
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]
