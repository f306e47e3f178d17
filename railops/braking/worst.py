"""The worst gradient profile within a survey's tolerance.

The paper suggests searching for the worst track profile instead of drawing many at random. Here
each stretch of the line may be off by a tolerance, and the mean error over the line ahead by a
smaller one (heights at the ends are known better than in between). The search moves error between
stretches as long as that lengthens the stop; lowering a gradient never shortens it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from railops.braking.stopping import BrakeName, stopping_distance
from railops.braking.train import Train
from railops.errors import check_range
from railops.traction import Line

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WorstProfile:
    """The result of the search.

    Attributes:
        line: The worst line found.
        distance_m: Stopping distance on it, metres.
        nominal_m: Stopping distance on the line as surveyed, metres.
    """

    line: Line
    distance_m: float
    nominal_m: float

    @property
    def overrun_m(self) -> float:
        """By how much the survey's error may lengthen the stop, metres."""
        return self.distance_m - self.nominal_m


def worst_profile(
    train: Train,
    tolerance: float,
    mean_tolerance: float,
    brake: BrakeName = "emergency",
    stretch_m: float = 100.0,
) -> WorstProfile:
    """Search for the gradient errors that lengthen the stop most.

    Args:
        train: The train at its place on the surveyed line.
        tolerance: Largest gradient error of one stretch, rise over run, >= 0.
        mean_tolerance: Largest mean error over the stopping distance, rise over run,
            0 … ``tolerance``.
        brake: Which brake.
        stretch_m: Length of a stretch, metres.

    Raises:
        CannotStopError: if the train runs away on a profile within the tolerance.
    """
    check_range("tolerance", tolerance, 0.0, 0.1, "m/m")
    check_range("mean_tolerance", mean_tolerance, 0.0, tolerance, "m/m")
    check_range("stretch_m", stretch_m, 10.0, 10_000.0, "m")
    nominal = stopping_distance(train, brake).distance_m
    # The longest conceivable stop fixes how far the line matters.
    steepest = _with_errors(train.line, train.position_m, 1e6, np.array([-tolerance]))
    reach = stopping_distance(replace(train, line=steepest), brake).distance_m
    stretches = max(int(np.ceil(reach / stretch_m)), 1)

    def line_of(errors: Array) -> Line:
        return _with_errors(train.line, train.position_m, stretch_m, errors)

    def distance(errors: Array) -> float:
        return stopping_distance(replace(train, line=line_of(errors)), brake).distance_m

    errors = np.full(stretches, -mean_tolerance)
    best = distance(errors)
    step = tolerance
    while step > tolerance / 100.0:
        improved = False
        for down, up in itertools.permutations(range(stretches), 2):
            moved = min(step, errors[down] + tolerance, tolerance - errors[up])
            if moved <= 1e-12:
                continue
            trial = errors.copy()
            trial[down] -= moved
            trial[up] += moved
            length = distance(trial)
            if length > best + 1e-6:
                errors, best, improved = trial, length, True
        if not improved:
            step /= 2.0
    return WorstProfile(line_of(errors), best, nominal)


def _with_errors(line: Line, position_m: float, stretch_m: float, errors: Array) -> Line:
    """The line with gradient errors on successive stretches ahead of a position."""
    ends = position_m + stretch_m * np.arange(errors.size + 1)
    starts, grades = np.array(line.gradients).T
    cuts = np.unique(np.concatenate([starts, ends]))
    surveyed = grades[np.clip(np.searchsorted(starts, cuts, "right") - 1, 0, None)]
    stretch = np.searchsorted(ends, cuts, "right") - 1
    inside = (stretch >= 0) & (stretch < errors.size)
    off = np.where(inside, errors[np.clip(stretch, 0, errors.size - 1)], 0.0)
    pieces = zip(cuts.tolist(), (surveyed + off).tolist(), strict=True)
    return Line(tuple((cut, grade) for cut, grade in pieces), line.curves)
