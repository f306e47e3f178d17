"""The timeline as inline SVG: status, events, when braking had to start, ranges over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any, Final

from railinspect.report.summary import BINS, InputTimeline
from railinspect.sinks.overlay import clock

WIDTH: Final = 1000.0
"""Drawing units across the time axis; the SVG scales to the page."""

_LEFT: Final = 46.0
_BAND_H: Final = 22.0
_ROW_H: Final = 19.0
_CHART_H: Final = 130.0
_MARK_W: Final = 5.0


def timeline_svg(
    timeline: InputTimeline, events: Sequence[Mapping[str, Any]], breaks: Sequence[float]
) -> str:
    """Draw one input.

    Args:
        timeline: Its condensed frames.
        events: Its events, as in ``events.jsonl``.
        breaks: Media times at which reading failed, seconds.

    Returns:
        An ``<svg>`` element. Colours come from the page's style by class name.
    """
    rows = _pack(timeline, events)
    lanes = max((row for _, row in rows), default=-1) + 1
    ranged = bool(timeline.points)
    band_y, lane_y = 6.0, 6.0 + _BAND_H + 8
    chart_y = lane_y + lanes * _ROW_H + 18
    axis_y = chart_y + _CHART_H + 6 if ranged else lane_y + lanes * _ROW_H
    parts = [*_axis(timeline, band_y, axis_y), *_band(timeline, band_y)]
    for event, row in rows:
        parts.append(_event_bar(timeline, event, lane_y + row * _ROW_H))
    if ranged:
        types = {event["id"]: event["type"] for event in events}
        parts += _range_chart(timeline, types, chart_y)
    for time_s in breaks:
        x = _x(timeline, time_s)
        parts.append(
            f'<g class="break"><line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{axis_y:.1f}"/>'
            f"<title>reading broke at {clock(time_s)}</title></g>"
        )
    height = axis_y + 24
    label = f"Timeline of {len(events)} events, {clock(timeline.first_s)} to "
    label += clock(timeline.last_s)
    return (
        f'<svg class="timeline" viewBox="0 0 {_LEFT + WIDTH + 16:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def _x(timeline: InputTimeline, time_s: float) -> float:
    span = max(timeline.last_s - timeline.first_s, 1e-9)
    share = min(max((time_s - timeline.first_s) / span, 0.0), 1.0)
    return _LEFT + share * WIDTH


def _band(timeline: InputTimeline, y: float) -> list[str]:
    """Status rectangles, equal neighbours joined."""
    parts = [f'<text class="lane" x="0" y="{y + 15:.0f}">status</text>']
    parts.append(
        f'<rect class="none" x="{_LEFT}" y="{y}" width="{WIDTH}" height="{_BAND_H}" rx="3"/>'
    )
    step = WIDTH / BINS
    for status, run in groupby(enumerate(timeline.status), key=lambda item: item[1]):
        columns = [index for index, _ in run]
        if status is None:
            continue
        start_s = timeline.first_s + columns[0] / BINS * (timeline.last_s - timeline.first_s)
        parts.append(
            f'<rect class="s-{status}" x="{_LEFT + columns[0] * step:.1f}" y="{y}" '
            f'width="{len(columns) * step:.2f}" height="{_BAND_H}">'
            f"<title>{status} from {clock(start_s)}</title></rect>"
        )
    return parts


def _pack(
    timeline: InputTimeline, events: Sequence[Mapping[str, Any]]
) -> list[tuple[Mapping[str, Any], int]]:
    """Give each event the first lane in which its bar and its label fit; at most eight lanes."""
    ends: list[float] = []
    placed: list[tuple[Mapping[str, Any], int]] = []
    for event in sorted(events, key=lambda item: item["first_time_s"]):
        start = _x(timeline, event["first_time_s"])
        end = max(_x(timeline, event["last_time_s"]), start + 8) + _label_width(event)
        start = min([start, *(x - _MARK_W for _, _, x in _marks(timeline, event))])
        row = next((i for i, taken in enumerate(ends) if taken <= start), len(ends))
        if row == len(ends):
            if row == 8:
                row = min(range(8), key=lambda i: ends[i])
            else:
                ends.append(0.0)
        ends[row] = end
        placed.append((event, row))
    return placed


def _label_width(event: Mapping[str, Any]) -> float:
    return 14 + 6.2 * len(_label(event))


def _label(event: Mapping[str, Any]) -> str:
    return f"{event['id']} {event['type']}"


def _event_bar(timeline: InputTimeline, event: Mapping[str, Any], y: float) -> str:
    left = _x(timeline, event["first_time_s"])
    width = max(_x(timeline, event["last_time_s"]) - left, 6.0)
    text_x, anchor = left + width + 5, "start"
    if text_x + _label_width(event) > _LEFT + WIDTH + 16:
        first = min([left, *(x - _MARK_W for _, _, x in _marks(timeline, event))])
        text_x, anchor = first - 5, "end"
    title = f"event {_label(event)}, {clock(event['first_time_s'])} to "
    title += clock(event["last_time_s"])
    return (
        f'<a href="#event-{event["id"]}"><g class="t-{escape(event["type"])}">'
        f'<rect x="{left:.1f}" y="{y:.1f}" width="{width:.1f}" height="12" rx="3"/>'
        f'<text class="label" x="{text_x:.1f}" y="{y + 10:.1f}" text-anchor="{anchor}">'
        f"{escape(_label(event))}</text><title>{escape(title)}</title></g>"
        f"{_braking(timeline, event, left, y)}</a>"
    )


def _marks(timeline: InputTimeline, event: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """The brakes that fell due in the recording: which one, when (s), and where in the drawing."""
    due = [(brake, event.get(f"{brake}_by_time_s")) for brake in ("service", "emergency")]
    return [(brake, time_s, _x(timeline, time_s)) for brake, time_s in due if time_s is not None]


def _braking(timeline: InputTimeline, event: Mapping[str, Any], left: float, y: float) -> str:
    """A flag where each brake had to be applied, joined to the event's bar if it lies before it."""
    parts = []
    for brake, time_s, x in _marks(timeline, event):
        words = f"{brake} braking for event {_label(event)} had to start at {clock(time_s)}"
        parts.append(
            f'<g class="m-{brake}"><title>{escape(words)}</title>'
            f'<line class="lead" x1="{x:.1f}" x2="{max(left, x):.1f}" y1="{y + 6:.1f}" '
            f'y2="{y + 6:.1f}"/>'
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{y - 3:.1f}" y2="{y + 14:.1f}"/>'
            f'<polygon points="{x:.1f},{y + 3:.1f} {x - _MARK_W:.1f},{y - 4:.1f} '
            f'{x + _MARK_W:.1f},{y - 4:.1f}"/></g>'
        )
    return "".join(parts)


