"""Compiling the loop's inner functions before the clock runs.

The track follower and the stopping distance are compiled to machine code on their first use and
kept on disk. On a machine that has never run them this takes some ten seconds, which belong to no
frame.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np

from railinspect.camera import Camera
from railinspect.labels import HUMAN, RAIL_RAISED, TRACKBED
from railinspect.pipeline import Inspector
from railinspect.segmenter import Segmentation
from railinspect.video import Frame
from railops.braking import Train

_SIZE_WH = (1024, 576)  # from COARSE_PX on feet are looked up in the picture


@functools.cache
def warm_up() -> None:
    """Run the loop once per process on a drawn track with a person on it, without a network."""
    camera = Camera.from_field_of_view(_SIZE_WH, np.radians(50.0), 2.6, pitch_rad=0.045)
    drawn = drawn_track(camera)
    inspector = Inspector(lambda rgb: drawn, camera, Train(speed_mps=20.0))
    blank = np.zeros((_SIZE_WH[1], _SIZE_WH[0], 3), np.uint8)
    for index in range(5):  # the fourth confirms the person, which asks for an advice
        inspector.feed(Frame(index, 0.04 * index, blank))


def drawn_track(camera: Camera) -> Segmentation:
    """The segmentation of a straight track with a person standing on it 30 m ahead."""
    width, height = camera.size_wh
    labels = np.full((height, width), TRACKBED, np.uint8)
    along = np.geomspace(4.0, 300.0, 60)
    for y in (-camera.rail_spacing_m / 2, camera.rail_spacing_m / 2):
        rail = camera.project(np.stack([along, np.full(60, y), np.zeros(60)], axis=1))
        points = np.round(rail * 8).astype(np.int32)
        cv2.polylines(labels, [points], False, RAIL_RAISED, 3, cv2.LINE_8, 3)
    (x0, y0), (x1, y1) = camera.project([[30.0, 0.3, 1.8], [30.0, -0.3, 0.0]])
    labels[round(y0) : round(y1), round(x0) : round(x1)] = HUMAN
    score = np.where(labels == RAIL_RAISED, 240, 5).astype(np.uint8)
    return Segmentation(labels, np.full(labels.shape, 230, np.uint8), score)
