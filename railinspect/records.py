"""What the frame loop says about one frame, and its form in ``frames.jsonl``/``events.jsonl``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from railinspect.events import Event
    from railinspect.findings import Finding
    from railinspect.ranging import Motion, Range
    from railops.braking import Advice, BrakeMoments, RangeMeasurement

Status = Literal["clear", "finding", "unknown"]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LocatedFinding:
    """A finding with its range and the event it belongs to.

    Attributes:
        finding: What was found and where in the image.
        range: Distance along the track; None beyond the reliable range.
        event_id: Id of its event; None while the event is not confirmed.
        range_reason: Why there is no range; None where there is one.
        motion: Filtered range and closing speed of its event; None while there are none.
    """

    finding: Finding
    range: Range | None
    event_id: int | None
    range_reason: str | None = None
    motion: Motion | None = None


@dataclass(frozen=True)
class FrameRecord:
    """Everything found in one frame.

    Attributes:
        index: Position of the frame in its input.
        time_s: Media time, seconds.
        status: "finding" where something was found (confirmed or not), else "unknown" where the
            rails could not be followed or the picture is damaged, else "clear".
        followed: Both rails of the own track were followed in a sound picture.
        reason: Why they were not, or why the rails end where they do; None if nothing needs
            saying.
        left_uv: Left rail, input pixels, shape (N, 2), top to bottom; empty if not followed.
        right_uv: Right rail, likewise.
        vanishing_uv: Vanishing point of the track, input pixels; None if unknown.
        roi_uv: Outline of the region inspected, input pixels, shape (K, 2).
        reach_m: Range up to which the rails were followed, metres; None if unknown.
        findings: The findings with their ranges.
        advice: What the brake decision advises; None if there is nothing to decide, or if no
            train was given.
        speed_mps: The train's speed, m/s; None where it is unknown or only assumed.
        speed_error_mps: By how much the train may be faster, m/s; None likewise.
        camera_drift: How the camera has moved from its calibration; None while it has not, while
            too little was seen to tell, and without a calibration.
        stamp_ns: Unix time of the frame, nanoseconds, where its source states one.
    """

    index: int
    time_s: float
    status: Status
    followed: bool
    reason: str | None
    left_uv: Array
    right_uv: Array
    vanishing_uv: Array | None
    roi_uv: Array
    reach_m: float | None
    findings: tuple[LocatedFinding, ...]
    advice: Advice | None
    speed_mps: float | None = None
    speed_error_mps: float | None = None
    camera_drift: str | None = None
    stamp_ns: int | None = None

    def as_json(self) -> dict[str, Any]:
        """The object stored as one line of ``frames.jsonl``; pixels to 0.1, times to 1 µs."""
        return {
            "index": self.index,
            "time_s": round(self.time_s, 6),
            "stamp_ns": self.stamp_ns,
            "status": self.status,
            "followed": self.followed,
            "reason": self.reason,
            "rails": {"left": _points(self.left_uv), "right": _points(self.right_uv)},
            "vanishing_point": None if self.vanishing_uv is None else _points(self.vanishing_uv),
            "reach_m": number(self.reach_m, 2),
            "speed_mps": number(self.speed_mps, 3),
            "speed_error_mps": number(self.speed_error_mps, 3),
            "camera_drift": self.camera_drift,
            "findings": [located_json(found) for found in self.findings],
            "advice": advice_json(self.advice),
        }


def located_json(found: LocatedFinding) -> dict[str, Any]:
    """A finding with its range, its instruments and its motion as a JSON object."""
    finding, distance = found.finding, found.range
    return {
        "type": finding.type,
        "polygon": _points(np.asarray(finding.polygon_uv, float)),
        "box_xyxy": [number(value, 1) for value in finding.box_xyxy],
        "confidence": number(finding.confidence, 3),
        "range_m": number(distance.range_m, 2) if distance else None,
        "range_std_m": number(distance.std_m, 2) if distance else None,
        "range_interval_m": interval(distance.interval_m if distance else None),
        "range_method": distance.method if distance else None,
        "range_reason": found.range_reason,
        "range_noise_m": number(distance.noise_m, 2) if distance else None,
        "range_bias_m": number(distance.bias_m, 2) if distance else None,
        "instruments": [
            {
                "method": reading.method,
                "range_m": number(reading.range_m, 2),
                "std_m": number(reading.std_m, 2),
                "agrees": reading.agrees,
            }
            for reading in (distance.readings if distance else ())
        ],
        **_motion_json(found.motion),
        "event_id": found.event_id,
        "evidence": finding.evidence,
    }


def _motion_json(motion: Motion | None) -> dict[str, Any]:
    """Closing speed (m/s, positive when nearing) and time to reach (s), as far as known."""
    closing = None if motion is None else motion.closing
    return {
        "closing_mps": None if closing is None else number(closing.speed_mps, 2),
        "closing_std_mps": None if closing is None else number(closing.std_mps, 2),
        "time_to_reach_s": None if motion is None else number(motion.time_to_reach_s, 2),
    }


def advice_json(advice: Advice | None) -> dict[str, Any] | None:
    """An advice as a JSON object: action, metres and seconds of margin, and its reason."""
    if advice is None:
        return None
    return {
        "action": advice.action,
        "required_m": number(advice.required_m, 1),
        "available_m": number(advice.available_m, 1),
        "margin_m": number(advice.margin_m, 1),
        "margin_s": number(advice.margin_s, 1),
        "governed_by": _measurement_json(advice.governed_by),
        "reason": advice.reason,
    }


def _measurement_json(measurement: RangeMeasurement | None) -> dict[str, Any] | None:
    if measurement is None:
        return None
    return {
        "channel": measurement.channel,
        "time_s": number(measurement.time_s, 6),
        "range_m": number(measurement.range_m, 2),
    }


def event_json(event: Event, input_name: str, thumbnail: str | None) -> dict[str, Any]:
    """The object stored as one line of ``events.jsonl``.

    Args:
        event: The event.
        input_name: Name of the input it was seen in.
        thumbnail: Path of its picture relative to the run folder, or None.
    """
    return {
        "id": event.id,
        "input": input_name,
        "type": event.type,
        "confidence": number(event.confidence, 3),
        "type_shares": {name: number(share, 3) for name, share in event.type_shares.items()},
        "first_time_s": number(event.first_time_s, 6),
        "confirmed_time_s": number(event.confirmed_time_s, 6),
        "last_time_s": number(event.last_time_s, 6),
        "first_frame": event.first_frame,
        "last_frame": event.last_frame,
        "best_frame": event.best_frame,
        "best_box_xyxy": [number(value, 1) for value in event.best_box_xyxy],
        "frames_seen": event.frames_seen,
        "first_range_m": number(event.first_range_m, 2),
        "first_range_interval_m": interval(event.first_range_interval_m),
        "closest_range_m": number(event.closest_range_m, 2),
        "closest_range_interval_m": interval(event.closest_range_interval_m),
        "closest_time_s": number(event.closest_time_s, 6),
        "advice": event.advice,
        "advice_reason": event.advice_reason,
        "advice_time_s": number(event.advice_time_s, 6),
        **_moments_json(event.brake),
        "doubt": event.doubt,
        "thumbnail": thumbnail,
    }


def _moments_json(moments: BrakeMoments | None) -> dict[str, Any]:
    """State and media time of both moments; None without a train."""
    service = moments.service if moments else None
    emergency = moments.emergency if moments else None
    return {
        "service_by": service.state if service else None,
        "service_by_time_s": number(service.time_s, 3) if service else None,
        "emergency_by": emergency.state if emergency else None,
        "emergency_by_time_s": number(emergency.time_s, 3) if emergency else None,
    }


def number(value: float | None, digits: int) -> float | None:
    """A finite number rounded for JSON; None for None, NaN and infinities, which JSON lacks."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits)


def interval(bounds: Sequence[float] | None) -> list[float | None] | None:
    """Lower and upper bound for JSON; an open bound is None."""
    return None if bounds is None else [number(bounds[0], 2), number(bounds[1], 2)]


def _points(points: Array) -> list[Any]:
    """Pixels rounded to 0.1 as nested lists."""
    rounded: list[Any] = np.round(points, 1).tolist()
    return rounded


def flat_for_parquet(event: Mapping[str, Any]) -> dict[str, Any]:
    """An ``events.jsonl`` object with intervals and boxes spread over scalar columns."""
    row = {key: event[key] for key in event if key not in ("type_shares", "best_box_xyxy")}
    for name in ("first_range", "closest_range"):
        low, high = row.pop(f"{name}_interval_m") or (None, None)
        row[f"{name}_low_m"], row[f"{name}_high_m"] = low, high
    for name, value in zip(("left", "top", "right", "bottom"), event["best_box_xyxy"], strict=True):
        row[f"best_box_{name}_px"] = value
    return row
