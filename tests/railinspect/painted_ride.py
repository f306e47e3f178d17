"""A painted ride and a segmenter that reads the paint, so that tests need no network.

The pictures are flat colours: sky, bed, two rails in true perspective, and red people. The
segmenter tells the colours apart again, also after H.264.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from railinspect.camera import Camera
from railinspect.labels import HUMAN, RAIL_RAISED, SKY, TRACKBED

SIZE_WH = (640, 360)
CAMERA = Camera.from_field_of_view(SIZE_WH, np.radians(50.0), 2.6, pitch_rad=0.045)
SPEED_MPS = 20.0


@dataclass(frozen=True)
class Painted:
    """What a segmenter returns."""

    labels: np.ndarray
    confidence: np.ndarray
    rail_score: np.ndarray


def read_paint(rgb: np.ndarray) -> Painted:
    """Segment a painted picture by its colours."""
    red, green, blue = (rgb[..., i].astype(np.int16) for i in range(3))
    labels = np.full(rgb.shape[:2], TRACKBED, np.uint8)
    labels[(blue > red + 25) & (blue > 150)] = SKY
    labels[(red > 170) & (green > 170)] = RAIL_RAISED
    labels[(red > green + 70) & (red > blue + 70)] = HUMAN
    score = np.where(labels == RAIL_RAISED, 240, 5).astype(np.uint8)
    score = cv2.GaussianBlur(score, (3, 3), 0.6)
    return Painted(labels, np.full(labels.shape, 230, np.uint8), score)


def paint(people_at_m: Sequence[float] = (), rails: bool = True) -> np.ndarray:
    """A straight track seen from its middle, with people standing on it at these ranges."""
    rgb = np.full((SIZE_WH[1], SIZE_WH[0], 3), (96, 88, 80), np.uint8)
    rgb[: round(CAMERA.horizon_v())] = (150, 180, 225)
    if rails:
        along = np.geomspace(4.0, 400.0, 60)
        for side in (-1, 1):
            edges = []
            for shift in (-0.036, 0.036):
                y = side * CAMERA.rail_spacing_m / 2 + shift
                points = np.stack([along, np.full(60, y), np.zeros(60)], axis=1)
                edges.append(CAMERA.project(points))
            outline = np.concatenate([edges[0], edges[1][::-1]])
            outline = np.round(outline * 16).astype(np.int32)
            cv2.fillPoly(rgb, [outline], (215, 215, 210), cv2.LINE_AA, 4)
    for range_m in sorted(people_at_m, reverse=True):
        if 5.0 < range_m < 150.0:
            corners = CAMERA.project([[range_m, 0.5, 1.75], [range_m, -0.1, -0.1]])
            (x0, y0), (x1, y1) = np.round(corners).astype(int)
            cv2.rectangle(rgb, (int(x0), int(y0)), (int(x1), int(y1)), (215, 30, 30), -1)
    return rgb


def ride(
    people_m: Sequence[float] = (90.0,), frames: int = 50, rate: float = 12.5
) -> list[np.ndarray]:
    """Pictures of a ride at 20 m/s past people at these chainages."""
    return [paint([at - SPEED_MPS * i / rate for at in people_m]) for i in range(frames)]


def write_video(
    path: Path,
    pictures: Sequence[np.ndarray],
    times_s: Sequence[float] | None = None,
    *,
    rate: float = 12.5,
    codec: str = "libx264",
    pix_fmt: str = "yuv420p",
    source_format: str = "rgb24",
    container_options: dict[str, str] | None = None,
    codec_options: dict[str, str] | None = None,
    prepare: Any = None,
) -> Path:
    """Encode pictures, by default at a constant rate; ``prepare`` may change the stream first."""
    fine = Fraction(1, 12800)
    with av.open(str(path), "w", options=container_options or {}) as container:
        stream = container.add_stream(codec, rate=Fraction(rate).limit_denominator(1000))
        stream.width, stream.height = pictures[0].shape[1], pictures[0].shape[0]
        stream.pix_fmt = pix_fmt
        stream.time_base = stream.codec_context.time_base = fine
        stream.options = codec_options or {"preset": "ultrafast", "crf": "18", "bf": "0"}
        if prepare is not None:
            prepare(stream)
        for index, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format=source_format)
            time_s = index / rate if times_s is None else times_s[index]
            frame.pts, frame.time_base = round(time_s / fine), fine
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
