"""Situation space, rules, detectors and memory of the crossing room."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railops.crossing import negative, vdetector
from railops.crossing.coverage import estimate, interval
from railops.crossing.detectors import DetectorSet, distances
from railops.crossing.geodesy import Position, geodesic_m, haversine_m, offset
from railops.crossing.memory import Memory
from railops.crossing.probability import Approach, collision_probability
from railops.crossing.published import ALARMED, ANTIGENS, SELF
from railops.crossing.rules import Crossing, can_stop, clearance
from railops.crossing.situation import HIGH, LOW, Situation, as_points, random_situations, scaled
from railops.errors import DomainError, FileError


def situation(**changes: float) -> Situation:
    return replace(Situation(80.0, 40.0, 0.0, 0.0, 1000.0, 500.0, 20.0, 50.0), **changes)


@pytest.fixture(scope="module")
def detectors() -> DetectorSet:
    return vdetector.train(SELF, seed=7, settings=vdetector.Settings(coverage=0.98))


def test_situation_outside_its_range_is_refused_by_name_and_unit() -> None:
    with pytest.raises(DomainError, match=r"train_speed_kmh is 130.0 km/h; expected .*\[0, 100\]"):
        situation(train_speed_kmh=130.0)
    with pytest.raises(DomainError, match="humidity_percent is nan"):
        situation(humidity_percent=float("nan"))
    with pytest.raises(DomainError, match=r"expected eight"):
        Situation.of([1.0, 2.0])
    wrong = SELF.copy()
    wrong[3, 5] = 2000.0
    with pytest.raises(DomainError, match="car_distance_m of situation 3"):
        as_points(wrong)
    with pytest.raises(DomainError, match="without a track"):
        Crossing(tracks=0)


def test_scaling_maps_the_ranges_onto_the_unit_cube() -> None:
    np.testing.assert_allclose(scaled(np.array([LOW, HIGH])), [[0.0] * 8, [1.0] * 8])


@given(st.floats(-89.0, 89.0), st.floats(-179.0, 179.0), st.floats(-3e3, 3e3), st.floats(-3e3, 3e3))
def test_haversine_is_symmetric_and_near_the_geodesic(
    lat: float, lon: float, east: float, north: float
) -> None:
    here = Position(lat, lon)
    try:
        there = offset(here, east, north)
    except DomainError:
        return  # over the pole or the date line
    sphere, ellipsoid = haversine_m(here, there), geodesic_m(here, there)
    assert sphere == pytest.approx(haversine_m(there, here), abs=1e-6)
    assert sphere == pytest.approx(ellipsoid, rel=0.007, abs=1e-3)


def test_quarter_meridian_golden() -> None:
    # WGS 84: the quarter meridian is 10 001 965.729 m
    assert geodesic_m(Position(0.0, 0.0), Position(90.0, 0.0)) == pytest.approx(10_001_965.729)


def test_positions_off_earth_are_refused() -> None:
    with pytest.raises(DomainError, match=r"latitude_deg is 91.0 °.*latitude comes first"):
        Position(91.0, 0.0)
    with pytest.raises(DomainError, match="longitude_deg is -180"):
        Position(0.0, -180.5)


@pytest.mark.parametrize(
    ("changes", "kept", "reason"),
    [
        ({}, False, "same time"),
        ({"car_distance_m": 60.0}, True, "clear 38.7 s before"),
        ({"car_distance_m": 110.0}, False, "only 34.2 s before"),
        ({"train_distance_m": 200.0}, True, "after the train has left"),
        ({"train_speed_kmh": 0.0}, True, "stands before"),
        ({"car_speed_kmh": 0.0, "car_distance_m": -2.0}, False, "stands on the crossing"),
        ({"car_distance_m": -10.0}, True, "car has passed"),
    ],
)
def test_rule_of_35_seconds(changes: dict[str, float], kept: bool, reason: str) -> None:
    verdict = clearance(situation(**changes))
    assert (verdict.kept, reason in verdict.reason) == (kept, True), verdict


def test_a_second_track_takes_longer_to_cross() -> None:
    now = situation(car_distance_m=60.0)
    one, two = clearance(now), clearance(now, Crossing(tracks=2))
    assert two.car_clears_s - one.car_clears_s == pytest.approx(4.1 / (40.0 / 3.6))
    train, car = Approach(1000.0, 80 / 3.6), Approach(500.0, 38 / 3.6)
    risk = [collision_probability(train, car, Crossing(tracks=count)) for count in (1, 2, 3)]
    assert risk[0] < risk[1] < risk[2]


def test_a_train_the_gradient_pulls_away_cannot_stop() -> None:
    check = can_stop(situation(rail_slope_percent=-20.0))
    assert not check.possible
    assert check.stopping_m == float("inf")


@settings(max_examples=25, deadline=None)
@given(st.floats(20.0, 99.0), st.floats(0.5, 1.0))
def test_stopping_takes_longer_the_faster_and_the_wetter(speed: float, more: float) -> None:
    slow, fast = (can_stop(situation(train_speed_kmh=v)).stopping_m for v in (speed, speed + more))
    wet = can_stop(situation(train_speed_kmh=speed, humidity_percent=100.0)).stopping_m
    assert slow < fast
    assert wet >= slow
    assert slow > 7.0 * 1.1 * speed / 3.6  # the valve's seven seconds at the largest speed


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 150), st.floats(0.0, 0.3))
def test_index_finds_what_brute_force_finds(seed: int, count: int, grown: float) -> None:
    rng = np.random.default_rng(seed)
    made = DetectorSet(
        rng.uniform(-0.2, 1.2, (count, 8)), rng.uniform(0.01, 0.9, count), 0.1, "random", seed
    )
    points = rng.random((200, 8))
    apart = distances(points, made.centres)
    reach = made.radii + grown
    found = made.match(points, sample_radius=grown)
    np.testing.assert_array_equal(found >= 0, (apart < reach).any(axis=1))
    hit = found >= 0
    assert (apart[hit, found[hit]] < reach[found[hit]]).all()


def test_published_antigens_are_alarmed_and_safe_situations_are_not(
    detectors: DetectorSet,
) -> None:
    assert (detectors.judge(ANTIGENS[:ALARMED]) >= 0).all()
    assert (detectors.judge(SELF) < 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_no_detector_reaches_a_safe_ball(seed: int) -> None:
    fast = negative.Settings(generations=3)
    for made, safe in (
        (vdetector.train(SELF, seed, vdetector.Settings(coverage=0.9)), scaled(SELF)),
        (negative.train(SELF, seed, fast), SELF - LOW),
    ):
        gap = distances(safe, made.centres) - made.radii
        assert gap.min() >= made.self_radius - 1e-9


def test_same_seed_same_detectors() -> None:
    fast = negative.Settings(generations=2)
    one, two, other = (negative.train(SELF, seed, fast) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.centres, two.centres)
    assert one.centres.shape != other.centres.shape or (one.centres != other.centres).any()


def test_overlap_measure_golden() -> None:
    # two equal spheres one radius apart: δ = (1 + 1 − 1)/2 = 0.5, w = (e^0.5 − 1)^8
    apart = np.array([[0.0, 1.0], [1.0, 0.0]])
    expected = (np.exp(0.5) - 1.0) ** 8
    np.testing.assert_allclose(
        negative.overlap_measure(apart, np.ones(2)), [[0.0, expected], [expected, 0.0]]
    )


def test_moves_are_of_the_given_length_and_away() -> None:
    centres, origins = np.zeros((2, 8)), np.zeros((2, 8))
    origins[0, 2] = 1.0
    moved = negative.away(centres, origins, 0.25)
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 0.25)
    assert moved[0, 2] == -0.25


def test_training_without_room_or_safe_situations_is_refused() -> None:
    with pytest.raises(DomainError, match="at least one safe situation"):
        vdetector.train(np.empty((0, 8)), 1)
    with pytest.raises(DomainError, match="room for a detector"):
        vdetector.train(SELF, 1, vdetector.Settings(self_radius=5.0))
    with pytest.raises(DomainError, match=r"clones \+ fresh"):
        negative.Settings(detectors=3, clones=3, fresh=1)


def test_coverage_interval_holds_the_truth(detectors: DetectorSet) -> None:
    small = estimate(detectors, SELF, seed=1, samples=2000)
    large = estimate(detectors, SELF, seed=2, samples=50_000)
    assert small.low <= large.share <= small.high
    assert interval(0, 10)[0] == 0.0
    assert interval(10, 10)[1] == 1.0


def test_memory_returns_what_it_was_given(tmp_path: Path, detectors: DetectorSet) -> None:
    memory = Memory(tmp_path / "immune.db")
    memory.save(vdetector.train(SELF, 1, vdetector.Settings(detectors=3)))
    memory.save(detectors)
    again = memory.load()
    points = random_situations(500, np.random.default_rng(0))
    np.testing.assert_array_equal(again.judge(points), detectors.judge(points))
    assert (again.seed, again.method, again.units) == (7, "V-detectors", "scaled")
    memory.remember(ANTIGENS[:2], [4, 5], ["stop train", "change speeds"])
    caught, numbers, reactions = memory.caught()
    np.testing.assert_array_equal(caught, ANTIGENS[:2])
    assert (numbers, reactions) == ((4, 5), ("stop train", "change speeds"))


def test_memory_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="train one first"):
        Memory(tmp_path / "missing.db").load()
    text = tmp_path / "text.db"
    text.write_text("this is not a database, it is a longer piece of plain text " * 5)
    with pytest.raises(FileError, match="as immune memory"):
        Memory(text).load()
