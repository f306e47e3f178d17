"""The report of a fleet run: one page that needs nothing beside it and no network."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from railinspect.fleet import dataset
from railinspect.fleet.budget import Budget, Rate, rate, read_budget
from railinspect.fleet.clips import clip_of, top_events
from railinspect.fleet.drift import Drift, drift_of
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.geojson import write_geojson
from railinspect.fleet.published import publish
from railinspect.fleet.totals import RANGES_M, Exposure, Totals, events_of, totals_of
from railinspect.report.parts import cards_of, clip, count_of, document, picture, table
from railinspect.sinks.overlay import TYPE_RGB, clock

CLIPS: Final = 12
"""Events shown with a clip or a picture."""

MAX_ROWS: Final = 500
"""Inputs, lines and cameras listed in one table; the data set has them all."""

_VERDICTS: Final = {
    "kept": '<span class="badge s-clear">kept</span>',
    "broken": '<span class="badge s-finding">broken</span>',
    "open": '<span class="badge s-unknown">not shown yet</span>',
}
_QUANTITIES: Final = {
    "horizon_v_px": ("row of the horizon", "px", 1.0, 1),
    "vanishing_u_px": ("column of the vanishing point", "px", 1.0, 1),
    "spacing_per_row": ("rail spacing over camera height", "", 1.0, 4),
}


def write(run_folder: str | Path) -> None:
    """Write ``events.geojson`` (where places are known) and ``report.html`` from the data set.

    Finished inputs that are not in the data set yet are added first: nothing finished is left out.
    The page has no wall-clock time: written again from the same results it is the same.

    Raises:
        BadInputError: if the folder holds no fleet run.
    """
    run = Path(run_folder)
    for one in finished_inputs(run):
        if not all(path.exists() for path in dataset.table_paths(run, one.counts.id)):
            dataset.add(one.folder, run)
    located = write_geojson(run)
    totals = totals_of(run)
    events = list(events_of(run, totals))
    state = _state(run)
    body = [
        _header(totals, state),
        _verdict(totals, state),
        _cards(totals, located),
        _budget(totals.all, read_budget(run)),
        _clips(events, totals.inputs),
        _divided(totals),
        _unknown(totals),
        _drift(totals),
        _inputs(totals, state),
        "<footer>Times are those of the recordings. Known time is time in which both rails of the "
        "own track were followed in a sound picture; nothing is claimed about the rest, in "
        "particular not that the track was clear. Rates are per known hour and known kilometre, "
        "with 95 % Poisson intervals.</footer>",
    ]
    with publish(run / "report.html") as part:
        part.write_text(document(f"RailInspect: {run.resolve().name}", "".join(body)), "utf-8")


def _state(run: Path) -> list[dict[str, Any]]:
    """The inputs as ``fleet.json`` lists them: done, bad and pending."""
    try:
        inputs = json.loads((run / "fleet.json").read_text(encoding="utf-8"))["inputs"]
        return [dict(one) for one in inputs]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _header(totals: Totals, state: Sequence[Mapping[str, Any]]) -> str:
    done, hours = len(totals.inputs), totals.all.total_s / 3600
    of = f" of {len(state)}" if len(state) > done else ""
    return (
        f"<header><h1>Fleet inspection</h1><p>{count_of(done, 'input')}{of}, "
        f"{_hours(hours)} of footage</p></header>"
    )


def _hours(hours: float) -> str:
    if hours >= 1:
        return f"{hours:,.1f} h".replace(",", "\u202f")
    return f"{hours * 60:.1f} min" if hours >= 1 / 60 else f"{hours * 3600:.0f} s"


def _verdict(totals: Totals, state: Sequence[Mapping[str, Any]]) -> str:
    everything = totals.all
    events = sum(everything.events.values())
    bad = sum(one.get("state") == "bad" for one in state)
    pending = sum(one.get("state") == "pending" for one in state)
    if events:
        kind = "attention"
        listed = ", ".join(f"{everything.events[n]} {n}" for n in TYPE_RGB if everything.events[n])
        say = f"<b>{count_of(events, 'event')}</b> to look at: {listed}."
    elif everything.unknown_s or bad or pending or not totals.inputs:
        kind, say = "doubt", "<b>No event, but not everything could be inspected.</b>"
    else:
        kind, say = "", "<b>No event.</b> Both rails were followed all the time."
    notes = []
    if everything.unknown_s:
        share = everything.unknown_s / everything.total_s
        notes.append(
            f"{_hours(everything.unknown_s / 3600)} ({share:.1%}) are unknown: nothing is claimed "
            "about them, in particular not that the track is clear."
        )
    broken = sum(one.counts.break_count > 0 for one in totals.inputs)
    if broken:
        notes.append(f"{count_of(broken, 'input')} could not be read throughout.")
    if bad:
        notes.append(f"{count_of(bad, 'input')} could not be inspected at all, listed below.")
    if pending:
        notes.append(f"{count_of(pending, 'input')} are not finished.")
    if None in totals.by_line and len(totals.by_line) > 1:
        notes.append("Of some inputs the line is not known; the logbook does not name it.")
    inner = "".join(f"<li>{note}</li>" for note in notes)
    return f'<section class="verdict {kind}">{say}{f"<ul>{inner}</ul>" if inner else ""}</section>'


def _cards(totals: Totals, located: int) -> str:
    everything = totals.all
    share = everything.unknown_s / everything.total_s if everything.total_s else math.nan
    per_hour = rate(sum(everything.events.values()), everything.known_s / 3600)
    return cards_of(
        [
            (_hours(everything.total_s / 3600), "of footage"),
            (f"{everything.way_m / 1000:.1f} km" if everything.way_m else "–", "of known way"),
            (str(sum(everything.events.values())), "events"),
            (f"{per_hour.value:.2f}" if per_hour.exposure else "–", "events per known hour"),
            (f"{share:.1%}" if everything.total_s else "–", "of the time unknown"),
            (str(located) if located else "–", "events with a place"),
        ]
    )


def _budget(everything: Exposure, budget: Budget) -> str:
    """Every event counts as a false alarm here: nobody has said which ones are not."""
    alarms = sum(everything.events.values())
    way_km = 0.0 if everything.wayless_s > 0.01 * everything.known_s else everything.way_m / 1000
    rows = [
        _budget_row("per hour", "h", rate(alarms, everything.known_s / 3600), budget.per_hour),
        _budget_row("per kilometre", "km", rate(alarms, way_km), budget.per_km),
    ]
    heads = ["Alarms", "Over", "Observed", "95 % interval", "Budget", "Verdict"]
    wayless = ""
    if everything.wayless_s > 0.01 * everything.known_s:
        wayless = (
            f"<p>The way is not known for {_hours(everything.wayless_s / 3600)} of the known time, "
            "so there is no rate per kilometre; give speeds or positions.</p>"
        )
    return (
        '<section id="budget"><h2>False-alarm budget</h2><p>All events count as alarms: the rate '
        "of false ones is at most this. A budget is kept, or broken, only where the whole interval "
        f"says so.</p>{table('rates', heads, rows, '')}{wayless}</section>"
    )


def _budget_row(name: str, unit: str, one: Rate, budget: float | None) -> list[str]:
    if not one.exposure:
        return [name, "–", "–", "–", "–" if budget is None else f"{budget:g}", "–"]
    said = "no budget stated"
    if budget is not None:
        verdict = one.against(budget)
        said = _VERDICTS[verdict]
        if verdict == "open":
            said += f"<small>after {one.still_needed(budget):.1f} {unit} without one it is</small>"
    return [
        name,
        f"{one.alarms} in {one.exposure:.2f} {unit}",
        f"{one.value:.3f}",
        f"{one.low:.3f} to {one.high:.3f}",
        "–" if budget is None else f"{budget:g}",
        said,
    ]


def _clips(events: Sequence[Mapping[str, Any]], inputs: Iterable[FinishedInput]) -> str:
    by_id = {one.counts.id: one for one in inputs}
    figures = [_figure(event, by_id[event["input"]]) for event in top_events(events, CLIPS)]
    if not figures:
        return '<section id="top"><h2>Events to look at first</h2><p>None.</p></section>'
    more = len(events) - len(figures)
    rest = f"<p>and {more} more, in the data set.</p>" if more else ""
    return (
        '<section id="top"><h2>Events to look at first</h2>'
        f'<div class="clips">{"".join(figures)}</div>{rest}</section>'
    )


def _figure(event: Mapping[str, Any], one: FinishedInput) -> str:
    label = f"{event['type']}, event {event['id']} of {event['name']}"
    thumbnail = _thumbnail(event, one)
    film = clip_of(event, one)
    shown = "<p>no picture</p>"
    if film is not None:
        shown = clip(film, thumbnail, label)
    elif thumbnail is not None:
        shown = picture(thumbnail, label)
    place = ""
    if event["latitude_deg"] is not None:
        whose = "" if event["place"] == "ahead" else " (train)"
        place = f" · {event['latitude_deg']:.5f}, {event['longitude_deg']:.5f}{whose}"
    nearest = event["closest_range_m"]
    range_text = "range unknown" if nearest is None else f"closest {nearest:.0f} m"
    advice = event["advice"] if not event["doubt"] else "doubtful"
    badge = (
        f' <span class="badge a-{escape(advice)}">{escape(advice)}</span>'
        if advice and advice != "none"
        else ""
    )
    kind = escape(event["type"])
    return (
        f'<figure id="event-{escape(event["input"])}-{event["id"]}">{shown}<figcaption>'
        f'<span class="badge t-{kind}">{kind}</span>{badge} {escape(event["name"])} #{event["id"]}'
        f" at {clock(event['first_time_s'])}, {range_text}, confidence {event['confidence']:.0%}"
        f"{escape(place)}</figcaption></figure>"
    )


def _thumbnail(event: Mapping[str, Any], one: FinishedInput) -> bytes | None:
    path = one.thumbnail(dict(event))
    if path is None or not path.resolve().is_relative_to(one.folder.resolve()):
        return None
    try:
        return path.read_bytes()
    except OSError:
        return None


def _divided(totals: Totals) -> str:
    """Events by type, range, hour and line."""
    types = [name for name in TYPE_RGB if totals.all.events[name]]
    ranges = [(low, _range_name(low)) for low in (*RANGES_M, None)]
    most = max((sum(events.values()) for events in totals.by_range.values()), default=1)
    range_rows = [
        [name, *_numbers(totals.by_range.get(low, Counter()), types, most)] for low, name in ranges
    ]
    kind_rows = [
        [
            f'<span class="badge t-{name}">{name}</span>',
            str(totals.all.events[name]),
            _per(totals.all.events[name], totals.all),
        ]
        for name in types
    ]
    hours = sorted(totals.by_hour, key=lambda hour: (hour is None, hour or 0))
    hour_rows = [
        _exposure_row("unknown" if hour is None else f"{hour:02d} h", totals.by_hour[hour])
        for hour in hours
    ]
    lines = sorted(totals.by_line, key=lambda line: (line is None, line or ""))
    line_rows = [
        _exposure_row("unknown" if line is None else escape(line), totals.by_line[line])
        for line in lines[:MAX_ROWS]
    ]
    heads = ["Time", "Unknown", "Way", "Events", "Per known hour"]
    nothing = "Nothing was inspected."
    by_type = table("types", ["Type", "Events", "Per known hour"], kind_rows, "No event.")
    by_range = table("ranges", ["Range", "Events", ""], range_rows, "")
    by_line = table("lines", ["Line", *heads], line_rows, nothing)
    by_hour = table("hours", ["Hour", *heads], hour_rows, nothing)
    return (
        '<section id="divided"><h2>Events by type, range, line and hour</h2><div class="columns">'
        f"<div><h3>By type</h3>{by_type}</div><div><h3>By closest range</h3>{by_range}</div></div>"
        f"<h3>By line</h3>{by_line}<h3>By hour of the day</h3>{by_hour}</section>"
    )


def _range_name(low: float | None) -> str:
    if low is None:
        return "not known"
    above = [bound for bound in RANGES_M if bound > low]
    return f"{low:.0f} to {above[0]:.0f} m" if above else f"over {low:.0f} m"


def _numbers(events: Counter[str], types: Sequence[str], most: int) -> list[str]:
    """How many, and a bar of their types; the longest bar of the table stands for ``most``."""
    parts = "".join(
        f'<i class="t-{name}" style="width:{100 * events[name] / most:.1f}%" '
        f'title="{events[name]} {name}"></i>'
        for name in types
        if events[name]
    )
    return [str(sum(events.values())), f'<div class="bar">{parts}</div>']


def _per(events: int, exposure: Exposure) -> str:
    one = rate(events, exposure.known_s / 3600)
    if not one.exposure:
        return "–"
    return f"{one.value:.2f}<small>{one.low:.2f} to {one.high:.2f}</small>"


def _exposure_row(name: str, exposure: Exposure) -> list[str]:
    events = sum(exposure.events.values())
    unknown = f"{exposure.unknown_s / exposure.total_s:.1%}" if exposure.total_s else "–"
    way = f"{exposure.way_m / 1000:.1f} km" if exposure.way_m else "–"
    by_type = ", ".join(f"{exposure.events[n]} {n}" for n in TYPE_RGB if exposure.events[n])
    return [
        name,
        _hours(exposure.total_s / 3600),
        unknown,
        way,
        f"{events}<small>{by_type}</small>" if events else "0",
        _per(events, exposure),
    ]


def _unknown(totals: Totals) -> str:
    if not totals.all.unknown_s:
        return '<section id="unknown"><h2>Unknown time</h2><p>None.</p></section>'
    rows = [
        [escape(reason), _hours(seconds / 3600), f"{seconds / totals.all.unknown_s:.1%}"]
        for reason, seconds in totals.reasons_s.most_common(20)
    ]
    return (
        '<section id="unknown"><h2>Unknown time</h2>'
        f"{table('reasons', ['Why', 'Time', 'Share of it'], rows, '')}</section>"
    )


def _drift(totals: Totals) -> str:
    rows: list[list[str]] = []
    for camera, blocks in sorted(totals.blocks.items())[:MAX_ROWS]:
        rows += [_drift_row(camera, one) for one in drift_of(blocks)]
    heads = ["Camera", "Quantity", "First", "Last", "Change over the run", "Minutes", "Verdict"]
    return (
        '<section id="drift"><h2>Calibration drift</h2><p>Medians over a minute of what the rails '
        "say about the camera: pitch moves the horizon, yaw the vanishing point, a change of "
        "height the spacing. The change is the trend over the run with its 99 % interval.</p>"
        f"{table('cameras', heads, rows, 'No camera was seen for long enough.')}</section>"
    )


def _drift_row(camera: str, one: Drift) -> list[str]:
    name, unit, scale, digits = _QUANTITIES[one.quantity]

    def say(value: float) -> str:
        return f"{value * scale:.{digits}f}{' ' + unit if unit else ''}"

    change = "–"
    verdict = "too short to say"
    if one.drifts is not None:
        change = f"{say(one.change)}<small>{say(one.change_low)} to {say(one.change_high)}</small>"
        verdict = '<span class="late">drifts: calibrate again</span>' if one.drifts else "steady"
    return [
        escape(camera),
        name,
        say(one.first),
        say(one.last),
        change,
        str(one.blocks),
        verdict,
    ]


def _inputs(totals: Totals, state: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    worst = sorted(
        totals.inputs, key=lambda one: (-totals.by_input[one.counts.id].unknown_s, one.counts.id)
    )
    for one in worst[:MAX_ROWS]:
        exposure = totals.by_input[one.counts.id]
        breaks = one.counts.break_count
        rows.append(
            [
                f"{escape(one.counts.name)}<small>{escape(one.counts.id)}</small>",
                _hours(exposure.total_s / 3600),
                f"{exposure.unknown_s / exposure.total_s:.1%}" if exposure.total_s else "–",
                str(sum(exposure.events.values())),
                f'<span class="late">{count_of(breaks, "break")}</span>' if breaks else "whole",
            ]
        )
    heads = ["Input", "Time", "Unknown", "Events", "Read"]
    more = len(worst) - len(rows)
    rest = f"<p>and {more} more inputs, in the data set.</p>" if more > 0 else ""
    bad = [
        [escape(str(one.get("name"))), escape(str(one.get("address"))), escape(str(one["reason"]))]
        for one in state
        if one.get("state") == "bad"
    ]
    listed = ""
    if bad:
        shown = table("bad", ["Input", "Address", "Why"], bad[:MAX_ROWS], "")
        listed = f"<h3>Not inspected</h3>{shown}"
        if len(bad) > MAX_ROWS:
            listed += f"<p>and {len(bad) - MAX_ROWS} more, in fleet.json.</p>"
    return (
        '<section id="inputs"><h2>Inputs</h2>'
        f"{table('finished', heads, rows, 'None is finished.')}{rest}{listed}</section>"
    )
