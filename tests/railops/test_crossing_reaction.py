"""Collision probability, the methods that lower it, the fall-back, and the tables."""

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from railops._extras import extra
from railops.crossing import clonal, genetic, perceptron, tables
from railops.crossing.experiment import METHODS, crowd, run, scenario
from railops.crossing.fallback import Order, react
from railops.crossing.front import nsga2
from railops.crossing.probability import (
    Approach,
    Uncertainty,
    calibrate,
    collision_probability,
    published_values,
    student3,
)
from railops.crossing.problem import BOTH_WAYS, SLOW_DOWN, ActionRange, Problem
from railops.crossing.rules import Crossing
from railops.crossing.situation import Situation
from railops.errors import DomainError, EvidenceError, MeasurementError, MissingExtraError

TRAIN = Approach(1000.0, 80 / 3.6)
CAR = Approach(500.0, 40 / 3.6)


@pytest.mark.parametrize(("change", "printed", "ours"), published_values())
def test_published_probabilities_within_a_factor_of_one_and_a_half(
    change: float, printed: float, ours: float
) -> None:
    assert 1 / 1.5 <= ours / printed <= 1.5


def test_probability_falls_all_the_way_as_the_car_slows() -> None:
    slowed = [
        collision_probability(TRAIN, Approach(500.0, (40 - slower) / 3.6))
        for slower in np.linspace(0.0, 10.0, 101)
    ]
    assert (np.diff(slowed) < 0.0).all()


def test_defaults_are_the_calibration_rounded() -> None:
    speed_rel, lead_m = calibrate()
    assert round(speed_rel, 3) == Uncertainty().speed_rel
    assert round(lead_m) == Crossing().lead_m


@given(st.floats(-1e4, 1e4))
def test_student_is_scipys(x: float) -> None:
    assert student3(x) == pytest.approx(stats.t.cdf(x, 3), rel=1e-9, abs=1e-12)


@given(
    st.floats(-50.0, 1000.0), st.floats(0.0, 40.0), st.floats(-10.0, 1000.0), st.floats(0.0, 40.0)
)
def test_probability_is_a_probability(d_t: float, v_t: float, d_c: float, v_c: float) -> None:
    p = collision_probability(Approach(d_t, v_t), Approach(d_c, v_c))
    assert 0.0 <= p <= 1.0


def test_doubt_spreads_with_horizon_and_age() -> None:
    # 40 s apart: more doubt means more risk, and so does a longer way at the same gap
    def p(distance_m: float, age_s: float) -> float:
        gap_m = 40.0 * 20.0
        return collision_probability(
            Approach(distance_m + gap_m, 20.0, age_s), Approach(distance_m, 20.0, age_s)
        )

    assert p(200.0, 0.0) < p(600.0, 0.0) < p(600.0, 5.0) < p(600.0, 15.0)


def test_a_late_report_is_no_present_position() -> None:
    # ten seconds ago the car was 10 s behind the train, so by now both are there together
    train, car = Approach(400.0, 20.0), Approach(600.0, 20.0, 10.0)
    met = collision_probability(train, car)
    assert met > collision_probability(train, Approach(650.0, 20.0, 10.0))
    assert met > collision_probability(train, Approach(550.0, 20.0, 10.0))
    assert met > 5.0 * collision_probability(train, replace(car, age_s=0.0))
    problem = Problem((train,), (car,))
    assert problem.probability_unchanged() == collision_probability(train, car)
    # predicted to be over the crossing is not the same as reported over it
    gone = Approach(60.0, 20.0, 4.0)
    assert collision_probability(Approach(10.0, 20.0), gone) > 0.01
    assert collision_probability(Approach(10.0, 20.0), Approach(-20.0, 20.0)) == 0.0


def test_a_late_report_leaves_less_room_to_stop() -> None:
    ahead = Situation(80.0, 0.0, 0, 0, 600.0, -3.0, 20.0, 50.0)
    assert not react(ahead, seed=1).too_late
    late = react(ahead, seed=1, train_age_s=10.0)
    assert late.too_late
    assert late.stop.distance_m < 600.0 - 10.0 * 80.0 / 3.6


