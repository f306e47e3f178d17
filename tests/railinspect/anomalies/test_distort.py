import math

import numpy as np
import pytest

from railinspect.anomalies.distort import Distortion, displacement_m, distort
from railinspect.labels import CLASSES
from tests.railinspect.anomalies.flat_track import a_camera, flat_picture


def rail_centres(labels, track, row, shift_px=0.0):
    out = []
    for column in (track.left_px, track.right_px):
        centre = np.interp(-row, -track.rows_px, column) + shift_px
        low = max(0, round(centre) - 14)
        hits = np.flatnonzero(labels[row, low : low + 29] == 17)
        out.append(low + hits.mean() if len(hits) else np.nan)
    return np.array(out)


def test_ripple_is_equation_47_with_the_row_in_the_sine():
    rows = np.arange(400.0, 299.0, -1.0)
    along = np.linspace(10.0, 20.0, 101)
    wave = displacement_m(Distortion("ripple", 10.0, 10.0, 0.2, waves=2.0), rows, along)
    # ν' = 400 is the near row, 300 the far one; λ = 100/2 rows
    raw = [(400 - v) / 100 * math.sin(2 * math.pi * (v - 300) / 50) for v in rows]
    np.testing.assert_allclose(wave, 0.2 * np.array(raw) / np.abs(raw).max(), atol=1e-12)
    assert np.abs(wave).max() == pytest.approx(0.2)
    assert abs(wave[0]) < 1e-12
    assert abs(wave[-1]) < 1e-12


def test_buckle_is_one_bulge_of_its_amplitude():
    rows = np.arange(400.0, 299.0, -1.0)
    along = np.linspace(5.0, 25.0, 101)
    bulge = displacement_m(Distortion("buckle", 10.0, 10.0, -0.25), rows, along)
    assert bulge.min() == pytest.approx(-0.25)
    assert (bulge <= 0).all()
    assert (bulge[(along < 10) | (along > 20)] == 0).all()


@pytest.mark.parametrize("kind", ["ripple", "buckle"])
def test_rails_in_the_mask_lie_where_the_metres_put_them(kind):
    camera = a_camera()
    rgb, labels, track = flat_picture(camera, 900.0)
    before, plan = labels.copy(), Distortion(kind, 10.0, 14.0, 0.25, 2.0)
    _, notes, moved = distort(rgb, labels, track, plan)
    seen = []
    for row in range(int(moved.v[0]) + 2, int(moved.v[-1]) - 2, 3):
        shift = np.interp(row, moved.v, moved.shift_px)
        along = np.interp(-row, -track.rows_px, track.along_m)
        metres = displacement_m(plan, moved.v, np.interp(-moved.v, -track.rows_px, track.along_m))
        assert -np.interp(row, moved.v, metres) * np.interp(
            along, track.along_m, track.metre_px
        ) == pytest.approx(shift, abs=0.05)
        old, new = rail_centres(before, track, row), rail_centres(labels, track, row, shift)
        np.testing.assert_allclose(new - old, shift, atol=1.0)
        seen.append(abs(shift))
    assert max(seen) > 5
    assert notes["amplitude_px"] == pytest.approx(max(seen), rel=0.2)


def test_the_picture_moves_with_the_mask_and_only_there():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    base = rgb.copy()
    polygon, _, moved = distort(rgb, labels, track, Distortion("buckle", 12.0, 10.0, 0.3))
    changed = np.flatnonzero((rgb != base).any(axis=(1, 2)))
    assert changed.min() >= moved.v[0]
    assert changed.max() <= moved.v[-1]
    assert polygon[:, 1].min() >= moved.v[0] - 1
    row = int(moved.v[np.argmax(np.abs(moved.shift_px))])
    bright = rgb[row].mean(axis=1) > 185
    on_rail = labels[row] == 17
    assert (bright & on_rail).sum() >= 0.7 * on_rail.sum()


def test_points_of_the_rails_move_with_them():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    _, _, moved = distort(rgb, labels, track, Distortion("ripple", 10.0, 12.0, 0.2))
    rail = np.stack([track.left_px, track.rows_px], axis=-1)
    gone = moved(rail)
    inside = (rail[:, 1] >= moved.v[0]) & (rail[:, 1] <= moved.v[-1])
    np.testing.assert_allclose(
        gone[inside, 0] - rail[inside, 0],
        np.interp(rail[inside, 1], moved.v, moved.shift_px),
        atol=1e-9,
    )
    np.testing.assert_array_equal(gone[~inside], rail[~inside])
    far_away = np.array([[5.0, float(moved.v.mean())]])
    np.testing.assert_array_equal(moved(far_away), far_away)


@pytest.mark.parametrize(("kind", "missing"), [("gap", 3.0), ("break", 1.5 * 0.33)])
def test_a_missing_piece_of_rail_is_missing_in_mask_and_picture(kind, missing):
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    distort(
        rgb,
        labels,
        track,
        Distortion(kind, 10.0, 3.0 if kind == "gap" else 1.5, 0.05, rails=(True, False)),
    )
    near, far = np.interp([10.0, 10.0 + missing], track.along_m, track.rows_px)
    middle = round(0.5 * (near + far))
    left, right = rail_centres(labels, track, middle)
    assert np.isnan(left)
    assert np.isfinite(right)
    column = round(np.interp(-middle, -track.rows_px, track.left_px))
    assert rgb[middle, column].mean() < 160
    assert labels.max() < len(CLASSES)
    beyond = round(np.interp(9.0, track.along_m, track.rows_px))
    assert np.isfinite(rail_centres(labels, track, beyond)).all()


def test_a_straight_track_mirrored_distorts_mirrored():
    camera = a_camera()
    rgb, labels, track = flat_picture(camera)
    _, _, one = distort(rgb.copy(), labels.copy(), track, Distortion("ripple", 10.0, 12.0, 0.2))
    _, _, other = distort(rgb.copy(), labels.copy(), track, Distortion("ripple", 10.0, 12.0, -0.2))
    np.testing.assert_allclose(one.shift_px, -other.shift_px)
