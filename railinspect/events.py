"""From findings in single frames to events: one obstacle is one event with one id.

The rules, in the order they apply:

1. **Association.** A finding continues a known candidate when both lie at the same place: their
   ranges agree and their image columns overlap, after the candidate has been carried forward to
   the present (its range by the ego speed or by its own closing speed; its box grown about the
   vanishing point accordingly). Without ranges, the boxes themselves have to overlap. Strongly
   overlapping boxes are enough in any case.
2. **One place, one event.** Two findings of one frame are one event if
   (a) they have the same type and the same range, within ``same_place_m`` or their noise: two
   people side by side, or a heap of stones, are one place to brake for;
   (b) their types differ, their ranges agree likewise and their boxes touch: an obstacle hides
   the rails behind it and so also reads as a distortion;
   (c) one is a fragment of the other, whatever their ranges: at least half inside its box, or of
   the same type, touching it and mostly beside it. (The range of a person's arm is that of the
   ground far behind it.)
   All other findings are separate events: different types that do not touch, and the same type
   at different ranges.
3. **Type.** The type with the most summed confidence. A distortion's confidence counts half, as
   an obstruction explains a distorted rail and not the other way round.
4. **Confirmation.** A candidate becomes an event once it was seen in ``confirm_hits`` of the last
   ``confirm_window`` frames. The delay this costs is at least ``confirm_hits - 1`` frames and is
   recorded (``confirmed_time_s - first_time_s``).
5. **End.** An event not seen for ``lose_after_s`` ends. Drop-outs shorter than that do not split
   it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from railinspect.errors import BadInputError

Box = tuple[float, float, float, float]

TYPE_WEIGHT: Final[dict[str, float]] = {"distortion": 0.5, "obstruction": 1.0, "trespasser": 1.0}
"""Weight of a finding's confidence in the vote on its event's type (rule 3)."""

MAX_CLOSING_MPS: Final = 100.0
"""Fastest approach considered when neither the ego speed nor a closing speed is known, m/s."""


@dataclass(frozen=True)
class EventSettings:
    """When findings become an event and when they are one event.

    Attributes:
        confirm_hits: Frames with the finding that confirm it, out of ``confirm_window``.
        confirm_window: Number of last frames looked at.
        lose_after_s: An event unseen for this long ends, seconds of media time.
        same_place_m: Findings closer than this along the track may be one event, metres.
        gate_std: Range differences up to this many standard deviations are measurement noise.
    """

    confirm_hits: int = 4
    confirm_window: int = 6
    lose_after_s: float = 2.0
    same_place_m: float = 4.0
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
        whole: False where the edge of the picture cuts it; such a picture is a worse thumbnail.
    """

    type: str
    confidence: float
    box_xyxy: Box
    range_m: float | None = None
    range_std_m: float | None = None
    range_interval_m: tuple[float, float] | None = None
    whole: bool = True


