"""The one frame loop: segment → track → findings → range → events → advice → record."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from railinspect._threads import one_ahead, prefetch, side_by_side
from railinspect.adviser import Adviser
from railinspect.ego_motion import EgoMotion
from railinspect.events import Event, EventSettings, EventTracker, Sighting
from railinspect.findings import Finding, find
from railinspect.fovea import for_stills
from railinspect.journey import Journey
from railinspect.ranging import Absent, FrameRanging, Motion, MotionFilter, Range
from railinspect.ranging.calibrate_ride import DriftMonitor
from railinspect.ranging.stereo import check_sides
from railinspect.ranging.stereo_view import StereoView
from railinspect.records import FrameRecord, LocatedFinding, Status
from railinspect.segmenter import Segmenter
from railinspect.speed_log import SpeedLog
from railinspect.suspicion import Suspicions
from railinspect.thresholds import Thresholds
from railinspect.thumbnail import cut_out
from railinspect.track import TrackFollower, TrackGeometry
from railinspect.track.geometry import SegmentationLike
from railinspect.video import Frame, Source, open_source
from railops.braking import (
    Advice,
    Policy,
    Train,
    decide,
)

if TYPE_CHECKING:
    from railinspect.camera import Camera
    from railinspect.ranging.stereo_camera import StereoCamera

SegmentFunction = Callable[[npt.NDArray[np.uint8]], SegmentationLike]
"""From an RGB image, uint8 (H, W, 3), to its segmentation; a ``Segmenter`` is one."""


@dataclass(frozen=True)
class Steps:
    """The steps of the loop that other rooms provide, so that a test can replace one."""

    follower: Callable[[Camera | None], TrackFollower] = TrackFollower
    find: Callable[[SegmentationLike, TrackGeometry, Thresholds], tuple[Finding, ...]] = find
    range_of: Callable[[FrameRanging, Finding], Range | Absent | None] = FrameRanging.measure
    decide: Callable[..., Advice] = decide


class Inspector:
    """Inspects the frames of one recording, fed in order; holds all state of that recording.

    Args:
        segmenter: Callable from an RGB image to a ``Segmentation``, usually a ``Segmenter``.
        camera: The calibrated camera; by default one is estimated from the track itself.
        train: The train the advice is for; None gives records without advice. Its
            ``speed_mps`` may be changed between frames through ``speed_mps``.
        policy: Margins and thresholds of the decision.
        thresholds: Limits above which a deviation is a finding.
        event_settings: When findings become an event.
        speed_log: The train's speed over media time, in place of ``train``'s own. Where it says
            nothing, every advice takes the policy's cautious branch.
        speed_is_known: False where the train's speed is only assumed; it then sizes the advice
            but is not used to follow objects from frame to frame.
        first_event_id: Id of the first event.
        stereo: Calibration of a rectified pair whose left pictures are the frames; the right
            ones are fed beside them.
        steps: Replaces single steps of the loop.
    """

    def __init__(
        self,
        segmenter: SegmentFunction,
        camera: Camera | None = None,
        train: Train | None = None,
        policy: Policy | None = None,
        *,
        thresholds: Thresholds | None = None,
        event_settings: EventSettings | None = None,
        speed_log: SpeedLog | None = None,
        speed_is_known: bool = True,
        first_event_id: int = 1,
        stereo: StereoCamera | None = None,
        steps: Steps | None = None,
    ) -> None:
        self._segmenter = segmenter
        self._camera = camera
        self._stereo, self._sides_checked = stereo, False
        self._drift: DriftMonitor | None = None
        if train is None and speed_log is not None:
            train = Train(speed_mps=speed_log.highest_mps)
        self._journey = Journey(train, speed_log, speed_is_known) if train else None
        self._thresholds = thresholds or Thresholds()
        self._steps = steps or Steps()
        self._adviser = Adviser(policy or Policy(), self._steps.decide)
        self._events = EventTracker(event_settings, first_event_id)
        self._suspicions = Suspicions(event_settings)
        self._motion = EgoMotion()
        self._follower: TrackFollower | None = None
        self._size_wh = (0, 0)
        self._ended: list[Event] = []
        self._motions: dict[int, MotionFilter] = {}

    @property
    def speed_mps(self) -> float | None:
        """The train's speed, m/s, where it is known; assign to it as the speed changes."""
        return self._journey.speed_mps if self._journey else None

    @speed_mps.setter
    def speed_mps(self, value: float) -> None:
        self._journey = self._journey or Journey(Train(speed_mps=value))
        self._journey.assign(value)

    @property
    def next_event_id(self) -> int:
        """The id the next confirmed event will get."""
        return self._events.next_id

    @property
    def live_ids(self) -> tuple[int, ...]:
        """The ids of the events confirmed and not ended."""
        return tuple(event.id for event in self._events.live())

    def pass_by(self, times_s: Sequence[float]) -> None:
        """Let the train run through frames that are not inspected.

        Args:
            times_s: Their media times, seconds, rising, before that of the next frame fed.
        """
        if self._journey is not None:
            for time_s in times_s:
                self._journey.advance(time_s)

    def __call__(self, frame: Frame) -> FrameRecord:
        """The same as :meth:`feed`."""
        return self.feed(frame)

    def feed(
        self,
        frame: Frame,
        segmentation: SegmentationLike | None = None,
        right_rgb: npt.NDArray[np.uint8] | None = None,
    ) -> FrameRecord:
        """Inspect the next frame.

        Args:
            frame: A frame later than the one before. A change of picture size restarts the
                following of the track.
            segmentation: What the segmenter says of it, if it was asked already.
            right_rgb: The right picture of a rectified stereo pair, uint8 (H, W, 3); an instrument
                among the others. Needs ``stereo``.

        Returns:
            The record; events that ended are collected for :meth:`take_ended`.
        """
        if segmentation is None:
            segmentation = self._segmenter(frame.rgb)
        if self._journey is not None:
            self._journey.advance(frame.time_s)
        track = self._follower_for(frame).update(segmentation, frame)
        drift = self._drift.update(track) if self._drift is not None else None
        doubt = self._why_unknown(frame, track)
        # What is seen is reported even where the track is not followed; only "clear" needs that.
        seen = self._steps.find(segmentation, track, self._thresholds)
        seen = tuple(sorted(seen, key=lambda finding: finding.doubt is not None))
        findings = tuple(finding for finding in seen if finding.doubt is None)
        ranges, reasons = self._ranged(seen, track, segmentation, frame, right_rgb)
        size_wh = (frame.rgb.shape[1], frame.rgb.shape[0])
        sightings = tuple(_sighting(f, r, size_wh) for f, r in zip(seen, ranges, strict=True))
        vanishing = track.vanishing_uv
        motion = (
            self.speed_mps,
            None if vanishing is None else (float(vanishing[0]), float(vanishing[1])),
            self._seen_speed_mps(frame, track),
        )
        update = self._events.update(frame.index, frame.time_s, sightings[: len(findings)], *motion)
        why = tuple(f"{f.type}, {f.doubt}" if f.doubt else None for f in seen)
        suspicion = self._suspicions.update(frame.index, frame.time_s, sightings, why, *motion)
        ranges, reasons = ranges[: len(findings)], reasons[: len(findings)]
        self._ended.extend(map(self._looked_back, update.ended))
        for event in update.live:
            if self._events.wants_thumbnail(event.id, frame.index):
                self._events.set_thumbnail(event.id, self._thumbnail(frame, event.id))
        sure = None in update.doubts
        if findings and not sure:
            doubt = doubt or update.doubts[0]
        nearest_m = float(track.path.chainage_m[0]) if track.path is not None else 0.0
        doubt = doubt or suspicion or self._events.lost(frame.time_s, self.speed_mps, nearest_m)
        motions = self._follow(frame.time_s, ranges, update.ids)
        self._motions = {e.id: self._motions[e.id] for e in update.live if e.id in self._motions}
        located = tuple(
            LocatedFinding(*parts)
            for parts in zip(findings, ranges, update.ids, reasons, motions, strict=True)
        )
        status: Status = "finding" if sure else "unknown" if doubt else "clear"
        return FrameRecord(
            index=frame.index,
            time_s=frame.time_s,
            status=status,
            followed=track.followed and not frame.damaged,
            reason=doubt or track.reason,
            left_uv=track.left_uv,
            right_uv=track.right_uv,
            vanishing_uv=vanishing,
            roi_uv=track.roi_uv,
            reach_m=track.reach_m,
            findings=located,
            advice=self._advise(update.live, frame.time_s, doubt is not None),
            speed_mps=self.speed_mps,
            speed_error_mps=self._speed_error_mps,
            camera_drift=drift.alarm if drift is not None else None,
            stamp_ns=frame.stamp_ns,
        )

    def take_ended(self) -> tuple[Event, ...]:
        """The events that ended since the last call, oldest first."""
        ended, self._ended = tuple(self._ended), []
        return ended

    def finish(self) -> tuple[Event, ...]:
        """End the recording: every event not yet taken, including those still live."""
        return (*self.take_ended(), *map(self._looked_back, self._events.finish()))

    @property
    def _speed_error_mps(self) -> float | None:
        if self._journey is None or self._journey.speed_mps is None:
            return None
        train = self._journey.train
        return train.fastest_mps - train.speed_mps

    def _follower_for(self, frame: Frame) -> TrackFollower:
        size_wh = (frame.rgb.shape[1], frame.rgb.shape[0])
        if self._follower is None or size_wh != self._size_wh:
            camera = self._camera.resized(size_wh) if self._camera else None
            self._follower, self._size_wh = self._steps.follower(camera), size_wh
            self._drift = DriftMonitor(camera) if camera else None
        return self._follower

    def _view(self, frame: Frame, right_rgb: npt.NDArray[np.uint8] | None) -> StereoView | None:
        """The stereo pair of this frame, if there is one; a recording's first is checked."""
        if right_rgb is None or self._stereo is None:
            return None
        if not self._sides_checked:
            check_sides(frame.rgb, right_rgb)
            self._sides_checked = True
        return StereoView(frame.rgb, right_rgb, self._stereo)

    def _seen_speed_mps(self, frame: Frame, track: TrackGeometry) -> float | None:
        """The speed the picture shows, m/s, measured only where it is needed."""
        if self.speed_mps is not None or not self._events.watching:
            self._motion.forget()
            return None
        return self._motion.update(frame, track)

    def _ranged(
        self,
        findings: tuple[Finding, ...],
        track: TrackGeometry,
        segmentation: SegmentationLike,
        frame: Frame,
        right_rgb: npt.NDArray[np.uint8] | None,
    ) -> tuple[list[Range | None], list[str | None]]:
        """Each finding's range, or why there is none."""
        if not findings:
            return [], []
        stereo = self._view(frame, right_rgb)
        ranging = FrameRanging(track, segmentation=segmentation, stereo=stereo, rgb=frame.rgb)
        measured = [self._steps.range_of(ranging, finding) for finding in findings]
        ranges = [_sound(m) if isinstance(m, Range) else None for m in measured]
        reasons = [m.reason if isinstance(m, Absent) else None for m in measured]
        return ranges, reasons

    def _follow(
        self,
        time_s: float,
        ranges: list[Range | None],
        ids: tuple[int | None, ...],
    ) -> list[Motion | None]:
        """Closing speeds of confirmed events; the nearest finding of an event leads."""
        motions: list[Motion | None] = []
        for distance, event_id in zip(ranges, ids, strict=True):
            if event_id is None or distance is None or distance.range_m <= 0:
                motions.append(None)
                continue
            nearest = min(
                r.range_m for r, i in zip(ranges, ids, strict=True) if i == event_id and r
            )
            if distance.range_m > nearest:
                motions.append(None)
                continue
            known = self._motions.setdefault(event_id, MotionFilter())
            noise = max(distance.noise_m, 0.01 * distance.range_m)
            motions.append(known.update(time_s, distance.range_m, noise, distance.bias_m))
        return motions

    @staticmethod
    def _why_unknown(frame: Frame, track: TrackGeometry) -> str | None:
        if frame.damaged:
            return "the picture is damaged in the recording"
        if not track.followed:
            return track.reason or "the rails cannot be followed"
        return None

    def _advise(self, live: tuple[Event, ...], time_s: float, unknown: bool) -> Advice | None:
        if self._journey is None:
            return None
        return self._adviser.advise(self._journey, self._events, live, time_s, unknown)

    def _looked_back(self, event: Event) -> Event:
        return self._adviser.looked_back(self._journey, event) if self._journey else event

    def _thumbnail(self, frame: Frame, event_id: int) -> bytes:
        return cut_out(frame.rgb, self._events.box_of(event_id))


