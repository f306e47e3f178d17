"""What goes into and comes out of the event tracker."""

from __future__ import annotations

from dataclasses import dataclass

from railinspect.boxes import Box
from railinspect.errors import BadInputError
from railops.braking import BrakeMoments


@dataclass(frozen=True)
class EventSettings:
    """When findings become an event and when they are one event.

    Attributes:
        confirm_hits: Frames with the finding that confirm it, out of ``confirm_window``.
        confirm_window: Number of last frames looked at.
        lose_after_s: An event unseen for this long ends, seconds of media time.
        same_place_m: Findings closer than this along the track may be one event, metres.
        stretch_m: Distortions closer than this along the track are one, metres.
        gate_std: Range differences up to this many standard deviations are measurement noise.
    """

    confirm_hits: int = 4
    confirm_window: int = 6
    lose_after_s: float = 2.0
    same_place_m: float = 4.0
    stretch_m: float = 15.0
    gate_std: float = 3.0

    def __post_init__(self) -> None:
        if not 1 <= self.confirm_hits <= self.confirm_window:
            raise BadInputError(
                f"confirm_hits {self.confirm_hits} of confirm_window {self.confirm_window} cannot "
                "be met; it must lie between 1 and the window"
            )

    @staticmethod
    def still() -> EventSettings:
        """For a single image: there is no second frame to confirm anything with."""
        return EventSettings(confirm_hits=1, confirm_window=1)


@dataclass(frozen=True)
class Sighting:
    """One finding in one frame, as far as events need it.

    Attributes:
        type: "distortion", "obstruction" or "trespasser".
        confidence: 0 to 1.
        box_xyxy: Left, top, right, bottom in input pixels.
        range_m: Distance along the track, metres; None beyond the reliable range.
        range_std_m: Standard deviation of the range, metres; None without a range.
        range_interval_m: 95 % interval of the range, metres; None without a range.
        range_noise_m: The part of ``range_std_m`` that differs from frame to frame, metres; None
            where it is not known apart from the whole.
        whole: False where the edge of the picture cuts it; such a picture is a worse thumbnail.
    """

    type: str
    confidence: float
    box_xyxy: Box
    range_m: float | None = None
    range_std_m: float | None = None
    range_interval_m: tuple[float, float] | None = None
    range_noise_m: float | None = None
    whole: bool = True


@dataclass(frozen=True)
class Event:
    """One obstacle, from its first sighting to its last.

    Times are media times in seconds, ranges metres along the track with 95 % intervals, boxes
    input pixels. ``advice`` is the most severe action that was advised because of this event,
    ``advice_time_s`` when it first was. ``brake`` says when braking for it had to start; it is
    there once the event has ended, where a train was given.
    ``doubt`` says why it cannot be a thing that stands on the ground (rule 6 of
    :mod:`railinspect.events`); None for nearly all events.
    """

    id: int
    type: str
    first_time_s: float
    confirmed_time_s: float
    last_time_s: float
    first_frame: int
    last_frame: int
    best_frame: int
    best_box_xyxy: Box
    frames_seen: int
    confidence: float
    type_shares: dict[str, float]
    first_range_m: float | None
    first_range_interval_m: tuple[float, float] | None
    closest_range_m: float | None
    closest_range_interval_m: tuple[float, float] | None
    closest_time_s: float | None
    advice: str | None = None
    advice_reason: str | None = None
    advice_time_s: float | None = None
    brake: BrakeMoments | None = None
    doubt: str | None = None
    thumbnail_jpeg: bytes | None = None


@dataclass(frozen=True)
class EventUpdate:
    """What one frame did to the events.

    Attributes:
        ids: For each sighting of the frame its event's id; None while unconfirmed.
        live: Events confirmed and not ended, nearest first.
        ended: Events that ended with this frame.
        doubts: For each sighting why it cannot stand on the ground (rule 6), None where nothing
            speaks against it.
    """

    ids: tuple[int | None, ...]
    live: tuple[Event, ...]
    ended: tuple[Event, ...]
    doubts: tuple[str | None, ...]


@dataclass(frozen=True)
class TimedRange:
    """A measured range of an event.

    Attributes:
        time_s: Media time, seconds.
        range_m: Metres along the track.
        std_m: Standard deviation, metres.
        interval_m: 95 % interval, metres.
        noise_m: Standard deviation of what differs from frame to frame, metres.
        whole: False where the edge of the picture cut what was seen.
    """

    time_s: float
    range_m: float
    std_m: float
    interval_m: tuple[float, float]
    noise_m: float = 0.0
    whole: bool = True
