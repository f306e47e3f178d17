"""Training windows: what stands at their place is their answer, and nothing else varies them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fscnn.close_ups import cache
from fscnn.close_ups.dataset import WindowSet, read, varied
from fscnn.close_ups.windows import (
    AT_PLACE,
    MARGIN_PX,
    SIZE_WH,
    Windows,
    _apart,
    _shown,
    drawn,
    rendered,
)
from railinspect.anomalies.ego import EgoTrack
from railinspect.close_ups import ANSWERS, WINDOW_WH
from railinspect.errors import BadInputError
from railinspect.evaluation.drawn_tracks import camera
from railinspect.labels import HUMAN
from railinspect.scenes.render import SceneObject

SEEDS = range(31_000_000, 31_000_006)


@pytest.fixture(scope="module")
def world() -> tuple[int, Windows]:
    """The first seed with a track, and its windows."""
    return next((seed, w) for seed in SEEDS if (w := drawn(seed)) is not None)


def test_a_drawn_world_shows_its_clear_track_and_two_anomalies_of_each_type_twice(
    world: tuple[int, Windows],
) -> None:
    _, windows = world
    count = np.bincount(windows.answers, minlength=len(ANSWERS))
    assert count[0] >= 6
    assert count[1:].tolist() == [4, 4, 4]
    assert {image.shape for image in windows.images} == {(SIZE_WH[1], SIZE_WH[0], 3)}


def test_an_anomaly_changes_the_window_at_its_place(world: tuple[int, Windows]) -> None:
    _, windows = world
    people = [i for i, a in zip(windows.images, windows.answers, strict=True) if a == 3]
    middle = np.s_[SIZE_WH[1] // 4 : -SIZE_WH[1] // 4, SIZE_WH[0] // 4 : -SIZE_WH[0] // 4]
    # a person where there was ballast and rails: two windows of different people differ there
    assert np.abs(people[0][middle].astype(int) - people[2][middle]).mean() > 3


def test_rendered_worlds_show_all_answers_between_them() -> None:
    answers = [
        a for seed in range(32_000_000, 32_000_030) if (w := rendered(seed)) for a in w.answers
    ]
    assert set(answers) >= {0, 2, 3}


def test_the_same_seed_gives_the_same_windows(world: tuple[int, Windows]) -> None:
    seed, one = world
    two = drawn(seed)
    assert two is not None
    assert one.answers == two.answers
    assert all(np.array_equal(a, b) for a, b in zip(one.images, two.images, strict=True))


def test_what_is_neither_at_the_place_nor_apart_is_left_out() -> None:
    assert not _apart(20.0 * np.exp(2 * AT_PLACE), (20.0, 20.0))
    assert _apart(28.0, (20.0, 20.0))
    assert not _apart(25.0, (20.0, 30.0))
    assert _apart(14.0, (20.0, 30.0))


def write(folder: Path, name: str, count: int, answer: int = 0) -> None:
    shape = (count, SIZE_WH[1], SIZE_WH[0], 3)
    rng = np.random.default_rng(count)
    images = rng.integers(0, 256, shape, dtype=np.uint8)
    answers = np.full(count, answer, np.uint8)
    np.savez(folder / name, images=images, answers=answers)


def test_the_cache_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def few(seed: int) -> None:
        made.append(seed)

    monkeypatch.setitem(cache.SOURCES, "drawn", few)
    first = list(cache.fill(tmp_path, "drawn", range(120), workers=1))
    assert [p.name for p in first] == [f"drawn{i:010d}.npz" for i in (0, 50, 100)]
    assert made == list(range(120))
    first[1].unlink()
    made.clear()
    assert list(cache.fill(tmp_path, "drawn", range(120), workers=1)) == first
    assert made == list(range(50, 100))


def test_reading_keeps_one_file_in_so_many_for_validation(tmp_path: Path) -> None:
    for i in range(4):
        write(tmp_path, f"w{i}.npz", 3 + i, i)
    training, held_out = read(tmp_path)
    assert held_out.answers.tolist() == [0] * 3
    assert len(training.answers) == 4 + 5 + 6
    plain = WindowSet(held_out)[0]
    assert plain[0].shape == (WINDOW_WH[1], WINDOW_WH[0], 3)
    inner = held_out.images[0][MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
    assert np.array_equal(plain[0].numpy(), inner)


@pytest.mark.parametrize("fault", ["none", "damaged", "pickled", "other size", "other answers"])
def test_files_that_are_no_windows_are_refused(tmp_path: Path, fault: str) -> None:
    write(tmp_path, "a.npz", 2)
    if fault == "damaged":
        (tmp_path / "b.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:500])
    elif fault == "pickled":
        np.savez(tmp_path / "b.npz", images=np.array([{}], object), answers=np.zeros(1, np.uint8))
    elif fault == "other size":
        blank = np.zeros((1, 8, 8, 3), np.uint8)
        np.savez(tmp_path / "b.npz", images=blank, answers=np.zeros(1, np.uint8))
    elif fault == "other answers":
        write(tmp_path, "b.npz", 2, answer=9)
    with pytest.raises(BadInputError, match=r"make (them|it)"):
        read(tmp_path)


def test_variations_keep_the_size_and_most_of_the_picture() -> None:
    image = np.zeros((SIZE_WH[1], SIZE_WH[0], 3), np.uint8)
    image[:, : SIZE_WH[0] // 2] = 220
    rng = np.random.default_rng(0)
    left_bright = 0
    for _ in range(60):
        window = varied(image, rng)
        assert window.shape == (WINDOW_WH[1], WINDOW_WH[0], 3)
        assert window.dtype == np.uint8
        halves = window[:, :40].mean(), window[:, -40:].mean()
        assert abs(halves[0] - halves[1]) > 60  # moved, but the edge stays near the middle
        left_bright += halves[0] > halves[1]
    assert 15 < left_bright < 45  # mirrored about every other time


def test_what_can_hardly_be_told_is_of_no_answer() -> None:
    along = np.array([5.0, 50.0, 100.0])
    track = EgoTrack(
        camera(),
        True,
        along,
        np.zeros((3, 3)),
        np.zeros(3),
        np.array([300.0, 200.0, 190.0]),
        320.0 - 300.0 / along,
        320.0 + 300.0 / along,
    )

    def thing(
        kind: str, visible_px: int = 200, height_m: float = 1.0, on: bool = True
    ) -> SceneObject:
        box = (0.0, 0.0, 9.0, 9.0)
        return SceneObject(1, kind, HUMAN, box, visible_px, 50.0, height_m, 1.9, on)

    assert _shown(thing("obstruction"), 0.0, track) == ((50.0, 50.0), 2)
    assert _shown(thing("obstruction", visible_px=9), 0.0, track) == ((50.0, 50.0), 0)
    assert _shown(thing("trespasser", height_m=0.1), 0.0, track) == ((50.0, 50.0), 0)
    assert _shown(thing("distortion", height_m=0.3), 12.0, track) == ((50.0, 62.0), 1)
    assert _shown(thing("distortion", height_m=0.1), 12.0, track) == ((50.0, 62.0), 0)
    assert _shown(thing("person", on=False), 0.0, track) == ((50.0, 50.0), 0)  # beside: neither
    assert _shown(thing("car", on=True), 0.0, track) == ((50.0, 50.0), 0)