def _sound(distance: Range | None) -> Range | None:
    """The range, unless one of its numbers is none: no answer must not look like an answer."""
    if distance is None:
        return None
    numbers = (distance.range_m, distance.std_m, *distance.interval_m)
    return distance if all(math.isfinite(n) and n >= 0 for n in numbers) else None


def _sighting(finding: Finding, distance: Range | None, size_wh: tuple[int, int]) -> Sighting:
    left, top, right, bottom = finding.box_xyxy
    whole = left > 2 and top > 2 and right < size_wh[0] - 3 and bottom < size_wh[1] - 3
    return Sighting(
        type=finding.type,
        confidence=finding.confidence,
        box_xyxy=finding.box_xyxy,
        range_m=distance.range_m if distance else None,
        range_std_m=distance.std_m if distance else None,
        range_interval_m=distance.interval_m if distance else None,
        range_noise_m=distance.noise_m if distance else None,
        whole=whole,
    )


Segmented = tuple[Frame, SegmentationLike]

MOST_LANES: Final = 8
"""Frames of a recording that are segmented at once: what follows them keeps up with no more."""


def segmented_frames(
    source: Source, segmenter: SegmentFunction
) -> Generator[Segmented, None, None]:
    """A source's frames with their segmentations, in order; closes the source at the end.

    Decoding runs ahead in a thread, and the network of the next frames in as many as it may use,
    a frame each, while this frame's track is followed: all release the interpreter. A handful of
    frames wait; of a live source none does, and the network takes the newest frame, with all its
    threads, when the last one is taken.

    Close the iterator when leaving early, as ``contextlib.closing`` does.
    """
    if source.kind == "live":
        newest = one_ahead((frame, segmenter(frame.rgb)) for frame in source)
        try:
            yield from newest
        finally:
            source.close()  # ends a wait for the next frame
            newest.close()
        return
    lanes = 1 if source.kind == "image" else min(getattr(segmenter, "threads", 1), MOST_LANES)
    network = segmenter
    if lanes > 1:
        network = segmenter.on_one_thread()  # type: ignore[attr-defined]  # what has threads has it

    def segmented(frame: Frame) -> Segmented:
        return frame, network(frame.rgb)

    with closing(source), closing(prefetch(source, depth=2)) as frames:
        yield from side_by_side(segmented, frames, lanes)


