"""The closed loop: Appendix C's equations integrated independently, limits, noise, sight, MPC."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from railops.errors import DomainError
from railops.pilot import Mpc, Pid, Reality, Reference, Route, SpeedProfile, Trip, plan_trip, track
from railops.pilot.controllers import box_qp, pid_force
from railops.pilot.sight import in_sight
from railops.traction import Line


@pytest.fixture(scope="module")
def plan():
    """A short trip with the paper's legs."""
    route = Route.paper(trip_m=40e3, ramp_m=10e3)
    return plan_trip(Trip(route, open_from_m=12e3, close_until_m=28e3))


@pytest.fixture(scope="module")
def ideal(plan):
    return track(plan, Pid(anti_windup=False), Reality(limited=False))


def test_pid_stays_within_the_papers_15_metres(ideal):
    assert ideal.largest_error_m < 15.0
    assert ideal.mother_m[-1] > 39_990.0
    assert ideal.smallest_gap_m > 90.0


def test_the_loop_agrees_with_appendix_c_integrated_by_another_method(plan, ideal):
    """Eq. 25 as ordinary differential equations, by an adaptive eighth-order method."""
    trip, vehicle = plan.trip, plan.trip.vehicle
    mother, davis = trip.route.mother, vehicle.davis
    pid, begin = Pid(), 13e3  # within the opening leg
    start = int(np.searchsorted(ideal.mother_m, begin))

    def rates(_, state):
        p, x, v, total = state
        speed = float(mother.speed_at(p))
        gap, slope, _ = plan.reference.at(p)
        error, error_rate = float(gap) - x, speed * (1.0 + float(slope)) - v
        force = pid.proportional * error + pid.integral * total + pid.derivative * error_rate
        return [speed, v - speed, force - davis.c0 - davis.c1 * v - davis.c2 * v * v, error]

    total = float(np.sum(ideal.error_m[: start + 1]) * 0.1)
    begun = [ideal.mother_m[start], ideal.gap_m[start], ideal.speed_mps[start], total]
    done = solve_ivp(rates, (0.0, 60.0), begun, method="DOP853", rtol=1e-8, max_step=0.2)
    index = start + 600
    # The loop decides every 0.1 s and holds the force meanwhile; the equations are continuous.
    assert ideal.mother_m[index] == pytest.approx(done.y[0, -1], abs=0.05)
    assert ideal.gap_m[index] == pytest.approx(done.y[1, -1], abs=0.1)
    assert ideal.speed_mps[index] == pytest.approx(done.y[2, -1], abs=0.02)


def test_mpc_beats_pid_and_its_bar(plan, ideal):
    smart = track(plan, Mpc())
    assert smart.largest_error_m < 3.0
    assert smart.largest_error_m < ideal.largest_error_m


def test_limits_are_never_passed_and_saturation_is_reported(plan):
    weak = replace(plan.trip.vehicle, traction_mps2=0.45, reserve=0.0)
    hampered = replace(plan, trip=replace(plan.trip, vehicle=weak))
    found = track(hampered, Pid())
    assert found.force_mps2.max() <= 0.45 + 1e-12
    assert found.saturated_share > 0.005
    assert found.beyond_plan_mps2 == pytest.approx(0.0, abs=1e-12)
    assert found.largest_error_m > 1.0


def test_anti_windup_shortens_the_way_back(plan):
    weak = replace(plan.trip.vehicle, traction_mps2=0.45, reserve=0.0)
    hampered = replace(plan, trip=replace(plan.trip, vehicle=weak))
    guarded, plain = (track(hampered, Pid(anti_windup=on)) for on in (True, False))
    assert guarded.gap_m.max() < plain.gap_m.max()  # less overshoot beyond the far gap


def test_a_rough_day_costs_accuracy_but_not_safety(plan):
    reality = replace(Reality.rough(), range_std_m=3.0)
    for controller in (Pid(), Mpc()):
        found = track(plan, controller, reality, seed=1)
        assert 0.05 < found.rms_error_m < found.largest_error_m < 15.0
        assert found.smallest_gap_m > 80.0


def test_same_seed_same_track(plan):
    first, again = (track(plan, Pid(), Reality.rough(), seed=3) for _ in range(2))
    assert (first.gap_m == again.gap_m).all()
    other = track(plan, Pid(), Reality.rough(), seed=4)
    assert (first.gap_m != other.gap_m).any()


def test_dead_reckoning_drifts_with_the_odometer_only_while_out_of_sight(plan):
    """On a curve the chord leaves the cleared strip; the estimate then lives on the radio."""
    curved = Line(((0.0, 0.0),), ((0.0, np.inf), (16e3, 900.0), (19e3, np.inf)))
    bent = replace(plan, trip=replace(plan.trip, route=replace(plan.trip.route, line=curved)))
    reality = Reality(clear_m=8.0, odometer_std=0.003)
    found = track(bent, Pid(), reality, seed=2)
    off = np.abs(found.estimate_m - found.gap_m)
    assert 0.02 < found.unseen_share < 0.5
    assert off[found.seen].max() < 1e-6
    assert off[~found.seen].max() > 2.0
    straight = track(plan, Pid(), reality, seed=2)
    assert straight.unseen_share == 0.0


def test_sight_follows_the_sagitta():
    """A chord of length x on a circle of radius ρ departs from it by x²/(8ρ)."""
    route = Route(SpeedProfile.constant(30.0, 20e3), Line.uniform(0.0, 1000.0))
    sagitta = 400.0**2 / 8000.0
    for clear, expected in ((1.05 * sagitta, 1.0), (0.95 * sagitta, 0.0)):
        _, seen = in_sight(route, Reference.constant(400.0), clear)
        assert (seen[10:-10] == expected).all()


def test_pid_by_hand():
    gains = np.array([0.8, 0.1, 6.0, 1.0])
    force, total = pid_force(2.0, -0.5, 3.0, gains, -9.0, 9.0, 0.1)
    assert total == pytest.approx(3.2)
    assert force == pytest.approx(0.8 * 2.0 + 0.1 * 3.2 - 6.0 * 0.5)
    _, held = pid_force(20.0, 0.0, 3.0, gains, -9.0, 9.0, 0.1)
    assert held == 3.0  # saturated outwards: the integral waits


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_box_qp_finds_the_constrained_minimum(seed):
    rng = np.random.default_rng(seed)
    factor, target = rng.normal(size=(8, 6)), rng.normal(size=8) * 3.0
    low, high = -rng.random(6), rng.random(6)
    answer = np.zeros(6)
    hessian = factor.T @ factor + 0.1 * np.eye(6)
    gradient = -factor.T @ target
    box_qp(hessian, gradient, low, high, answer, 3000)
    stacked = np.vstack([factor, np.sqrt(0.1) * np.eye(6)])
    reference = lsq_linear(stacked, np.concatenate([target, np.zeros(6)]), (low, high), tol=1e-12).x
    assert answer == pytest.approx(reference, abs=1e-4)


def test_bad_input_is_refused(plan):
    with pytest.raises(DomainError, match=r"radio_loss is 1\.5"):
        Reality(radio_loss=1.5)
    with pytest.raises(DomainError, match="horizon is 1"):
        Mpc(horizon=1)
    with pytest.raises(DomainError, match="step_s"):
        track(plan, step_s=5.0)
