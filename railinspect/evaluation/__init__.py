"""Judging the inspector, or any other judge, against data sets whose truth is known."""

from railinspect.evaluation.answers import Answer, Judge, inspect_still, true_segmentation
from railinspect.evaluation.rides import ClearRides, clear_rides, ride_through
from railinspect.evaluation.run import Evaluation, evaluated, judge_set
from railinspect.evaluation.samples import Anomaly, Sample, read_samples
from railinspect.evaluation.scores import Band, Rate, Scores, score

__all__ = [
    "Anomaly",
    "Answer",
    "Band",
    "ClearRides",
    "Evaluation",
    "Judge",
    "Rate",
    "Sample",
    "Scores",
    "clear_rides",
    "evaluated",
    "inspect_still",
    "judge_set",
    "read_samples",
    "ride_through",
    "score",
    "true_segmentation",
]