def inspect_video(
    path: str | Path,
    segmenter: SegmentFunction | None = None,
    camera: Camera | None = None,
    train: Train | None = None,
    policy: Policy | None = None,
    *,
    folder_rate_hz: float | None = None,
    speed_log: SpeedLog | None = None,
) -> Iterator[FrameRecord]:
    """Inspect a video file, an image folder or an image, frame by frame.

    Args:
        path: The input.
        segmenter: The network; by default the bundle that ships with the package.
        camera: The calibrated camera; by default one is estimated from the track.
        train: The train the advice is for; None gives records without advice.
        policy: Margins and thresholds of the decision.
        folder_rate_hz: Frames per second of an image folder.
        speed_log: The train's speed over media time.

    Returns:
        One record per frame, in order.

    Raises:
        BadInputError: if the input cannot be read.
    """
    source = open_source(path, folder_rate_hz)
    still = source.kind == "image"
    settings = EventSettings.still() if still else EventSettings()
    thresholds = Thresholds().still() if still else Thresholds()
    segment = segmenter if segmenter is not None else Segmenter.default()
    if still:
        segment = for_stills(segment, camera)
    inspector = Inspector(
        segment,
        camera,
        train,
        policy,
        thresholds=thresholds,
        event_settings=settings,
        speed_log=speed_log,
    )
    return _records(segmented_frames(source, segment), inspector)


def _records(
    frames: Generator[Segmented, None, None], inspector: Inspector
) -> Iterator[FrameRecord]:
    with closing(frames):
        for frame, segmentation in frames:
            yield inspector.feed(frame, segmentation)
