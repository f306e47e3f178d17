"""Chainage and lateral position of ground points against a curved track."""

from __future__ import annotations

import numpy as np
import pytest

from railinspect.findings.place import track_coordinates
from railinspect.track.geometry import TrackPath


def arc(radius_m: float, step_m: float = 4.0) -> TrackPath:
    """A path on a circle to the left, sampled so sparsely that points lie between samples."""
    chainage = np.arange(4.0, 180.0, step_m)
    heading = chainage / radius_m
    xy = radius_m * np.stack([np.sin(heading), 1.0 - np.cos(heading)], axis=1)
    even = np.ones(len(chainage))
    nothing = np.zeros((len(chainage), 2))
    return TrackPath(xy, heading, 0.75 * even, chainage, nothing, even, even, even > 0)


@pytest.mark.parametrize("radius_m", [150.0, -150.0, 400.0])
def test_points_beside_a_curve_have_their_arc_s_chainage(radius_m: float) -> None:
    path = arc(radius_m)
    for along in (21.0, 66.5, 122.3):
        turned = along / radius_m
        for aside in (-2.0, 0.0, 1.4):
            x = (radius_m - aside) * np.sin(turned)
            y = radius_m - (radius_m - aside) * np.cos(turned)
            chainage, lateral, _ = track_coordinates(path, np.array([[x, y]]))
            assert chainage[0] == pytest.approx(along, abs=0.1)
            assert lateral[0] == pytest.approx(aside, abs=0.1)
