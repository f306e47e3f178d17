"""Fig. 4.4: the eight-dimensional detector space in two-dimensional projections."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from railops._extras import extra
from railops.crossing.detectors import DetectorSet, extent
from railops.crossing.situation import LOW, SPACE, SPAN, Array
from railops.errors import FileError

PAIRS: tuple[tuple[int, int], ...] = ((0, 1), (4, 5))
"""The published pairs: both speeds, and both distances."""


def draw(
    path: str | Path,
    detectors: DetectorSet,
    safe: Array,
    situations: Array,
    pairs: tuple[tuple[int, int], ...] = PAIRS,
) -> None:
    """Draw safe situations, detectors and judged situations, projected on pairs of parameters.

    A projected circle may cover a point that the sphere in eight dimensions does not reach: read
    alarms from the colours, not from the circles.

    Args:
        path: Image file to write.
        detectors: The detectors; every circle is a projection of one.
        safe: Safe situations, in their own units, shape (N, 8).
        situations: Situations to judge, shape (M, 8).
        pairs: Pairs of axes of ``SPACE``.

    Raises:
        MissingExtraError: if matplotlib (which pymoo brings) is not installed.
        FileError: if the file cannot be written, or its ending names no picture format.
    """
    figures = extra("crossing", "matplotlib.figure", "drawing projections")
    patches = extra("crossing", "matplotlib.patches", "drawing projections")
    figure = figures.Figure(figsize=(6.0 * len(pairs), 5.0), layout="constrained")
    alarmed = detectors.judge(situations) >= 0
    per_unit = SPAN / extent(detectors.units)
    for axes, (i, j) in zip(figure.subplots(1, len(pairs), squeeze=False)[0], pairs, strict=True):
        for centre, radius in zip(detectors.centres, detectors.radii, strict=True):
            middle = (LOW + centre * per_unit)[[i, j]]
            size = 2.0 * radius * per_unit[[i, j]]
            axes.add_patch(patches.Ellipse(middle, *size, fill=False, ec="tab:blue", alpha=0.15))
        for points, colour, label in (
            (safe, "tab:green", "safe"),
            (situations[alarmed], "tab:red", "alarmed"),
            (situations[~alarmed], "gold", "not alarmed"),
        ):
            shown = np.atleast_2d(points)
            axes.scatter(shown[:, i], shown[:, j], c=colour, label=label, s=25, zorder=3)
        axes.set_xlim(SPACE[i].low, SPACE[i].high)
        axes.set_ylim(SPACE[j].low, SPACE[j].high)
        axes.set_xlabel(f"{SPACE[i].label}, {SPACE[i].unit}")
        axes.set_ylabel(f"{SPACE[j].label}, {SPACE[j].unit}")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    title = f"circles: {len(detectors)} detectors"
    figure.legend(handles, labels, loc="outside lower center", ncols=3, title=title)
    try:
        figure.savefig(path, dpi=90)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot draw into {path}: {error}") from error
