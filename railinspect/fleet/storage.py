"""Where an input's content lies: a local path, or a copy fetched from object storage."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from railinspect.errors import BadInputError
from railinspect.fleet.inputs import is_address, printable
from railinspect.images import IMAGE_SUFFIXES

BLOCK: Final = 1 << 20
"""So much is read at a time, bytes."""

DEFAULT_LIMIT_BYTES: Final = 64 * 10**9
"""Largest object that is fetched unless another limit is given."""


def remote_filesystem(address: str) -> tuple[Any, str]:
    """The fsspec file system of an address and the path in it.

    Raises:
        BadInputError: if there is none, or fsspec is not installed.
    """
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise BadInputError(
            f"input {printable(address)} needs fsspec; install railinspect[fleet]"
        ) from error
    try:
        filesystem, path = url_to_fs(address)
    except (ImportError, ValueError, OSError) as error:
        raise BadInputError(f"cannot open {printable(address)}: {error}") from error
    return filesystem, path


def version(address: str) -> str:
    """Something that changes when the content does, without reading it.

    Raises:
        BadInputError: if the input does not exist or cannot be reached.
    """
    if is_address(address):
        filesystem, path = remote_filesystem(address)
        try:
            return f"{filesystem.size(path)} {filesystem.ukey(path)}"
        except FileNotFoundError as error:
            raise BadInputError(f"input {printable(address)} does not exist") from error
        except Exception as error:  # each file system raises its own
            raise BadInputError(
                f"cannot reach {printable(address)}: {type(error).__name__}: {error}"
            ) from error
    local = Path(address)
    try:
        files = list(_images(local)) if local.is_dir() else [local]
        seen = [(file.name, file.stat()) for file in files]
    except OSError as error:
        why = "does not exist" if isinstance(error, FileNotFoundError) else error.strerror
        raise BadInputError(f"input {printable(address)} {why}") from error
    if not local.is_dir() and not stat.S_ISREG(seen[0][1].st_mode):
        raise BadInputError(
            f"input {printable(address)} is neither a file nor a folder; give a recording"
        )
    text = "\n".join(f"{name} {one.st_size} {one.st_mtime_ns}" for name, one in seen)
    return hashlib.sha256(os.fsencode(text)).hexdigest()[:32]


def content_hash(path: Path) -> tuple[str, int]:
    """SHA-256 of a file, or of an image folder's names and images, in hex, and its bytes.

    Raises:
        BadInputError: if it cannot be read.
    """
    total = hashlib.sha256()
    size = 0
    try:
        for file in _images(path) if path.is_dir() else [path]:
            digest = hashlib.sha256() if path.is_dir() else total
            with file.open("rb") as stream:
                while block := stream.read(BLOCK):
                    digest.update(block)
                    size += len(block)
            if path.is_dir():
                total.update(os.fsencode(file.name) + b"\0" + digest.digest())
    except OSError as error:
        raise BadInputError(f"cannot read {printable(str(path))}: {error.strerror}") from error
    return total.hexdigest(), size


def fetch(address: str, to: Path, limit_bytes: int) -> None:
    """Copy a remote object to a file.

    Raises:
        BadInputError: if it cannot be read or is larger than the limit.
        OSError: if the file cannot be written.
    """
    filesystem, path = remote_filesystem(address)
    too_large = (
        f"{printable(address)} is larger than the limit of {limit_bytes / 1e9:g} GB; raise "
        "--fetch-limit if that is meant"
    )
    try:
        size = filesystem.size(path)
        source = filesystem.open(path, "rb", block_size=8 * BLOCK)
    except Exception as error:  # each file system raises its own
        raise BadInputError(
            f"cannot fetch {printable(address)}: {type(error).__name__}: {error}"
        ) from error
    if size is not None and size > limit_bytes:
        source.close()
        raise BadInputError(too_large)
    copied = 0
    with source, to.open("wb") as target:
        while True:
            try:
                block = source.read(8 * BLOCK)
            except Exception as error:  # each file system raises its own
                raise BadInputError(
                    f"cannot fetch {printable(address)}: {type(error).__name__}: {error}"
                ) from error
            if not block:
                return
            copied += len(block)
            if copied > limit_bytes:
                raise BadInputError(too_large)
            target.write(block)


def publish(made: Path, final: Path) -> None:
    """Give a file or folder its final name, whole or not at all, also if the power fails.

    What already has that name stays: it was made from the same content in the same way.
    """
    for file in _files(made):
        _sync(file)
    final.parent.mkdir(parents=True, exist_ok=True)
    try:
        made.rename(final)
    except OSError:
        if not final.exists():
            raise
        remove(made)
    _sync(final.parent)


def replace_file(final: Path, data: bytes, scratch: Path) -> None:
    """Write a file under a temporary name in ``scratch`` and put it in place of the old one."""
    scratch.mkdir(parents=True, exist_ok=True)
    made = scratch / f"{final.name}-{os.getpid()}"
    made.write_bytes(data)
    _sync(made)
    final.parent.mkdir(parents=True, exist_ok=True)
    made.replace(final)
    _sync(final.parent)


def remove(path: Path) -> None:
    """Delete a file or folder if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        for folder, _, names in os.walk(path, topdown=False):
            yield from (Path(folder, name) for name in names)
            yield Path(folder)
    else:
        yield path


def _sync(path: Path) -> None:
    """Have a file's or folder's content written to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _images(path: Path) -> Iterator[Path]:
    """The images directly in a folder, by name."""
    found = [file for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
    yield from sorted(found, key=lambda file: os.fsencode(file.name))
