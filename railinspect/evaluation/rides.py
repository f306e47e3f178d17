"""False alarms on rides known to be clear, per hour and per kilometre, with upper bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

from railinspect.close_ups import CloseUpNetwork
from railinspect.evaluation.answers import true_segmentation
from railinspect.events import Event
from railinspect.pipeline import Inspector, SegmentFunction
from railinspect.scenes import Ride, SceneSettings, demo_settings
from railinspect.scenes.settings import Kind
from railinspect.track.geometry import SegmentationLike
from railinspect.video import Frame


@dataclass(frozen=True)
class ClearRides:
    """What was raised on rides without any anomaly: every event is a false alarm.

    Attributes:
        count: Rides.
        hours: Time ridden.
        km: Way ridden.
        frames: Frames inspected.
        unknown: Frames in which the rails could not be followed.
        false_events: The events, each with its ride's seed.
    """

    count: int
    hours: float
    km: float
    frames: int
    unknown: int
    false_events: tuple[tuple[int, Event], ...]

    @property
    def per_hour(self) -> float:
        """False events per hour."""
        return len(self.false_events) / self.hours

    @property
    def per_km(self) -> float:
        """False events per kilometre."""
        return len(self.false_events) / self.km

    def at_most(self, confidence: float = 0.95) -> float:
        """Upper bound of the expected number of events in this time (Poisson, one-sided).

        Example:
            >>> round(ClearRides(1, 1.0, 72.0, 45000, 0, ()).at_most(), 2)
            3.0
        """
        return float(gammaincinv(len(self.false_events) + 1, confidence))


def clear_rides(count: int, seed: int = 100, duration_s: float = 60.0) -> list[Ride]:
    """Rides without anomalies: open lines and stations in turn, all weathers, curves from 300 m.

    Args:
        count: How many.
        seed: Seed of the first; the others follow it.
        duration_s: Length of each, seconds.
    """
    kinds: tuple[Kind, ...] = ("line", "station")
    settings = [
        SceneSettings(camera=demo_settings().camera, kind=kind, weather=True, min_radius_m=300.0)
        for kind in kinds
    ]
    return [
        Ride.plan(seed + i, settings[i % len(kinds)], duration_s=duration_s) for i in range(count)
    ]


def ride_through(
    rides: Sequence[Ride],
    segmenter: SegmentFunction | None,
    camera_known: bool = True,
    progress: Callable[[int, float], None] | None = None,
    close_ups: CloseUpNetwork | None = None,
) -> ClearRides:
    """Inspect clear rides frame by frame, as a recording would be.

    Args:
        rides: Rides without planted anomalies.
        segmenter: From picture to masks; None takes the true masks.
        camera_known: Whether the inspector is told the camera.
        progress: Called with frames done and their share of all.
        close_ups: Looks at the pictures besides true masks; a segmenter brings its own.
    """
    total = sum(len(ride) for ride in rides)
    frames = unknown = 0
    events: list[tuple[int, Event]] = []
    for ride in rides:
        assert not ride.planted
        camera = ride.camera if camera_known else None
        judge = Inspector(segmenter or _no_segmenter, camera)
        for index in range(len(ride)):
            picture = ride.frame(index)
            frame = Frame(index, index / ride.frame_rate, picture.rgb)
            masks = None
            if segmenter is None:
                look = None if close_ups is None else partial(close_ups, picture.rgb)
                masks = true_segmentation(picture.labels, look)
            record = judge.feed(frame, masks)
            frames += 1
            unknown += record.status == "unknown"
            if progress is not None:
                progress(frames, frames / total)
        events += [(ride.world.seed, event) for event in judge.finish()]
    seconds = [len(ride) / ride.frame_rate for ride in rides]
    metres = [s * ride.speed_mps for s, ride in zip(seconds, rides, strict=True)]
    return ClearRides(
        len(rides), sum(seconds) / 3600, sum(metres) / 1000, frames, unknown, tuple(events)
    )


def _no_segmenter(_: npt.NDArray[np.uint8]) -> SegmentationLike:
    raise AssertionError("the true masks are handed over with each frame")
