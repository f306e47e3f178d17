"""Close-ups hold what the masks show, drop it, or show what the masks do not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from railinspect.close_ups import ANSWERS, FARTHEST_M, STEP, CloseUps, LookAtTrack, places
from railinspect.evaluation.answers import inspect_still
from railinspect.evaluation.drawn_tracks import Masks, Thing, camera, draw
from railinspect.findings import Finding, find, place_on_track
from railinspect.findings.second_look import WATCH_EVERY
from railinspect.labels import CONSTRUCTION, HUMAN
from railinspect.ranging import FrameRanging, Range
from railinspect.segmenter import Segmentation
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower
from railinspect.track.geometry import TrackGeometry

CAMERA = camera()
STILL, RECORDING = Thresholds().still(), Thresholds()
PERSON = Thing(HUMAN, 25.0, 0.0, 0.6, 1.75)
CLEAR_TRACK = draw(CAMERA)
WITH_PERSON = draw(CAMERA, things=[PERSON])


def saying(answer: str, chance: float, from_m: float, to_m: float) -> Sayer:
    return Sayer(ANSWERS.index(answer), chance, from_m, to_m)


class Sayer:
    """Close-ups that are so sure of an answer from … to, and of a clear track elsewhere."""

    def __init__(self, answer: int, chance: float, from_m: float, to_m: float) -> None:
        self.answer, self.chance, self.from_m, self.to_m = answer, chance, from_m, to_m

    def __call__(
        self,
        track: TrackGeometry,
        from_m: float = 0.0,
        to_m: float = FARTHEST_M,
        every: int = 1,
    ) -> CloseUps:
        at = places(track, from_m, to_m, every)
        chances = np.zeros((len(at), len(ANSWERS)))
        there = (at >= self.from_m) & (at <= self.to_m)
        chances[:, self.answer] = np.where(there, self.chance, 0.0)
        chances[:, 0] += 1.0 - chances.sum(axis=1)
        return CloseUps(at, chances)


def seen(
    masks: Masks, sayer: LookAtTrack | None, confidence: int = 230, limits: Thresholds = STILL
) -> tuple[Finding, ...]:
    sure = np.full_like(masks.labels, confidence)
    segmentation = Segmentation(masks.labels, sure, masks.rail_score, close_ups=sayer)
    track = TrackFollower(CAMERA).update(segmentation)
    return find(segmentation, track, limits)


def test_what_both_see_stays_as_the_masks_show_it() -> None:
    (alone,) = seen(WITH_PERSON, None)
    (both,) = seen(WITH_PERSON, saying("trespasser", 0.9, 22.0, 28.0))
    assert both.type == "trespasser"
    assert both.doubt is None
    assert both.evidence == alone.evidence
    assert both.box_xyxy == alone.box_xyxy


def test_another_type_is_support_too_and_names_what_a_single_picture_shows() -> None:
    (both,) = seen(WITH_PERSON, saying("obstruction", 0.9, 22.0, 28.0))
    assert both.type == "obstruction"
    assert both.doubt is None
    assert both.evidence.endswith("; close-ups show an obstruction")
    (alone,) = seen(WITH_PERSON, None)
    assert (both.box_xyxy, both.confidence) == (alone.box_xyxy, alone.confidence)
    # A recording's events are named by many frames' masks.
    (framed,) = seen(WITH_PERSON, saying("obstruction", 0.9, 22.0, 28.0), limits=Thresholds())
    assert framed.type == "trespasser"


def test_a_name_takes_more_than_a_small_majority() -> None:
    class Divided(Sayer):
        def __call__(self, *args: object, **kwargs: object) -> CloseUps:
            told = super().__call__(*args, **kwargs)
            told.chances[:, 3] = self.share / (1 - self.share) * told.chances[:, 2]
            return CloseUps(told.chainage_m, told.chances)

        share = 0.0

    divided = Divided(ANSWERS.index("obstruction"), 0.5, 22.0, 28.0)
    divided.share = 1.1 - STILL.seen_named
    assert [f.type for f in seen(WITH_PERSON, divided)] == ["trespasser"]
    divided.share = 0.9 - STILL.seen_named
    assert [f.type for f in seen(WITH_PERSON, divided)] == ["obstruction"]


def test_the_part_of_a_person_that_the_masks_take_for_a_thing_is_none_of_its_own() -> None:
    part = Thing(CONSTRUCTION, 24.7, 0.25, 0.5, 0.9)
    masks = draw(CAMERA, things=[PERSON, part])
    assert {f.type for f in seen(masks, None)} == {"obstruction", "trespasser"}
    (person,) = seen(masks, saying("trespasser", 0.99, 20.0, 30.0))
    assert person.type == "trespasser"
    assert "close-ups" not in person.evidence
    apart = replace(part, lateral_m=-1.2)
    both = seen(draw(CAMERA, things=[PERSON, apart]), saying("trespasser", 0.99, 20.0, 30.0))
    assert [f.type for f in both] == ["trespasser", "trespasser"]


def test_a_thing_behind_a_person_keeps_apart_from_it_whatever_it_is_called() -> None:
    near, far = saying("trespasser", 0.99, 20.0, 30.0), saying("distortion", 0.99, 38.0, 60.0)

    def both(track: TrackGeometry, *way: float) -> CloseUps:
        one, two = near(track, *way), far(track, *way)
        at_far = (one.chainage_m >= 34.0)[:, None]
        return CloseUps(one.chainage_m, np.where(at_far, two.chances, one.chances))

    masks = draw(CAMERA, things=[PERSON, Thing(CONSTRUCTION, 45.0, 0.5, 1.6, 1.5)])
    assert [f.type for f in seen(masks, None)] == ["trespasser", "obstruction"]
    assert [f.type for f in seen(masks, both)] == ["trespasser", "distortion"]


def test_what_is_doubtful_keeps_its_name() -> None:
    between = 0.5 * (STILL.seen_perhaps + STILL.seen_again)
    (finding,) = seen(WITH_PERSON, saying("obstruction", between, 22.0, 28.0))
    assert finding.doubt is not None
    assert finding.type == "trespasser"


def test_what_nobody_looked_at_keeps_its_name() -> None:
    leaving = draw(CAMERA, things=[Thing(HUMAN, 4.5, 0.0, 0.6, 1.75)])
    for answer in ("clear", "obstruction", "distortion"):
        assert [f.type for f in seen(leaving, saying(answer, 0.99, 0.0, 8.0))] == ["trespasser"]


def test_what_close_ups_clearly_do_not_show_is_dropped() -> None:
    assert seen(WITH_PERSON, saying("trespasser", 0.5 * STILL.seen_perhaps, 22.0, 28.0)) == ()
    # nor does what they show somewhere else hold it
    found = seen(WITH_PERSON, saying("distortion", 0.9 * STILL.seen_bent, 40.0, 60.0))
    assert found == ()


def test_what_they_hardly_show_is_doubtful_and_the_picture_unknown() -> None:
    between = 0.5 * (STILL.seen_perhaps + STILL.seen_again)
    sayer = saying("trespasser", between, 22.0, 28.0)
    (found,) = seen(WITH_PERSON, sayer)
    assert found.doubt is not None
    masks = WITH_PERSON
    sure = np.full_like(masks.labels, 230)
    still = Segmentation(masks.labels, sure, masks.rail_score, close_ups=sayer)
    answer = inspect_still(still, CAMERA)
    assert answer.said == "unknown"
    assert "close-ups" in answer.reason


def test_where_nobody_looked_the_masks_have_the_say() -> None:
    def nowhere(track: TrackGeometry) -> CloseUps:
        return CloseUps(np.array([5.0]), np.eye(4)[:1])

    found = seen(WITH_PERSON, nowhere)
    assert [f.type for f in found] == ["trespasser"]


def test_a_weak_sight_counts_where_close_ups_see_it_too() -> None:
    weak = 80  # of 255: too little by itself
    assert seen(WITH_PERSON, None, weak) == ()
    (found,) = seen(WITH_PERSON, saying("trespasser", 0.85, 22.0, 28.0), weak)
    assert found.type == "trespasser"
    assert found.confidence == pytest.approx(0.85)
    assert abs(found.foot_uv[1] - seen(WITH_PERSON, None)[0].foot_uv[1]) < 1  # the masks' own place


@pytest.mark.parametrize("answer", ANSWERS[1:])
@pytest.mark.parametrize("range_m", [12.0, 30.0])
def test_close_ups_alone_find_what_they_clearly_show(answer: str, range_m: float) -> None:
    (found,) = seen(CLEAR_TRACK, saying(answer, 0.97, 0.9 * range_m, 1.12 * range_m))
    assert found.type == answer
    assert found.doubt is None
    assert found.place_rel > 0
    assert "close-ups" in found.evidence
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    measured = FrameRanging(track).measure(found)
    assert isinstance(measured, Range)
    assert measured.range_m == pytest.approx(range_m, rel=0.1)
    assert measured.std_m >= found.place_rel * measured.range_m
    low, high = measured.interval_m
    assert low < range_m < high


def test_one_place_alone_is_not_enough() -> None:
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    at = float(places(track)[10])
    sayer = saying("obstruction", 0.99, at - 0.01, at + 0.01)
    assert sayer(track).chances[:, 2].max() == pytest.approx(0.99)
    assert seen(CLEAR_TRACK, sayer) == ()


def test_no_second_finding_is_made_of_what_the_masks_show_already() -> None:
    found = seen(WITH_PERSON, saying("trespasser", 0.99, 15.0, 35.0))
    assert [f.type for f in found] == ["trespasser"]
    assert "masks do not" not in found[0].evidence


@given(range_m=st.floats(9.0, 60.0), chance=st.floats(0.0, 1.0))
def test_a_box_never_leaves_the_picture(range_m: float, chance: float) -> None:
    for answer in ANSWERS[1:]:
        for found in seen(CLEAR_TRACK, saying(answer, chance, 0.9 * range_m, 1.12 * range_m)):
            left, top, right, bottom = found.box_xyxy
            assert 0 <= left < right <= 639
            assert 0 <= top < bottom <= 359
            bent = found.type == "distortion"
            assert found.confidence >= (STILL.seen_bent if bent else STILL.seen_alone) - 1e-9


def test_weaker_thresholds_are_weaker() -> None:
    limits, weaker = STILL, STILL.weaker()
    for name in ("least_confidence", "person_confidence", "least_doubt", "bend_px", "bend_noise"):
        assert getattr(weaker, name) < getattr(limits, name)
    assert replace(weaker, bend_px=limits.bend_px).bend_m == limits.bend_m


class Counting(Sayer):
    """Close-ups that note how many were taken each time."""

    def __call__(self, *what: Any) -> CloseUps:
        told = super().__call__(*what)
        self.counts.append(len(told.chainage_m))
        return told


def counting(answer: str, chance: float, from_m: float, to_m: float) -> Counting:
    sayer = Counting(ANSWERS.index(answer), chance, from_m, to_m)
    sayer.counts = []
    return sayer


def test_a_recording_watches_few_places_and_looks_around_what_they_show() -> None:
    clear = counting("trespasser", 0.0, 0.0, 0.0)
    assert seen(CLEAR_TRACK, clear, limits=RECORDING) == ()
    (watched,) = clear.counts
    assert 2 <= watched <= 3
    for person_m in (20.0, 27.0, 35.0, 44.0, 52.0):
        # what stands somewhere is seen at most places less than a fifth nearer or farther
        shown = counting("trespasser", 0.99, person_m / 1.25, person_m * 1.25)
        (found,) = seen(CLEAR_TRACK, shown, limits=RECORDING)
        assert (found.type, found.doubt) == ("trespasser", None)
        track = TrackFollower(CAMERA).update(CLEAR_TRACK)
        at = place_on_track(track, found.foot_uv[None])[0][0]
        assert at == pytest.approx(person_m, rel=0.25)
        assert len(shown.counts) == 2
        assert shown.counts[1] <= 7


def test_what_a_recording_s_masks_show_is_looked_at_and_not_found_again() -> None:
    shown = counting("trespasser", 0.95, 20.0, 32.0)
    (found,) = seen(WITH_PERSON, shown, limits=RECORDING)
    assert "masks do not" not in found.evidence
    assert len(shown.counts) == 2  # at the finding, and the watched places
    assert seen(WITH_PERSON, saying("trespasser", 0.01, 22.0, 28.0), limits=RECORDING) == ()
    # what is doubtful is not known yet
    uncertain = seen(WITH_PERSON, saying("trespasser", 0.99, 16.0, 34.0), 150, RECORDING)
    assert sorted(f.doubt is None for f in uncertain) == [False, True]


def test_what_a_recording_s_close_ups_show_has_to_be_sure_and_at_two_places() -> None:
    unsure = 0.5 * (STILL.seen_alone + RECORDING.seen_alone)
    for answer in ("distortion", "obstruction", "trespasser"):
        assert seen(CLEAR_TRACK, saying(answer, unsure, 15.0, 60.0), limits=RECORDING) == ()
        assert len(seen(CLEAR_TRACK, saying(answer, 0.99, 15.0, 60.0), limits=RECORDING)) == 1
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    (middle, *_) = places(track, 25.0, 60.0, WATCH_EVERY)
    one = saying("obstruction", 0.99, middle / 1.02, middle * 1.02)
    assert seen(CLEAR_TRACK, one, limits=RECORDING) == ()


def test_a_track_that_is_not_followed_is_not_watched() -> None:
    shown = saying("obstruction", 0.99, 15.0, 60.0)
    sure = np.full_like(CLEAR_TRACK.labels, 230)
    masks = Segmentation(CLEAR_TRACK.labels, sure, CLEAR_TRACK.rail_score, close_ups=shown)
    track = TrackFollower(CAMERA).update(masks)
    assert len(find(masks, track)) == 1
    assert find(masks, replace(track, followed=False)) == ()


def test_of_a_distortion_the_beginning_counts() -> None:
    weak, strong = saying("distortion", 0.95, 24.0, 45.0), saying("distortion", 0.999, 36.0, 42.0)

    def rising(*what: Any) -> CloseUps:
        one, two = weak(*what), strong(*what)
        surer = two.chances[:, :1] < 0.5
        return CloseUps(one.chainage_m, np.where(surer, two.chances, one.chances))

    (found,) = seen(CLEAR_TRACK, rising)
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    at = place_on_track(track, found.foot_uv[None])[0][0]
    assert 23.5 < at < 24.0 * STEP + 0.5
    assert found.place_rel > 0.1


def test_a_thing_stands_before_the_places_that_show_it() -> None:
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    two = places(track)[10:12]
    (found,) = seen(CLEAR_TRACK, saying("obstruction", 0.99, two[0] - 0.01, two[1] + 0.01))
    at = place_on_track(track, found.foot_uv[None])[0][0]
    assert at == pytest.approx(0.956 * np.sqrt(two[0] * two[1]), rel=0.005)


def test_what_is_about_to_leave_the_picture_is_not_held_against_its_border() -> None:
    track = TrackFollower(CAMERA).update(CLEAR_TRACK)
    assert track.path is not None
    near = draw(CAMERA, things=[replace(PERSON, range_m=1.05 * float(track.path.chainage_m[0]))])
    found = seen(near, saying("trespasser", 0.0, 0.0, 200.0), limits=Thresholds())
    assert [f.type for f in found] == ["trespasser"]


def test_a_distortion_counts_from_less_than_a_thing() -> None:
    chance = 0.5 * (STILL.seen_bent + STILL.seen_alone)
    assert seen(CLEAR_TRACK, saying("obstruction", chance, 20.0, 26.0)) == ()
    (found,) = seen(CLEAR_TRACK, saying("distortion", chance, 20.0, 26.0))
    assert found.confidence == pytest.approx(chance)
    # where it would be less than 1.5 px wide it does not
    assert seen(CLEAR_TRACK, saying("distortion", chance, 65.0, 85.0)) == ()
    assert len(seen(CLEAR_TRACK, saying("distortion", 0.98, 65.0, 85.0))) == 1
