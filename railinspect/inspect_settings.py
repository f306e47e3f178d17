"""How a run inspects its inputs, and the inspector these choices make."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from railinspect.camera import Camera
from railinspect.events import EventSettings
from railinspect.pipeline import Inspector, SegmentFunction, Steps
from railinspect.ranging.stereo_camera import StereoCamera
from railinspect.speed_log import SpeedLog
from railinspect.thresholds import Thresholds
from railops.braking import Policy, Train


@dataclass(frozen=True)
class InspectSettings:
    """How a run inspects its inputs.

    Attributes:
        camera: The calibrated camera; None estimates one from each track.
        train: The train the advice is for; None gives no advice.
        speed_log: The train's speed over media time, in place of ``train``'s own; fits one input.
        speed_is_known: False where the train's speed is an assumption.
        policy: Margins and thresholds of the decision.
        thresholds: Limits above which a deviation is a finding; a single image uses their
            ``still()``.
        events: When findings become an event; a single image uses ``EventSettings.still()``.
        folder_rate_hz: Frames per second of image folders; None as in ``open_source``.
        topic: Topic of a bag's pictures; None takes the only one there is.
        overlay: Whether to write the overlay video.
        right: The right-hand recording of a rectified stereo pair; fits one input.
        stereo: The pair's calibration; needed with ``right``.
    """

    camera: Camera | None = None
    train: Train | None = None
    speed_log: SpeedLog | None = None
    speed_is_known: bool = True
    policy: Policy = field(default_factory=Policy)
    thresholds: Thresholds = field(default_factory=Thresholds)
    events: EventSettings = field(default_factory=EventSettings)
    folder_rate_hz: float | None = None
    topic: str | None = None
    overlay: bool = True
    right: Path | None = None
    stereo: StereoCamera | None = None

    def inspector(
        self,
        segmenter: SegmentFunction,
        kind: str,
        *,
        first_event_id: int = 1,
        steps: Steps | None = None,
    ) -> Inspector:
        """An inspector for one input of a kind ("video", "folder", "image")."""
        return Inspector(
            segmenter,
            self.camera,
            self.train,
            self.policy,
            thresholds=self.thresholds.still() if kind == "image" else self.thresholds,
            event_settings=EventSettings.still() if kind == "image" else self.events,
            speed_log=self.speed_log,
            speed_is_known=self.speed_is_known,
            first_event_id=first_event_id,
            stereo=self.stereo,
            steps=steps,
        )
