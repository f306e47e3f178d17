"""Both trains on the section with the codes, as one HTML file that needs no network."""

from __future__ import annotations

import json
from importlib import resources

import numpy as np

from railops.headway.draw import front_path
from railops.headway.interval import Succession
from railops.headway.protection import MovingBlock
from railops.headway.simulation import simulate
from railops.headway.stairway import stairway

_STEP_S = 0.5
_MOST_PIECES = 120  # more circuits or blocks than this are not drawn one by one


def animation(
    pair: Succession, second_s: float, first_s: float, dwell_s: float, interval_s: float
) -> str:
    """The HTML document.

    Args:
        pair: The section.
        second_s: Run time of the second train, s.
        first_s: Run time of the train in front, s.
        dwell_s: Dwell of the train in front, s.
        interval_s: Departure interval to show, s; it may be too short.
    """
    times, front = front_path(pair, first_s, dwell_s)
    run, plan = pair.run(second_s).nodes, pair.plan
    seen = simulate(pair, second_s, first_s, interval_s, dwell_s)
    end = max(float(times[-1]), interval_s + second_s)
    clock = np.arange(0.0, end + _STEP_S, _STEP_S)
    shown_to = np.interp(clock - interval_s, seen.log[:, 0], seen.log[:, 4].clip(0.0, 99.0))
    edges = plan.boundary_m
    pieces = [] if isinstance(pair.section.protection, MovingBlock) else edges.tolist()
    if len(pieces) > _MOST_PIECES:
        pieces = []
    _, critical = stairway(pair, second_s, first_s, dwell_s)
    document = {
        "name": pair.section.name,
        "length": pair.section.length_m,
        "train": pair.section.stock.length_m,
        "step": _STEP_S,
        "interval": round(interval_s, 3),
        "shortest": round(pair.interval(second_s, first_s).at(dwell_s), 3),
        "dwell": dwell_s,
        "runs": [first_s, second_s],
        "front": np.interp(clock, times, front).round(2).tolist(),
        "second": np.interp(clock - interval_s, run.time_s, run.position_m).round(2).tolist(),
        "speed": (3.6 * np.interp(clock - interval_s, run.time_s, run.speed_mps)).round(1).tolist(),
        "permitted": (3.6 * shown_to).round(1).tolist(),
        "edges": pieces,
        "codes": (3.6 * plan.code_mps).round(0).tolist() if plan.code_mps.size else [],
        "shown": [
            round(float(value), 2) if np.isfinite(value) else None
            for value in pair.given_all_s(first_s, dwell_s)
        ]
        if pieces
        else [],
        "violation": round(seen.violation_s + interval_s, 2) if seen.restricted else None,
        "critical": critical.name,
    }
    page = resources.files("railops.headway").joinpath("animation.html").read_text("utf-8")
    data = json.dumps(document, allow_nan=False).replace("</", "<\\/")
    return page.replace("/*DATA*/null", data)
