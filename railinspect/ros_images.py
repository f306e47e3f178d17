"""Pictures in ROS messages: ``sensor_msgs`` ``Image`` and ``CompressedImage`` in CDR.

The two layouts are read directly (OMG DDS-RTPS 2.3, 10.2, plain CDR of either byte order): a
definition that comes with a recording is never interpreted.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.errors import BadInputError
from railinspect.images import check_size, decode_image

IMAGE_TYPES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
"""Message types that are pictures."""

MAX_TEXT_BYTES: Final = 4096
"""Longest frame name or encoding read, bytes."""

# Encoding: bytes per channel, channels, OpenCV's conversion to RGB (None: it is RGB already).
_ENCODINGS: Final[dict[str, tuple[int, int, int | None]]] = {
    "rgb8": (1, 3, None),
    "bgr8": (1, 3, cv2.COLOR_BGR2RGB),
    "8UC3": (1, 3, cv2.COLOR_BGR2RGB),
    "rgba8": (1, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (1, 4, cv2.COLOR_BGRA2RGB),
    "8UC4": (1, 4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, 1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, 1, cv2.COLOR_GRAY2RGB),
    "mono16": (2, 1, cv2.COLOR_GRAY2RGB),
    "16UC1": (2, 1, cv2.COLOR_GRAY2RGB),
    "rgb16": (2, 3, None),
    "bgr16": (2, 3, cv2.COLOR_BGR2RGB),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
}


@dataclass(frozen=True)
class Picture:
    """A decoded message.

    Attributes:
        stamp_ns: Unix time in its header, nanoseconds; 0 where the header is empty.
        rgb: Image, uint8, shape (H, W, 3).
    """

    stamp_ns: int
    rgb: npt.NDArray[np.uint8]


def decode_picture(data: bytes, type_: str) -> Picture:
    """Decode a message.

    Args:
        data: Its bytes, with the four that say how it is encoded.
        type_: One of ``IMAGE_TYPES``.

    Raises:
        BadInputError: if it is damaged, too large, or of an encoding not read.
    """
    if type_ not in IMAGE_TYPES:
        raise BadInputError(f"a message of type {type_[:80]!r} is no picture")
    cdr = _Cdr(data)
    seconds, nanoseconds = cdr.int32(), cdr.uint32()
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise BadInputError(f"a message is stamped {seconds} s and {nanoseconds} ns; it is damaged")
    stamp_ns = seconds * 1_000_000_000 + nanoseconds
    cdr.text()  # the frame's name
    if type_.endswith("CompressedImage"):
        cdr.text()  # the format in words; the bytes themselves say it better
        return Picture(stamp_ns, decode_image(bytes(cdr.octets()), "a compressed picture"))
    height, width = cdr.uint32(), cdr.uint32()
    encoding, big_endian, step = cdr.text(), cdr.uint8(), cdr.uint32()
    return Picture(stamp_ns, _raw(cdr.octets(), (width, height), encoding, bool(big_endian), step))


def _raw(
    data: memoryview, size_wh: tuple[int, int], encoding: str, big_endian: bool, step: int
) -> npt.NDArray[np.uint8]:
    """Rows of pixels, each ``step`` bytes long, to RGB."""
    check_size(size_wh, "a picture")
    if encoding not in _ENCODINGS:
        raise BadInputError(
            f"a picture is encoded as {encoding[:40]!r}; read are {', '.join(_ENCODINGS)}"
        )
    depth, channels, conversion = _ENCODINGS[encoding]
    width, height = size_wh
    row_bytes = width * depth * channels
    if step < row_bytes or step > 4 * row_bytes + 4096 or len(data) < height * step:
        raise BadInputError(
            f"a picture of {width}×{height} pixels in {encoding} has rows of {step} bytes and "
            f"{len(data)} bytes in all; it is cut off or damaged"
        )
    rows = np.frombuffer(data, np.uint8, height * step).reshape(height, step)[:, :row_bytes]
    pixels: npt.NDArray[np.generic] = np.ascontiguousarray(rows)
    if depth == 2:
        wide = pixels.view(">u2" if big_endian else "<u2")
        # 65535 becomes 255, as for images in files.
        pixels = np.round(wide.astype(np.float32) * (255 / 65535)).astype(np.uint8)
    pixels = pixels.reshape(height, width, channels) if channels > 1 else pixels
    if conversion is None:
        return np.array(pixels, np.uint8)
    try:
        return cast(npt.NDArray[np.uint8], cv2.cvtColor(pixels.astype(np.uint8), conversion))
    except cv2.error as error:
        raise BadInputError(
            f"a picture of {width}×{height} pixels cannot be {encoding}; it is damaged"
        ) from error


class _Cdr:
    """Reads values one after another, each aligned to its own size after the first four bytes."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise BadInputError(
                "a message is not plain CDR; a bag that compresses each message has to be "
                "converted first (ros2 bag convert)"
            )
        self._order = "<" if data[1] else ">"
        self._data, self._at = memoryview(data)[4:], 0

    def _number(self, layout: str, size: int) -> int:
        start = -(-self._at // size) * size
        self._at = start + size
        if self._at > len(self._data):
            raise BadInputError("a message ends too early; it is damaged")
        return int(struct.unpack_from(self._order + layout, self._data, start)[0])

    def uint8(self) -> int:
        return self._number("B", 1)

    def int32(self) -> int:
        return self._number("i", 4)

    def uint32(self) -> int:
        return self._number("I", 4)

    def octets(self) -> memoryview:
        """A sequence of bytes, without copying it."""
        length = self.uint32()
        start, self._at = self._at, self._at + length
        if self._at > len(self._data):
            raise BadInputError("a message ends too early; it is damaged")
        return self._data[start : self._at]

    def text(self) -> str:
        """A string, which ends in a zero byte."""
        octets = self.octets()
        if len(octets) > MAX_TEXT_BYTES:
            raise BadInputError(f"a message has a name of {len(octets)} bytes; it is damaged")
        return bytes(octets).rstrip(b"\0").decode("utf-8", "replace")
