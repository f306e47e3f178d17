"""Which recordings a command names: files, folders, globs, lists, and fsspec addresses."""

from __future__ import annotations

import csv
import glob
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from railinspect.errors import BadInputError
from railinspect.images import IMAGE_SUFFIXES

VIDEO_SUFFIXES: Final = (
    *(".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".ts", ".m2ts", ".mts", ".mpg", ".mpeg"),
    *(".mxf", ".wmv", ".asf", ".flv", ".3gp", ".ogv", ".h264", ".h265", ".hevc", ".mcap"),
)
"""Files of a folder that are recordings; others are passed over."""

LIST_SUFFIXES: Final = (".csv", ".parquet")

LIST_COLUMNS: Final = ("address", "path", "file", "url")
"""Columns of a list that may hold the addresses; the first one there is taken."""

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(?:://|::)")
_PATTERN = re.compile(r"[*?\[]")


def is_address(text: str) -> bool:
    """Whether an input is an fsspec address such as ``s3://bucket/ride.mp4``, not a local path."""
    return bool(_ADDRESS.match(text)) and not os.path.lexists(text)


def names_many(text: str) -> bool:
    """Whether an input names several recordings, or one that is not a local file or folder."""
    path = Path(text)
    if is_address(text) or path.suffix.lower() in LIST_SUFFIXES:
        return True
    if path.is_dir():
        return not _holds_images(path)
    return not os.path.lexists(path) and bool(_PATTERN.search(text))


def expand(inputs: Sequence[str], apart_from: Path | None = None) -> tuple[str, ...]:
    """The address of every recording the inputs name, each once, sorted.

    Args:
        inputs: Files, image folders, folders of recordings (searched to any depth), glob patterns
            (``**`` for any depth), lists (``.csv`` or ``.parquet`` with a column ``address`` or
            ``path``; relative paths count from the list's folder) and fsspec addresses.
        apart_from: A folder that is not searched.

    Returns:
        Absolute paths and fsspec addresses. A file named outright is among them even where it
        does not exist: what becomes of it is recorded.

    Raises:
        BadInputError: if an input names nothing, or a list cannot be read.
    """
    found: set[str] = set()
    for text in inputs:
        named = list(_expanded(text, apart_from))
        found.update(named)
        if named:
            continue
        if Path(text).is_dir():
            raise BadInputError(
                f"folder {printable(text)} holds no image and no video "
                f"({', '.join(VIDEO_SUFFIXES[:4])}, …) at any depth; give the one recordings are in"
            )
        raise BadInputError(f"input {printable(text)} names no recording; check what it matches")
    return tuple(sorted(found, key=os.fsencode))


def _expanded(text: str, apart_from: Path | None) -> Iterator[str]:
    if is_address(text) and not text.startswith(("file://", "local://")):
        yield from _remote(text)
        return
    text = re.sub(r"^(?:file|local)://", "", text)
    path = Path(text)
    if path.suffix.lower() in LIST_SUFFIXES and not path.is_dir():
        for entry in _listed(path):
            local = not is_address(entry) and not Path(entry).is_absolute()
            yield from _expanded(str(path.parent / entry) if local else entry, apart_from)
    elif path.is_dir():
        yield from _in_folder(path, apart_from)
    elif not os.path.lexists(path) and _PATTERN.search(text):
        for match in glob.iglob(text, recursive=True):  # noqa: PTH207  # takes absolute patterns
            yield from _local(match, apart_from)
    else:
        yield _absolute(text)


def _local(match: str, apart_from: Path | None) -> Iterator[str]:
    """A file or folder that a pattern matched; nothing in its name has a meaning any more."""
    if Path(match).is_dir():
        yield from _in_folder(Path(match), apart_from)
    else:
        yield _absolute(match)


def _absolute(path: str | Path) -> str:
    """An absolute path, so that no name looks like a protocol or an option; follows no link."""
    return os.path.abspath(path)  # noqa: PTH100  # Path.resolve() would follow links


def _in_folder(path: Path, apart_from: Path | None) -> Iterator[str]:
    """The folder itself if it holds images, and every video and image folder below it."""
    apart = None if apart_from is None else apart_from.resolve()
    for folder, folders, files in os.walk(path):
        here = Path(folder)
        if apart is not None and here.resolve() == apart:
            folders.clear()
            continue
        folders.sort()
        if any(Path(name).suffix.lower() in IMAGE_SUFFIXES for name in files):
            yield _absolute(here)
        for name in sorted(files):
            if Path(name).suffix.lower() in VIDEO_SUFFIXES:
                yield _absolute(here / name)


def _holds_images(path: Path) -> bool:
    with os.scandir(path) as entries:
        return any(Path(entry.name).suffix.lower() in IMAGE_SUFFIXES for entry in entries)


def _remote(address: str) -> Iterator[str]:
    from railinspect.fleet.storage import remote_filesystem

    filesystem, path = remote_filesystem(address)
    try:
        if _PATTERN.search(path):
            matches = sorted(filesystem.glob(path))
        elif filesystem.isdir(path):
            matches = [
                match
                for match in sorted(filesystem.find(path))
                if Path(match).suffix.lower() in VIDEO_SUFFIXES
            ]
        else:
            yield address
            return
    except Exception as error:  # each file system raises its own
        raise BadInputError(
            f"cannot list {address}: {type(error).__name__}: {error}; check the address and your "
            "credentials"
        ) from error
    for match in matches:
        yield filesystem.unstrip_protocol(match)


def _listed(path: Path) -> list[str]:
    """The addresses of a list."""
    rows: list[dict[str, Any]]
    try:
        if path.suffix.lower() == ".parquet":
            import pyarrow.parquet as pq

            names = pq.read_schema(path).names
            column = next((name for name in LIST_COLUMNS if name in names), None)
            rows = [] if column is None else pq.read_table(path, columns=[column]).to_pylist()
        else:
            with path.open(encoding="utf-8-sig", newline="") as file:
                reader = csv.DictReader(file)
                rows = list(reader)
                names = list(reader.fieldnames or ())
            column = next((name for name in LIST_COLUMNS if name in names), None)
    except (OSError, ValueError, csv.Error) as error:
        raise BadInputError(f"cannot read the list {path}: {error}") from error
    if column is None:
        raise BadInputError(
            f"list {path} has the columns {', '.join(names) or '(none)'}; name the one that holds "
            f"the recordings {LIST_COLUMNS[0]!r} or {LIST_COLUMNS[1]!r}"
        )
    return [str(row[column]).strip() for row in rows if row[column] and str(row[column]).strip()]


def printable(text: str) -> str:
    """An address for people and for JSON: undecodable bytes and control characters escaped.

    Example:
        >>> printable("ride" + chr(9) + ".mp4") == "ride" + chr(92) + "t.mp4"
        True
    """
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def short_name(address: str) -> str:
    """A name for people: the last part of an address without its ending.

    Example:
        >>> short_name("s3://fleet/2026/cab 7.mp4"), short_name("/rides/a<b>.mkv")
        ('cab 7', 'a_b_')
    """
    last = re.split(r"[/\\\\]", address.rstrip("/"))[-1]
    stem = last.rsplit(".", 1)[0] if "." in last.strip(".") else last
    clean = re.sub(r"[^\w .+=@-]", "_", printable(stem)).strip(". ")
    return clean[:80] or "input"
