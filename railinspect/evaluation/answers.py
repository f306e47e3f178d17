"""What a judge says of one picture, and the inspector as a judge."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from railinspect.boxes import Box
from railinspect.camera import Camera
from railinspect.close_ups import LookAtTrack
from railinspect.event_candidate import TYPE_WEIGHT
from railinspect.findings import find
from railinspect.labels import RAILS
from railinspect.segmenter import Segmentation
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower
from railinspect.track.geometry import SegmentationLike

Array = npt.NDArray[np.float64]
Said = Literal["clear", "unknown", "distortion", "obstruction", "trespasser"]

TYPES: Final[tuple[Said, ...]] = ("distortion", "obstruction", "trespasser")
"""The anomaly types of the published benchmark, in the order of its table."""


@dataclass(frozen=True)
class Answer:
    """One judge's answer for one picture.

    Attributes:
        said: The type of the strongest finding (a distortion's confidence counts half, as in
            events: an obstruction explains a distorted rail and not the other way round), or
            "clear", or "unknown" where the rails could not be followed or nothing but a doubtful
            finding, a wall behind a crest, speaks against a clear track.
        boxes: Type and box of every sure finding, input pixels.
        reason: Evidence of the strongest finding, or why the answer is unknown.
        time_ms: Processor time of this answer after the segmentation, milliseconds.
        rails_uv: Left and right rail as followed, input pixels; empty where none.
    """

    said: Said
    boxes: tuple[tuple[str, Box], ...] = ()
    reason: str = ""
    time_ms: float = 0.0
    rails_uv: tuple[Array, ...] = ()

    @property
    def alarmed(self) -> bool:
        """Whether it calls the picture anomalous."""
        return self.said in TYPES


Judge = Callable[[SegmentationLike, Camera | None], Answer]
"""Anything that says of a segmented still, with or without its camera, what is wrong in it."""


def inspect_still(segmentation: SegmentationLike, camera: Camera | None = None) -> Answer:
    """The inspector on a single picture: nothing is known from frames before it.

    Args:
        segmentation: Masks of the picture.
        camera: Its camera; None has one estimated from the track.
    """
    began = time.process_time()
    track = TrackFollower(camera).update(segmentation)
    found = find(segmentation, track, Thresholds().still())
    time_ms = 1e3 * (time.process_time() - began)
    rails = (track.left_uv, track.right_uv)
    findings = [f for f in found if f.doubt is None]
    boxes = tuple((f.type, f.box_xyxy) for f in findings)
    if findings:
        worst = max(findings, key=lambda f: f.confidence * TYPE_WEIGHT[f.type])
        return Answer(worst.type, boxes, worst.evidence, time_ms, rails)
    if not track.followed:
        reason = track.reason or "the rails cannot be followed"
        return Answer("unknown", (), reason, time_ms, rails)
    if found:
        reason = f"{found[0].evidence}, {found[0].doubt}"
        return Answer("unknown", (), reason, time_ms, rails)
    return Answer("clear", (), "", time_ms, rails)


def true_segmentation(
    labels: npt.NDArray[np.uint8], close_ups: LookAtTrack | None = None
) -> Segmentation:
    """The segmentation a perfect network would give: sure of every true label.

    Args:
        labels: Class ids, uint8 (H, W).
        close_ups: Looks at the picture besides; None for masks alone.
    """
    rail = np.where(np.isin(labels, RAILS), 255, 0).astype(np.uint8)
    return Segmentation(labels, np.full_like(labels, 255), rail, close_ups=close_ups)
