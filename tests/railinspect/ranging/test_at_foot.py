"""One compiled look at a foot says what the track's own functions say."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from railinspect import labels
from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.findings import place_on_track
from railinspect.ranging.at_foot import commonest_class, foot_place
from railinspect.ranging.small_solve import factorise, substitute
from railinspect.track import TrackFollower


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.1, 0.02, 0.0, 0.0, 0.0)])
def test_a_foot_stands_where_the_track_has_it(distortion: tuple[float, ...]) -> None:
    cam = dataclasses.replace(camera((1280, 720)), yaw_rad=0.02)
    track = TrackFollower(cam).update(draw(cam, 1 / 500))
    bent = dataclasses.replace(track.camera, distortion=distortion)
    track = dataclasses.replace(track, camera=bent)
    path = track.path
    assert path is not None
    for u, v in ((640.0, 700.0), (660.5, 500.5), (500.0, 450.5)):
        place = foot_place(track, u, v)
        chainage = float(place_on_track(track, np.array([[u, v]]))[0][0])
        assert place.plane_m == pytest.approx(chainage)
        along = path.chainage_m
        spacing = 2 * np.interp(chainage, along, path.half_m)
        spacing *= np.interp(chainage, along, path.across_px)
        assert place.spacing_px == pytest.approx(spacing)
        assert place.metre_px == pytest.approx(np.interp(chainage, along, path.metre_px))
    assert np.isnan(foot_place(track, 640.0, 10.0).plane_m)


def test_the_class_is_that_of_the_lower_half() -> None:
    masks = np.full((60, 80), labels.TRACKBED, np.uint8)
    masks[10:30, 20:40] = labels.HUMAN
    masks[30:50, 20:40] = labels.CAR
    assert commonest_class(masks, (20.0, 10.0, 39.0, 49.0)) == labels.CAR
    assert commonest_class(masks, (20.0, 10.0, 39.0, 29.0)) == labels.HUMAN
    assert commonest_class(masks, (200.0, 10.0, 239.0, 49.0)) == -1


@pytest.mark.parametrize("size", [1, 3, 9])
def test_small_systems_are_solved(size: int) -> None:
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size + 2))
    matrix, right, found = root @ root.T, rng.normal(size=size), np.empty(size)
    lower = np.triu(np.full((size, size), np.nan), 1) + np.tril(matrix)  # above it nothing is read
    factorise(lower)
    substitute(lower, right, found)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9)
