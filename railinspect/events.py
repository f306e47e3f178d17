"""From findings in single frames to events: one obstacle is one event with one id.

The rules, in the order they apply:

1. **Association.** A finding continues a known candidate when both lie at the same place: their
   ranges agree and their image columns overlap, after the candidate has been carried forward to
   the present (its range by the ego speed or by its own closing speed; its box grown about the
   vanishing point accordingly). Without ranges, the boxes themselves have to overlap. Strongly
   overlapping boxes are enough in any case, and so is a box that holds the old one while its foot
   lies lower: the upper part was seen first.
2. **One place, one event.** Two findings of one frame are one event if
   (a) they have the same type and the same range, within ``same_place_m`` or their noise: two
   people side by side, or a heap of stones, are one place to brake for. A distortion is a stretch
   of track whose worst part changes as the train nears, so for it ``stretch_m`` counts;
   (b) their types differ, their ranges agree likewise and their boxes touch: an obstacle hides
   the rails behind it and so also reads as a distortion;
   (c) one is a fragment of the other, whatever their ranges: at least half inside its box, or of
   the same type, touching it and mostly beside it. (The range of a person's arm is that of the
   ground far behind it.)
   All other findings are separate events: different types that do not touch, and the same type
   at different ranges.
3. **Type.** The type with the most confidence, summed over the sightings and each divided by its
   range: what is near is seen large. A distortion's confidence counts half, as an obstruction
   explains a distorted rail and not the other way round.
4. **Confirmation.** A candidate becomes an event once it was seen in ``confirm_hits`` of the last
   ``confirm_window`` frames. The delay this costs is at least ``confirm_hits - 1`` frames and is
   recorded (``confirmed_time_s - first_time_s``).
5. **End.** An event not seen for ``lose_after_s`` ends. Drop-outs shorter than that do not split
   it.
6. **Doubt.** What keeps its distance although the train is known or seen to move, faster than
   anyone runs, does not stand on the track. It has to last for ``lose_after_s`` to become an
   event, and so has what keeps its distance while no speed is known: waiting costs no way there.
   It may roll ahead of the train, so it is never dropped: the event
   stays, says why it is doubtful, and stops being so when it comes nearer. The
   frame loop takes doubtful events as perception in doubt (unknown), not as obstacles to stop for.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from railinspect.boxes import Box, boxes_touch, columns_touch, height, iou, overlap_share
from railinspect.event_candidate import Candidate
from railinspect.event_types import Event, EventSettings, EventUpdate, Sighting, TimedRange

FOOT_SHARE: Final = 0.6
"""Least share of its range left to a thing whose foot comes into sight."""

__all__ = ["Event", "EventSettings", "EventTracker", "EventUpdate", "Sighting", "TimedRange"]


class EventTracker:
    """Turns the sightings of successive frames into events (rules in the module's docstring)."""

    def __init__(self, settings: EventSettings | None = None, first_id: int = 1) -> None:
        self._settings = settings or EventSettings()
        self._next_id = first_id
        self._candidates: list[Candidate] = []

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
        seen_speed_mps: float | None = None,
    ) -> EventUpdate:
        """Take in one frame.

        Args:
            frame_index: Index of the frame, rising.
            time_s: Its media time, seconds, rising.
            sightings: Its findings, in any order.
            ego_speed_mps: The train's speed, m/s, >= 0; None if unknown.
            vanishing_uv: Vanishing point of the track in the image, pixels; None if unknown.
            seen_speed_mps: The speed as the picture shows it, m/s, where it is not known; it only
                serves to doubt (rule 6).

        Returns:
            Ids for the sightings, the live events, and those that just ended.
        """
        ended = self._end_lost(time_s)
        owners = self._associate(time_s, sightings, ego_speed_mps, vanishing_uv)
        seen: dict[int, Candidate] = {}
        for index, sighting in enumerate(sightings):
            owner = owners[index]
            if owner is None:
                owner = Candidate(time_s, frame_index, deque(maxlen=self._settings.confirm_window))
                self._candidates.append(owner)
                owners[index] = owner
            owner.see(frame_index, time_s, sighting)
            seen[id(owner)] = owner
        for candidate in self._candidates:
            candidate.hits.append(id(candidate) in seen)
        owners = self._merge_same_place(owners, time_s)
        speed_mps = seen_speed_mps if ego_speed_mps is None else ego_speed_mps
        for candidate in self._candidates:
            if candidate.last_time_s == time_s:
                candidate.doubted = candidate.doubt(speed_mps)
        for candidate in self._candidates:
            if candidate.id is None and self._confirmed(candidate, time_s, speed_mps):
                candidate.id, candidate.confirmed_time_s = self._next_id, time_s
                self._next_id += 1
        self._candidates = [c for c in self._candidates if c.id is not None or any(c.hits)]
        ids = tuple(None if owner is None else owner.id for owner in owners)
        doubts = tuple(None if owner is None else owner.doubted for owner in owners)
        return EventUpdate(ids, self.live(), ended, doubts)

    @property
    def watching(self) -> bool:
        """Whether anything was seen lately that the train's speed would help to judge."""
        return any(c.type != "distortion" for c in self._candidates)

    @property
    def following(self) -> bool:
        """Whether anything seen before is still looked for."""
        return bool(self._candidates)

    def lost(self, time_s: float, ego_speed_mps: float | None, nearest_m: float) -> str | None:
        """Which confirmed thing ought to be in sight and is not; None where all is as expected.

        Args:
            time_s: Media time of the frame just taken in, seconds.
            ego_speed_mps: The train's speed, m/s; None if unknown.
            nearest_m: Range below which the train's own front hides what lies on the track, metres.
        """
        for candidate in self._candidates:
            if candidate.id is None or candidate.last_time_s == time_s or candidate.doubted:
                continue
            expected = candidate.range_at(time_s, ego_speed_mps)
            if expected is None or expected[0] > nearest_m:
                ago_s = time_s - candidate.last_time_s
                return f"event {candidate.id} ({candidate.type}), seen {ago_s:.1f} s ago, is lost"
        return None

    def live(self) -> tuple[Event, ...]:
        """Confirmed events that have not ended, nearest first."""
        events = [c.event() for c in self._candidates if c.id is not None]
        return tuple(sorted(events, key=lambda e: (e.closest_range_m or math.inf, e.id)))

    def ranges_since(self, event_id: int, time_s: float) -> tuple[TimedRange, ...]:
        """The last ranges of a live event from ``time_s`` on, oldest first, at most twelve."""
        found = self._find(event_id)
        recent = list(found.ranges)[-12:] if found else []
        return tuple(r for r in recent if r.time_s >= time_s)

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

    def note_advice(
        self, event_id: int, action: str, rank: int, reason: str | None, time_s: float
    ) -> None:
        """Remember the first of the most severe advices given because of the event.

        Args:
            event_id: The event.
            action: What was advised.
            rank: Its severity; the higher wins.
            reason: Why.
            time_s: When, media time, seconds.
        """
        found = self._find(event_id)
        if found is not None and rank > found.advice_rank:
            found.advice, found.advice_rank, found.advice_reason = action, rank, reason
            found.advice_time_s = time_s

    def finish(self) -> tuple[Event, ...]:
        """End everything: the confirmed events that were still live."""
        events = self.live()
        self._candidates = []
        return events

    def _find(self, event_id: int) -> Candidate | None:
        return next((c for c in self._candidates if c.id == event_id), None)

    def _confirmed(self, candidate: Candidate, time_s: float, speed_mps: float | None) -> bool:
        """Rules 4 and 6: seen often enough, and long enough where it keeps its distance."""
        if sum(candidate.hits) < self._settings.confirm_hits:
            return False
        seen_s = time_s - candidate.first_time_s
        return seen_s >= self._settings.lose_after_s or not candidate.can_wait(speed_mps)

    def _end_lost(self, time_s: float) -> tuple[Event, ...]:
        limit_s = self._settings.lose_after_s
        lost = [c for c in self._candidates if time_s - c.last_time_s > limit_s]
        self._candidates = [c for c in self._candidates if time_s - c.last_time_s <= limit_s]
        return tuple(c.event() for c in lost if c.id is not None)

    def _associate(
        self,
        time_s: float,
        sightings: tuple[Sighting, ...],
        ego_speed_mps: float | None,
        vanishing_uv: tuple[float, float] | None,
    ) -> list[Candidate | None]:
        """The known candidate each sighting continues, cheapest pairs first, else None."""
        costs: list[tuple[float, int, int]] = []
        for c_index, candidate in enumerate(self._candidates):
            predicted = candidate.range_at(time_s, ego_speed_mps)
            box = candidate.box_at(predicted[0] if predicted else None, vanishing_uv)
            for s_index, sighting in enumerate(sightings):
                cost = self._cost(candidate, predicted, box, sighting)
                if cost is not None:
                    costs.append((cost, s_index, c_index))
        owners: list[Candidate | None] = [None] * len(sightings)
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
        candidate: Candidate,
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
            similar = 0.4 < height(box) / max(height(sighting.box_xyxy), 1.0) < 2.5
            return 1.5 - overlap + bias if similar and overlap > 0 else None
        gate_m = self._near_m(predicted[1], sighting.range_std_m)
        gate_m = max(min(gate_m, 0.5 * max(predicted[0], sighting.range_m)), 2.0)
        if candidate.type == sighting.type == "distortion":
            gate_m = max(gate_m, self._settings.stretch_m)
        apart_m = abs(predicted[0] - sighting.range_m)
        if apart_m > gate_m and self._grows(candidate, predicted[0], box, sighting):
            return 2.0 - overlap + bias
        if apart_m > gate_m or not columns_touch(box, sighting.box_xyxy, slack=0.5):
            return None
        return apart_m / gate_m + (1 - overlap) / 2 + bias

    @staticmethod
    def _grows(candidate: Candidate, range_m: float, box: Box, sighting: Sighting) -> bool:
        """Whether a sighting is a candidate of which only the upper part was seen before.

        A foot that comes out of the haze lowers the range at once, by more than its noise.
        """
        if sighting.range_m is None or sighting.type not in candidate.votes:
            return False
        nearer = FOOT_SHARE * range_m <= sighting.range_m < range_m
        return nearer and overlap_share(box, sighting.box_xyxy) >= 0.6

    def _near_m(self, first_std_m: float | None, second_std_m: float | None) -> float:
        """How far two ranges of one place may lie apart: so far that their intervals touch.

        The deviations add up and not their squares: a camera's range errors last for many frames
        and may turn within one, so the two are no independent draws.
        """
        both_m = (first_std_m or 0.0) + (second_std_m or 0.0)
        return max(self._settings.same_place_m, self._settings.gate_std * both_m)

    def _one_place(self, first: Sighting, second: Sighting) -> bool:
        """Rule 2 for two findings of one frame."""
        touching = boxes_touch(first.box_xyxy, second.box_xyxy)
        if touching and _is_fragment(first, second):
            return True
        if first.range_m is None or second.range_m is None:
            return touching
        near_m = self._near_m(first.range_std_m, second.range_std_m)
        if first.type == second.type == "distortion":
            near_m = max(near_m, self._settings.stretch_m)
        same_range = abs(first.range_m - second.range_m) <= near_m
        return same_range and (touching or first.type == second.type)

    def _merge_same_place(
        self, owners: list[Candidate | None], time_s: float
    ) -> list[Candidate | None]:
        """Join candidates seen now that have come to lie at one place (rule 2), oldest stays."""
        now = [c for c in self._candidates if c.last_time_s == time_s]
        now.sort(key=lambda c: (c.id is None, c.id or 0, c.first_frame))
        replaced: dict[int, Candidate] = {}
        for index, keep in enumerate(now):
            if id(keep) in replaced:
                continue
            for other in now[index + 1 :]:
                if id(other) in replaced or other.id is not None:
                    continue  # two confirmed events keep their ids
                if self._one_place(keep.as_sighting(), other.as_sighting()):
                    keep.absorb(other)
                    replaced[id(other)] = keep
        self._candidates = [c for c in self._candidates if id(c) not in replaced]
        return [replaced.get(id(owner), owner) if owner else None for owner in owners]


def _is_fragment(first: Sighting, second: Sighting) -> bool:
    """Whether one of two touching findings is a piece of the other, by their boxes alone."""
    a, b = first.box_xyxy, second.box_xyxy
    if overlap_share(a, b) >= 0.5:
        return True
    beside = min(a[3], b[3]) - max(a[1], b[1])
    return first.type == second.type and beside >= 0.5 * min(height(a), height(b))
