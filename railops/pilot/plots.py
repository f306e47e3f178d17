"""The paper's Figs. 8–12 and Appendix A Fig. 1, from plans and tracks.

Needs Matplotlib (``pip install 'railinspect[pilot]'``); draws off screen and writes files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from railops._extras import extra
from railops.pilot.plan import LegPlan
from railops.pilot.tracking import Track
from railops.pilot.trip import TripPlan

_BLUE, _RED, _GREY = "#1f4e9c", "#c0392b", "#888888"


def _canvas(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    """A figure with its axes that never touches a display or global state."""
    figure = extra("pilot", "matplotlib.figure", "drawing").Figure(
        figsize=size, layout="constrained"
    )
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(True, linewidth=0.3, color="#cccccc")
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _marks(axis: Any, plan: TripPlan) -> None:
    """Dashed lines at p_m^s, p_m^c, p_m^b and p_m^e."""
    for at in (*plan.opening.span_m, *plan.closing.span_m):
        axis.axvline(at / 1e3, color="#2e8b57", linestyle="--", linewidth=0.8)
    axis.set_xlabel("mother train at p_m, km")


def plot_trip(plan: TripPlan, path: str | Path) -> Path:
    """Figs. 8 and 9: v_m, x_ref, u, v and v − v_m over the trip and over both legs."""
    figure, axes = _canvas(4, 3, (13.0, 11.0))
    first, *_, last = plan.trip.route.mother.position_m
    stretches = [("whole trip", first, last)]
    stretches += [
        (name, leg.span_m[0] - 500.0, leg.span_m[1] + 500.0)
        for name, leg in (("opening", plan.opening), ("closing", plan.closing))
    ]
    vehicle = plan.trip.vehicle
    for column, (name, low, high) in enumerate(stretches):
        at = np.linspace(max(low, first), min(high, last), 4000)
        gap, slope, _ = plan.reference.at(at)
        mother = plan.trip.route.mother.speed_at(at)
        rows = [
            ("x_ref, m", gap, (plan.trip.near_gap_m, plan.trip.far_gap_m)),
            (
                "u/m, m/s²",
                plan.force_mps2(at),
                (-vehicle.braking_mps2, vehicle.traction_mps2),
            ),
            ("v and v_m, m/s", mother * (1.0 + slope), ()),
            ("v − v_m, m/s", mother * slope, (plan.trip.relative_speed_mps,)),
        ]
        for row, (label, values, limits) in enumerate(rows):
            axis = axes[row, column]
            axis.plot(at / 1e3, values, color=_BLUE, linewidth=1.6)
            if row == 2:
                axis.plot(at / 1e3, mother, color=_RED, linestyle="--", linewidth=1.2)
            for limit in limits:
                axis.axhline(limit, color=_RED, linestyle=":", linewidth=0.9)
            axis.set_ylabel(label)
            _marks(axis, plan)
            axis.set_xlim(at[0] / 1e3, at[-1] / 1e3)
        axes[0, column].set_title(name)
    return _save(figure, path)


def plot_legs(plans: dict[str, LegPlan], path: str | Path) -> Path:
    """Figs. 10 and 11 and Appendix A Fig. 1: u/m and v − v_m of several plans of one leg."""
    figure, axes = _canvas(2, len(plans), (4.2 * len(plans), 5.6))
    for column, (name, plan) in enumerate(plans.items()):
        path_ = plan.trajectory
        at = (path_.position_m - path_.position_m[0]) / 1e3
        mother = plan.leg.route.mother.speed_at(path_.position_m)
        # The force that holds the gap before and after the leg shows where u jumps.
        ends = plan.leg.route.hold_mps2(
            plan.leg.vehicle, path_.position_m[[0, -1]], plan.leg.from_gap_m
        )
        at_all = np.concatenate([[at[0] - 0.3, at[0]], at, [at[-1], at[-1] + 0.3]])
        force = np.concatenate([ends[[0, 0]], path_.force_mps2, ends[[1, 1]]])
        axes[0, column].plot(at_all, force, color=_BLUE, linewidth=1.6)
        axes[0, column].axhline(plan.leg.vehicle.traction_mps2, color=_RED, linestyle=":")
        axes[0, column].axhline(-plan.leg.vehicle.braking_mps2, color=_RED, linestyle=":")
        axes[0, column].set_title(name)
        axes[0, column].set_ylabel("u/m, m/s²")
        axes[1, column].plot(at, path_.speed_mps - mother, color=_BLUE, linewidth=1.6)
        axes[1, column].set_ylabel("v − v_m, m/s")
        axes[1, column].set_xlabel("p_m from the leg's start, km")
    return _save(figure, path)


def plot_track(plan: TripPlan, tracks: dict[str, Track], path: str | Path) -> Path:
    """Fig. 12: gap, tracking error and force of one or more controllers."""
    figure, axes = _canvas(3, 1, (11.0, 8.0))
    colours = (_BLUE, "#d08a00", "#6a3d9a", _GREY)
    for colour, (name, track) in zip(colours, tracks.items(), strict=False):
        at = track.mother_m / 1e3
        axes[0, 0].plot(at, track.gap_m, color=colour, linewidth=1.4, label=name)
        axes[1, 0].plot(at, track.error_m, color=colour, linewidth=0.9, label=name)
        axes[2, 0].plot(at, track.force_mps2, color=colour, linewidth=0.9, label=name)
    first = next(iter(tracks.values()))
    axes[0, 0].plot(
        first.mother_m / 1e3, first.reference_m, color=_RED, linestyle="--", label="x_ref"
    )
    for limit in first.limits_mps2:
        axes[2, 0].axhline(limit, color=_RED, linestyle=":")
    for axis, label in zip(axes[:, 0], ("x, m", "x_ref − x, m", "u/m, m/s²"), strict=True):
        axis.set_ylabel(label)
        _marks(axis, plan)
    axes[0, 0].legend(frameon=False, loc="lower center")
    return _save(figure, path)


def _save(figure: Any, path: str | Path) -> Path:
    """Write the figure in the format the path's ending names."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    return target
