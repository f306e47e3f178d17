"""A frame is not clear while something may stand on the track."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from railinspect.evaluation.answers import inspect_still
from railinspect.events import EventSettings, Sighting
from railinspect.findings import find
from railinspect.inspect_settings import InspectSettings
from railinspect.labels import HUMAN
from railinspect.pipeline import Inspector, inspect_video
from railinspect.suspicion import Suspicions
from railinspect.track import TrackFollower
from railinspect.video import Frame
from railops.braking import Train
from tests.railinspect.painted_ride import CAMERA, SPEED_MPS, paint, read_paint, ride

DOUBTFUL, TOO_LITTLE = 148, 100  # of 255


def sees_people(confidence_at):
    """A segmenter that is less sure of people, by the number of the frame."""
    number = -1

    def segment(rgb):
        nonlocal number
        number += 1
        seen = read_paint(rgb)
        sure = confidence_at(number)
        confidence = np.where(seen.labels == HUMAN, sure or 0, seen.confidence).astype(np.uint8)
        if sure is None:  # it takes people for ground
            seen = replace(seen, labels=np.where(seen.labels == HUMAN, 15, seen.labels))
        return replace(seen, confidence=confidence)

    return segment


def statuses(confidence_at, pictures):
    inspector = Inspector(sees_people(confidence_at), CAMERA, Train(speed_mps=SPEED_MPS))
    records = [inspector(Frame(i, i / 12.5, rgb)) for i, rgb in enumerate(pictures)]
    return records, inspector.finish()


def test_a_doubtful_person_is_no_finding_and_the_frame_is_not_clear():
    records, events = statuses(lambda _: DOUBTFUL, ride([60.0], 30))
    assert events == ()
    assert all(record.findings == () for record in records)
    ahead = records[8:25]  # seen in four frames, and not passed yet
    assert {record.status for record in ahead} == {"unknown"}
    assert all("perhaps trespasser" in record.reason for record in ahead)
    assert all("only 58 % sure" in record.reason for record in ahead)
    assert all(record.advice is not None for record in ahead)


def test_one_doubtful_frame_of_a_video_is_no_suspicion_but_a_still_has_a_finding(tmp_path):
    once = [paint()] * 5 + [paint([20.0])] + [paint()] * 5
    records, _ = statuses(lambda _: DOUBTFUL, once)
    assert {record.status for record in records} == {"clear"}
    path = tmp_path / "still.png"
    cv2.imwrite(str(path), paint([20.0])[..., ::-1])
    for record in (
        next(inspect_video(path, sees_people(lambda _: DOUBTFUL), CAMERA)),
        InspectSettings(CAMERA)
        .inspector(sees_people(lambda _: DOUBTFUL), "image")
        .feed(Frame(0, 0.0, paint([20.0]))),
    ):
        assert record.status == "finding"
        assert [found.finding.type for found in record.findings] == ["trespasser"]


def test_what_the_segmentation_hardly_believes_is_nothing():
    records, _ = statuses(lambda _: TOO_LITTLE, ride([60.0], 20))
    assert {record.status for record in records} == {"clear"}


def test_a_person_lost_before_the_train_is_there_is_unknown_and_passed_is_clear():
    lost_at = 12
    pictures = ride([60.0], 45)  # the train is there at frame 37
    records, events = statuses(lambda n: 230 if n < lost_at else None, pictures)
    assert len(events) == 1
    assert records[lost_at - 1].status == "finding"
    after = records[lost_at : lost_at + 10]
    assert {record.status for record in after} == {"unknown"}
    assert all("event 1 (trespasser), seen 0." in record.reason for record in after)
    passed, _ = statuses(lambda _: 230, pictures)
    assert passed[-1].status == "clear"  # it went out of sight below: that is not lost


def test_doubtful_findings_are_marked_and_a_still_names_them():
    segment = sees_people(lambda _: DOUBTFUL)
    masks = segment(paint([20.0]))
    (found,) = find(masks, TrackFollower(CAMERA).update(masks))
    assert found.doubt == "only 58 % sure"
    assert inspect_still(masks, CAMERA).said == "trespasser"
    too_little = sees_people(lambda _: TOO_LITTLE)(paint([20.0]))
    assert inspect_still(too_little, CAMERA).said == "clear"


def test_a_sure_body_beside_a_doubtful_one_stays_as_it_is():
    seen = read_paint(paint([20.0]))
    (alone,) = find(seen, TrackFollower(CAMERA).update(seen))
    rows, columns = np.nonzero(seen.labels == HUMAN)
    labels, confidence = seen.labels.copy(), seen.confidence.copy()
    beside = columns + (columns.max() - columns.min()) + 4
    labels[rows, beside], confidence[rows, beside] = HUMAN, DOUBTFUL
    both = replace(seen, labels=labels, confidence=confidence)
    found = find(both, TrackFollower(CAMERA).update(both))
    sure = [f for f in found if f.doubt is None]
    assert [f.box_xyxy for f in sure] == [alone.box_xyxy]


@pytest.mark.parametrize("hits", [3, 4])
def test_a_suspicion_has_to_last(hits):
    suspicions = Suspicions(EventSettings(confirm_hits=hits, confirm_window=6))
    seen = Sighting("trespasser", 0.5, (300.0, 200.0, 320.0, 250.0), 30.0, 1.0, (28.0, 32.0))
    said = [suspicions.update(i, 0.04 * i, (seen,), ("a person",), 1.0) for i in range(6)]
    assert said == [None] * (hits - 1) + ["perhaps a person"] * (7 - hits)


def test_what_is_surely_seen_is_no_suspicion():
    suspicions = Suspicions(EventSettings.still())
    seen = Sighting("trespasser", 0.9, (300.0, 200.0, 320.0, 250.0), 30.0, 1.0, (28.0, 32.0))
    far = replace(seen, box_xyxy=(100.0, 150.0, 105.0, 160.0), range_m=90.0)
    assert suspicions.update(0, 0.0, (seen, seen), (None, "its arm"), 1.0) is None
    assert suspicions.update(1, 0.1, (seen, far), (None, "another"), 1.0) == "perhaps another"
