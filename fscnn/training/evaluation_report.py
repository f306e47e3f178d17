"""What ``evaluate.py --out`` leaves: JSON, Markdown, and a page with the best and worst frames."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2

from fscnn.data.datasets import FolderSource, SceneSource
from fscnn.training.evaluation import Evaluation, FrameScore, Segment
from fscnn.training.pictures import strip
from fscnn.training.tables import appendix_e, markdown, percent, printed_rows, row_of, table_iii
from railinspect.errors import OutputError
from railinspect.labels import CLASSES

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; padding: 0 1rem;
  color: #1d2329; background: #fff }
h1, h2, h3 { line-height: 1.2 } h2 { margin-top: 2.5rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #d9dee3; text-align: right }
th:first-child, td:first-child { text-align: left; white-space: nowrap }
img { width: 100%; display: block; border-radius: 4px } figure { margin: 0 0 1.2rem }
figcaption { font-size: 13px; color: #55606b; padding: .3rem 0 }
"""


def printable(value: Any) -> Any:
    """JSON has no NaN: what could not be judged becomes null."""
    if isinstance(value, dict):
        return {key: printable(part) for key, part in value.items()}
    if isinstance(value, list):
        return [printable(part) for part in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def tables(evaluations: Sequence[Evaluation]) -> dict[str, list[list[str]]]:
    """All tables by heading, first row the column names; the paper's printed rows come first."""
    rows = printed_rows()
    for done in evaluations:
        rows[done.model] = row_of(done.scores)
    result = {
        "As Table III": table_iii(rows),
        "As Appendix E: IoU of each class (%)": appendix_e(rows),
    }
    names = ("rail_iou", "thin_precision", "thin_recall", "thin_f", "accuracy", "ece")
    head = ["Method", "Images", "Rail IoU (%)", "Thin precision (%)", "Thin recall (%)"]
    overall = [[*head, "Thin F (%)", "Accuracy (%)", "Calibration error (%)"]]
    for done in evaluations:
        summary = done.scores.summary()
        shares = [percent(float(summary[n])) for n in names]
        overall.append([done.model, str(summary["images"]), *shares])
    result[f"Rails, within {evaluations[0].scores.tolerance_px:g} px"] = overall
    for done in evaluations:
        if done.bands is not None:
            head = ["Range", "Rail IoU (%)", "Thin precision (%)", "Thin recall (%)", "Pixels"]
            result[f"By range: {done.model}"] = [head] + [
                [
                    band,
                    *(percent(s[n]) for n in ("rail_iou", "thin_precision", "thin_recall")),
                    f"{s['pixels']:.0f}",
                ]
                for band, s in done.bands.summary().items()
            ]
        matrix = done.scores.matrix
        result[f"Confusion, % of each true class: {done.model}"] = [["true \\ said", *CLASSES]] + [
            [name, *(percent(v / row.sum()) for v in row)]
            for name, row in zip(CLASSES, matrix, strict=True)
            if row.sum()
        ]
    return result


def write(
    folder: Path,
    evaluations: Sequence[Evaluation],
    segments: Sequence[Segment],
    source: FolderSource | SceneSource,
    pictures: int = 4,
) -> None:
    """Write ``evaluation.json``, ``evaluation.md`` and ``evaluation.html``.

    Args:
        folder: Folder to write to; made where it is missing.
        evaluations: What was measured.
        segments: The models, in the same order, to draw the pictures with.
        source: The labelled images.
        pictures: Best and worst frames shown of each model.

    Raises:
        OutputError: if the folder cannot be written to.
    """
    found = tables(evaluations)
    text = ["# Segmentation results", ""]
    page = [f"<style>{_STYLE}</style><h1>Segmentation results</h1>"]
    for heading, table in found.items():
        text += [f"## {heading}", "", markdown(table), ""]
        page.append(f"<h2>{html.escape(heading)}</h2>{_html_table(table)}")
    for done, segment in zip(evaluations, segments, strict=True):
        best, worst = done.extremes(pictures)
        for kind, frames in (("Best", best), ("Worst", worst)):
            page.append(f"<h2>{kind} frames: {html.escape(done.model)}</h2>")
            page += [_figure(frame, segment, source) for frame in frames]
    head = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Segmentation results</title>'
    )
    document = printable({"models": [done.document() for done in evaluations]})
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "evaluation.json").write_text(json.dumps(document), encoding="utf-8")
        (folder / "evaluation.md").write_text("\n".join(text), encoding="utf-8")
        (folder / "evaluation.html").write_text(head + "\n".join(page), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from error


def _html_table(table: Sequence[Sequence[str]]) -> str:
    rows = [
        "<tr>" + "".join(f"<{cell}>{html.escape(v)}</{cell}>" for v in row) + "</tr>"
        for cell, row in zip(["th"] + ["td"] * (len(table) - 1), table, strict=True)
    ]
    return f'<div class="wide"><table>{"".join(rows)}</table></div>'


def _figure(frame: FrameScore, segment: Segment, source: FolderSource | SceneSource) -> str:
    image, mask = source(frame.index)
    row = strip(image, mask, segment(image).labels, height_px=240)
    done, data = cv2.imencode(".jpg", cv2.cvtColor(row, cv2.COLOR_RGB2BGR))
    assert done
    name = html.escape(frame.name)
    return (
        f'<figure><img alt="{name}: image, mask, prediction" '
        f'src="data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}">'
        f"<figcaption>{name}: image, mask, prediction · rail IoU {percent(frame.rail_iou)} % · "
        f"accuracy {percent(frame.accuracy)} %</figcaption></figure>"
    )
