"""Judging a whole data set: with its true masks or with a bundle's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from railinspect.camera import Camera
from railinspect.close_ups import CloseUpNetwork
from railinspect.evaluation.answers import Answer, Judge, inspect_still, true_segmentation
from railinspect.evaluation.rides import ClearRides
from railinspect.evaluation.samples import Sample
from railinspect.evaluation.scores import Band, Rate, Scores, score
from railinspect.fovea import Fovea, Network
from railinspect.track.geometry import SegmentationLike


@dataclass(frozen=True)
class Evaluation:
    """One judge over one data set, and over clear rides if asked for.

    Attributes:
        data_set: Folder of the set.
        judge: Who judged, in words.
        masks: Whose masks, in words.
        samples: The pictures.
        answers: The judge's answers, in the same order.
        scores: Their scores.
        rides: What clear rides raised; None if none were ridden.
    """

    data_set: Path
    judge: str
    masks: str
    samples: tuple[Sample, ...]
    answers: tuple[Answer, ...]
    scores: Scores
    rides: ClearRides | None = None

    def as_json(self) -> dict[str, Any]:
        """The document of ``railinspect evaluate --json``; shares are 0 to 1."""
        s = self.scores
        return {
            "data_set": str(self.data_set),
            "judge": self.judge,
            "masks": self.masks,
            "pictures": len(self.samples),
            "accuracy": _rate(s.accuracy),
            "sensitivity": {name: _rate(rate) for name, rate in s.sensitivity.items()},
            "specificity": _rate(s.specificity),
            "named_right": {name: _rate(rate) for name, rate in s.named.items()},
            "named_and_placed_right": {name: _rate(rate) for name, rate in s.placed.items()},
            "unknown": _rate(s.unknown),
            "confusion": [
                {"truth": truth, "said": said, "pictures": count}
                for (truth, said), count in sorted(s.confusion.items())
            ],
            "recall_by_range_m": [_band(band) for band in s.by_range],
            "recall_by_size_px": [_band(band) for band in s.by_size],
            "median_ms": round(s.median_ms, 2),
            "slowest_twentieth_ms": round(s.slowest_ms, 2),
            "clear_rides": None if self.rides is None else _rides(self.rides),
        }


def judge_set(
    samples: Sequence[Sample],
    segmenter: Network | None,
    judge: Judge = inspect_still,
    use_camera: bool = True,
    progress: Callable[[int, float], None] | None = None,
    close_ups: CloseUpNetwork | None = None,
) -> tuple[Answer, ...]:
    """One answer per picture.

    Args:
        samples: The data set.
        segmenter: The network, which looks closer at wide pictures; None takes the set's true
            masks.
        judge: Who answers.
        use_camera: Whether the judge is told the camera where the set knows it.
        progress: Called with pictures done and their share of all.
        close_ups: Looks at the pictures besides true masks; a segmenter brings its own.

    Raises:
        BadInputError: if a picture or, without a segmenter, its mask cannot be read.
    """
    answers = []
    for done, sample in enumerate(samples, 1):
        camera = sample.camera if use_camera else None
        answers.append(judge(masks_of(sample, segmenter, camera, close_ups), camera))
        if progress is not None:
            progress(done, done / len(samples))
    return tuple(answers)


def masks_of(
    sample: Sample,
    segmenter: Network | None,
    camera: Camera | None,
    close_ups: CloseUpNetwork | None = None,
) -> SegmentationLike:
    """A picture's masks: the network's, with closer looks if it is wide, or the true ones.

    Raises:
        BadInputError: if the picture or, without a network, its mask cannot be read.
    """
    if segmenter is None:
        look = None if close_ups is None else partial(close_ups, sample.rgb())
        return true_segmentation(sample.labels(), look)
    return Fovea(segmenter, camera)(sample.rgb())


def evaluated(
    data_set: Path,
    samples: Iterable[Sample],
    answers: Iterable[Answer],
    judge: str,
    masks: str,
    rides: ClearRides | None = None,
) -> Evaluation:
    """Answers with their scores."""
    samples, answers = tuple(samples), tuple(answers)
    return Evaluation(data_set, judge, masks, samples, answers, score(samples, answers), rides)


def _rate(rate: Rate) -> dict[str, Any]:
    low, high = rate.interval()
    share = round(rate.share, 4) if rate.of else None
    return {
        "share": share,
        "interval_95": [round(low, 4), round(high, 4)],
        "hits": rate.hits,
        "of": rate.of,
    }


def _band(band: Band) -> dict[str, Any]:
    high = band.high if band.high != float("inf") else None
    return {"from": band.low, "to": high, **_rate(band.rate)}


def _rides(rides: ClearRides) -> dict[str, Any]:
    return {
        "rides": rides.count,
        "hours": round(rides.hours, 4),
        "km": round(rides.km, 3),
        "frames": rides.frames,
        "unknown_frames": rides.unknown,
        "false_events": len(rides.false_events),
        "false_per_hour": round(rides.per_hour, 3),
        "false_per_km": round(rides.per_km, 4),
        "false_per_hour_at_most_95": round(rides.at_most() / rides.hours, 3),
        "events": [
            {
                "ride_seed": seed,
                "type": event.type,
                "first_time_s": round(event.first_time_s, 3),
                "last_time_s": round(event.last_time_s, 3),
                "closest_range_m": event.closest_range_m,
            }
            for seed, event in rides.false_events
        ],
    }
