"""Fit what is not known of a section to a measured or published characteristic.

A characteristic says little: by the argument of :mod:`railops.headway.interval` a table of N run
times holds about N numbers f(T) and the known slope in the run time of the train in front. More
unknowns than that cannot be told apart, so the result reports for each of them how much narrower
than its bounds the table makes it, and over which range equally good fits were met.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import Bounds, differential_evolution, minimize

from railops.errors import DomainError, RailOpsError
from railops.headway.characteristic import Characteristic, characteristic
from railops.headway.protection import TrackCircuits
from railops.headway.regulator import Regulator
from railops.headway.section import Dwell, Section
from railops.headway.stock import Stock
from railops.seeds import generator
from railops.traction import Davis, Effort

Array = npt.NDArray[np.float64]

ROUNDING_STD_S = 1.0 / 12.0**0.5  # of intervals printed in whole seconds
SEARCH_STEP_S = 0.5
_WORST_S = 1e4
_REACH_M = 900.0  # circuits are laid this far beyond the next stopping point


@dataclass(frozen=True)
class Unknowns:
    """A section with evenly spaced circuits, described by the numbers a table can say about.

    Attributes:
        length_m: Distance between the stopping points.
        accel_mps2: Starting effort.
        power_w_per_kg: Traction power.
        resistance: Running resistance as a multiple of the default Davis formula.
        brake_mps2: Service deceleration.
        train_m: Train length.
        pitch_m: Length of a track circuit.
        offset_m: Boundary of the circuits next to the first stopping point, from it.
        design_decel_mps2: Deceleration the codes are designed with.
        design_delay_s: Reaction time they are designed with.
        overlap_m: Distance they keep free behind the tail's circuit.
        delay_s: From the tail leaving a circuit until the better code is shown.
    """

    length_m: float = 1700.0
    accel_mps2: float = 1.0
    power_w_per_kg: float = 12.0
    resistance: float = 1.0
    brake_mps2: float = 0.9
    train_m: float = 120.0
    pitch_m: float = 120.0
    offset_m: float = 30.0
    design_decel_mps2: float = 0.8
    design_delay_s: float = 2.0
    overlap_m: float = 0.0
    delay_s: float = 1.5

    def section(self, steps_kmh: tuple[float, ...], name: str = "calibrated") -> Section:
        """The section they describe, with codes derived from braking."""
        offset = self.offset_m % self.pitch_m
        first = int(np.floor(-offset / self.pitch_m)) - 1
        last = int(np.ceil((self.length_m + _REACH_M) / self.pitch_m))
        edges = [round(offset + self.pitch_m * index, 3) for index in range(first, last + 1)]
        davis = Davis()
        share = self.resistance
        return Section(
            length_m=self.length_m,
            name=name,
            limits_kmh=((0.0, max(steps_kmh)),),
            stock=Stock(
                self.train_m,
                Effort(self.accel_mps2, self.power_w_per_kg),
                Davis(share * davis.c0, share * davis.c1, share * davis.c2),
                brake_mps2=self.brake_mps2,
            ),
            protection=TrackCircuits(
                tuple(pairwise(edges)),
                steps_kmh=steps_kmh,
                design_decel_mps2=self.design_decel_mps2,
                design_delay_s=self.design_delay_s,
                overlap_m=self.overlap_m,
                delay_s=self.delay_s,
            ),
        )


# What is physically possible for a metro section; every bound can be replaced.
BOUNDS: Mapping[str, tuple[float, float]] = {
    "length_m": (800.0, 3000.0),
    "accel_mps2": (0.7, 1.4),
    "power_w_per_kg": (6.0, 20.0),
    "resistance": (0.7, 2.0),
    "brake_mps2": (0.6, 1.2),
    "train_m": (80.0, 165.0),
    "pitch_m": (40.0, 300.0),
    "offset_m": (0.0, 300.0),
    "design_decel_mps2": (0.5, 1.2),
    "design_delay_s": (0.5, 4.0),
    "overlap_m": (0.0, 100.0),
    "delay_s": (0.5, 5.0),
}
METRO_CODES_KMH = (0.0, 40.0, 60.0, 70.0, 80.0)


@dataclass(frozen=True)
class Estimate:
    """One unknown after the fit.

    Attributes:
        name: Which of the unknowns.
        value: Its fitted value, in its unit.
        low: Lower bound it was searched in.
        high: Upper bound.
        spread: Its standard deviation after the fit over that before (uniform in the bounds), from
            the linearised model: near 1 the table says nothing about it.
        equally_good: Range of its values among all fits met whose residual is within a tenth of a
            second of the best.
    """

    name: str
    value: float
    low: float
    high: float
    spread: float
    equally_good: tuple[float, float]

    @property
    def verdict(self) -> str:
        """``identified``, ``weakly identified`` or ``not identifiable``."""
        if self.spread > 0.7:
            return "not identifiable"
        width = (self.equally_good[1] - self.equally_good[0]) / (self.high - self.low)
        return "identified" if max(self.spread, width) < 0.2 else "weakly identified"


@dataclass(frozen=True, eq=False)
class Calibration:
    """The fitted section and what the table says about it.

    Attributes:
        section: The fitted section.
        rms_s: Root mean square residual over the table, s.
        residual_s: Model − table, s, shape (N, M); NaN where the table has no entry.
        estimates: One per free unknown.
        evaluations: Characteristics computed.
        seed: Of the search.
    """

    section: Section
    rms_s: float
    residual_s: Array
    estimates: tuple[Estimate, ...]
    evaluations: int
    seed: int


class _Problem:
    """Residuals of a table as a function of the free unknowns, with everything met on the way."""

    def __init__(
        self, table: Characteristic, known: Unknowns, names: list[str], codes: tuple[float, ...]
    ) -> None:
        self.table, self.known, self.names, self.codes = table, known, names, codes
        self.observed = table.interval_s()
        self.there = ~np.isnan(self.observed)
        self.met: list[tuple[float, Array]] = []
        self.evaluations = 0

    def section(self, values: Array, name: str = "calibrated") -> Section:
        free: dict[str, Any] = dict(zip(self.names, map(float, values), strict=True))
        section = replace(self.known, **free).section(self.codes, name)
        times = tuple(self.table.second_s.tolist())
        return replace(section, dwell=Dwell(self.table.dwell_s), run_times_s=times)

    def model(self, values: Array, step_s: float = SEARCH_STEP_S) -> Array:
        section = self.section(values)
        second, first = self.table.second_s.tolist(), self.table.first_s.tolist()
        table = characteristic(section, second, first, name_critical=False, step_s=step_s)
        return table.interval_s(self.table.dwell_s)

    def residuals(self, values: Array, step_s: float = SEARCH_STEP_S) -> Array:
        difference: Array = (self.model(values, step_s) - self.observed)[self.there]
        return difference

    def cost(self, values: Array) -> float:
        """RMS residual, s; beyond the possible, a slope back to it."""
        self.evaluations += 1
        try:
            rms = float(np.sqrt(np.mean(self.residuals(values) ** 2)))
        except (RailOpsError, ValueError):
            return self._beyond(values)
        self.met.append((rms, np.array(values)))
        return rms

    def _beyond(self, values: Array) -> float:
        try:
            regulator = Regulator(self.section(values), SEARCH_STEP_S)
        except (RailOpsError, ValueError):
            return _WORST_S
        low, high = float(self.table.second_s[0]), float(self.table.second_s[-1])
        missing = max(0.0, regulator.shortest_s - low)
        missing += max(0.0, high - regulator.longest().run_time_s)
        return 0.1 * _WORST_S + missing


def calibrate(
    table: Characteristic,
    bounds: Mapping[str, tuple[float, float]] = BOUNDS,
    known: Unknowns | None = None,
    codes_kmh: tuple[float, ...] = METRO_CODES_KMH,
    *,
    seed: int = 0,
    generations: int = 120,
    name: str = "calibrated",
) -> Calibration:
    """Fit a section of evenly spaced circuits to a characteristic.

    Differential evolution over the bounds, since the residual jumps at code boundaries, then a
    simplex search around the best.

    Args:
        table: The measured or published characteristic.
        bounds: The unknowns to fit with the bounds to search in; the others keep ``known``.
        known: Values of those not fitted.
        codes_kmh: Speed codes of the system, km/h, 0 among them.
        seed: Of the search; equal seeds give equal results.
        generations: Generations of the search, each of 10 trials per unknown.
        name: Name of the fitted section.

    Raises:
        DomainError: if an unknown does not exist, or a lower bound is not below the upper.
        RailOpsError: if no section within the bounds can be run in the table's run times.
    """
    for key, (low, high) in bounds.items():
        if key not in BOUNDS:
            raise DomainError("unknown", key, f"one of {', '.join(BOUNDS)}")
        if not low < high:
            raise DomainError(key, f"{low:g} … {high:g}", "a lower bound below the upper")
    names = list(bounds)
    box = np.array([bounds[key] for key in names])
    problem = _Problem(table, known or Unknowns(), names, codes_kmh)
    found = differential_evolution(
        problem.cost,
        Bounds(box[:, 0], box[:, 1]),
        rng=generator(seed),
        popsize=10,
        maxiter=generations,
        tol=1e-3,
        polish=False,
        init="sobol",
        mutation=(0.4, 0.9),
        recombination=0.85,
    )
    if found.fun >= 0.1 * _WORST_S:
        raise RailOpsError(
            "no section within the bounds can be run in the table's run times; widen the bounds "
            "of length_m, accel_mps2 or power_w_per_kg"
        )
    polished = minimize(
        problem.cost,
        found.x,
        method="Nelder-Mead",
        bounds=Bounds(box[:, 0], box[:, 1]),
        options={"maxfev": 60 * len(names)},
    )
    values = np.clip(polished.x if polished.fun < found.fun else found.x, box[:, 0], box[:, 1])
    section = problem.section(values, name)
    final = characteristic(
        section, table.second_s.tolist(), table.first_s.tolist(), name_critical=False
    )
    residual = final.interval_s(table.dwell_s) - problem.observed
    rms = float(np.sqrt(np.nanmean(residual**2)))
    estimates = _estimates(problem, values, box, rms)
    return Calibration(section, rms, residual, estimates, problem.evaluations, seed)


def _estimates(problem: _Problem, values: Array, box: Array, rms_s: float) -> tuple[Estimate, ...]:
    """How far the table narrows each unknown, linearised, and the ranges of equal fits."""
    width = box[:, 1] - box[:, 0]
    columns = []
    for index in range(values.size):
        ends, at = [], []
        for sign in (-1.0, 1.0):
            trial = values.copy()
            trial[index] = np.clip(
                trial[index] + sign * 0.005 * width[index], box[index, 0], box[index, 1]
            )
            try:
                ends.append(problem.residuals(trial, 0.1))
                at.append(trial[index])
            except (RailOpsError, ValueError):
                ends.append(problem.residuals(values, 0.1))
                at.append(values[index])
        gap = (at[1] - at[0]) / width[index]
        columns.append((ends[1] - ends[0]) / gap if gap > 0.0 else np.zeros_like(ends[0]))
    jacobian = np.array(columns).T  # per whole width of the bounds
    prior = 12.0 * np.eye(values.size)  # variance 1/12 of a uniform distribution of width one
    noise = max(rms_s, ROUNDING_STD_S)
    after = np.linalg.inv(jacobian.T @ jacobian / noise**2 + prior)
    spread = np.sqrt(np.diag(after) * 12.0)
    best = min(cost for cost, _ in problem.met)
    good = np.array([point for cost, point in problem.met if cost <= best + 0.1] + [values])
    return tuple(
        Estimate(
            key,
            float(values[index]),
            float(box[index, 0]),
            float(box[index, 1]),
            float(spread[index]),
            (float(good[:, index].min()), float(good[:, index].max())),
        )
        for index, key in enumerate(problem.names)
    )
