"""Drawing a record over its picture: rails, region inspected, findings, ranges and advice."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.records import FrameRecord, LocatedFinding

Image = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

STATUS_RGB: Final[dict[str, Colour]] = {
    "clear": (70, 200, 120),
    "finding": (222, 72, 78),
    "unknown": (170, 170, 180),
}
"""Colour of each frame status; the report uses the same."""

TYPE_RGB: Final[dict[str, Colour]] = {
    "distortion": (250, 190, 60),
    "obstruction": (255, 105, 60),
    "trespasser": (235, 70, 150),
}
"""Colour of each finding type; the report uses the same."""

ACTION_RGB: Final[dict[str, Colour]] = {
    "none": (150, 160, 170),
    "warn": (250, 190, 60),
    "service": (255, 120, 60),
    "emergency": (240, 60, 60),
}
"""Colour of each advised action; the report uses the same."""

_RAIL: Final = (60, 225, 235)
_ROI: Final = (60, 150, 235)
_INK: Final = (245, 247, 250)
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_SUBPIXEL_BITS: Final = 3
_PLAIN: Final = str.maketrans({"–": "-", "−": "-", "±": "+-", "≥": ">=", "≤": "<=", "…": "..."})


def draw_overlay(rgb: Image, record: FrameRecord) -> Image:
    """A copy of the picture with the record drawn over it.

    Confirmed findings have a solid box with their event's number, unconfirmed ones a thin box.

    Args:
        rgb: The inspected image, shape (H, W, 3).
        record: Its record.

    Returns:
        RGB image of the same shape.
    """
    picture = rgb.copy()
    scale = max(min(rgb.shape[0], rgb.shape[1]) / 480, 0.75)
    thin = max(round(1.2 * scale), 1)
    if record.followed or record.status != "unknown":  # rails may be sure and the track not clear
        if len(record.roi_uv) > 2:
            _lines(picture, record.roi_uv, _ROI, thin, closed=True)
        for rail in (record.left_uv, record.right_uv):
            if len(rail) > 1:
                _lines(picture, rail, _RAIL, thin + 1, closed=False)
    labels: list[tuple[int, int, int, int]] = []
    for found in sorted(record.findings, key=lambda one: -one.finding.box_xyxy[3]):
        _draw_finding(picture, found, scale, thin, labels)
    _draw_banner(picture, record, scale)
    return picture


def _lines(
    picture: Image, points_uv: npt.NDArray[np.float64], colour: Colour, width: int, closed: bool
) -> None:
    fixed = np.round(points_uv[np.isfinite(points_uv).all(axis=1)] * (1 << _SUBPIXEL_BITS))
    fixed = np.clip(fixed, -(1 << 18), 1 << 18).astype(np.int32)
    cv2.polylines(picture, [fixed], closed, colour, width, cv2.LINE_AA, _SUBPIXEL_BITS)


def _draw_finding(
    picture: Image,
    found: LocatedFinding,
    scale: float,
    thin: int,
    labels: list[tuple[int, int, int, int]],
) -> None:
    colour = TYPE_RGB.get(found.finding.type, _INK)
    confirmed = found.event_id is not None
    polygon = np.asarray(found.finding.polygon_uv, float)
    if len(polygon) > 2:
        _lines(picture, polygon, colour, thin, closed=True)
    x0, y0, x1, y1 = (round(value) for value in found.finding.box_xyxy)
    cv2.rectangle(picture, (x0, y0), (x1, y1), colour, thin + 1 if confirmed else thin)
    words: str = found.finding.type
    if found.event_id is not None:
        words = f"#{found.event_id} {words}"
    if found.range is not None:
        low, high = found.range.interval_m
        words += f" {found.range.range_m:.0f} m ({low:.0f}-{high:.0f})"
    else:
        words += " range unknown"
    _label(picture, words, (x0, y0), colour, 0.45 * scale, labels)


def _label(
    picture: Image,
    words: str,
    at: tuple[int, int],
    colour: Colour,
    size: float,
    labels: list[tuple[int, int, int, int]],
) -> None:
    """Dark text on a coloured tag above ``at``, inside the picture and off the other labels."""
    thickness = max(round(size * 1.6), 1)
    (width, height), base = cv2.getTextSize(words, _FONT, size, thickness)
    tall, wide = height + base + 2, width + 6
    left = min(max(at[0], 0), max(picture.shape[1] - wide, 0))
    bottom = max(at[1] - 3, tall)
    for other in sorted(labels, key=lambda box: -box[3]):
        apart = left >= other[2] or other[0] >= left + wide
        if not apart and bottom > other[1] and bottom - tall < other[3] and other[1] >= tall:
            bottom = other[1] - 1
    labels.append((left, bottom - tall, left + wide, bottom))
    cv2.rectangle(picture, (left, bottom - tall), (left + wide, bottom), colour, -1)
    cv2.putText(
        picture, words, (left + 3, bottom - base), _FONT, size, (20, 22, 26), thickness, cv2.LINE_AA
    )


def _draw_banner(picture: Image, record: FrameRecord, scale: float) -> None:
    """Time, status and advice on a darkened strip along the bottom edge."""
    size = 0.5 * scale
    thickness = max(round(size * 1.6), 1)
    strip = picture[-max(round(26 * scale), 14) :]
    np.right_shift(strip, 2, out=strip)
    baseline = picture.shape[0] - round(8 * scale)
    pen = round(8 * scale)

    def write(words: str, colour: Colour) -> None:
        nonlocal pen
        cv2.putText(picture, words, (pen, baseline), _FONT, size, colour, thickness, cv2.LINE_AA)
        pen += cv2.getTextSize(words, _FONT, size, thickness)[0][0] + round(14 * scale)

    write(f"{clock(record.time_s)}", _INK)
    write(record.status.upper(), STATUS_RGB[record.status])
    advice = record.advice
    advised = advice is not None and advice.action != "none"
    if advice is not None and advised:
        words = f"{advice.action.upper()}"
        needed_m = advice.emergency_at_m if advice.action == "emergency" else advice.required_m
        if advice.available_m is not None and np.isfinite(needed_m):
            words += f" stop needs {needed_m:.0f} m, has {advice.available_m:.0f} m"
        write(words, ACTION_RGB[advice.action])
    if record.status == "unknown" and record.reason:
        write(ascii_only(record.reason), _INK)
    elif record.reach_m is not None and not advised:
        write(f"rails followed to {record.reach_m:.0f} m", _INK)


def ascii_only(words: str) -> str:
    """The text with what OpenCV's fonts lack replaced: dashes, ± and ≥ by ASCII, rest by "?"."""
    words = words.translate(_PLAIN)
    return words.encode("ascii", "replace").decode()


def clock(time_s: float) -> str:
    """Media time as ``h:mm:ss.s`` or ``m:ss.s``.

    Example:
        >>> clock(61.25), clock(3725.0), clock(-0.04)
        ('1:01.2', '1:02:05.0', '-0:00.0')
    """
    sign, tenths = ("-" if time_s < 0 else ""), int(abs(time_s) * 10)
    minutes, seconds = divmod(tenths / 10, 60)
    hours, minutes = divmod(int(minutes), 60)
    if hours:
        return f"{sign}{hours}:{minutes:02d}:{seconds:04.1f}"
    return f"{sign}{minutes}:{seconds:04.1f}"
