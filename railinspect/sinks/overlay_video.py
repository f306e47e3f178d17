"""The overlay as H.264 in MP4, encoded beside the frame loop, with the media's own times."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Final

import av
import cv2
import numpy as np
import numpy.typing as npt

from railinspect._threads import Worker
from railinspect.records import FrameRecord
from railinspect.sinks.overlay import draw_overlay

TICKS_PER_S: Final = 90_000
"""Time base of the video, ticks per second; fine enough for any frame rate."""

Image = npt.NDArray[np.uint8]


class OverlayVideo:
    """Draws and encodes in a worker thread; at most four pictures wait.

    The file is written in fragments that stay playable if the program is killed, and is turned
    into an ordinary MP4 by :meth:`close`. Times start at the first frame.

    Args:
        path: File to write.
        size_wh: Size of the first picture, pixels; later pictures of another size are fitted in.
    """

    def __init__(self, path: Path, size_wh: tuple[int, int]) -> None:
        self._size_wh = (size_wh[0] + size_wh[0] % 2, size_wh[1] + size_wh[1] % 2)
        options = {"movflags": "frag_keyframe+empty_moov+default_base_moof+hybrid_fragmented"}
        self._container = av.open(str(path), "w", format="mp4", options=options)
        self._stream = stream = self._container.add_stream("libx264", rate=25)
        stream.width, stream.height = self._size_wh
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, TICKS_PER_S)
        stream.codec_context.thread_count = 1
        # No B frames: in a fragmented file they would shift every time by their delay.
        stream.options = {"preset": "superfast", "crf": "24", "g": "100", "bf": "0"}
        self._start_s: float | None = None
        self._last_tick = -1
        self._worker = Worker(self._encode, depth=4)

    def write(self, rgb: Image, record: FrameRecord) -> None:
        """Queue a picture with its record."""
        self._worker.put((rgb, record))

    def close(self) -> None:
        """Encode what is waiting and finish the file."""
        try:
            self._worker.close()
            for packet in self._stream.encode():
                self._container.mux(packet)
        finally:
            self._container.close()

    def _encode(self, item: tuple[Image, FrameRecord]) -> None:
        rgb, record = item
        picture = av.VideoFrame.from_ndarray(fit(draw_overlay(rgb, record), self._size_wh))
        if self._start_s is None:
            self._start_s = record.time_s
        tick = round((record.time_s - self._start_s) * TICKS_PER_S)
        self._last_tick = max(tick, self._last_tick + 1)
        picture.pts, picture.time_base = self._last_tick, Fraction(1, TICKS_PER_S)
        for packet in self._stream.encode(picture):
            self._container.mux(packet)


def fit(rgb: Image, size_wh: tuple[int, int]) -> Image:
    """The picture at another size: padded by one row or column if that is all, else letterboxed."""
    width, height = size_wh
    have_h, have_w = rgb.shape[:2]
    if (have_w, have_h) == size_wh:
        return rgb
    if 0 <= width - have_w <= 1 and 0 <= height - have_h <= 1:
        return np.pad(rgb, ((0, height - have_h), (0, width - have_w), (0, 0)), mode="edge")
    scale = min(width / have_w, height / have_h)
    inner = (max(round(have_w * scale), 1), max(round(have_h * scale), 1))
    framed = np.zeros((height, width, 3), np.uint8)
    left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
    framed[top : top + inner[1], left : left + inner[0]] = cv2.resize(rgb, inner)
    return framed