def _range_chart(timeline: InputTimeline, types: Mapping[int, str], top: float) -> list[str]:
    """Range of each confirmed finding over time; the nearer, the lower."""
    highest = max(timeline.points.values())
    step = nice_step(highest, 4)
    full = max(math.ceil(highest / step) * step, step)
    parts = [f'<text class="lane" x="0" y="{top - 9:.1f}">range</text>']
    for index in range(round(full / step) + 1):
        y = top + _CHART_H * (1 - index * step / full)
        parts.append(
            f'<line class="grid" x1="{_LEFT}" x2="{_LEFT + WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="tick" x="{_LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">'
            f"{index * step:g} m</text>"
        )
    for (column, event_id), range_m in timeline.points.items():
        x = _LEFT + (column + 0.5) / BINS * WIDTH
        y = top + _CHART_H * (1 - range_m / full)
        kind = escape(types.get(event_id, "other"))
        parts.append(f'<circle class="t-{kind}" cx="{x:.1f}" cy="{y:.1f}" r="2"/>')
    return parts


def _axis(timeline: InputTimeline, top: float, bottom: float) -> list[str]:
    span = timeline.last_s - timeline.first_s
    step = nice_step(span, 10) if span > 0 else 1.0
    parts = []
    count = math.floor(timeline.last_s / step + 1e-9) - math.ceil(timeline.first_s / step - 1e-9)
    first = math.ceil(timeline.first_s / step - 1e-9)
    for index in range(count + 1):
        time_s = (first + index) * step
        x = _x(timeline, time_s)
        parts.append(
            f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{top:.1f}" y2="{bottom:.1f}"/>'
            f'<text class="tick" x="{x:.1f}" y="{bottom + 15:.1f}" text-anchor="middle">'
            f"{tick_text(time_s, step)}</text>"
        )
    return parts


def nice_step(span: float, count: int) -> float:
    """A step of 1, 2 or 5 times a power of ten (whole minutes above a minute) for some ticks.

    Example:
        >>> nice_step(21.0, 10), nice_step(1800.0, 10), nice_step(93.0, 4)
        (5.0, 300.0, 50.0)
    """
    raw = max(span, 1e-6) / count
    for step in (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0, 7200.0):
        if raw <= step and raw > 30.0:
            return step
    power = 10.0 ** math.floor(math.log10(raw))
    return next(factor * power for factor in (1, 2, 5, 10) if raw <= factor * power * (1 + 1e-9))


def tick_text(time_s: float, step_s: float) -> str:
    """A time for the axis, with tenths only where the steps need them."""
    text = clock(time_s + 1e-6)
    return text if step_s < 1 else text.rsplit(".", 1)[0]
