"""The evaluation for people: Markdown, and one HTML page with the failures shown."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from html import escape
from typing import Final

import cv2
import numpy as np

from railinspect.evaluation.answers import TYPES, Answer
from railinspect.evaluation.run import Evaluation
from railinspect.evaluation.samples import Sample
from railinspect.evaluation.scores import Rate, at_place, right
from railinspect.report.style import style_sheet
from railinspect.sinks.overlay import TYPE_RGB

Row = tuple[str, ...]

MOST_SHOWN: Final = 60
"""Failures whose picture is embedded in the page."""

PICTURE_WIDTH: Final = 420
"""Width of such a picture, pixels."""

_TRUTH: Final = (245, 247, 250)
_RAIL: Final = (60, 225, 235)


def tables(evaluation: Evaluation) -> list[tuple[str, Row, list[Row]]]:
    """Every table of the evaluation: title, head, rows; both pages print these."""
    s = evaluation.scores
    main: list[Row] = [("accuracy", *_told(s.accuracy)), ("specificity", *_told(s.specificity))]
    main += [(f"sensitivity, {name}", *_told(s.sensitivity[name])) for name in TYPES]
    main += [("unknown", *_told(s.unknown))]
    strict: list[Row] = [
        (name, _percent(s.named[name]), _percent(s.placed[name]), str(s.named[name].of))
        for name in TYPES
    ]
    said = ("clear", "unknown", *TYPES)
    confusion: list[Row] = [
        (truth, *(str(s.confusion.get((truth, word), 0)) for word in said))
        for truth in ("clear", *TYPES)
    ]
    found: list[tuple[str, Row, list[Row]]] = [
        ("Scores", ("measure", "share", "95 % interval", "pictures"), main),
        ("Type and place", ("type", "named right", "and placed right", "pictures"), strict),
        ("Truth (rows) and answer (columns)", ("", *said), confusion),
    ]
    for title, unit, bands in (
        ("Recall by range along the track", "m", s.by_range),
        ("Recall by size (root of the box's area)", "px", s.by_size),
    ):
        rows: list[Row] = [
            (f"{_edges(band.low, band.high)} {unit}", *_told(band.rate))
            for band in bands
            if band.rate.of
        ]
        found.append((title, ("band", "recall", "95 % interval", "pictures"), rows))
    times: list[Row] = [("median", f"{s.median_ms:.2f}"), ("95 % are below", f"{s.slowest_ms:.2f}")]
    found.append(("Processor time per picture after the segmentation", ("", "ms"), times))
    if (rides := evaluation.rides) is not None:
        ridden: list[Row] = [
            ("rides", str(rides.count)),
            ("time", f"{rides.hours * 60:.1f} min"),
            ("way", f"{rides.km:.2f} km"),
            ("frames unknown", f"{rides.unknown} of {rides.frames}"),
            ("false events", str(len(rides.false_events))),
            ("per hour", f"{rides.per_hour:.2f} (at most {rides.at_most() / rides.hours:.1f})"),
            ("per km", f"{rides.per_km:.3f} (at most {rides.at_most() / rides.km:.2f})"),
        ]
        found.append(("Clear rides (upper bounds at 95 %)", ("", ""), ridden))
    return found


def markdown(evaluation: Evaluation) -> str:
    """The evaluation as Markdown."""
    lines = [f"# {_title(evaluation)}", "", _caption(evaluation), ""]
    for title, head, rows in tables(evaluation):
        lines += [f"## {title}", "", _cells(head), _cells(("---",) * len(head))]
        lines += [*map(_cells, rows), ""]
    failures = _failures(evaluation)
    lines += [f"## Failures: {len(failures)}", ""]
    lines += [f"- `{sample.name}`: {_complaint(sample, answer)}" for sample, answer in failures]
    return "\n".join(lines).rstrip() + "\n"


def html(evaluation: Evaluation) -> str:
    """The evaluation as one page that needs nothing beside it and no network."""
    parts = [
        f"<header><h1>{escape(_title(evaluation))}</h1><p>{escape(_caption(evaluation))}</p>"
        "</header>"
    ]
    for title, head, rows in tables(evaluation):
        header = "".join(f"<th>{escape(cell)}</th>" for cell in head)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
        )
        parts.append(
            f"<section><h2>{escape(title)}</h2><table><tr>{header}</tr>{body}</table></section>"
        )
    failures = _failures(evaluation)
    shown = "".join(_figure(sample, answer) for sample, answer in failures[:MOST_SHOWN])
    rest = len(failures) - MOST_SHOWN
    more = f"<p>{rest} more are listed in the Markdown file.</p>" if rest > 0 else ""
    legend = "".join(
        f'<span><i class="t-{name}"></i>{name}</span>' for name in TYPES if name in TYPE_RGB
    )
    parts.append(
        f"<section><h2>Failures: {len(failures)}</h2><p>White: where the anomaly is. Coloured: "
        f'what was found.</p><div class="legend">{legend}</div><div class="failures">{shown}</div>'
        f"{more}</section>"
    )
    extra = (
        ".failures { display:grid; grid-template-columns:repeat(auto-fill,minmax(340px,1fr)); "
        "gap:16px; margin-top:12px; } figure { margin:0; } figure img { width:100%; "
        "border-radius:6px; } figcaption { font-size:13px; color:var(--soft); }"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">"
        f"<title>{escape(_title(evaluation))}</title><style>{style_sheet()}{extra}</style></head>"
        f"<body><main>{''.join(parts)}</main></body></html>\n"
    )


def _title(evaluation: Evaluation) -> str:
    return f"Evaluation of {evaluation.judge} on {evaluation.data_set.name}"


def _caption(evaluation: Evaluation) -> str:
    return (
        f"{len(evaluation.samples)} pictures, {evaluation.masks}. Accuracy and sensitivity are "
        "those of the binary question, anomalous or not; unknown is right for no picture."
    )


def _failures(evaluation: Evaluation) -> list[tuple[Sample, Answer]]:
    """Pictures told wrong first, then those whose type or place is wrong."""
    pairs = list(zip(evaluation.samples, evaluation.answers, strict=True))
    wrong = [pair for pair in pairs if not right(*pair)]
    misplaced = [pair for pair in pairs if right(*pair) and pair[0].anomaly and not at_place(*pair)]
    return wrong + misplaced


def _complaint(sample: Sample, answer: Answer) -> str:
    truth = "clear track"
    if sample.anomaly is not None:
        at = sample.anomaly.range_m
        truth = sample.anomaly.type + ("" if at is None else f" at {at:.0f} m")
    said = f"called {answer.said}" + (f" ({answer.reason})" if answer.reason else "")
    return f"{truth}, {said}"


def _figure(sample: Sample, answer: Answer) -> str:
    picture = sample.rgb().copy()
    for rail in answer.rails_uv:
        if len(rail) > 1:
            points = np.round(rail * 8).astype(np.int32)
            cv2.polylines(picture, [points], False, _RAIL, 1, cv2.LINE_AA, 3)
    marks = [(box, TYPE_RGB.get(name, _TRUTH)) for name, box in answer.boxes]
    if sample.anomaly is not None:
        marks.append((sample.anomaly.box_xyxy, _TRUTH))
    for box, colour in marks:
        left, top, right_, bottom = (round(v) for v in box)
        cv2.rectangle(picture, (left - 2, top - 2), (right_ + 2, bottom + 2), colour, 1)
    height = round(picture.shape[0] * PICTURE_WIDTH / picture.shape[1])
    small = cv2.resize(picture, (PICTURE_WIDTH, height), interpolation=cv2.INTER_AREA)
    bgr = cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 82])[1].tobytes()
    return (
        f'<figure><img alt="" src="data:image/jpeg;base64,{base64.b64encode(data).decode()}">'
        f"<figcaption><b>{escape(sample.name)}</b>: {escape(_complaint(sample, answer))}"
        "</figcaption></figure>"
    )


def _told(rate: Rate) -> tuple[str, str, str]:
    low, high = rate.interval()
    return _percent(rate), f"{100 * low:.1f}–{100 * high:.1f} %", f"{rate.hits} of {rate.of}"


def _percent(rate: Rate) -> str:
    return f"{100 * rate.share:.1f} %" if rate.of else "–"


def _edges(low: float, high: float) -> str:
    return f"from {low:g}" if math.isinf(high) else f"{low:g}–{high:g}"


def _cells(row: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
