"""One place at which something was seen: what the event tracker remembers of it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final

from railinspect.boxes import Box, area, union
from railinspect.event_types import Event, Sighting, TimedRange

TYPE_WEIGHT: Final[dict[str, float]] = {"distortion": 0.5, "obstruction": 1.0, "trespasser": 1.0}
"""Weight of a finding's confidence in the vote on its event's type."""

MAX_CLOSING_MPS: Final = 100.0
"""Fastest approach considered when neither the ego speed nor a closing speed is known, m/s."""

NEAREST_VOTE_M: Final = 5.0
"""Range below which a vote on the type grows no more, metres."""

UNKNOWN_VOTES_AS_M: Final = 50.0
"""Range at which a sighting without any range votes, metres."""

REMEMBERED: Final = 24
"""Number of last ranges kept: enough that their noise leaves a closing speed."""

PREDICTED_FROM: Final = 3
"""Number of last ranges a prediction is the median of."""

RUNNER_MPS: Final = 8.0
"""Nobody keeps ahead of a train at this speed on foot, m/s."""

KEPT_SHARE: Final = 0.3
"""What stands comes nearer at the train's speed; at less than this share of it, surely, it does
not stand."""


@dataclass
class Candidate:
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
    ranges: deque[TimedRange] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    first_range: tuple[float, tuple[float, float] | None] | None = None
    closest: tuple[float, tuple[float, float] | None, float] | None = None
    best_quality: float = -1.0
    best_frame: int = 0
    best_box_xyxy: Box = (0.0, 0.0, 0.0, 0.0)
    advice: str | None = None
    advice_reason: str | None = None
    advice_rank: int = -1
    advice_time_s: float | None = None
    doubted: str | None = None
    thumbnail_jpeg: bytes | None = None

    @property
    def type(self) -> str:
        """The type with the most votes."""
        return max(self.votes, key=lambda name: self.votes[name])

    def closing_mps(self, ego_speed_mps: float | None) -> tuple[float, float] | None:
        """Speed at which the place comes nearer and its standard deviation, m/s; None if unknown.

        The ego speed where it is known, else the slope of a line through the last ranges.
        """
        if not self.ranges:
            return None
        share = self.ranges[-1].std_m / max(self.ranges[-1].range_m, 1.0)
        if ego_speed_mps is not None:  # an error in proportion to the range is one of speed too
            return ego_speed_mps, 1.0 + share * ego_speed_mps
        fitted = _approach(self.ranges)
        if fitted is None:
            return None
        closing = min(max(fitted[0], 0.0), MAX_CLOSING_MPS)
        return closing, 2.0 + 0.2 * closing + fitted[1]

    def doubt(self, ego_speed_mps: float | None) -> str | None:
        """Why it cannot be a thing that stands on the ground; None where nothing speaks against.

        What stands comes nearer as fast as the train runs. What surely does not, at a speed at
        which nobody runs ahead, is something that rolls ahead of the train, or no thing at all: a
        reflection, a wiper, dirt, a part of the own vehicle. A distortion is not judged, since a
        long one has a near end for as long as it lasts, nor what the picture's edge cuts.
        """
        if ego_speed_mps is None or ego_speed_mps < RUNNER_MPS:
            return None
        seen = self._keeping(KEPT_SHARE * ego_speed_mps)
        if not seen:
            return None
        run_m = ego_speed_mps * (seen[-1].time_s - seen[0].time_s)
        return (
            f"keeps its distance of {seen[-1].range_m:.0f} m while the train runs {run_m:.0f} m: "
            "it moves ahead of the train or is in the picture only (reflection, wiper, dirt)"
        )

    def can_wait(self, ego_speed_mps: float | None) -> bool:
        """Whether watching it some seconds longer costs next to no way, so that it may be doubted.

        Where the speed is unknown, what surely comes nearer no faster than a walk stands before a
        train that stands or crawls, or is in the picture only.
        """
        if ego_speed_mps is None:
            return bool(self._keeping(KEPT_SHARE * RUNNER_MPS))
        return self.doubt(ego_speed_mps) is not None

    def _keeping(self, limit_mps: float) -> list[TimedRange]:
        """The ranges by which it surely comes nearer more slowly than this; none if it may not."""
        seen = [r for r in self.ranges if r.whole]
        fitted = _approach(seen, whole_error=False)
        surely = fitted is not None and fitted[0] + 3.0 * fitted[1] < limit_mps
        return seen if surely and self.type != "distortion" else []

    def range_at(self, time_s: float, ego_speed_mps: float | None) -> tuple[float, float] | None:
        """Predicted range and its standard deviation, metres; None without any range so far.

        The median of the last sightings, each carried forward to ``time_s``: one bad range does
        not lead the prediction astray. Its standard deviation is no smaller than that of one
        sighting, because what a camera's ranges have wrong they mostly have wrong together.
        """
        if not self.ranges:
            return None
        last = self.ranges[-1]
        closing = self.closing_mps(ego_speed_mps)
        if closing is None:
            # Anything between standing still and the fastest approach: centre and half width.
            half_m = min(last.range_m, MAX_CLOSING_MPS * (time_s - last.time_s)) / 2
            return last.range_m - half_m, math.hypot(last.std_m, half_m)
        recent = list(self.ranges)[-PREDICTED_FROM:]
        range_m = median(r.range_m - closing[0] * (time_s - r.time_s) for r in recent)
        gone_s = time_s - median(r.time_s for r in recent)
        return range_m, math.hypot(last.std_m, closing[1] * gone_s)

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

    def see(self, frame_index: int, time_s: float, sighting: Sighting) -> None:
        """Take in a sighting; several of one frame count once, the nearest range leading."""
        again = self.frames_seen > 0 and self.last_frame == frame_index
        self.last_time_s, self.last_frame = time_s, frame_index
        self.frames_seen += not again
        vote = TYPE_WEIGHT.get(sighting.type, 1.0) * sighting.confidence / self._voting_m(sighting)
        self.votes[sighting.type] = self.votes.get(sighting.type, 0.0) + vote
        if again:
            self.box_xyxy = union(self.box_xyxy, sighting.box_xyxy)
        else:
            self.confidence_sum += sighting.confidence
            self.box_xyxy = sighting.box_xyxy
        quality = sighting.confidence * math.sqrt(area(self.box_xyxy) + 1)
        quality *= 1.0 if sighting.whole else 0.5
        if quality > 1.2 * self.best_quality:  # in steps, so few pictures are cut out
            self.best_quality, self.best_frame = quality, frame_index
            self.best_box_xyxy = self.box_xyxy
        if sighting.range_m is not None:
            self._see_range(time_s, sighting, sighting.range_m, again)

    def _voting_m(self, sighting: Sighting) -> float:
        """What a vote on the type is divided by: its range, metres. The near is seen large."""
        last_m = self.ranges[-1].range_m if self.ranges else UNKNOWN_VOTES_AS_M
        return max(sighting.range_m or last_m, NEAREST_VOTE_M)

    def _see_range(self, time_s: float, sighting: Sighting, range_m: float, again: bool) -> None:
        bounds = sighting.range_interval_m or (range_m, range_m)
        std_m = sighting.range_std_m or 0.0
        noise_m = std_m if sighting.range_noise_m is None else sighting.range_noise_m
        measured = TimedRange(time_s, range_m, std_m, bounds, min(noise_m, std_m), sighting.whole)
        if again and self.ranges and self.ranges[-1].time_s == time_s:
            if range_m < self.ranges[-1].range_m:  # the nearer end of the same thing counts
                self.ranges[-1] = measured
        else:
            self.ranges.append(measured)
        if self.first_range is None:
            self.first_range = (range_m, sighting.range_interval_m)
        if self.closest is None or range_m < self.closest[0]:
            self.closest = (range_m, sighting.range_interval_m, time_s)

    def as_sighting(self) -> Sighting:
        """The candidate as it was last seen."""
        last = self.ranges[-1] if self.ranges else None
        return Sighting(
            self.type,
            1.0,
            self.box_xyxy,
            last.range_m if last else None,
            last.std_m if last else None,
        )

    def absorb(self, other: Candidate) -> None:
        """Take over what another candidate has seen of the same place."""
        for name, votes in other.votes.items():
            self.votes[name] = self.votes.get(name, 0.0) + votes
        if other.first_frame < self.first_frame:
            self.first_frame, self.first_time_s = other.first_frame, other.first_time_s
            self.first_range = other.first_range or self.first_range
        if other.closest and (self.closest is None or other.closest[0] < self.closest[0]):
            self.closest = other.closest
        self.box_xyxy = union(self.box_xyxy, other.box_xyxy)

    def event(self) -> Event:
        """The candidate as an event; only for confirmed ones."""
        assert self.id is not None
        assert self.confirmed_time_s is not None
        total = sum(self.votes.values()) or 1.0
        first, closest = self.first_range, self.closest
        return Event(
            id=self.id,
            type=self.type,
            first_time_s=self.first_time_s,
            confirmed_time_s=self.confirmed_time_s,
            last_time_s=self.last_time_s,
            first_frame=self.first_frame,
            last_frame=self.last_frame,
            best_frame=self.best_frame,
            best_box_xyxy=self.best_box_xyxy,
            frames_seen=self.frames_seen,
            confidence=self.confidence_sum / max(self.frames_seen, 1),
            type_shares={name: votes / total for name, votes in sorted(self.votes.items())},
            first_range_m=first[0] if first else None,
            first_range_interval_m=first[1] if first else None,
            closest_range_m=closest[0] if closest else None,
            closest_range_interval_m=closest[1] if closest else None,
            closest_time_s=closest[2] if closest else None,
            advice=self.advice,
            advice_reason=self.advice_reason,
            advice_time_s=self.advice_time_s,
            thumbnail_jpeg=self.thumbnail_jpeg,
            doubt=self.doubted,
        )


def _approach(ranges: Sequence[TimedRange], whole_error: bool = True) -> tuple[float, float] | None:
    """Speed of approach by a line through the ranges and its standard deviation, m/s.

    Without the whole error only what changes from frame to frame counts: a scale that is wrong for
    all ranges alike is wrong for a speed seen with the same camera too.
    """
    if len(ranges) < 4 or ranges[-1].time_s - ranges[0].time_s < 0.15:
        return None
    times = [r.time_s - ranges[0].time_s for r in ranges]
    mean_t = sum(times) / len(times)
    mean_r = sum(r.range_m for r in ranges) / len(times)
    spread = sum((t - mean_t) ** 2 for t in times)
    pairs = list(zip(times, ranges, strict=True))
    slope = sum((t - mean_t) * (r.range_m - mean_r) for t, r in pairs) / spread
    if whole_error:
        error_m = sum(r.std_m for r in ranges) / len(times)
    else:
        misfit = sum((r.range_m - mean_r - slope * (t - mean_t)) ** 2 for t, r in pairs)
        noise_m = sum(r.noise_m for r in ranges) / len(times)
        error_m = max(noise_m, math.sqrt(misfit / len(times)))
    return -slope, error_m / math.sqrt(spread)
