"""Missions against hand calculation, monotonicity, and what the camera's optics print."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railops.braking import Brake, Disturbances, stopping_distance
from railops.errors import DomainError
from railops.pilot import (
    Camera,
    Mission,
    Optics,
    Radio,
    braking_distance,
    lateral_shift,
    simulate,
)
from railops.pilot.mission import _geometric, share_of
from railops.pilot.page import write_page


def test_a_certain_mission_by_hand():
    mission = Mission.certain(30.0)
    found = simulate(mission, 3)
    stop = stopping_distance(mission.train).distance_m
    pilot_stop = stopping_distance(mission.pilot_train).distance_m
    # Recognised at 100 m after 0.1 s; message 0.1 s; command 0.2 s later.
    assert found.pilot_margin_m == pytest.approx(100.0 - 3.0 - pilot_stop, abs=0.5)
    assert found.margin_m["pilot"] == pytest.approx(1504.0 + 100.0 - 30.0 * 0.4 - stop, abs=0.5)
    assert found.margin_m["camera"] == pytest.approx(100.0 - 30.0 * 0.3 - stop, abs=0.5)
    assert found.margin_m["driver"] == pytest.approx(300.0 - 30.0 * 2.0 - stop, abs=0.5)


def test_lossy_radio_costs_its_interval_per_lost_message():
    calm = Mission.certain(30.0)
    lossy = replace(calm, radio=Radio(loss=0.5, outage=0.0, timeout_s=math.inf))
    found = simulate(lossy, 40_000, seed=1)
    late = simulate(calm, 1).margin_m["pilot"][0] - found.margin_m["pilot"]
    tries = late / (30.0 * 0.1)
    assert np.abs(tries - np.round(tries)).max() < 1e-6
    assert np.mean(tries) == pytest.approx(1.0, abs=0.03)  # mean of a geometric law at 1/2


def test_a_silent_radio_brakes_by_timeout_or_leaves_only_the_driver():
    calm = Mission.certain(30.0)
    dead = replace(calm, radio=Radio(outage=1.0, timeout_s=2.0))
    saved = simulate(dead, 1).margin_m["pilot"][0]
    late = simulate(calm, 1).margin_m["pilot"][0] - saved
    assert late == pytest.approx(30.0 * (2.0 - 0.1), abs=1e-6)
    never = replace(calm, radio=Radio(outage=1.0, timeout_s=math.inf))
    found = simulate(never, 1)
    assert found.margin_m["pilot"][0] == found.margin_m["driver"][0]


def test_an_obstacle_behind_the_pilot_vehicle_is_the_drivers():
    """Honest limit: what falls between the two is not seen by the one in front."""
    between = replace(Mission.certain(30.0), sudden=1.0, sudden_within_m=1000.0)
    found = simulate(between, 2000, seed=5)
    assert np.isnan(found.pilot_margin_m).all()
    assert (found.margin_m["pilot"] == found.margin_m["driver"]).all()


def test_a_blind_camera_still_warns_by_being_hit():
    blind = replace(Mission.certain(30.0), camera=Camera(working_log_std=0.0, blind=1.0))
    found = simulate(blind, 1)
    assert found.pilot_margin_m[0] < 0.0
    assert found.margin_m["pilot"][0] > 900.0


@settings(max_examples=20, deadline=None)
@given(st.floats(600.0, 2500.0), st.floats(1.0, 500.0))
def test_a_larger_gap_never_hurts(gap, more):
    plain = replace(Mission(), sudden=0.0)
    small = simulate(replace(plain, gap_m=gap), 300, seed=9)
    large = simulate(replace(plain, gap_m=gap + more), 300, seed=9)
    assert (large.margin_m["pilot"] >= small.margin_m["pilot"] - 1e-6).all()
    assert (large.margin_m["camera"] == small.margin_m["camera"]).all()


def test_the_pilot_vehicle_is_what_makes_the_difference():
    """Closing note 6 of the paper, and its limit at a realistic brake."""
    found = simulate(Mission(), 20_000, seed=0)
    assert found.stops("pilot").low > 0.9 > 0.1 > found.stops("driver").high
    assert found.stops("driver").low > found.stops("camera").high
    # 100 m of sight do not stop the pilot vehicle itself at 120 km/h with 1.5 m/s².
    assert found.pilot_stops.high < 0.01
    far = replace(Mission(), camera=Camera(600.0), disturbances=Disturbances(speed_error_rel=0.0))
    assert simulate(far, 5000, seed=0).pilot_stops.low > 0.9


def test_same_seed_same_missions_whatever_the_threads():
    one, two = (simulate(Mission(), 40_000, seed=2, threads=count) for count in (1, 2))
    for system, margin in one.margin_m.items():
        assert (margin == two.margin_m[system]).all()


def test_three_g_is_capped_by_adhesion():
    strong = replace(Mission.certain(30.0), pilot_brake=Brake(5.0, 0.1, 0.1))
    brake = stopping_distance(strong.pilot_train).distance_m
    assert brake > 1.4 * (30.0**2 / (2.0 * 5.0) + 30.0 * 0.15)


@settings(deadline=None)
@given(st.integers(1, 10_000), st.floats(0.0, 1.0))
def test_share_encloses_its_value(count, part):
    share = share_of(round(part * count), count)
    assert 0.0 <= share.low <= share.value <= share.high <= 1.0


def test_geometric_edges():
    uniform = np.array([0.0, 0.5, 0.999])
    assert (_geometric(uniform, 0.0) == 0.0).all()
    assert np.isinf(_geometric(uniform, 1.0)).all()
    assert _geometric(np.array([0.49, 0.51, 0.76]), 0.5).tolist() == [0.0, 1.0, 2.0]


def test_page_is_self_contained(tmp_path):
    page = write_page(simulate(Mission(), 500), tmp_path / "sub" / "mission.html")
    text = page.read_text(encoding="utf-8")
    assert "<canvas" in text
    assert "http" not in text
    assert "$" not in text


# Appendix D. The printed 90.18 m and 112.21 m are H·d/(H ± d) with H = f²/(k·δ) + f, an
# approximation; the printed formulas with their signs exchanged give 90.21 m and 112.18 m.
def test_depth_of_field():
    near, far = Optics().sharp_m
    assert (near, far) == (pytest.approx(90.2077, abs=1e-3), pytest.approx(112.1783, abs=1e-3))
    hyperfocal = 0.3**2 / (2.8 * 3.5e-5) + 0.3
    as_printed = [hyperfocal * 100.0 / (hyperfocal + sign * 100.0) for sign in (1, -1)]
    assert as_printed == [pytest.approx(90.18, abs=5e-3), pytest.approx(112.21, abs=5e-3)]
    assert Optics(f_number=64.0).sharp_m[1] == math.inf


def test_three_g_stop_as_printed_warns_about_adhesion():
    with pytest.warns(UserWarning, match="beyond wheel–rail adhesion"):
        assert braking_distance(250.0 / 3.6, 0.1, 3 * 9.8) == pytest.approx(88.96, abs=5e-3)


def test_lateral_shift_as_printed():
    assert lateral_shift(2000.0, 100.0) == pytest.approx(2.5, abs=5e-3)
    assert lateral_shift(2000.0, 7.0) == pytest.approx(0.012, abs=5e-4)
    with pytest.raises(DomainError, match="radius_m"):
        lateral_shift(50.0, 100.0)


def test_bad_input_is_refused():
    with pytest.raises(DomainError, match="hit_rate"):
        Camera(hit_rate=0.0)
    with pytest.raises(DomainError, match="timeout_s"):
        Radio(timeout_s=0.0)
    with pytest.raises(DomainError, match="gap_m"):
        Mission(gap_m=0.0)
