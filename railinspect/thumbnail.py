"""The picture of an event: its box with the surroundings, outlined."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

THUMBNAIL_WH: Final = (240, 160)
"""Largest size of an event's picture, pixels."""


def cut_out(rgb: npt.NDArray[np.uint8], box_xyxy: tuple[float, float, float, float]) -> bytes:
    """A JPEG of the box with its surroundings, the box outlined, at most 240×160 pixels."""
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box_xyxy
    half_w = max(0.8 * (x1 - x0), 1.2 * (y1 - y0), 48.0)
    half_h = half_w * THUMBNAIL_WH[1] / THUMBNAIL_WH[0]
    centre_u = min(max((x0 + x1) / 2, half_w), max(width - half_w, width / 2))
    centre_v = min(max((y0 + y1) / 2, half_h), max(height - half_h, height / 2))
    left, top = max(int(centre_u - half_w), 0), max(int(centre_v - half_h), 0)
    right, bottom = min(int(centre_u + half_w) + 1, width), min(int(centre_v + half_h) + 1, height)
    crop = rgb[top:bottom, left:right]
    scale = min(THUMBNAIL_WH[0] / crop.shape[1], THUMBNAIL_WH[1] / crop.shape[0])
    size = (max(round(crop.shape[1] * scale), 1), max(round(crop.shape[0] * scale), 1))
    picture = cv2.cvtColor(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2BGR)
    corners = [round((x0 - left) * scale) - 2, round((y0 - top) * scale) - 2]
    corners += [round((x1 - left) * scale) + 2, round((y1 - top) * scale) + 2]
    cv2.rectangle(picture, tuple(corners[:2]), tuple(corners[2:]), (60, 200, 255), 1, cv2.LINE_AA)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
