"""Ranges along the track, each with its error."""

from railinspect.ranging.along_track import RangingSettings, range_of
from railinspect.ranging.fusion import Estimate, Range, combine
from railinspect.ranging.goniometric import SizeRange, range_from_size
from railinspect.ranging.ground_plane import PlaneRange, range_from_row

__all__ = [
    "Estimate",
    "PlaneRange",
    "Range",
    "RangingSettings",
    "SizeRange",
    "combine",
    "range_from_row",
    "range_from_size",
    "range_of",
]