@dataclass(frozen=True)
class Event:
    """One obstacle, from its first sighting to its last.

    Times are media times in seconds, ranges metres along the track with 95 % intervals, boxes
    input pixels. ``advice`` is the most severe action that was advised because of this event.
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
    thumbnail_jpeg: bytes | None = None


@dataclass(frozen=True)
class EventUpdate:
    """What one frame did to the events.

    Attributes:
        ids: For each sighting of the frame its event's id; None while unconfirmed.
        live: Events confirmed and not ended, nearest first.
        ended: Events that ended with this frame.
    """

    ids: tuple[int | None, ...]
    live: tuple[Event, ...]
    ended: tuple[Event, ...]


@dataclass(frozen=True)
class TimedRange:
    """A measured range of an event: seconds of media time, metres, 95 % interval in metres."""

    time_s: float
    range_m: float
    std_m: float
    interval_m: tuple[float, float]


@dataclass
class _Candidate:
    """A place where something was seen; an event once ``id`` is set."""

    first_time_s: float
    first_frame: int
    hits: deque[bool]
    id: int | None = None
    confirmed_time_s: float | None = None
    last_time_s: float = 0.0
    last_frame: int = 0
    box_xyxy: Box = (0.0, 0.0, 0.0, 0.0)
    votes: dict[str, float] = field(default_factory=dict)
    confidence_sum: float = 0.0
    frames_seen: int = 0
    ranges: deque[TimedRange] = field(default_factory=lambda: deque(maxlen=12))
    first_range: tuple[float, tuple[float, float] | None] | None = None
    closest: tuple[float, tuple[float, float] | None, float] | None = None
    best_quality: float = -1.0
    best_frame: int = 0
    best_box_xyxy: Box = (0.0, 0.0, 0.0, 0.0)
    advice: str | None = None
    advice_reason: str | None = None
    advice_rank: int = -1
    thumbnail_jpeg: bytes | None = None

    @property
    def type(self) -> str:
        return max(self.votes, key=lambda name: self.votes[name])

    def closing_mps(self, ego_speed_mps: float | None) -> float | None:
        """Speed at which the place comes nearer, m/s; None if nothing is known about it."""
        if ego_speed_mps is not None:
            return ego_speed_mps
        if len(self.ranges) < 4 or self.ranges[-1].time_s - self.ranges[0].time_s < 0.15:
            return None
        times = [r.time_s - self.ranges[0].time_s for r in self.ranges]
        mean_t = sum(times) / len(times)
        mean_r = sum(r.range_m for r in self.ranges) / len(times)
        spread = sum((t - mean_t) ** 2 for t in times)
        pairs = zip(times, self.ranges, strict=True)
        slope = sum((t - mean_t) * (r.range_m - mean_r) for t, r in pairs) / spread
        return min(max(-slope, 0.0), MAX_CLOSING_MPS)

    def range_at(self, time_s: float, ego_speed_mps: float | None) -> tuple[float, float] | None:
        """Predicted range and its standard deviation, metres; None without any range so far."""
        if not self.ranges:
            return None
        range_m, std_m = self.ranges[-1].range_m, self.ranges[-1].std_m
        gone_s = time_s - self.ranges[-1].time_s
        closing = self.closing_mps(ego_speed_mps)
        if closing is None:
            # Anything between standing still and the fastest approach: centre and half width.
            half_m = min(range_m, MAX_CLOSING_MPS * gone_s) / 2
            return range_m - half_m, math.hypot(std_m, half_m)
        drift_mps = 1.0 if ego_speed_mps is not None else 0.2 * closing + 2.0
        return range_m - closing * gone_s, math.hypot(std_m, drift_mps * gone_s)

    def box_at(self, range_m: float | None, vanishing_uv: tuple[float, float] | None) -> Box:
        """The last box, grown about the vanishing point to the predicted range."""
        if range_m is None or vanishing_uv is None or not self.ranges or range_m < 1.0:
            return self.box_xyxy
        scale = min(max(self.ranges[-1].range_m / range_m, 0.5), 4.0)
        u, v = vanishing_uv
        x0, y0, x1, y1 = self.box_xyxy
        return (
            u + (x0 - u) * scale,
            v + (y0 - v) * scale,
            u + (x1 - u) * scale,
            v + (y1 - v) * scale,
        )


class EventTracker:
    """Turns the sightings of successive frames into events (rules in the module's docstring)."""

    def __init__(self, settings: EventSettings | None = None, first_id: int = 1) -> None:
        self._settings = settings or EventSettings()
        self._next_id = first_id
        self._candidates: list[_Candidate] = []
        self._time_s = -math.inf

    @property
    def next_id(self) -> int:
        """The id the next confirmed event will get."""
        return self._next_id

    def update(
        self,
        frame_index: int,
        time_s: float,
        sightings: tuple[Sighting, ...],
        ego_speed_mps: float | None = None,
        vanishing_uv: tuple[float, float] | None = None,
    ) -> EventUpdate:
        """Take in one frame.

        Args:
            frame_index: Index of the frame, rising.
            time_s: Its media time, seconds, rising.
            sightings: Its findings, in any order.
            ego_speed_mps: The train's speed, m/s, >= 0; None if unknown.
            vanishing_uv: Vanishing point of the track in the image, pixels; None if unknown.

        Returns:
            Ids for the sightings, the live events, and those that just ended.
        """
        ended = self._end_lost(time_s)
        owners = self._associate(time_s, sightings, ego_speed_mps, vanishing_uv)
        seen: dict[int, _Candidate] = {}
        for index, sighting in enumerate(sightings):
            owner = owners[index]
            if owner is None:
                owner = _Candidate(time_s, frame_index, deque(maxlen=self._settings.confirm_window))
                self._candidates.append(owner)
                owners[index] = owner
            self._see(owner, frame_index, time_s, sighting)
            seen[id(owner)] = owner
        for candidate in self._candidates:
            candidate.hits.append(id(candidate) in seen)
            if candidate.id is None and sum(candidate.hits) >= self._settings.confirm_hits:
                candidate.id, candidate.confirmed_time_s = self._next_id, time_s
                self._next_id += 1
        owners = self._merge_same_place(owners, time_s, ego_speed_mps)
        self._candidates = [c for c in self._candidates if c.id is not None or any(c.hits)]
        self._time_s = time_s
        ids = tuple(None if owner is None else owner.id for owner in owners)
        return EventUpdate(ids, self.live(), ended)

    def live(self) -> tuple[Event, ...]:
        """Confirmed events that have not ended, nearest first."""
        events = [_event(c) for c in self._candidates if c.id is not None]
        return tuple(sorted(events, key=lambda e: (e.closest_range_m or math.inf, e.id)))

    def ranges_since(self, event_id: int, time_s: float) -> tuple[TimedRange, ...]:
        """The last ranges of a live event from ``time_s`` on, oldest first, at most twelve."""
        found = self._find(event_id)
        return tuple(r for r in found.ranges if r.time_s >= time_s) if found else ()

    def box_of(self, event_id: int) -> Box:
        """Where a live event was last seen, input pixels."""
        found = self._find(event_id)
        return found.box_xyxy if found else (0.0, 0.0, 0.0, 0.0)

    def wants_thumbnail(self, event_id: int, frame_index: int) -> bool:
        """Whether this frame shows the event, and better than any picture kept so far."""
        found = self._find(event_id)
        if found is None or found.last_frame != frame_index:
            return False
        return found.thumbnail_jpeg is None or found.best_frame == frame_index

    def set_thumbnail(self, event_id: int, jpeg: bytes) -> None:
        """Keep a picture of the event, from the frame that last showed it."""
        if found := self._find(event_id):
            found.thumbnail_jpeg = jpeg
            found.best_frame, found.best_box_xyxy = found.last_frame, found.box_xyxy

    def note_advice(self, event_id: int, action: str, rank: int, reason: str | None) -> None:
        """Remember the most severe advice given because of the event (higher rank wins)."""
        found = self._find(event_id)
        if found is not None and rank > found.advice_rank:
            found.advice, found.advice_rank, found.advice_reason = action, rank, reason

    def finish(self) -> tuple[Event, ...]:
        """End everything: the confirmed events that were still live."""
        events = self.live()
        self._candidates = []
        return events

    def _find(self, event_id: int) -> _Candidate | None:
        return next((c for c in self._candidates if c.id == event_id), None)

    def _end_lost(self, time_s: float) -> tuple[Event, ...]:
        limit_s = self._settings.lose_after_s
        lost = [c for c in self._candidates if time_s - c.last_time_s > limit_s]
        self._candidates = [c for c in self._candidates if time_s - c.last_time_s <= limit_s]
        return tuple(_event(c) for c in lost if c.id is not None)

    def _associate(
        self,
        time_s: float,
        sightings: tuple[Sighting, ...],
        ego_speed_mps: float | None,
        vanishing_uv: tuple[float, float] | None,
    ) -> list[_Candidate | None]:
        """The known candidate each sighting continues, cheapest pairs first, else None."""
        costs: list[tuple[float, int, int]] = []
        for c_index, candidate in enumerate(self._candidates):
            predicted = candidate.range_at(time_s, ego_speed_mps)
            box = candidate.box_at(predicted[0] if predicted else None, vanishing_uv)
            for s_index, sighting in enumerate(sightings):
                cost = self._cost(candidate, predicted, box, sighting)
                if cost is not None:
                    costs.append((cost, s_index, c_index))
        owners: list[_Candidate | None] = [None] * len(sightings)
        leaders: dict[int, int] = {}  # each candidate's best sighting
        for _, s_index, c_index in sorted(costs):
            if owners[s_index] is None and c_index not in leaders:
                leaders[c_index] = s_index
                owners[s_index] = self._candidates[c_index]
        for s_index, sighting in enumerate(sightings):
            if owners[s_index] is not None:
                continue
            for c_index, leader in leaders.items():
                if self._one_place(sightings[leader], sighting):
                    owners[s_index] = self._candidates[c_index]
                    break
        return owners

    def _cost(
        self,
        candidate: _Candidate,
        predicted: tuple[float, float] | None,
        box: Box,
        sighting: Sighting,
    ) -> float | None:
        """Dissimilarity of a candidate and a sighting, 0 (same) upwards; None if not the same."""
        overlap = iou(box, sighting.box_xyxy)
        # Between equals an event goes before a candidate, and the same type before another.
        bias = (0.0 if sighting.type in candidate.votes else 0.3) + 0.3 * (candidate.id is None)
        if overlap >= 0.4:
            return 1 - overlap + bias
        if predicted is None or sighting.range_m is None:
            similar = 0.4 < _height(box) / max(_height(sighting.box_xyxy), 1.0) < 2.5
            touching = overlap > 0.05 or (overlap > 0 and min(_area(box), 1) > 0)
            return 1.5 - overlap + bias if similar and touching else None
        noise_m = math.hypot(predicted[1], sighting.range_std_m or 0.0)
        gate_m = max(self._settings.same_place_m, self._settings.gate_std * noise_m)
        gate_m = max(min(gate_m, 0.5 * max(predicted[0], sighting.range_m)), 2.0)
        apart_m = abs(predicted[0] - sighting.range_m)
        if apart_m > gate_m or not columns_touch(box, sighting.box_xyxy, slack=0.5):
            return None
        return apart_m / gate_m + (1 - overlap) / 2 + bias

    def _one_place(self, first: Sighting, second: Sighting) -> bool:
        """Rule 2 for two findings of one frame."""
        touching = boxes_touch(first.box_xyxy, second.box_xyxy)
        if touching and _is_fragment(first, second):
            return True
        if first.range_m is None or second.range_m is None:
            return touching
        noise_m = math.hypot(first.range_std_m or 0.0, second.range_std_m or 0.0)
        near_m = max(self._settings.same_place_m, self._settings.gate_std * noise_m)
        same_range = abs(first.range_m - second.range_m) <= near_m
        return same_range and (touching or first.type == second.type)

    def _see(
        self, candidate: _Candidate, frame_index: int, time_s: float, sighting: Sighting
    ) -> None:
        again = candidate.frames_seen > 0 and candidate.last_frame == frame_index
        candidate.last_time_s, candidate.last_frame = time_s, frame_index
        candidate.frames_seen += not again
        weight = TYPE_WEIGHT.get(sighting.type, 1.0)
        candidate.votes[sighting.type] = (
            candidate.votes.get(sighting.type, 0.0) + weight * sighting.confidence
        )
        if again:  # a second finding of the same frame at the same place: the strongest leads
            candidate.box_xyxy = _union(candidate.box_xyxy, sighting.box_xyxy)
        else:
            candidate.confidence_sum += sighting.confidence
            candidate.box_xyxy = sighting.box_xyxy
        quality = sighting.confidence * math.sqrt(_area(candidate.box_xyxy) + 1)
        quality *= 1.0 if sighting.whole else 0.5
        if quality > 1.2 * candidate.best_quality:  # in steps, so few pictures are cut out
            candidate.best_quality, candidate.best_frame = quality, frame_index
            candidate.best_box_xyxy = candidate.box_xyxy
        if sighting.range_m is not None:
            self._see_range(candidate, time_s, sighting, sighting.range_m, again)

    @staticmethod
    def _see_range(
        candidate: _Candidate, time_s: float, sighting: Sighting, range_m: float, again: bool
    ) -> None:
        bounds = sighting.range_interval_m or (range_m, range_m)
        measured = TimedRange(time_s, range_m, sighting.range_std_m or 0.0, bounds)
        if again and candidate.ranges and candidate.ranges[-1].time_s == time_s:
            if range_m < candidate.ranges[-1].range_m:  # the nearer end of the same thing counts
                candidate.ranges[-1] = measured
        else:
            candidate.ranges.append(measured)
        if candidate.first_range is None:
            candidate.first_range = (range_m, sighting.range_interval_m)
        if candidate.closest is None or range_m < candidate.closest[0]:
            candidate.closest = (range_m, sighting.range_interval_m, time_s)

    def _merge_same_place(
        self, owners: list[_Candidate | None], time_s: float, ego_speed_mps: float | None
    ) -> list[_Candidate | None]:
        """Join candidates seen now that have come to lie at one place (rule 2), oldest stays."""
        now = [c for c in self._candidates if c.last_time_s == time_s]
        now.sort(key=lambda c: (c.id is None, c.id or 0, c.first_frame))
        replaced: dict[int, _Candidate] = {}
        for index, keep in enumerate(now):
            if id(keep) in replaced:
                continue
            for other in now[index + 1 :]:
                if id(other) in replaced or other.id is not None:
                    continue  # two confirmed events keep their ids
                if self._one_place(_as_sighting(keep), _as_sighting(other)):
                    _absorb(keep, other)
                    replaced[id(other)] = keep
        self._candidates = [c for c in self._candidates if id(c) not in replaced]
        return [replaced.get(id(owner), owner) if owner else None for owner in owners]


def _is_fragment(first: Sighting, second: Sighting) -> bool:
    """Whether one of two touching findings is a piece of the other, by their boxes alone."""
    a, b = first.box_xyxy, second.box_xyxy
    if overlap_share(a, b) >= 0.5:
        return True
    beside = min(a[3], b[3]) - max(a[1], b[1])
    return first.type == second.type and beside >= 0.5 * min(_height(a), _height(b))


def _as_sighting(candidate: _Candidate) -> Sighting:
    range_m = candidate.ranges[-1].range_m if candidate.ranges else None
    std_m = candidate.ranges[-1].std_m if candidate.ranges else None
    return Sighting(candidate.type, 1.0, candidate.box_xyxy, range_m, std_m)


def _absorb(keep: _Candidate, other: _Candidate) -> None:
    for name, votes in other.votes.items():
        keep.votes[name] = keep.votes.get(name, 0.0) + votes
    if other.first_frame < keep.first_frame:
        keep.first_frame, keep.first_time_s = other.first_frame, other.first_time_s
        keep.first_range = other.first_range or keep.first_range
    if other.closest and (keep.closest is None or other.closest[0] < keep.closest[0]):
        keep.closest = other.closest
    keep.box_xyxy = _union(keep.box_xyxy, other.box_xyxy)


def _event(candidate: _Candidate) -> Event:
    assert candidate.id is not None
    assert candidate.confirmed_time_s is not None
    total = sum(candidate.votes.values()) or 1.0
    first, closest = candidate.first_range, candidate.closest
    return Event(
        id=candidate.id,
        type=candidate.type,
        first_time_s=candidate.first_time_s,
        confirmed_time_s=candidate.confirmed_time_s,
        last_time_s=candidate.last_time_s,
        first_frame=candidate.first_frame,
        last_frame=candidate.last_frame,
        best_frame=candidate.best_frame,
        best_box_xyxy=candidate.best_box_xyxy,
        frames_seen=candidate.frames_seen,
        confidence=candidate.confidence_sum / max(candidate.frames_seen, 1),
        type_shares={name: votes / total for name, votes in sorted(candidate.votes.items())},
        first_range_m=first[0] if first else None,
        first_range_interval_m=first[1] if first else None,
        closest_range_m=closest[0] if closest else None,
        closest_range_interval_m=closest[1] if closest else None,
        closest_time_s=closest[2] if closest else None,
        advice=candidate.advice,
        advice_reason=candidate.advice_reason,
        thumbnail_jpeg=candidate.thumbnail_jpeg,
    )


def iou(first: Box, second: Box) -> float:
    """Intersection over union of two boxes, 0 to 1."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    if width <= 0 or height <= 0:
        return 0.0
    shared = width * height
    return shared / (_area(first) + _area(second) - shared)


def overlap_share(first: Box, second: Box) -> float:
    """Share of the smaller box that lies inside the larger one, 0 to 1."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    smaller = min(_area(first), _area(second))
    return width * height / smaller if width > 0 and height > 0 and smaller > 0 else 0.0


def boxes_touch(first: Box, second: Box, slack: float = 0.15) -> bool:
    """Whether two boxes overlap once each has grown by ``slack`` of its size on every side."""
    return _grow_overlap(first, second, slack, 0, 2) and _grow_overlap(first, second, slack, 1, 3)


def columns_touch(first: Box, second: Box, slack: float) -> bool:
    """Whether the boxes' image columns overlap once each has grown by ``slack`` of its width."""
    return _grow_overlap(first, second, slack, 0, 2)


def _grow_overlap(first: Box, second: Box, slack: float, low: int, high: int) -> bool:
    grow_first = slack * (first[high] - first[low])
    grow_second = slack * (second[high] - second[low])
    return (
        first[low] - grow_first <= second[high] + grow_second
        and second[low] - grow_second <= first[high] + grow_first
    )


def _area(box: Box) -> float:
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)


def _height(box: Box) -> float:
    return box[3] - box[1]


def _union(first: Box, second: Box) -> Box:
    return (
        min(first[0], second[0]),
        min(first[1], second[1]),
        max(first[2], second[2]),
        max(first[3], second[3]),
    )