def test_standing_and_passed_vehicles() -> None:
    assert collision_probability(TRAIN, Approach(-2.0, 0.0)) == 1.0
    assert collision_probability(TRAIN, Approach(30.0, 0.0)) == 0.0
    assert collision_probability(TRAIN, Approach(-20.0, 10.0)) == 0.0
    assert collision_probability(Approach(-300.0, 20.0), CAR) == 0.0


def test_reports_from_the_future_or_long_ago_are_refused() -> None:
    with pytest.raises(MeasurementError, match="from the future"):
        Approach(100.0, 10.0, -1.0)
    with pytest.raises(MeasurementError, match="age_s is 601"):
        Approach(100.0, 10.0, 601.0)


def test_objective_takes_the_worst_pair_and_trains_only() -> None:
    cars = (CAR, Approach(100.0, 40 / 3.6))
    problem = Problem((TRAIN,), cars, BOTH_WAYS)
    probability, effort = problem.evaluate([[-3.0, 1.0, 2.0]])
    pairs = [
        collision_probability(
            Approach(1000.0, 77 / 3.6), Approach(car.distance_m, car.speed_mps + extra_kmh / 3.6)
        )
        for car, extra_kmh in zip(cars, (1.0, 2.0), strict=True)
    ]
    assert probability[0] == pytest.approx(max(pairs))
    assert effort[0] == 3.0
    with pytest.raises(DomainError, match=r"shape \(K, 3\)"):
        problem.evaluate([[0.0, 0.0]])
    with pytest.raises(DomainError, match="at least one of each"):
        Problem((), cars)
    with pytest.raises(DomainError, match="room for at least one"):
        ActionRange(0.0, 0.0)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 9), st.sampled_from(sorted(METHODS)), st.booleans())
def test_every_method_keeps_the_range_and_never_makes_it_worse(
    seed: int, number: int, method: str, both: bool
) -> None:
    problem = scenario(number, BOTH_WAYS if both else SLOW_DOWN)
    found = METHODS[method](problem, seed)
    for change in found.train_changes_kmh + found.car_changes_kmh:
        assert problem.actions.low_kmh <= change <= problem.actions.high_kmh
    assert found.objective <= problem.probability_unchanged()
    assert found == METHODS[method](problem, seed)


def test_clonal_selection_is_within_a_percent_of_the_front() -> None:
    problem = scenario(3, BOTH_WAYS)
    front = nsga2(problem, seed=1, population=40, generations=40)
    assert (np.diff(np.sort(front.train_change_kmh)) >= 0.0).all()
    assert clonal.solve(problem, seed=1).objective <= 1.01 * front.best(problem).objective


def test_suppression_keeps_the_better_of_two_alike() -> None:
    population = np.array([[0.0, 0.0], [0.001, 0.0], [5.0, 0.0]])
    kept = clonal.suppress(population, np.array([0.2, 0.1, 0.3]), 0.01)
    assert kept.tolist() == [1, 2]


def test_mutation_is_smaller_for_better_parents() -> None:
    problem = Problem((TRAIN,), (CAR,), ActionRange(-100.0, 100.0))
    rng = np.random.default_rng(0)
    parents = np.full((4000, 2), 37.0)
    moved = [
        np.median(
            np.abs(clonal.hypermutate(parents, np.full(4000, a), 5.0, problem, rng) - 37.0)[:, 0]
        )
        for a in (0.0, 1.0)
    ]
    assert moved[0] > 5.0 * moved[1]


def test_perceptron_input_order_and_early_end() -> None:
    problem = Problem((TRAIN,), (CAR,))
    np.testing.assert_allclose(perceptron.inputs_of(problem), [100.0, 80.0, 50.0, 40.0, 1.0])
    quick = perceptron.solve(problem, 1, perceptron.Settings(probability=0.1))
    assert quick.evaluations < 3001
    assert quick.probability < 0.1


