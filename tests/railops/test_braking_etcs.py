"""Curves in ETCS vocabulary: worked by hand, ordered, on gradients; bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railops.braking import Brake, Train
from railops.braking.etcs import BrakingData, a_gradient, curves, deceleration_curve
from railops.errors import CannotStopError, DomainError
from railops.traction import Line

DATA = BrakingData(
    A_brake_emergency=((0.0, 1.0),),
    A_brake_service=((0.0, 0.5),),
    T_be=2.0,
    T_bs=3.0,
    V_inaccuracy=0.0,
)


def test_curves_worked_by_hand_on_level_track():
    # 20 m/s towards 1000 m: EBD 1000 − 200, EBI 800 − 20·2, SBD 1000 − 400, SBI1 600 − 60 (the
    # nearer), SBI2 760 − 60, Permitted 540 − 80, Warning 540 − 40,
    # Indication 460 − 20·(max(2.4, 5) + 4).
    limits = curves(DATA, 1000.0, 20.0).at(20.0)
    assert limits == pytest.approx(
        {
            "ebd": 800.0,
            "ebi": 760.0,
            "sbd": 600.0,
            "sbi": 540.0,
            "permitted": 460.0,
            "warning": 500.0,
            "indication": 280.0,
        }
    )


def test_speed_inaccuracy_and_traction_by_hand():
    # V_bec = 20·1.05 + 0.5·1 + 0.4·1 = 21.9; EBD(21.9) = 239.805 m before the target;
    # D_bec = (21 + 0.25)·1 + (21.5 + 0.2)·1 = 42.95 m.
    data = BrakingData(
        ((0.0, 1.0),),
        ((0.0, 1.0),),
        2.0,
        0.0,
        A_est1=0.5,
        T_traction=1.0,
        A_est2=0.4,
        V_inaccuracy=0.05,
    )
    limits = curves(data, 1000.0, 20.0).at(20.0)
    assert limits["ebi"] == pytest.approx(1000.0 - 239.805 - 42.95)


def test_default_speed_inaccuracy_is_that_of_subset_041():
    data = BrakingData(((0.0, 1.0),), ((0.0, 1.0),), 0.0, 0.0)
    kmh = np.array([10.0, 30.0, 265.0, 500.0])
    assert data.speed_inaccuracy(kmh / 3.6) * 3.6 == pytest.approx([2.0, 2.0, 7.0, 12.0])


def test_correction_factors():
    data = BrakingData(
        ((0.0, 1.0),), ((0.0, 1.0),), 0.0, 0.0, Kdry_rst=0.8, Kwet_rst=0.9, M_NVAVADH=0.5
    )
    assert data.A_brake_safe == ((0.0, pytest.approx(0.8 * 0.95)),)


def test_step_function_and_gradient_by_hand():
    # Last 100 m level, before that 10 ‰ down; the brake is 1.0 below 10 m/s, 0.8 above.
    steps = ((0.0, 1.0), (10.0, 0.8))
    line = Line(((0.0, -0.01), (900.0, 0.0)))
    curve = deceleration_curve(steps, 1000.0, 30.0, line, 0.0, 0.0)
    down = 9.81 * 0.01
    assert float(curve.distance(10.0)) == pytest.approx(950.0)
    v_900 = np.sqrt(100.0 + 2 * 0.8 * 50.0)
    assert float(curve.distance(v_900)) == pytest.approx(900.0)
    expected = 900.0 - (30.0**2 - v_900**2) / (2 * (0.8 - down))
    assert float(curve.distance(30.0)) == pytest.approx(expected)


def test_gradient_counts_while_any_part_of_the_train_is_on_it():
    steps, line = ((0.0, 1.0),), Line(((0.0, -0.02), (500.0, 0.0)))
    long = deceleration_curve(steps, 1000.0, 25.0, line, 300.0, 0.0)
    # The rear leaves the descent when the front is at 800 m.
    assert float(long.distance(20.0)) == pytest.approx(800.0)
    assert float(long.distance(25.0)) == pytest.approx(800.0 - 225.0 / (2 * (1 - 0.1962)))
    assert long.distance(25.0) < deceleration_curve(steps, 1000.0, 25.0, line).distance(25.0)


def test_unknown_rotating_mass_takes_the_cautious_end():
    assert a_gradient(-0.01) == pytest.approx(-9.81 * 0.01 / 1.02)
    assert a_gradient(0.01) == pytest.approx(9.81 * 0.01 / 1.15)


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.3, 1.2),
    st.floats(1.0, 1.6),
    st.floats(0.0, 5.0),
    st.floats(0.0, 5.0),
    st.floats(-0.02, 0.03),
    st.floats(0.0, 0.1),
)
def test_limits_are_met_in_order_and_before_the_target(service, ratio, t_be, t_bs, grade, error):
    data = BrakingData(((0.0, service * ratio),), ((0.0, service),), t_be, t_bs, V_inaccuracy=error)
    c = curves(data, 5000.0, 40.0, Line.uniform(grade), 200.0)
    for nearer, farther in [
        (c.indication_m, c.permitted_m),
        (c.permitted_m, c.warning_m),
        (c.warning_m, c.sbi_m),
        (c.sbi_m, c.ebi_m),
        (c.ebi_m, c.ebd_m),
        (c.ebd_m, np.full_like(c.ebd_m, 5000.0)),
    ]:
        assert (nearer <= farther + 1e-9).all()
    for limit in (c.indication_m, c.sbi_m, c.ebi_m):
        assert (np.diff(limit) < 0).all()  # the faster, the earlier


def test_a_trains_tables_become_steps_that_nowhere_brake_better():
    brake = Brake(((5.0, 1.2), (25.0, 0.8), (40.0, 0.9)), 0.5, 1.0)
    data = BrakingData.of(Train(10.0, emergency=brake), Kdry_rst=0.9)
    assert data.T_be == 1.0
    speeds, decels = np.array(data.A_brake_emergency).T
    v = np.linspace(0.0, 50.0, 501)
    stepped = decels[np.searchsorted(speeds, v, "right") - 1]
    assert (stepped <= np.interp(v, *brake.table) + 1e-12).all()


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: BrakingData((), ((0.0, 1.0),), 1, 1), DomainError, r"A_brake_emergency is \(\)"),
        (lambda: BrakingData(((0, 0),), ((0.0, 1.0),), 1, 1), DomainError, r"is 0 m/s²; expected"),
        (lambda: BrakingData(((0, 1),), ((0, 1),), -1, 1), DomainError, r"T_be is -1 s"),
        (lambda: curves(DATA, 1000.0, 200.0), DomainError, r"speed_max_mps is 200.0 m/s"),
        (
            lambda: curves(DATA, 1000.0, 20.0, Line.uniform(-0.06)),
            CannotStopError,
            r"gradient of -60.0 ‰ outweighs the brake's 0.500 m/s²; it runs away",
        ),
    ],
)
def test_bad_input_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call()
