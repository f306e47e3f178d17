"""The train's speed from the picture, on rides whose speed is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from railinspect.ego_motion import EgoMotion
from railinspect.evaluation import true_segmentation
from railinspect.scenes import Ride, demo_settings
from railinspect.track import TrackFollower
from railinspect.video import Frame


@pytest.fixture(scope="module")
def shown():
    """Seven frames of a ride at 16 m/s with their tracks."""
    ride = Ride.plan(3, demo_settings(), speed_mps=16.0, duration_s=2.0, frame_rate=25.0)
    follower = TrackFollower(ride.camera)
    frames = []
    for index in range(7):
        picture = ride.frame(index)
        track = follower.update(true_segmentation(picture.labels))
        frames.append((Frame(index, index / 25.0, picture.rgb), track))
    return frames


def measured(frames) -> list[float | None]:
    motion = EgoMotion()
    return [motion.update(frame, track) for frame, track in frames]


def test_the_speed_is_seen(shown):
    speeds = measured(shown)
    assert speeds[0] is None
    assert speeds[-1] == pytest.approx(16.0, rel=0.15)


def test_a_standing_train_is_seen_to_stand(shown):
    frame, track = shown[0]
    still = [(dataclasses.replace(frame, index=i, time_s=i / 25.0), track) for i in range(5)]
    assert measured(still)[-1] == pytest.approx(0.0, abs=0.3)


def test_nothing_is_said_where_nothing_can_be_seen(shown):
    grey = [
        (dataclasses.replace(frame, rgb=np.full_like(frame.rgb, 90)), track)
        for frame, track in shown
    ]
    assert measured(grey) == [None] * len(shown)
    lost = [(frame, dataclasses.replace(track, followed=False)) for frame, track in shown]
    assert measured(lost) == [None] * len(shown)
    apart = [(dataclasses.replace(f, time_s=10.0 * f.time_s), track) for f, track in shown]
    assert measured(apart) == [None] * len(shown)
