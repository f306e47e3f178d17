"""The report page, built from the files of a run folder alone."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any, Final

from railinspect.report.parts import cards_of, count_of, document, picture, range_cell
from railinspect.report.summary import InputTimeline, summarise
from railinspect.report.timeline import timeline_svg
from railinspect.runfolder import RunFolder
from railinspect.sinks.json_lines import read_json_lines
from railinspect.sinks.overlay import STATUS_RGB, TYPE_RGB, clock

Json = Mapping[str, Any]

BRAKES: Final = ("service", "emergency")

MOMENTS: Final = {
    "not due": "not due while in sight",
    "before": "before the recording",
    "cannot stop": "cannot stop the train",
    "unknown": "unknown",
}
"""What the event table says where a brake's moment has no time."""

MAX_PICTURES: Final = 300
"""Events whose picture is embedded; those of later events stay in the run folder."""


def write_report(folder: RunFolder) -> None:
    """Write ``report.html`` from ``run.json``, ``frames.jsonl`` and ``events.jsonl``."""
    run = json.loads(folder.current("run.json").read_text(encoding="utf-8"))
    events = sorted(read_json_lines(folder.current("events.jsonl")), key=lambda e: int(e["id"]))
    frames = read_json_lines(folder.current("frames.jsonl"))
    timelines = summarise(frames, run["inputs"])
    page = render_page(run, events, timelines, folder)
    folder.part("report.html").write_text(page, encoding="utf-8")


def render_page(
    run: Json, events: list[dict[str, Any]], timelines: Mapping[str, InputTimeline], at: RunFolder
) -> str:
    """The page as a string; every name and reason from outside is escaped."""
    names = ", ".join(Path(one["path"]).name or one["path"] for one in run["inputs"])
    body = [
        f"<header><h1>{escape(names)}</h1>"
        f"<p>RailInspect {escape(str(run['versions']['railinspect'] or ''))} · inspected "
        f"{escape(run['started'])}</p></header>",
        _verdict(run, events),
        _cards(run, events),
        _timelines(run, events, timelines),
        _event_table(run, events, at),
        _unknown(run, timelines),
        _how(run),
        "<footer>Times are those of the recording. Ranges are along the track from the camera, "
        "with 95 % intervals; where no range is given, the place lies beyond the range that can "
        "be measured reliably. Brake by: the last moment at which that brake would still have "
        "stopped the train short of the place by the protective section, looking back from the "
        "range that was measured best.</footer>",
    ]
    return document(f"RailInspect: {names}", "".join(body))


def _verdict(run: Json, events: list[dict[str, Any]]) -> str:
    """What the reader should know first, without hiding what was not seen."""
    counts = run["counts"]
    frames, unknown = counts["frames"], counts["unknown_frames"]
    if events:
        kind = "attention"
        by_type = [(name, sum(e["type"] == name for e in events)) for name in TYPE_RGB]
        listed = ", ".join(f"{count} {name}" for name, count in by_type if count)
        say = f"<b>{count_of(len(events), 'event')}</b> to look at: {listed}."
    elif not frames or unknown:
        kind, say = "doubt", "<b>No event, but not everything could be inspected.</b>"
    else:
        kind, say = "", "<b>No event.</b> Both rails were followed in every frame."
    notes = []
    if unknown:
        notes.append(
            f"{count_of(unknown, 'frame')} ({unknown / max(frames, 1):.1%}) are unknown: nothing "
            "is claimed about them, in particular not that the track is clear."
        )
    if run["settings"]["speed_log"] is not None and counts["speed_unknown_frames"]:
        notes.append(
            "The speed log says nothing about "
            f"{count_of(counts['speed_unknown_frames'], 'frame')}: "
            "what was seen there is advised on as in doubt."
        )
    for one in run["inputs"]:
        if one["drift_frames"]:
            notes.append(
                f"{escape(one['name'])}: {escape(one['camera_drift'])}. Said in "
                f"{count_of(one['drift_frames'], 'frame')}; ranges there may be off by as much."
            )
    if counts["breaks"]:
        notes.append(f"Reading failed in {count_of(counts['breaks'], 'place')}, listed below.")
    for one in run["inputs"]:
        if one.get("live"):
            notes.append(_live_note(one["live"]))
    if not counts["complete"]:
        notes.append("The run was interrupted; this report covers what was finished.")
    listed_notes = "".join(f"<li>{note}</li>" for note in notes)
    return (
        f'<section class="verdict {kind}">{say}'
        f"{f'<ul>{listed_notes}</ul>' if notes else ''}</section>"
    )


