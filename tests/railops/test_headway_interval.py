"""The interval: golden case by hand, safety, dwell, monotonicity, an independent simulation."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.headway import STEPS_KMH, random_pair, searched
from benchmarks.headway_fine import interval_s as fine_interval_s
from railops.errors import RailOpsError
from railops.headway import (
    FixedBlock,
    MovingBlock,
    Section,
    Stock,
    Succession,
    TrackCircuits,
    bracketed_interval,
    characteristic,
    minimum_interval,
    simulate,
)
from railops.headway.demand import demand_times, permitted
from railops.headway.interval import level_name
from railops.traction import Davis, Effort

SEEDS = st.integers(0, 2**32 - 1)


def by_hand(codes=((0, 0.0), (1, 72.0))):
    """No resistance, 1 m/s² both ways, 20 m/s limit, 100 m train, circuits of 200 m."""
    edges = [-100.0 + 200.0 * index for index in range(9)]
    return Section(
        1000.0,
        TrackCircuits(tuple(pairwise(edges)), codes=codes, delay_s=2.0),
        Stock(100.0, Effort(1.0, 200.0), Davis(0.0, 0.0, 0.0), brake_mps2=1.0),
        limits_kmh=((0.0, 72.0),),
    )


def test_by_hand():
    # Both run 70 s: 20 s up (200 m), 30 s at 20 m/s, 20 s down. Entering circuit 4 (700–900 m)
    # after 20 + 500/20 = 45 s needs one free circuit: tail past 1100 m, front at 1200 m, 20 s after
    # drawing away (200 m at 1 m/s²). With δ = 2 s and D = 20 s: 70 + 20 + 20 + 2 − 45 = 67 s.
    # (Entering circuit 5, 100 m before the stop, asks for √800 − (70 − √200) + 92 = 64.4 s.)
    pair = Succession(by_hand())
    found = pair.interval(70.0, 70.0)
    assert found.at(20.0) == pytest.approx(67.0, abs=1e-9)
    assert level_name(pair.section, found.critical_level(20.0)) == "circuit 5 (900–1100 m)"
    # Before it stops, circuit 1 (100–300 m) counts: needed at once, given with the front at 400 m
    # after 20 + 200/20 = 30 s.
    assert found.before_s == pytest.approx(30.0 + 2.0 - 0.0, abs=1e-9)
    assert level_name(pair.section, found.before_level) == "circuit 1 (100–300 m)"
    assert found.linear_from_s == 0.0


def test_a_short_dwell_is_not_linear_where_the_run_decides():
    # A train in front that hardly stops: A > B + D, and the dwell below A − B changes nothing.
    found = Succession(by_hand()).interval(110.0, 70.0)
    short = found.__class__(60.0, 50.0, 1, 2)
    assert [short.at(dwell) for dwell in (0.0, 10.0, 25.0)] == [60.0, 60.0, 75.0]
    assert short.linear_from_s == 10.0
    assert [short.critical_level(dwell) for dwell in (0.0, 25.0)] == [1, 2]


def test_permitted_speed_of_each_system():
    coded = by_hand().plan
    assert [permitted(0.0, level, 0, coded) for level in (-1, 0, 1, 2)] == [0, 0, 0, 20.0]
    block = FixedBlock(((0.0, 500.0), (500.0, 1100.0)), decel_mps2=1.0, reaction_s=0.0)
    plan = block.plan(1000.0)
    assert [permitted(300.0, level, 0, plan) for level in (-1, 0, 1, 2)] == [0, 0, 20.0, np.inf]
    plan = MovingBlock(margin_m=0.0, decel_mps2=1.0, reaction_s=5.0).plan(1000.0)
    # v·5 + v²/2 = 100 → v = −5 + 15
    assert permitted(300.0, 400, 0, plan) == pytest.approx(10.0)


@settings(max_examples=150, deadline=None)
@given(SEEDS)
def test_safe_at_the_interval_restricted_a_second_below(seed):
    pair, second, first, dwell = random_pair(np.random.default_rng(seed))
    shortest = pair.interval(second, first).at(dwell)
    at = simulate(pair, second, first, shortest, dwell)
    assert not at.restricted
    assert at.margin_mps >= -1e-5
    below = simulate(pair, second, first, shortest - 1.0, dwell)
    assert below.restricted
    assert below.margin_mps < 0.0
    assert 0.0 <= below.violation_m <= pair.section.length_m


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_the_closed_form_is_what_a_search_finds(seed):
    pair, second, first, dwell = random_pair(np.random.default_rng(seed))

    def meets(interval):
        return simulate(pair, second, first, interval, dwell).restricted

    found = bracketed_interval(meets, 0.0, 900.0, 1e-6)
    assert found == pytest.approx(pair.interval(second, first).at(dwell), abs=2e-5)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0.0, 300.0))
def test_linear_in_the_dwell(seed, more):
    """By search, which does not know that the interval is a sum with the dwell in it."""
    pair, second, first, dwell = random_pair(np.random.default_rng(seed))
    found = pair.interval(second, first)
    dwell = max(dwell, found.linear_from_s)
    near = found.at(dwell)
    one = searched(pair, second, first, dwell, near - 1.0, near + 1e-3)
    two = searched(pair, second, first, dwell + more, near + more - 1.0, near + more + 1e-3)
    assert two - one == pytest.approx(more, abs=1e-9)
    # And what is computed is what is found, but for the micrometre per second that still counts as
    # running under a code: coasting towards it that is some microseconds.
    again = minimum_interval(pair.section, second, first, dwell + more)
    assert again == pytest.approx(two, abs=2e-5)
    assert again - found.at(dwell) == pytest.approx(more, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_monotone_in_both_run_times(seed):
    pair, *_ = random_pair(np.random.default_rng(seed))
    shortest = pair.regulator.shortest_s
    longest = min(1.3 * shortest, pair.regulator.longest().run_time_s)
    times = np.linspace(shortest, longest, 6).tolist()
    table = characteristic(pair.section, times, name_critical=False)
    for dwell in (0.0, 20.0, 90.0):
        interval = table.interval_s(dwell)
        assert np.all(np.diff(interval, axis=0) <= 1e-4)  # slower behind: never longer
        assert np.all(np.diff(interval, axis=1) >= -1e-4)  # slower in front: never shorter
    # After the dwell the run time in front counts second for second.
    after = table.after_s - table.first_s[None, :]
    assert np.ptp(after, axis=1) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", [2, 5, 6])
def test_an_independent_fine_simulation(seed):
    rng = np.random.default_rng(seed)
    for _ in range(4):
        pair, second, first, dwell = random_pair(rng)
        mine = pair.interval(second, first).at(dwell)
        assert fine_interval_s(pair.section, second, first, dwell) == pytest.approx(mine, abs=0.2)


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_less_information_never_shortens_the_interval(seed):
    pair, second, first, dwell = random_pair(np.random.default_rng(seed))
    section = pair.section
    fine = MovingBlock(margin_m=30.0, report_m=1.0, decel_mps2=0.8, reaction_s=2.0, delay_s=1.5)
    edges = [-100.0, *np.arange(150.0, section.length_m + 400.0, 300.0).tolist()]
    blocks = FixedBlock(tuple(pairwise(edges)), overlap_m=30.0)
    values = []
    for protection in (fine, blocks):
        other = Succession(section.with_protection(protection))
        shortest = max(second, other.regulator.shortest_s)
        values.append(other.interval(shortest, max(first, shortest)).at(dwell))
    assert values[0] <= values[1] + 1e-6


def test_demands_rise_with_the_level():
    pair = Succession(by_hand())
    demand = demand_times(pair.run(80.0).nodes, pair.plan)
    needed = demand[np.isfinite(demand)]
    assert np.all(np.diff(needed) >= 0.0)
    assert np.isinf(demand[-1])


def test_codes_met_are_logged():
    pair = Succession(by_hand(((0, 0.0), (1, 36.0), (2, 72.0))))
    shortest = pair.interval(75.0, 75.0).at(20.0)
    seen = simulate(pair, 75.0, 75.0, shortest, 20.0)
    changes = seen.code_changes()
    assert np.all(np.diff(changes[:, 0]) >= 0.0)
    assert changes[0, :2].tolist() == [0.0, 0.0]
    assert set(np.round(changes[:, 4] * 3.6).astype(int)) <= {0, 36, 72}
    assert np.all(seen.log[:-1, 4] - seen.log[:-1, 5] >= -1e-5)


def test_no_bracket_is_said():
    with pytest.raises(RailOpsError, match="no bracket: a code must be met at 10 s"):
        bracketed_interval(lambda interval: False, 10.0, 20.0)


def test_design_codes_stop_the_train_before_the_tail():
    # 14 m/s ≈ 50 km/h: 50 steps; every code must leave braking room behind the tail's circuit.
    edges = [-100.0 + 90.0 * index for index in range(30)]
    circuits = tuple(pairwise(edges))
    protection = TrackCircuits(circuits, steps_kmh=STEPS_KMH, overlap_m=25.0)
    code = protection.plan(1500.0).code_mps
    for i in range(29):
        for k in range(30):
            v = code[i, k]
            if v > 0.0:
                stop = edges[i + 1] + 2.0 * v + v * v / 1.6
                assert stop + 25.0 <= edges[k] + 1e-6
            assert k == 0 or v >= code[i, k - 1]
