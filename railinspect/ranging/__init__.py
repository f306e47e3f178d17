"""Ranges along the track, each with its error."""

from railinspect.ranging.along_track import FrameRanging, RangingSettings, range_of
from railinspect.ranging.fusion import Absent, Estimate, Range, Reading, combine
from railinspect.ranging.goniometric import SizeRange, range_from_size
from railinspect.ranging.ground_plane import PlaneRange, range_from_row
from railinspect.ranging.speed import Motion, MotionFilter, Speed
from railinspect.ranging.track_scale import ScaleSettings, TrackScale, fit_scale

__all__ = [
    "Absent",
    "Estimate",
    "FrameRanging",
    "Motion",
    "MotionFilter",
    "PlaneRange",
    "Range",
    "RangingSettings",
    "Reading",
    "ScaleSettings",
    "SizeRange",
    "Speed",
    "TrackScale",
    "combine",
    "fit_scale",
    "range_from_row",
    "range_from_size",
    "range_of",
]