def _live_note(live: Json) -> str:
    """What a live source's frames came to; nothing is claimed about those dropped."""
    dropped, received = (count_of(live[key], "frame") for key in ("dropped", "received"))
    said = f"Followed live: {dropped} of {received}"
    said += " dropped, about which nothing is claimed"
    if live["latency_worst_s"] is not None:
        said += (
            f"; from a frame's arrival to its record {live['latency_median_s']:.2f} s (median), "
            f"{live['latency_p95_s']:.2f} s (95 %), {live['latency_worst_s']:.2f} s at worst"
        )
    if live["skipped"]:
        said += f"; {count_of(live['skipped'], 'frame')} lay in the file before following began"
    return said + "."


def _cards(run: Json, events: list[dict[str, Any]]) -> str:
    counts = run["counts"]
    nearest = min((e["closest_range_m"] for e in events if e["closest_range_m"]), default=None)
    cards = [
        (f"{counts['frames']:,}".replace(",", "\u202f"), "frames"),
        (f"{counts['followed_fraction']:.1%}", "with both rails followed"),
        (str(len(events)), "events"),
        (f"{nearest:.0f} m" if nearest is not None else "–", "closest range of an event"),
        (f"{counts['unknown_frames']:,}".replace(",", "\u202f"), "frames unknown"),
        (f"{counts['frames_per_s']:.1f}/s", "frames inspected"),
    ]
    return cards_of(cards)


def _timelines(run: Json, events: list[dict[str, Any]], timelines: Json) -> str:
    parts = ['<section id="timeline"><h2>Timeline</h2>']
    for one in run["inputs"]:
        if len(run["inputs"]) > 1:
            parts.append(f"<h3>{escape(one['name'])}</h3>")
        own = [event for event in events if event["input"] == one["name"]]
        if one["name"] in timelines:
            at = [broken["time_s"] for broken in one["breaks"][:50]]
            parts.append(timeline_svg(timelines[one["name"]], own, at))
        else:
            parts.append("<p>No frame was inspected.</p>")
        parts.append(_breaks(one))
    swatches = [(f"s-{name}", name) for name in STATUS_RGB] + [(f"t-{n}", n) for n in TYPE_RGB]
    if any(event[f"{brake}_by_time_s"] is not None for event in events for brake in BRAKES):
        swatches += [(f"mark a-{brake}", f"{brake} braking had to start") for brake in BRAKES]
    legend = "".join(f'<span><i class="{kind}"></i>{name}</span>' for kind, name in swatches)
    return "".join(parts) + f'<p class="legend">{legend}</p></section>'


def _breaks(one: Json) -> str:
    if not one["breaks"]:
        return ""
    rows = "".join(
        f"<li>after {clock(b['time_s'])} (frame {b['frame_index']}): {escape(b['reason'])}</li>"
        for b in one["breaks"][:50]
    )
    more = one["break_count"] - min(len(one["breaks"]), 50)
    rest = f"<li>and {more} more, in run.json</li>" if more > 0 else ""
    return (
        f'<div class="alert" id="break"><b>{escape(one["name"])} could not be read throughout.</b>'
        f" Everything that could be read is in this report.<ul>{rows}{rest}</ul></div>"
    )