def test_genetic_algorithm_counts_its_evaluations() -> None:
    small = genetic.Settings(population=10, generations=3)
    assert genetic.solve(Problem((TRAIN,), (CAR,)), 1, small).evaluations == 40


@pytest.mark.parametrize(
    ("values", "order", "too_late"),
    [
        ((80.0, 40.0, 0, 0, 1000.0, 60.0, 20.0, 50.0), Order.NOTHING, False),
        ((80.0, 40.0, 0, 0, 1000.0, 500.0, 20.0, 50.0), Order.CHANGE_SPEEDS, False),
        ((80.0, 0.0, 0, 0, 900.0, -3.0, 20.0, 50.0), Order.STOP_TRAIN, False),
        ((80.0, 0.0, 0, 0, 300.0, -3.0, 20.0, 50.0), Order.STOP_TRAIN, True),
        ((80.0, 40.0, 0, 0, 150.0, 75.0, 20.0, 50.0), Order.STOP_TRAIN, True),  # P 0.04 is left
    ],
)
def test_fall_back(values: tuple[float, ...], order: Order, too_late: bool) -> None:
    decision = react(Situation.of(values), seed=1)
    assert (decision.order, decision.too_late) == (order, too_late)
    assert ("too late" in decision.reason) == too_late


def test_tables_of_a_short_plan() -> None:
    runs = run(seed=1, attempts=2, scenarios=2)
    assert len(runs) == 2 * 2 * 2 * len(METHODS)
    rows = tables.z_tests(runs, "clonal selection")
    assert [row.experiment for row in rows] == [1, 2, 3, 4]
    assert all(row.improved and row.low <= row.high < row.tested for row in rows)
    criteria = [row.criterion for row in tables.compare(runs, "genetic algorithm", seed=0)]
    assert criteria == list(tables.CRITERIA)
    numbered = tables.numbered(runs, seed=0)
    for table, rival, percents in (  # the thesis's last columns
        ("4.4", "genetic algorithm", [708.40, 280.23, 1579.87, -1.89]),
        ("4.5", "self-training perceptron", [121.01, 2.33, 260.64, -54.95]),
        ("4.6", "genetic algorithm", [700.00, 275.00, 1579.84, -6.80]),
        ("4.7", "self-training perceptron", [118.18, 0.00, 260.73, -60.47]),
    ):
        rows = {row["criterion"]: row for row in numbered[table]}
        assert list(rows) == list(tables.CRITERIA)
        printed = [row["published_percent"] for row in rows.values()]
        assert printed == pytest.approx(percents, abs=0.02)
        left = tables.values(runs, rival, "collision probability")
        mean = left.mean() if table < "4.6" else left.std(axis=1, ddof=1).mean()
        assert rows["collision probability"]["other"] == pytest.approx(mean)
        assert rows["collision probability"]["rival"] == rival
    assert numbered["4.2"][0]["tested"] == runs[0].before
    shown = tables.text(runs, 0)
    assert shown.count("4 of 4 improved") == len(METHODS)
    assert "± 0 (0.00086)" in shown  # clonal selection finds the same answer; the thesis's mean
    with pytest.raises(EvidenceError, match="no runs of magic"):
        tables.values(runs, "magic", "collision probability")


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", fail)
    with pytest.raises(MissingExtraError, match=r"needs simpy.*railinspect\[crossing\]"):
        extra("crossing", "simpy", "the exchange simulation")


def test_probability_is_finite_at_the_edges() -> None:
    assert math.isfinite(collision_probability(Approach(0.0, 0.001), Approach(0.0, 0.001)))


def test_clonal_selection_leads_the_genetic_algorithm_on_a_crowd() -> None:
    problem = crowd(1, BOTH_WAYS)
    assert problem == crowd(1, BOTH_WAYS)
    assert (len(problem.trains), len(problem.cars)) == (2, 3)
    best = nsga2(problem, seed=1, population=60, generations=60).best(problem).objective
    found = {name: METHODS[name](problem, seed=1).objective for name in METHODS}
    assert found["clonal selection"] <= 1.01 * best
    assert found["clonal selection"] <= found["genetic algorithm"]
