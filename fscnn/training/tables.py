"""Tables in the shape of the paper's Table III and of its Appendix E, with the printed rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from fscnn.training.metrics import Scores, intersection_over_union
from railinspect.labels import CLASSES

PRINTED: dict[str, tuple[float, ...]] = {
    "SCNN (printed)": (
        *(48.1, 52.2, 70.2, 47.3, 46.7, 59.4, 34.3, 29.5, 83.9, 54.6),
        *(94.2, 45.9, 79.5, 48.7, 18.1, 63.9, 60.5, 68.8, 40.3),
    ),
    "FRRNB (printed)": (
        *(50.5, 54.0, 72.4, 40.1, 49.8, 60.2, 36.8, 32.5, 84.1, 59.5),
        *(94.7, 46.7, 81.9, 50.6, 20.7, 67.8, 62.8, 71.5, 45.0),
    ),
    "FSCNN (printed)": (
        *(53.4, 53.1, 71.7, 70.2, 47.0, 62.6, 45.6, 44.5, 84.1, 61.9),
        *(95.8, 63.6, 89.2, 73.1, 16.2, 72.5, 56.7, 72.4, 54.2),
    ),
}
"""IoU of each class in per cent, Wang et al. 2023, Appendix E, Table II; 500 RailSem19 images."""

Row = Mapping[str, float]


def printed_rows() -> dict[str, Row]:
    """The paper's rows: IoU by class name, 0 … 1."""
    return {
        name: {c: value / 100 for c, value in zip(CLASSES, row, strict=True)}
        for name, row in PRINTED.items()
    }


def row_of(scores: Scores) -> Row:
    """A model's row: IoU by class name; NaN for classes the images do not hold, said or not."""
    each = intersection_over_union(scores.matrix)
    present = scores.matrix.sum(1) > 0
    return {c: float(v) if p else math.nan for c, v, p in zip(CLASSES, each, present, strict=True)}


def mean_iou(row: Row) -> float:
    """Mean over the classes that have an IoU (eq. 49 with its missing 1/N)."""
    known = [value for value in row.values() if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan


def percent(value: float) -> str:
    """A share as the paper prints it; a dash for what could not be judged.

    >>> percent(0.6254), percent(float("nan"))
    ('62.5', '–')
    """
    return "–" if math.isnan(value) else f"{100 * value:.1f}"


def table_iii(rows: Mapping[str, Row]) -> list[list[str]]:
    """Method, mean IoU, rail-raised IoU, rail-embedded IoU, per cent; first row the headings."""
    head = ["Method", "Mean IoU (%)", "Rail-raised IoU (%)", "Rail-embedded IoU (%)"]
    return [head] + [
        [name, percent(mean_iou(row)), percent(row["rail-raised"]), percent(row["rail-embedded"])]
        for name, row in rows.items()
    ]


def appendix_e(rows: Mapping[str, Row]) -> list[list[str]]:
    """Method and the IoU of each class, per cent; first row the headings."""
    return [["Method", *CLASSES]] + [
        [name, *(percent(row[c]) for c in CLASSES)] for name, row in rows.items()
    ]


def markdown(table: Sequence[Sequence[str]]) -> str:
    """A table as Markdown.

    >>> print(markdown([["a", "b"], ["1", "2"]]))
    | a | b |
    | --- | --- |
    | 1 | 2 |
    """
    lines = ["| " + " | ".join(row) + " |" for row in table]
    return "\n".join([lines[0], "|" + " --- |" * len(table[0]), *lines[1:]])
