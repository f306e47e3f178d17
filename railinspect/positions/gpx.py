"""Track points of a GPX file."""

from __future__ import annotations

import math
from pathlib import Path

from railinspect.clock import clock_time, finite
from railinspect.errors import BadInputError
from railinspect.positions.fixes import Fixes, FixList
from railinspect.xml_elements import read_elements


def read_gpx(path: Path, what: str) -> Fixes:
    """The points of all tracks in a GPX file of any version.

    Args:
        path: The file.
        what: What it is to the user, for messages.

    Raises:
        BadInputError: if it is no GPX file, or a point lacks its place or its time.
    """
    found = FixList(what)
    points = read_elements(path, "gpx", ("trkpt",), what, "a GPX file")
    for number, point in enumerate(points, start=1):
        values = {child.tag.lower(): (child.text or "") for child in point.iter()}
        try:
            at = clock_time(values["time"]).timestamp()
            place = (finite(point.attrib["lat"]), finite(point.attrib["lon"]))
            speed = finite(values["speed"]) if "speed" in values else math.nan
        except (KeyError, ValueError):
            raise BadInputError(
                f"{what}, track point {number}: needs lat, lon and a time with its zone, all of "
                "them readable"
            ) from None
        found.add(at, place, speed)
    return found.fixes()
