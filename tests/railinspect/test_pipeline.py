"""The frame loop on painted pictures, with the real steps and with single steps replaced."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import railinspect
from railinspect.errors import BadInputError
from railinspect.findings import Finding
from railinspect.pipeline import Inspector, Steps, inspect_video
from railinspect.ranging import Range
from railinspect.speed_log import SpeedLog
from railinspect.thumbnail import cut_out
from railinspect.video import Frame
from railops.braking import Brake, Train
from railops.traction import Adhesion, Davis, Line
from tests.railinspect.painted_ride import CAMERA, SPEED_MPS, paint, read_paint, ride, write_video


def frames(pictures, rate=12.5):
    return [Frame(i, i / rate, rgb) for i, rgb in enumerate(pictures)]


def test_a_person_ahead_becomes_one_event_with_its_range():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS))
    records = [inspector(frame) for frame in frames(ride([80.0], 45))]
    assert {r.status for r in records[:5]} <= {"clear", "finding"}
    near = records[25]  # the person is 80 − 40 = 40 m ahead
    assert near.status == "finding"
    (found,) = near.findings
    assert found.finding.type == "trespasser"
    assert found.event_id == 1
    assert found.range is not None
    assert found.range.range_m == pytest.approx(40.0, rel=0.08)
    assert near.advice is not None
    assert near.advice.action == "emergency"
    (event,) = inspector.finish()
    assert event.type == "trespasser"
    assert event.advice == "emergency"
    assert event.thumbnail_jpeg is not None
    assert event.thumbnail_jpeg[:2] == b"\xff\xd8"


def test_what_keeps_its_distance_at_speed_is_unknown_and_no_obstacle():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS))
    records = [inspector(frame) for frame in frames([paint([12.0])] * 40)]
    last = records[-1]
    assert len(last.findings) == 1
    assert last.status == "unknown"
    assert last.reason is not None
    assert "keeps its distance" in last.reason
    assert last.advice is not None
    assert last.advice.action == "service"  # doubt, not an emergency stop for a reflection
    (event,) = inspector.finish()
    assert event.doubt is not None
    unmoved = Inspector(read_paint, CAMERA)  # the picture shows no motion either
    assert [unmoved(frame).status for frame in frames([paint([12.0])] * 25)][-1] == "finding"


def test_a_clear_track_is_clear_and_needs_no_advice():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS))
    record = inspector.feed(Frame(0, 0.0, paint()))
    assert record.status == "clear"
    assert record.followed
    assert record.findings == ()
    assert record.advice is None
    assert len(record.left_uv) > 10
    assert (np.diff(record.left_uv[:, 1]) > 0).all()  # top to bottom
    assert inspector.finish() == ()


def test_a_track_without_rails_is_unknown_with_a_reason_and_never_clear():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS))
    record = inspector.feed(Frame(0, 0.0, paint(rails=False)))
    assert record.status == "unknown"
    assert not record.followed
    assert record.reason
    assert record.advice is not None
    assert record.advice.action == "service"  # the policy's cautious branch


def test_a_damaged_picture_is_unknown_even_where_rails_are_seen():
    inspector = Inspector(read_paint, CAMERA)
    record = inspector.feed(Frame(0, 0.0, paint(), damaged=True))
    assert record.status == "unknown"
    assert record.reason == "the picture is damaged in the recording"


def test_without_a_train_there_is_no_advice():
    inspector = Inspector(read_paint, CAMERA)
    assert all(inspector.feed(f).advice is None for f in frames(ride([60.0], 12)))


def test_a_finding_beyond_the_reliable_range_has_no_number_and_is_doubt():
    def far(*_):
        box = (300.0, 150.0, 310.0, 170.0)
        foot = np.array([305.0, 170.0])
        return (Finding("obstruction", np.empty((0, 2)), box, 0.9, foot, "painted"),)

    steps = Steps(find=far, range_of=lambda *_: None)
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS), steps=steps)
    record = [inspector.feed(f) for f in frames([paint()] * 6)][-1]
    assert record.findings[0].range is None
    assert record.as_json()["findings"][0]["range_m"] is None
    assert record.advice is not None
    assert record.advice.action in ("service", "emergency")


def test_a_train_that_cannot_stop_gets_the_emergency_advice_not_an_exception():
    downhill = Train(speed_mps=20.0, line=Line(gradients=((0.0, -0.2),)))
    inspector = Inspector(read_paint, CAMERA, downhill)
    record = [inspector.feed(f) for f in frames(ride([60.0], 12))][-1]
    assert record.advice is not None
    assert record.advice.action == "emergency"
    assert record.as_json()["advice"]["required_m"] is None  # infinite


def test_a_change_of_size_does_not_stop_the_inspection():
    inspector = Inspector(read_paint, CAMERA)
    import cv2

    small = cv2.resize(paint(), (480, 270), interpolation=cv2.INTER_AREA)
    pictures = [paint()] * 3 + [small] * 3
    records = [inspector.feed(f) for f in frames(pictures)]
    assert [r.status for r in records] == ["clear"] * 6
    assert records[-1].left_uv[:, 0].max() < 480


def test_the_speed_can_change_on_the_way():
    inspector = Inspector(read_paint, CAMERA)
    assert inspector.speed_mps is None
    inspector.speed_mps = 5.0
    assert inspector.speed_mps == 5.0
    slow = [inspector.feed(f) for f in frames([paint([70.0])] * 8)][-1].advice
    inspector.speed_mps = 30.0
    fast = inspector.feed(Frame(8, 0.64, paint([70.0]))).advice
    assert slow is not None
    assert fast is not None
    assert slow.required_m < fast.required_m


def test_an_assumed_speed_sizes_the_advice_but_does_not_drive_the_tracking():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=22.0), speed_is_known=False)
    assert inspector.speed_mps is None


def person_ahead(at_m=110.0, count=62):
    return frames(ride([at_m], count))


def test_the_event_says_when_braking_had_to_start():
    # From 20 m/s at 2.5 m/s² a stop needs 1.05·80 + 8 + 0.5·20 = 102 m, at 3.2 m/s² 83.6 m.
    train = Train(
        SPEED_MPS,
        davis=Davis(0.0, 0.0, 0.0),
        speed_error_rel=0.0,
        service=Brake(2.5, 0.0, 0.0),
        emergency=Brake(3.2, 0.0, 0.0),
        adhesion=Adhesion(1.5),
    )
    inspector = Inspector(read_paint, CAMERA, train)
    for frame in person_ahead():
        inspector(frame)
    (event,) = inspector.finish()
    assert event.brake.service.state == event.brake.emergency.state == "due"
    assert event.brake.service.time_s == pytest.approx((110.0 - 102.0) / 20.0, abs=0.1)
    assert event.brake.emergency.time_s == pytest.approx((110.0 - 83.6) / 20.0, abs=0.1)
    assert event.advice_time_s is not None
    assert event.confirmed_time_s <= event.advice_time_s <= event.last_time_s


def test_a_brake_too_weak_from_the_start_was_due_before_the_recording():
    inspector = Inspector(read_paint, CAMERA, Train(speed_mps=SPEED_MPS))
    for frame in person_ahead(60.0, 30):
        inspector(frame)
    (event,) = inspector.finish()
    assert event.brake.service.state == event.brake.emergency.state == "before"


def test_the_speed_of_each_frame_is_read_from_the_log_at_its_time():
    log = SpeedLog("log", [0.0, 1.0, 2.0], [20.0, 21.0, 19.0], 0.1)
    train = Train(0.0, speed_error_rel=0.02, speed_error_mps=0.2)
    inspector = Inspector(read_paint, CAMERA, train, speed_log=log)
    records = [inspector(frame) for frame in frames([paint()] * 30)]
    for record in records:
        read = log.at(record.time_s)
        if read is None:
            assert record.speed_mps is None
            assert record.speed_error_mps is None
        else:
            assert record.speed_mps == read.speed_mps
            error = 0.02 * read.speed_mps + 0.2 + read.error_mps
            assert record.speed_error_mps == pytest.approx(error)
    assert sum(record.speed_mps is None for record in records) == 4
    assert all(record.advice is None for record in records)  # nothing to decide about


def test_where_the_log_says_nothing_the_advice_is_the_cautious_branch():
    log = SpeedLog("log", [0.0, 1.0], [2.0, 2.0])
    inspector = Inspector(read_paint, CAMERA, Train(0.0), speed_log=log)
    pictures = [paint([60.0])] * 25  # a train at walking pace, a person far ahead
    records = [inspector(frame) for frame in frames(pictures)]
    known = [r.advice.action for r in records if r.advice and r.speed_mps is not None]
    unknown = [r.advice for r in records if r.advice and r.speed_mps is None]
    assert set(known) <= {"none", "warn"}
    assert known
    assert {advice.action for advice in unknown} == {"service"}
    assert "the train's speed is unknown" in unknown[0].reason
    (event,) = inspector.finish()
    assert event.advice == "service"
    assert event.advice_time_s == pytest.approx(1.04)


def test_the_train_moves_along_its_line():
    # Level for 20 m, then a slope no brake holds: unless the train moves, nothing is wrong.
    line = Line(gradients=((0.0, 0.0), (20.0, -0.2)))
    train = Train(10.0, line=line, length_m=1.0)
    inspector = Inspector(read_paint, CAMERA, train)
    records = [inspector(frame) for frame in frames([paint([60.0])] * 25)]
    required = [r.advice.required_m for r in records if r.advice]
    assert math.isinf(required[-1])
    still = Inspector(read_paint, CAMERA, replace(train, speed_mps=0.0, position_m=-500.0))
    assert all(
        r.advice.action != "emergency"
        for f in frames([paint([60.0])] * 8)
        if (r := still(f)).advice
    )


def test_inspect_video_yields_one_record_per_frame(tmp_path):
    path = write_video(tmp_path / "ride.mp4", ride([60.0], 20))
    records = list(inspect_video(path, read_paint, CAMERA))
    assert [r.index for r in records] == list(range(20))
    assert records[-1].time_s == pytest.approx(19 / 12.5, abs=1e-3)
    assert records[-1].findings


def test_inspect_video_refuses_at_the_call_and_can_be_left_early(tmp_path):
    with pytest.raises(BadInputError, match="does not exist"):
        inspect_video(tmp_path / "none.mp4", read_paint)
    path = write_video(tmp_path / "ride.mp4", [paint()] * 10)
    records = railinspect.inspect_video(path, read_paint, CAMERA)
    assert next(records).index == 0
    records.close()


@pytest.mark.parametrize("bad", [(math.nan, 1.0), (50.0, math.inf), (-3.0, 1.0)])
def test_a_range_that_is_no_number_counts_as_no_range(bad):
    odd = Range(*bad, (1.0, 99.0), "odd")
    inspector = Inspector(
        read_paint, CAMERA, Train(speed_mps=10.0), steps=Steps(range_of=lambda *_: odd)
    )
    record = [inspector.feed(f) for f in frames(ride([40.0], 8))][-1]
    assert record.findings[0].range is None
    assert record.advice is not None
    assert record.advice.action != "none"


def test_a_record_is_plain_json_without_nan():
    import json

    sound = Inspector(read_paint, CAMERA, Train(speed_mps=10.0))
    for frame in frames(ride([50.0], 8)):
        text = json.dumps(sound.feed(frame).as_json(), allow_nan=False)
        assert set(json.loads(text)) >= {"index", "time_s", "status", "reason", "rails", "advice"}


@pytest.mark.parametrize("box", [(0, 0, 3, 3), (600, 300, 639, 359), (0, 0, 639, 359)])
def test_thumbnails_stay_inside_the_picture(box):
    import cv2

    jpeg = cut_out(paint(), box)
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[0] <= 160
    assert picture.shape[1] <= 240


def test_the_public_names_are_these():
    assert railinspect.__all__ == sorted(railinspect.__all__)
    for name in railinspect.__all__:
        assert getattr(railinspect, name).__name__ == name
    with pytest.raises(AttributeError, match="has no attribute"):
        _ = railinspect.nothing


def test_a_camera_that_has_moved_is_said_while_riding():
    pictures = [paint()] * 105
    tilted = replace(CAMERA, pitch_rad=CAMERA.pitch_rad - math.radians(0.6))
    for camera, moved in ((tilted, True), (CAMERA, False)):
        inspector = Inspector(read_paint, camera)
        records = [inspector(frame) for frame in frames(pictures)]
        assert records[50].camera_drift is None  # too little seen yet
        said = records[-1].camera_drift
        assert (said is not None) == moved
        assert records[-1].as_json()["camera_drift"] == said
        if moved:
            assert "pitch has moved by +0.6" in said
    assert Inspector(read_paint).feed(frames([paint()])[0]).camera_drift is None
