"""The shared longitudinal model: hand-worked values, averaging over the train, bad input."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railops.errors import DomainError, check_range
from railops.traction import (
    GRAVITY_MPS2,
    Adhesion,
    Davis,
    Effort,
    Line,
    acceleration,
    adhesion_limit,
    build_up,
    line_resistance,
    running_resistance,
)


def w(line, position, length):
    return line_resistance(position, *line.table(length))


def test_pilot_vehicle_resistance_by_hand():
    # c0 0.01176, c1 7.7616e-4, c2 1.6e-5 at 50 m/s: 0.01176 + 0.038808 + 0.04.
    assert running_resistance(50.0, 0.01176, 7.7616e-4, 1.6e-5) == pytest.approx(0.090568)


def test_default_davis_is_the_stated_form_in_newtons_per_kilonewton():
    davis, speed_kmh = Davis(), 72.0
    in_n_per_kn = 1.1 + 0.012 * speed_kmh + 0.000267 * speed_kmh**2
    assert running_resistance(20.0, davis.c0, davis.c1, davis.c2) == pytest.approx(
        in_n_per_kn * 1e-3 * GRAVITY_MPS2
    )


def test_adhesion_golden():
    # Curtius and Kniffler: 0.331 at standstill, 0.161 + 7.5/144 at 100 km/h.
    assert adhesion_limit(0.0, 1.0) / GRAVITY_MPS2 == pytest.approx(0.331, abs=5e-4)
    at_100 = Adhesion(0.5).limit_mps2(100 / 3.6)
    assert at_100 / GRAVITY_MPS2 == pytest.approx(0.5 * (0.161 + 7.5 / 144))


def test_effort_is_capped_by_power():
    effort = Effort(1.0, 10.0)
    assert [effort.at(v) for v in (0.0, 10.0, 20.0)] == pytest.approx([1.0, 1.0, 0.5])


def test_build_up_is_dead_time_then_ramp():
    assert [build_up(t, 1.0, 2.0) for t in (0.0, 1.0, 2.0, 3.0, 9.0)] == [0, 0, 0.5, 1, 1]
    assert build_up(1.0 + 1e-9, 1.0, 0.0) == 1.0


def test_rotating_mass_is_in_the_resistances_only():
    assert acceleration(-1.0, 0.0, 0.106, 0.0, 0.0, 0.0, 0.06) == pytest.approx(-1.1)


def test_curve_resistance_is_700_over_r_per_mille():
    assert w(Line.uniform(radius_m=700.0), 0.0, 100.0) == pytest.approx(1e-3 * GRAVITY_MPS2)


def test_gradient_builds_up_over_the_train_length():
    line = Line(((0.0, 0.0), (1000.0, 0.02)))
    full = GRAVITY_MPS2 * math.sin(math.atan(0.02))
    assert [w(line, s, 200.0) for s in (900.0, 1000.0, 1050.0, 1200.0, 5000.0)] == pytest.approx(
        [0.0, 0.0, 0.25 * full, full, full]
    )


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-0.04, 0.04), min_size=1, max_size=6),
    st.floats(1.0, 700.0),
    st.floats(-500.0, 3000.0),
)
def test_average_equals_a_fine_sum_over_the_train(gradients, length, position):
    line = Line(tuple((300.0 * i, g) for i, g in enumerate(gradients)), ((0.0, 500.0),))
    mass_points = position - length * (np.arange(20000) + 0.5) / 20000
    index = np.clip((mass_points // 300).astype(int), 0, len(gradients) - 1)
    slopes = np.array(gradients)[index]
    fine = GRAVITY_MPS2 * np.mean(np.sin(np.arctan(slopes)) + 0.7 / 500.0)
    assert w(line, position, length) == pytest.approx(fine, abs=2e-4)


def test_tightest_radius_ahead():
    line = Line(curves=((0.0, math.inf), (500.0, 300.0), (800.0, math.inf)))
    assert line.radius_m(100.0, 200.0) == math.inf
    assert line.radius_m(100.0, 500.0) == 300.0
    assert line.radius_m(600.0) == 300.0
    assert line.radius_m(900.0) == math.inf


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Davis(c0=-1.0), r"c0 is -1.0 m/s²; expected a number in \[0, 1\] m/s²"),
        (lambda: Davis(c1=math.nan), r"c1 is nan 1/s"),
        (
            lambda: Davis.per_train(0.0, 1, 1, 1),
            r"mass_kg is 0.0 kg; expected a number in \(0, inf",
        ),
        (lambda: Adhesion(0.0), r"adhesion factor is 0.0; expected a number in \(0, 1.5\]"),
        (lambda: Effort(accel_mps2=9.0), r"accel_mps2 is 9.0 m/s²"),
        (lambda: Line(((0.0, 25.0),)), r"gradient is 25.0 m/m; .* \(25 ‰ is 0.025\)"),
        (lambda: Line(((5.0, 0.0), (5.0, 0.1))), r"gradients is .* increasing positions in m"),
        (lambda: Line(()), r"gradients is \(\)"),
        (lambda: Line((1.0,)), r"gradients is \(1.0,\); expected a list of \[position_m, value\]"),
        (lambda: Line(curves=((0.0, 5.0),)), r"curve radius_m is 5.0 m; expected at least 20 m"),
        (lambda: check_range("x", "fast"), r"x is fast; expected a number in \(-inf, inf\)"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(DomainError, match=message):
        call()
