"""One obstacle is one event: through approach, drop-outs, fragments and changes of type."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from railinspect.boxes import boxes_touch, iou
from railinspect.errors import BadInputError
from railinspect.events import EventSettings, EventTracker, Sighting

RATE_HZ = 12.5
VANISHING = (320.0, 150.0)


def seen(
    range_m: float,
    type_: str = "obstruction",
    lateral_m: float = 0.0,
    confidence: float = 0.8,
    size_m: tuple[float, float] = (0.8, 1.0),
    std_share: float = 0.04,
    ranged: bool = True,
) -> Sighting:
    """What a camera 2.6 m above a straight track (focal length 686 px) sees at a range."""
    focal, (u, v) = 686.0, VANISHING
    x0 = u + focal * (-lateral_m - size_m[0] / 2) / range_m
    x1 = u + focal * (-lateral_m + size_m[0] / 2) / range_m
    y1 = v + focal * 2.6 / range_m
    box = (x0, y1 - focal * size_m[1] / range_m, x1, y1)
    if not ranged:
        return Sighting(type_, confidence, box)
    std_m = std_share * range_m
    bounds = (range_m - 2 * std_m, range_m + 2 * std_m)
    return Sighting(type_, confidence, box, range_m, std_m, bounds)


class Ride:
    """Feeds a tracker frame by frame at 20 m/s."""

    def __init__(self, speed_known: bool = True, settings: EventSettings | None = None) -> None:
        self.tracker = EventTracker(settings)
        self.speed_mps = 20.0 if speed_known else None
        self.frame = 0
        self.ended = []

    def chainage_m(self) -> float:
        return 20.0 * self.frame / RATE_HZ

    def show(self, *sightings: Sighting):
        update = self.tracker.update(
            self.frame, self.frame / RATE_HZ, sightings, self.speed_mps, VANISHING
        )
        self.ended += update.ended
        self.frame += 1
        return update

    def events(self):
        return [*self.ended, *self.tracker.finish()]


@pytest.mark.parametrize("speed_known", [True, False])
def test_an_approach_is_one_event_with_its_first_and_closest_range(speed_known):
    ride = Ride(speed_known)
    while (range_m := 100.0 - ride.chainage_m()) > 8:
        ride.show(seen(range_m))
    (event,) = ride.events()
    assert event.id == 1
    assert event.type == "obstruction"
    assert event.first_range_m == pytest.approx(100.0)
    assert event.first_range_interval_m == pytest.approx((92.0, 108.0))
    assert event.closest_range_m == pytest.approx(8.8, abs=1.0)
    assert event.first_time_s == 0.0
    assert event.closest_time_s == event.last_time_s


def test_confirmation_takes_the_stated_frames():
    ride = Ride(settings=EventSettings(confirm_hits=3, confirm_window=5))
    pattern = [True, False, True, False, True]
    ids = [ride.show(*([seen(80 - 1.6 * i)] if hit else [])).ids for i, hit in enumerate(pattern)]
    assert ids == [(None,), (), (None,), (), (1,)]
    (event,) = ride.events()
    assert event.first_time_s == 0.0
    assert event.confirmed_time_s == pytest.approx(4 / RATE_HZ)
    assert event.frames_seen == 3


def test_a_flicker_never_becomes_an_event():
    ride = Ride()
    for index in range(60):
        ride.show(*([seen(60.0)] if index % 4 == 0 else []))
    assert ride.events() == []


@pytest.mark.parametrize("speed_known", [True, False])
def test_a_gap_does_not_split_an_event(speed_known):
    ride = Ride(speed_known)
    while (range_m := 110.0 - ride.chainage_m()) > 8:
        hidden = 40 < range_m < 70  # 1.5 s at 20 m/s
        ride.show(*([] if hidden else [seen(range_m)]))
    assert len(ride.events()) == 1


def test_two_obstacles_one_after_the_other_are_two_events():
    ride = Ride()
    while ride.chainage_m() < 170:
        ranges = [at - ride.chainage_m() for at in (100.0, 180.0)]
        ride.show(*(seen(r) for r in ranges if 8 < r < 90))
    assert [e.id for e in ride.events()] == [1, 2]


@pytest.mark.parametrize("speed_known", [True, False])
def test_an_obstacle_appearing_as_another_is_passed_is_a_new_event(speed_known):
    ride = Ride(speed_known)
    while ride.chainage_m() < 150:
        near, far = 60.0 - ride.chainage_m(), 160.0 - ride.chainage_m()
        ride.show(*([seen(near)] if near > 8 else [seen(far)] if far > 8 else []))
    assert len(ride.events()) == 2


def test_distortion_and_obstruction_at_one_place_are_one_event_of_the_cause():
    ride = Ride()
    while (range_m := 70.0 - ride.chainage_m()) > 10:
        bent = seen(range_m + 1.5, "distortion", confidence=0.9, size_m=(1.6, 0.4))
        ride.show(seen(range_m, "obstruction", confidence=0.7), bent)
    (event,) = ride.events()
    assert event.type == "obstruction"
    assert event.type_shares["distortion"] > 0.2
    assert event.frames_seen == 38  # a frame with two findings counts once


def test_distortion_that_is_first_alone_takes_the_type_of_what_it_turns_out_to_be():
    ride = Ride()
    while (range_m := 90.0 - ride.chainage_m()) > 10:
        type_ = "distortion" if range_m > 70 else "obstruction"
        ride.show(seen(range_m, type_))
    (event,) = ride.events()
    assert event.type == "obstruction"
    assert event.first_range_m == pytest.approx(90.0)


def test_different_types_that_do_not_touch_are_two_events():
    ride = Ride()
    while (range_m := 40.0 - ride.chainage_m()) > 10:
        person = seen(range_m, "trespasser", lateral_m=1.4, size_m=(0.5, 1.8))
        crate = seen(range_m, "obstruction", lateral_m=-1.0, size_m=(0.8, 0.8))
        ride.show(person, crate)
    assert sorted(e.type for e in ride.events()) == ["obstruction", "trespasser"]


def test_two_people_side_by_side_are_one_place_to_brake_for():
    ride = Ride()
    while (range_m := 60.0 - ride.chainage_m()) > 10:
        ride.show(*(seen(range_m, "trespasser", lateral_m=y, size_m=(0.4, 1.8)) for y in (-1, 1)))
    assert len(ride.events()) == 1


def test_two_people_far_apart_along_the_track_are_two_events():
    ride = Ride()
    while (range_m := 50.0 - ride.chainage_m()) > 9:
        ride.show(
            seen(range_m, "trespasser", size_m=(0.4, 1.8)),
            seen(range_m + 40, "trespasser", lateral_m=0.9, size_m=(0.4, 1.8)),
        )
    assert len(ride.events()) == 2


def test_a_fragment_with_a_wrong_range_joins_its_whole():
    ride = Ride()
    while (range_m := 60.0 - ride.chainage_m()) > 10:
        body = seen(range_m, "trespasser", size_m=(0.5, 1.8))
        x0, y0, _, y1 = body.box_xyxy
        arm = (x0 - 0.4 * (y1 - y0) / 1.8, y0, x0, y0 + 0.55 * (y1 - y0))
        ride.show(body, Sighting("trespasser", 0.6, arm, 1.6 * range_m, 3.0, (1.5, 2.0)))
    (event,) = ride.events()
    assert event.closest_range_m == pytest.approx(10.4, abs=1.0)


@pytest.mark.parametrize("speed_known", [True, False])
def test_a_distortion_whose_worst_part_moves_along_it_is_one_event(speed_known):
    ride = Ride(speed_known)
    index = 0
    while (range_m := 45.0 - ride.chainage_m()) > 6:
        shown = range_m + (0.0, 7.0, 3.0, 9.0)[index // 3 % 4]
        hidden = 18 < index < 26
        ride.show(*([] if hidden else [seen(shown, "distortion", size_m=(1.6, 0.3))]))
        index += 1
    assert len(ride.events()) == 1


def test_two_distortions_far_apart_are_two_events():
    ride = Ride()
    while ride.chainage_m() < 85:
        ranges = [at - ride.chainage_m() for at in (50.0, 90.0)]
        ride.show(*(seen(r, "distortion", size_m=(1.6, 0.3)) for r in ranges if 8 < r < 55))
    assert len(ride.events()) == 2


def test_without_any_range_boxes_alone_hold_an_event_together():
    ride = Ride(speed_known=False)
    for index in range(40):
        ride.show(seen(150.0 - 1.6 * index, ranged=False))
    (event,) = ride.events()
    assert event.first_range_m is None
    assert event.closest_range_interval_m is None


def test_an_event_ends_after_the_stated_time_and_memory_is_freed():
    ride = Ride(settings=EventSettings(lose_after_s=1.0))
    for _ in range(6):
        ride.show(seen(50.0 - ride.chainage_m()))
    while not ride.ended:
        ride.show()
    assert ride.frame / RATE_HZ == pytest.approx(5 / RATE_HZ + 1.0 + 2 / RATE_HZ, abs=0.1)
    assert ride.tracker.live() == ()
    assert ride.tracker._candidates == []


def test_a_still_is_confirmed_at_once():
    tracker = EventTracker(EventSettings.still())
    assert tracker.update(0, 0.0, (seen(40.0),)).ids == (1,)


def test_the_most_severe_advice_and_the_best_picture_are_kept():
    ride = Ride()
    for index in range(20):
        ride.show(seen(60.0 - ride.chainage_m()))
        if ride.tracker.wants_thumbnail(1, index):
            ride.tracker.set_thumbnail(1, b"%d" % index)
        action, rank = ("warn", 1) if index < 10 else ("service", 2)
        ride.tracker.note_advice(1, action, rank, "x", 2.0)
        ride.tracker.note_advice(1, "none", 0, "y", 3.0)
    (event,) = ride.events()
    assert (event.advice, event.advice_reason) == ("service", "x")
    assert event.thumbnail_jpeg is not None
    assert int(event.thumbnail_jpeg) == event.best_frame > 12


def test_the_type_is_judged_where_the_thing_is_seen_large():
    ride = Ride()
    while (range_m := 100.0 - ride.chainage_m()) > 8:
        ride.show(seen(range_m, "trespasser" if range_m > 40 else "obstruction"))
    (event,) = ride.events()
    assert event.type == "obstruction"  # although it was taken for a person nearly twice as often


def test_a_foot_that_comes_out_of_the_haze_makes_no_second_event():
    ride = Ride()
    while (range_m := 70.0 - ride.chainage_m()) > 8:
        whole = seen(range_m, "trespasser", size_m=(0.5, 1.8), std_share=0.01)
        left, top, right, bottom = whole.box_xyxy
        far_m = range_m * 2.6 / 1.9  # only down to the knees: where that row would be on the ground
        upper = replace(
            whole, box_xyxy=(left, top, right, bottom - 0.4 * (bottom - top)), range_m=far_m
        )
        ride.show(upper if range_m > 30 else whole)
    assert [event.type for event in ride.events()] == ["trespasser"]


def test_ids_go_on_from_where_they_are_told():
    tracker = EventTracker(EventSettings.still(), first_id=7)
    assert tracker.update(0, 0.0, (seen(40.0), seen(90.0, "trespasser"))).ids == (7, 8)
    assert tracker.next_id == 9


def test_settings_that_cannot_be_met_are_refused():
    with pytest.raises(BadInputError, match="cannot be met"):
        EventSettings(confirm_hits=7, confirm_window=6)


box = st.tuples(*[st.floats(0, 600, width=32)] * 2, *[st.floats(1, 100, width=32)] * 2).map(
    lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
)


@given(box, box)
def test_overlap_is_symmetric_and_bounded(first, second):
    assert 0 <= iou(first, second) <= 1 + 1e-6
    assert iou(first, second) == pytest.approx(iou(second, first))
    assert boxes_touch(first, second) == boxes_touch(second, first)
    assert iou(first, first) == pytest.approx(1)


def at(values: dict[int, float], rest: float = 0.0) -> list[float]:
    """Forty-five values: those given by index, all others ``rest``."""
    return [values.get(i, rest) for i in range(45)]


@given(
    st.lists(st.floats(-0.1, 0.1), min_size=45, max_size=45),
    st.lists(st.booleans(), min_size=45, max_size=45),
)
@example(  # one bad range led the prediction astray
    at({25: -0.09765625, 27: 0.078125, 28: 0.03125}), [i == 26 for i in range(45)]
)
@example(  # errors that last for frames and then turn are no independent draws
    at({i: 0.1 if i // 5 % 2 else -0.1 for i in range(45)}), [i > 30 for i in range(45)]
)
def test_noise_and_drop_outs_never_make_two_of_one(noise, dropped):
    """Whatever ±10 % range noise and single drop-outs do, one obstacle is never two events."""
    ride = Ride()
    for index in range(45):
        range_m = 90.0 - ride.chainage_m()
        hidden = dropped[index] and index % 2 == 0
        ride.show(*([] if hidden else [seen(range_m * (1 + noise[index]))]))
    assert len(ride.events()) <= 1


@given(st.data())
def test_the_order_of_findings_within_a_frame_does_not_matter(data):
    first, second = Ride(), Ride()
    for _ in range(12):
        sightings = [
            seen(70.0 - first.chainage_m()),
            seen(110.0 - first.chainage_m(), "trespasser", lateral_m=2.0),
            seen(40.0 - first.chainage_m(), "distortion", lateral_m=-1.0),
        ]
        first.show(*sightings)
        second.show(*data.draw(st.permutations(sightings)))
    summary = [
        sorted((e.type, e.first_range_m, e.frames_seen) for e in r.events())
        for r in (first, second)
    ]
    assert summary[0] == summary[1]


# Doubt


def steady(ride: Ride, frames: int, range_m: float = 10.0, type_: str = "obstruction", **rest):
    """Something that keeps its distance, a little unsteadily."""
    for index in range(frames):
        update = ride.show(seen(range_m + 0.1 * (-1) ** index, type_, **rest))
    return update


def test_what_keeps_its_distance_at_speed_is_doubtful_but_never_dropped():
    ride = Ride()
    (event,) = steady(ride, 40).live
    assert event.id == 1
    assert event.doubt is not None
    assert "keeps its distance of 10 m" in event.doubt
    assert [e.doubt for e in ride.events()] == [event.doubt]


@pytest.mark.parametrize(
    ("speed_mps", "confirmed_at"),
    [(20.0, 25), (None, 25), (5.0, 3)],
)
def test_what_keeps_its_distance_waits_to_become_an_event(speed_mps, confirmed_at):
    """A blemish of the picture for a second is none; what stays for two is, and somebody may run
    ahead of a train that crawls."""
    tracker = EventTracker()
    confirmed = None
    for frame in range(40):
        sighting = replace(seen(10.0 + 0.05 * (-1) ** frame), range_noise_m=0.1)
        update = tracker.update(frame, frame / RATE_HZ, (sighting,), speed_mps, VANISHING)
        if confirmed is None and update.live:
            confirmed = frame
    assert confirmed == confirmed_at


@pytest.mark.parametrize("speed_mps", [0.0, 20.0])
def test_a_scale_that_is_wrong_for_all_ranges_does_not_hide_whether_a_thing_comes_nearer(speed_mps):
    """A guessed camera's ranges are wrong by a quarter, all alike."""
    tracker = EventTracker()
    for frame in range(14):
        range_m = (60.0 - speed_mps * frame / RATE_HZ) * 0.75
        sighting = replace(seen(range_m, std_share=0.25), range_noise_m=0.01 * range_m)
        update = tracker.update(frame, frame / RATE_HZ, (sighting,), 20.0, VANISHING)
    (event,) = update.live
    assert (event.doubt is None) == (speed_mps > 0)


