"""The worst profile: against brute force, monotone in the tolerance, bad input."""

import itertools

import numpy as np
import pytest

from railops.braking import Train, stopping_distance
from railops.braking.worst import _with_errors, worst_profile
from railops.errors import DomainError
from railops.traction import Line

TRAIN = Train(20.0, length_m=60.0, line=Line(((0.0, 0.005), (90.0, -0.01), (210.0, 0.0))))


def test_against_brute_force():
    found = worst_profile(TRAIN, 0.004, 0.001, stretch_m=80.0)
    levels = np.linspace(-0.004, 0.004, 9)
    best = 0.0
    for errors in itertools.product(levels, repeat=3):
        if np.mean(errors) < -0.001 - 1e-12:
            continue
        line = _with_errors(TRAIN.line, 0.0, 80.0, np.array(errors))
        best = max(best, stopping_distance(Train(20.0, length_m=60.0, line=line)).distance_m)
    assert found.distance_m >= best - 0.05
    assert found.overrun_m > 0


def test_the_found_line_keeps_the_tolerances():
    found = worst_profile(TRAIN, 0.004, 0.001, stretch_m=80.0)
    again = stopping_distance(Train(20.0, length_m=60.0, line=found.line)).distance_m
    assert again == found.distance_m
    position = np.arange(0.5, 240.0)

    def grade(line):
        starts, grades = np.array(line.gradients).T
        return grades[np.searchsorted(starts, position, "right") - 1]

    off = grade(found.line) - grade(TRAIN.line)
    assert np.abs(off).max() <= 0.004 + 1e-12
    assert off.mean() >= -0.001 - 1e-9


def test_wider_tolerance_is_worse():
    runs = [worst_profile(TRAIN, t, t / 4).distance_m for t in (0.0, 0.002, 0.004)]
    assert runs[0] == pytest.approx(stopping_distance(TRAIN).distance_m)
    assert runs[0] < runs[1] < runs[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-0.1, 0.0), r"tolerance is -0.1 m/m"),
        ((0.001, 0.002), r"mean_tolerance is 0.002 m/m; expected a number in \[0, 0.001\]"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(DomainError, match=message):
        worst_profile(TRAIN, *arguments)