def _event_table(run: Json, events: list[dict[str, Any]], at: RunFolder) -> str:
    several = len(run["inputs"]) > 1
    heads = ["#", "Picture", "Type", *(["Input"] if several else []), "First seen"]
    heads += ["First range", "Closest range", "Seen", "Brake by", "Advice"]
    rows = "".join(_event_row(event, several, at) for event in events)
    if not events:
        rows = f'<tr><td colspan="{len(heads)}">No event was confirmed.</td></tr>'
    head = "".join(f"<th>{name}</th>" for name in heads)
    return (
        '<section><h2>Events</h2><div class="scroll"><table id="events">'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>"
    )


def _event_row(event: Json, several: bool, at: RunFolder) -> str:
    others = [
        f"{share:.0%} {name}"
        for name, share in event["type_shares"].items()
        if name != event["type"] and share >= 0.05
    ]
    mixed = f"<small>also read as {', '.join(others)}</small>" if others else ""
    cells = [
        str(event["id"]),
        _picture(event, at),
        f'<span class="badge t-{escape(event["type"])}">{escape(event["type"])}</span>'
        f"<small>confidence {event['confidence']:.0%}</small>{mixed}",
        *([escape(event["input"])] if several else []),
        f"{clock(event['first_time_s'])}<small>frame {event['first_frame']}</small>"
        f"<small>confirmed {event['confirmed_time_s'] - event['first_time_s']:.2f} s later</small>",
        range_cell(event["first_range_m"], event["first_range_interval_m"]),
        range_cell(event["closest_range_m"], event["closest_range_interval_m"]),
        f"{event['last_time_s'] - event['first_time_s']:.1f} s"
        f"<small>{count_of(event['frames_seen'], 'frame')}</small>",
        _brake_by(event),
        _advice(event),
    ]
    inner = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr id="event-{event["id"]}">{inner}</tr>'


def _picture(event: Json, at: RunFolder) -> str:
    if event["thumbnail"] is None:
        return "–"
    if event["id"] > MAX_PICTURES:  # a page of a thousand pictures would no longer open
        return f"<small>{escape(event['thumbnail'])}</small>"
    try:
        data = at.current(event["thumbnail"]).read_bytes()
    except OSError:
        return "–"
    return picture(data, f"event {event['id']}: {event['type']}")


def _brake_by(event: Json) -> str:
    """When each brake had to be applied, and whether the event was confirmed by then."""
    lines = []
    for brake in BRAKES:
        state, time_s = event[f"{brake}_by"], event[f"{brake}_by_time_s"]
        if state is None:
            return "–"
        said = clock(time_s) if time_s is not None else MOMENTS[state]
        lines.append(f"<span>{brake}: {said}</span>")
        if time_s is not None:
            early_s = time_s - event["confirmed_time_s"]
            when = f"confirmed {abs(early_s):.1f} s {'before' if early_s >= 0 else 'too late'}"
            lines.append(f"<small{'' if early_s >= 0 else ' class=late'}>{when}</small>")
        else:
            lines.append("<br>")
    return "".join(lines)


def _advice(event: Json) -> str:
    if event.get("doubt"):
        return (
            f'<span class="badge s-unknown">doubtful</span><small>{escape(event["doubt"])}</small>'
        )
    if event["advice"] is None:
        return "–"
    action = escape(event["advice"])
    since = f" from {clock(event['advice_time_s'])}" if event["advice_time_s"] is not None else ""
    reason = f"<small>{escape(event['advice_reason'])}</small>" if event["advice_reason"] else ""
    return f'<span class="badge a-{action}">{action}</span>{since}{reason}'


