"""Metrics against a confusion matrix worked by hand and against an independent implementation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fscnn.training.metrics import Scores, confusion_matrix, intersection_over_union, union_iou
from railinspect.labels import RAIL_EMBEDDED, RAIL_RAISED, SKY, TRACKBED, VOID

# Six pixels, one void. Rows are truth, columns prediction:
#   truth       sky  sky  bed  rail-raised  rail-embedded  void
#   predicted   sky  bed  bed  rail-embedded rail-embedded sky
TRUTH = np.array([[SKY, SKY, TRACKBED, RAIL_RAISED, RAIL_EMBEDDED, VOID]], np.uint8)
PREDICTED = np.array([[SKY, TRACKBED, TRACKBED, RAIL_EMBEDDED, RAIL_EMBEDDED, SKY]], np.uint8)


def test_hand_worked_confusion_matrix() -> None:
    matrix = confusion_matrix(TRUTH, PREDICTED)
    assert matrix.shape == (19, 19)
    assert matrix.sum() == 5
    assert matrix[SKY, SKY] == 1
    assert matrix[SKY, TRACKBED] == 1
    assert matrix[TRACKBED, TRACKBED] == 1
    assert matrix[RAIL_RAISED, RAIL_EMBEDDED] == 1
    assert matrix[RAIL_EMBEDDED, RAIL_EMBEDDED] == 1


def test_hand_worked_scores() -> None:
    scores = Scores()
    scores.add(TRUTH, PREDICTED)
    summary = scores.summary()
    iou = summary["iou"]
    assert isinstance(iou, dict)
    assert iou["sky"] == 1 / 2  # 1 hit, 1 missed
    assert iou["trackbed"] == 1 / 2  # 1 hit, 1 false
    assert iou["rail-raised"] == 0  # 1 missed
    assert iou["rail-embedded"] == 1 / 2  # 1 hit, 1 false
    assert math.isnan(iou["human"])
    assert summary["rail_iou"] == 1  # as one class both rails are right
    assert summary["mean_iou"] == pytest.approx((0.5 + 0.5 + 0 + 0.5) / 4)
    assert summary["accuracy"] == 3 / 5


def test_absent_classes_are_nan_not_zero() -> None:
    empty = np.zeros((19, 19), np.int64)
    assert np.isnan(intersection_over_union(empty)).all()
    assert math.isnan(union_iou(empty))
    summary = Scores().summary()
    for name in ("mean_iou", "accuracy", "rail_iou", "thin_f", "ece"):
        assert math.isnan(summary[name]), name


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), void=st.floats(0, 1))
def test_agrees_with_an_independent_implementation(seed: int, void: float) -> None:
    """Sets of pixel positions instead of a matrix."""
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 19, (9, 11)).astype(np.uint8)
    truth[rng.random(truth.shape) < void] = VOID
    predicted = rng.integers(0, 19, (9, 11)).astype(np.uint8)
    found = intersection_over_union(confusion_matrix(truth, predicted))
    places = {(v, u) for v, u in np.ndindex(truth.shape) if truth[v, u] != VOID}
    for label in range(19):
        real = {p for p in places if truth[p] == label}
        said = {p for p in places if predicted[p] == label}
        if real | said:
            assert found[label] == pytest.approx(len(real & said) / len(real | said))
        else:
            assert math.isnan(found[label])


def test_thin_structures_within_tolerance() -> None:
    truth = np.full((20, 20), TRACKBED, np.uint8)
    predicted = truth.copy()
    truth[:, 5] = RAIL_RAISED
    predicted[:, 8] = RAIL_RAISED  # three pixels off
    predicted[:10, 18] = RAIL_RAISED  # and a false one
    for tolerance, precision, recall in ((2, 0.0, 0.0), (3, 20 / 30, 1.0)):
        scores = Scores(tolerance_px=tolerance)
        scores.add(truth, predicted)
        summary = scores.summary()
        assert summary["thin_precision"] == pytest.approx(precision)
        assert summary["thin_recall"] == pytest.approx(recall)
    assert summary["thin_f"] == pytest.approx(2 * precision * recall / (precision + recall))


def test_calibration_error_by_hand() -> None:
    # Four pixels at 0.8, half of them right; four at 0.4, half right: (0.3 + 0.1) / 2.
    truth = np.array([[SKY] * 8], np.uint8)
    predicted = np.array([[SKY, SKY, 0, 0, SKY, SKY, 0, 0]], np.uint8)
    confidence = np.array([[204] * 4 + [102] * 4], np.uint8)
    scores = Scores()
    scores.add(truth, predicted, confidence)
    assert scores.summary()["ece"] == pytest.approx((0.3 + 0.1) / 2)
