"""Reading one picture from a file as RGB, or refusing it with one sentence.

The size is taken from the file's header before any pixel is decoded, so a small file that claims
a gigantic picture costs nothing.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError

Image = npt.NDArray[np.uint8]
Decoded = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

IMAGE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""File name endings read as single images, lower case."""

MAX_PIXELS: Final = 100_000_000
"""Largest picture accepted, pixels; beyond it a header is taken for a decompression bomb."""

MIN_SIDE_PX: Final = 32
"""Smallest width and height in which a track could be seen at all, pixels."""


def read_image(path: Path) -> Image:
    """Read a picture of 8 or 16 bits, grey, RGB, RGBA, palette or CMYK.

    Sixteen-bit values are scaled from their full range (65535 becomes 255); transparent pixels
    are laid over black; the orientation stored by a camera (EXIF) is applied.

    Args:
        path: A PNG, JPEG, BMP, TIFF or WebP file.

    Returns:
        RGB image, shape (H, W, 3).

    Raises:
        BadInputError: if the file is missing, empty, not one of these formats, damaged, smaller
            than 32 pixels on a side or larger than 100 million pixels.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read image {path}: {error.strerror or error}") from error
    if not data:
        raise BadInputError(f"image {path} is empty (0 bytes); copy the file again")
    return decode_image(data, str(path))


def decode_image(data: bytes, name: str) -> Image:
    """Decode the bytes of a picture file as :func:`read_image` does.

    Args:
        data: The file's bytes.
        name: What to call it in a message.

    Returns:
        RGB image, shape (H, W, 3).

    Raises:
        BadInputError: as :func:`read_image`.
    """
    size = header_size_wh(data)
    if size is None:
        raise BadInputError(
            f"{name} is not a PNG, JPEG, BMP, TIFF or WebP image; check that its contents match "
            "its name"
        )
    check_size(size, name)
    return _to_rgb8(_decode(data, name))


def check_size(size_wh: tuple[int, int], name: str) -> None:
    """Refuse pictures too small to show a track or too large to be honest.

    Raises:
        BadInputError: if a side is below 32 pixels or the area above 100 million pixels.
    """
    width, height = size_wh
    if min(width, height) < MIN_SIDE_PX:
        raise BadInputError(
            f"{name} is {width}×{height} pixels; each side must be at least {MIN_SIDE_PX} pixels "
            "to show a track"
        )
    if width * height > MAX_PIXELS:
        raise BadInputError(
            f"{name} claims {width}×{height} pixels; at most {MAX_PIXELS // 1_000_000} million "
            "are accepted, so scale it down first"
        )


def header_size_wh(data: bytes) -> tuple[int, int] | None:
    """Width and height from the header of a supported image file; None if it is not one."""
    try:
        if data[:8] == b"\x89PNG\r\n\x1a\n":
            width, height = struct.unpack(">II", data[16:24])
        elif data[:2] == b"BM":
            width, height = struct.unpack("<ii", data[18:26])
        elif data[:2] == b"\xff\xd8":
            return _jpeg_size_wh(data)
        elif data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff_size_wh(data)
        elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_size_wh(data)
        else:
            return None
    except (struct.error, IndexError):
        return None
    return int(width), abs(int(height))


def _jpeg_size_wh(data: bytes) -> tuple[int, int] | None:
    """Size from the first start-of-frame segment (ITU-T T.81, B.2.2)."""
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return int(width), int(height)
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _tiff_size_wh(data: bytes) -> tuple[int, int] | None:
    """Size from tags 256 and 257 of the first directory (TIFF 6.0, section 2)."""
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack(order + "I", data[4:8])
    (count,) = struct.unpack(order + "H", data[at : at + 2])
    found: dict[int, int] = {}
    for entry in range(count):
        start = at + 2 + 12 * entry
        tag, kind = struct.unpack(order + "HH", data[start : start + 4])
        if tag in (256, 257):
            layout = order + ("H" if kind == 3 else "I")
            length = struct.calcsize(layout)
            found[tag] = struct.unpack(layout, data[start + 8 : start + 8 + length])[0]
    return (found[256], found[257]) if len(found) == 2 else None


def _webp_size_wh(data: bytes) -> tuple[int, int] | None:
    """Size from the first chunk of a WebP file (RFC 9649, sections 2.5 to 2.7)."""
    chunk = data[12:16]
    if chunk == b"VP8X":
        width = 1 + int.from_bytes(data[24:27], "little")
        return width, 1 + int.from_bytes(data[27:30], "little")
    if chunk == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if chunk == b"VP8 ":
        width, height = struct.unpack("<HH", data[26:30])
        return int(width) & 0x3FFF, int(height) & 0x3FFF
    return None


def _decode(data: bytes, name: str) -> Decoded:
    """Decode to (H, W, 3 or 4) BGR(A), 8 or 16 bits; damaged files raise."""
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)  # the one sentence below says it all
    try:
        buffer = np.frombuffer(data, np.uint8)
        flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
        if _may_have_alpha(data):
            flags = cv2.IMREAD_UNCHANGED
        decoded = cv2.imdecode(buffer, flags)
    except cv2.error:
        decoded = None
    finally:
        log.setLogLevel(level)
    if decoded is None:
        raise BadInputError(f"image {name} is damaged and cannot be decoded; copy the file again")
    if decoded.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise BadInputError(
            f"image {name} stores {decoded.dtype} values; convert it to 8 or 16 bits per channel"
        )
    if decoded.ndim == 2:
        decoded = cv2.cvtColor(decoded, cv2.COLOR_GRAY2BGR)
    return cast(Decoded, decoded)


def _may_have_alpha(data: bytes) -> bool:
    """Whether the file is a PNG with an alpha channel (colour types 4 and 6).

    Only these are decoded unchanged: that mode would skip the camera's orientation and the CMYK
    conversion which other formats need.
    """
    return data[:4] == b"\x89PNG" and data[25] in (4, 6)


def _to_rgb8(image: Decoded) -> Image:
    """BGR or BGRA of 8 or 16 bits to RGB uint8, shape (H, W, 3)."""
    if image.dtype == np.uint16:
        image = cast(Image, cv2.convertScaleAbs(image, alpha=255 / 65535))
    if image.ndim == 3 and image.shape[2] == 4:
        alpha = image[..., 3:].astype(np.float32) / 255
        image = np.rint(image[..., :3].astype(np.float32) * alpha).astype(np.uint8)
    return cast(Image, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
