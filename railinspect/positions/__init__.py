"""Where the train was: satellite fixes from GPX, NMEA and MCAP, and the way between them."""

from railinspect.positions.files import POSITION_SUFFIXES, read_fixes
from railinspect.positions.fixes import Fixes
from railinspect.positions.log import Place, PositionLog

__all__ = ["POSITION_SUFFIXES", "Fixes", "Place", "PositionLog", "read_fixes"]