def test_doubt_ends_as_soon_as_it_comes_nearer():
    ride = Ride()
    assert steady(ride, 30, 60.0, std_share=0.01).live[0].doubt
    start = ride.chainage_m()
    while (range_m := 60.0 - (ride.chainage_m() - start)) > 20:
        update = ride.show(seen(range_m, std_share=0.01))
    assert update.live[0].doubt is None


@pytest.mark.parametrize(
    ("speed_mps", "seen_mps", "doubtful"),
    [(20.0, None, True), (None, 20.0, True), (None, None, False), (5.0, None, False)],
)
def test_doubt_needs_a_speed_at_which_nobody_runs(speed_mps, seen_mps, doubtful):
    tracker = EventTracker()
    for frame in range(40):
        update = tracker.update(
            frame, frame / RATE_HZ, (seen(10.0),), speed_mps, VANISHING, seen_mps
        )
    assert bool(update.live[0].doubt) == doubtful


def test_a_long_distortion_and_what_the_picture_cuts_off_are_not_doubted():
    ride = Ride()
    assert steady(ride, 30, type_="distortion").live[0].doubt is None
    cut = EventTracker()
    box = (250.0, 200.0, 390.0, 359.0)
    for frame in range(30):
        sighting = Sighting("obstruction", 0.9, box, 5.0, 0.2, (4.6, 5.4), whole=False)
        update = cut.update(frame, frame / RATE_HZ, (sighting,), 20.0, VANISHING)
    assert update.live[0].doubt is None


@given(
    st.lists(st.floats(-0.1, 0.1), min_size=45, max_size=45),
    st.lists(st.booleans(), min_size=45, max_size=45),
)
@example(  # a slope of errors as steep as they get
    at({i: 0.1 - 0.2 * max(0, 20 - i) / 20 for i in range(45)}), [False] * 45
)
def test_what_stands_on_the_track_is_never_doubted(noise, dropped):
    ride = Ride()
    for index in range(45):
        range_m = 90.0 - ride.chainage_m()
        hidden = dropped[index] and index % 2 == 0
        update = ride.show(*([] if hidden else [seen(range_m * (1 + noise[index]))]))
        assert [e for e in update.live if e.doubt] == []