def _unknown(run: Json, timelines: Mapping[str, InputTimeline]) -> str:
    parts = ['<section id="unknown"><h2>Unknown frames</h2>']
    if not run["counts"]["unknown_frames"]:
        return "".join([*parts, "<p>None: both rails were followed in every frame.</p></section>"])
    for name, timeline in timelines.items():
        if not timeline.reasons:
            continue
        if len(timelines) > 1:
            parts.append(f"<h3>{escape(name)}</h3>")
        rows = [
            f"<tr><td>{clock(s.first_s)} to {clock(s.last_s)}</td><td>{s.frames}</td>"
            f"<td>{s.first_frame}</td><td>{_reasons(s.reasons.most_common())}</td></tr>"
            for s in timeline.stretches
        ]
        if timeline.dropped_stretches:
            rows.append(
                f'<tr><td colspan="4">and {timeline.dropped_stretches} shorter stretches; every '
                "frame's reason is in frames.jsonl</td></tr>"
            )
        parts.append(
            '<div class="scroll"><table class="unknown"><thead><tr><th>When</th><th>Frames</th>'
            "<th>From frame</th><th>Why</th></tr></thead>"
            f"<tbody>{''.join(rows)}</tbody></table></div>"
        )
    return "".join([*parts, "</section>"])


def _reasons(counted: Iterable[tuple[str, int]]) -> str:
    listed = list(counted)
    shown = [
        escape(reason) + (f" ({count}×)" if len(listed) > 1 else "") for reason, count in listed[:3]
    ]
    if len(listed) > 3:
        shown.append(f"and {len(listed) - 3} other reasons")
    return "<br>".join(shown)


def _how(run: Json) -> str:
    """Inputs, model, camera and settings: what is needed to repeat the run."""
    rows: list[tuple[str, str]] = []
    for one in run["inputs"]:
        width, height = one["size_wh"]
        rows.append(
            (
                "Input",
                f"{one['path']} ({one['kind']}, {width}×{height} pixels, "
                f"{count_of(one['frames'], 'frame')})",
            )
        )
        if one["overlay"]:
            rows.append(("Overlay", one["overlay"]))
    rows.append(("Model", _model(run["model"])))
    rows.append(("Camera", _camera(run["camera"])))
    settings = run["settings"]
    rows.append(("Speed", _speed(settings, run["counts"]["speed_unknown_frames"])))
    events = settings["events"]
    rows.append(
        (
            "Confirmation",
            f"an event is confirmed by {events['confirm_hits']} of the last "
            f"{events['confirm_window']} frames and ends after {events['lose_after_s']:g} s unseen",
        )
    )
    versions = ", ".join(f"{k} {v}" for k, v in run["versions"].items() if v)
    rows.append(("Versions", versions))
    inner = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows)
    return f'<section id="how"><h2>How it was inspected</h2><dl>{inner}</dl></section>'


def _speed(settings: Json, unknown_frames: int) -> str:
    """Where the train's speed came from."""
    if (log := settings["speed_log"]) is not None:
        frames = count_of(unknown_frames, "frame")
        unknown = f"; unknown in {frames}, where braking is advised in doubt"
        return (
            f"{log['source']}, {clock(log['first_time_s'])} to {clock(log['last_time_s'])}, up to "
            f"{log['highest_mps'] * 3.6:.0f} km/h{unknown if unknown_frames else ''}"
        )
    if settings["speed_mps"] is None:
        return "not given: no advice"
    known = "given" if settings["speed_is_known"] else "assumed, as none was given"
    return f"{settings['speed_mps'] * 3.6:.0f} km/h ({known})"


def _model(model: Json | None) -> str:
    if model is None:
        return "not a bundle"
    width, height = model["input_size_wh"] or (0, 0)
    return (
        f"{model['network']}, {width}×{height} pixels, written by version "
        f"{model['package_version']}, training data {str(model['training_fingerprint'])[:12]}"
    )


def _camera(camera: Json | None) -> str:
    if camera is None:
        return "no calibration given: estimated from the track's vanishing point and gauge"
    width, height = camera["size_wh"]
    return (
        f"{width}×{height} pixels, focal length {camera['focal_px']:.0f} px, height "
        f"{camera['height_m']:.2f} m, gauge {camera['gauge_m'] * 1000:.0f} mm"
    )
