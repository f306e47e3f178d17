"""Close-ups: where they are cut, at which scale, and which files are their network."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper

from railinspect.close_ups import (
    ANSWERS,
    FARTHEST_M,
    METADATA_KEY,
    PLACE_UV,
    PX_PER_M,
    STEP,
    WINDOW_WH,
    CloseUpNetwork,
    close_up,
    expected_metadata,
    golden_windows,
    places,
)
from railinspect.errors import BundleError
from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.segmenter import Segmenter
from railinspect.track import TrackFollower
from tests.railinspect.hand_bundle import bundle

WIDE = camera((1920, 1080))


def grainy(most: int) -> np.ndarray:
    """A dark picture 1920×1080, coarse grain up to ``most`` grey levels in it."""
    coarse = np.random.default_rng(5).integers(0, most + 1, (108, 192, 3), np.uint8)
    return np.kron(coarse, np.ones((10, 10, 1), np.uint8)) + np.uint8(8)


def by_hand(said: dict[str, object] | None = None, classes: int = len(ANSWERS)) -> bytes:
    """A network whose chances are the mean of each window's red channel, for every answer."""
    width, height = WINDOW_WH
    windows = helper.make_tensor_value_info(
        "windows", TensorProto.UINT8, ["batch", height, width, 3]
    )
    chances = helper.make_tensor_value_info("chances", TensorProto.FLOAT, ["batch", classes])
    red = helper.make_tensor("red", TensorProto.INT64, [1], [0])
    times = helper.make_tensor("times", TensorProto.INT64, [2], [1, classes])
    full = helper.make_tensor("full", TensorProto.FLOAT, [1], [255.0])
    axes = helper.make_tensor("axes", TensorProto.INT64, [2], [1, 2])
    nodes = [
        helper.make_node("Cast", ["windows"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("Gather", ["float", "red"], ["channel"], axis=3),
        helper.make_node("ReduceMean", ["channel", "axes"], ["mean"], keepdims=0),
        helper.make_node("Div", ["mean", "full"], ["share"]),
        helper.make_node("Tile", ["share", "times"], ["chances"]),
    ]
    graph = helper.make_graph(nodes, "by hand", [windows], [chances], [red, times, full, axes])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(said or expected_metadata())
    return bytes(model.SerializeToString())


@given(
    u=st.floats(300, 1600),
    v=st.floats(560, 900),
    metre=st.floats(8, 300),
)
def test_the_place_and_the_metre_come_to_lie_where_they_should(
    u: float, v: float, metre: float
) -> None:
    # red rises by the column, green by the row: a window's pixel says where it was cut
    column = np.arange(1920) / 1919 * 255
    row = np.arange(1080) / 1079 * 255
    picture = np.zeros((1080, 1920, 3), np.uint8)
    picture[..., 0], picture[..., 1] = column[None].round(), row[:, None].round()
    window = close_up(picture, (u, v), metre)
    assert window is not None
    assert window.shape == (WINDOW_WH[1], WINDOW_WH[0], 3)
    at = window[PLACE_UV[1], PLACE_UV[0]].astype(float)
    pixel = metre / PX_PER_M + 1.5
    assert abs(at[0] / 255 * 1919 - u) <= 4 + pixel  # a grey level is 7.5 columns
    assert abs(at[1] / 255 * 1079 - v) <= 2.5 + pixel
    aside = PLACE_UV[0] + round(PX_PER_M)
    if u + 1.3 * metre < 1919:
        moved = window[PLACE_UV[1], aside, 0] / 255 * 1919 - at[0] / 255 * 1919
        assert abs(moved - metre) <= 8 + pixel


def test_outside_of_the_picture_its_border_is_repeated() -> None:
    picture = np.zeros((360, 640, 3), np.uint8)
    picture[-1] = 200
    window = close_up(picture, (320.0, 358.0), 20.0)
    assert window is not None
    assert (window[-10:] == 200).all()
    assert (window[:40] == 0).all()


def test_a_window_beside_the_picture_is_none() -> None:
    picture = np.zeros((360, 640, 3), np.uint8)
    assert close_up(picture, (2000.0, 300.0), 20.0) is None
    assert close_up(picture, (320.0, -500.0), 20.0) is None


def test_places_follow_the_track_as_far_as_it_is_seen_and_a_little_on() -> None:
    track = TrackFollower(WIDE).update(draw(WIDE))
    assert track.reach_m is not None
    at = places(track)
    assert len(at) > 20
    assert np.allclose(at[1:] / at[:-1], STEP)
    assert 0.8 * min(track.reach_m, FARTHEST_M) < at[-1] <= FARTHEST_M
    near = places(track, 20.0, 40.0)
    assert near.min() >= 20.0
    assert near.max() <= 40.0
    assert set(near) <= set(at)


def test_without_a_track_there_are_no_places() -> None:
    blank = draw(WIDE)
    empty = dataclasses.replace(blank, rail_score=np.zeros_like(blank.rail_score))
    empty = dataclasses.replace(empty, labels=np.full_like(blank.labels, 10))
    track = TrackFollower(WIDE).update(empty)
    assert track.path is None
    assert len(places(track)) == 0
    found = CloseUpNetwork(by_hand())(np.zeros((1080, 1920, 3), np.uint8), track)
    assert found.chances.shape == (0, len(ANSWERS))


def test_each_place_gets_its_own_windows_answer() -> None:
    drawn = draw(WIDE)
    track = TrackFollower(WIDE).update(drawn)
    picture = grainy(10)
    picture[: round(WIDE.horizon_v()) + 60, :, 0] = 250  # far places are red
    found = CloseUpNetwork(by_hand())(picture, track)
    assert len(found.chainage_m) == len(places(track))
    assert found.chances[-1, 0] > 0.9
    assert found.chances[0, 0] < 0.75
    assert (np.diff(found.chances[:, 0]) > -0.02).all()


@pytest.mark.parametrize(("grey", "grain"), [(0, 0), (1, 1), (255, 0)])
def test_nobody_looks_where_nothing_shows(grey: int, grain: int) -> None:
    track = TrackFollower(WIDE).update(draw(WIDE))
    look = CloseUpNetwork(by_hand())
    picture = grainy(grain)
    picture[:] = np.clip(picture.astype(int) - 8 + grey, 0, 255)
    assert len(look(picture, track).chainage_m) == 0
    picture[: round(WIDE.horizon_v()) + 60] = grainy(16)[: round(WIDE.horizon_v()) + 60]
    far = look(picture, track).chainage_m
    assert 3 < len(far) < len(places(track))
    assert far.min() > places(track).min()


def test_more_windows_than_a_batch_come_back_in_order() -> None:
    width, height = WINDOW_WH
    windows = np.zeros((150, height, width, 3), np.uint8)
    windows += np.arange(150, dtype=np.uint8)[:, None, None, None]
    chances = CloseUpNetwork(by_hand()).chances(windows)
    assert np.allclose(chances[:, 0] * 255, np.arange(150), atol=1e-3)


def test_the_shipped_network_gives_here_what_it_gave_where_it_was_made() -> None:
    network = CloseUpNetwork.default()
    expected = np.array(network.metadata["golden_chances"])
    chances = network.chances(golden_windows())
    assert np.allclose(chances, expected, atol=1e-3)
    assert np.allclose(chances.sum(axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"no onnx", "not an ONNX file"),
        (bundle(), "no close-up network of ours"),
        (by_hand({**expected_metadata(), "px_per_m": 10.0}), "has px_per_m 10.0"),
        (by_hand({"format": 1}), "metadata .* damaged"),
        (by_hand(classes=3), "expected"),
    ],
)
def test_another_file_is_refused_in_words(data: bytes, reason: str) -> None:
    with pytest.raises(BundleError, match=reason):
        CloseUpNetwork(data)


def test_a_close_up_network_is_no_bundle(tmp_path: Path) -> None:
    path = tmp_path / "close_up.onnx"
    path.write_bytes(by_hand())
    with pytest.raises(BundleError):
        Segmenter.load(path)
    onnx.checker.check_model(onnx.load(path))
    with pytest.raises(BundleError, match="cannot read"):
        CloseUpNetwork.load(tmp_path / "none.onnx")


def test_nobody_looks_where_the_track_has_left_the_picture() -> None:
    track = TrackFollower(WIDE).update(draw(WIDE))
    assert track.path is not None
    uv = track.path.uv.copy()
    uv[track.path.chainage_m > 30.0, 0] += 1000.0  # as if it turned sharply
    turned = dataclasses.replace(track, path=dataclasses.replace(track.path, uv=uv))
    found = CloseUpNetwork(by_hand())(grainy(10), turned)
    assert len(places(turned)) > len(found.chainage_m) > 5
    assert found.chainage_m.max() <= 30.0
