import cv2
import numpy as np
import pytest

from railinspect.anomalies.cutouts import Cutout, read_cutouts
from railinspect.anomalies.library import SORTS, built_in, draw_cutout
from railinspect.anomalies.sculpt import Sculpture, Surface, picture
from railinspect.errors import BadInputError
from railinspect.labels import CAR, CONSTRUCTION, HUMAN, TRUCK


def an_rgba(height=40, width=20, alpha=255):
    rgba = np.zeros((height, width, 4), np.uint8)
    rgba[5:35, 4:16] = (200, 100, 50, alpha)
    return rgba


def write(path, image):
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def test_a_folder_of_cutouts_with_heights_in_their_names(tmp_path):
    write(tmp_path / "worker_1.82m.png", an_rgba())
    write(tmp_path / "fridge_0.9m.png", an_rgba())
    write(tmp_path / "red-car_1.5m.png", an_rgba())
    fridge, car, worker = read_cutouts(tmp_path)
    assert (worker.type, worker.height_m, worker.label) == ("trespasser", 1.82, HUMAN)
    assert (fridge.type, fridge.height_m, fridge.label) == ("obstruction", 0.9, CONSTRUCTION)
    assert car.label == CAR
    assert worker.rgba.shape == (34, 16, 4)  # the opaque part and a margin of two pixels
    assert tuple(worker.rgba[10, 8]) == (50, 100, 200, 255)


def test_a_table_of_heights_types_and_classes(tmp_path):
    write(tmp_path / "a.png", an_rgba())
    write(tmp_path / "b.png", an_rgba())
    (tmp_path / "heights.csv").write_text(
        "file,height_m,type,class\na.png,2.5,obstruction,truck\nb.png,1.7,trespasser,\n"
    )
    a, b = read_cutouts(tmp_path)
    assert (a.height_m, a.label, a.type) == (2.5, TRUCK, "obstruction")
    assert (b.height_m, b.label, b.type) == (1.7, HUMAN, "trespasser")


@pytest.mark.parametrize(
    ("name", "image", "table", "sentence"),
    [
        ("x_1m.png", np.zeros((40, 40, 3), np.uint8), None, "no alpha channel"),
        ("x_1m.png", an_rgba(alpha=0), None, "transparent everywhere"),
        ("x.png", an_rgba(), None, "has no height"),
        ("x_0m.png", an_rgba(), None, "0.0 m high"),
        ("x_99m.png", an_rgba(), None, "99.0 m high"),
        ("x.png", an_rgba(), "file,height_m\nx.png,tall\n", "'tall'"),
        ("x.png", an_rgba(), "file,height_m\nx.png,nan\n", "nan m high"),
        ("x_1m.png", an_rgba(), "file,height_m\ny.png,1\n", "not there"),
        ("x_1m.png", an_rgba(), "height_m\n1\n", "names no file"),
        ("x.png", an_rgba(), "file,height_m,class\nx.png,1,unicorn\n", "unicorn"),
        ("x.png", an_rgba(), "file,height_m,type\nx.png,1,ghost\n", "ghost"),
        ("x_1m.png", b"not an image", None, "not a PNG"),
        ("x_1m.png", cv2.imencode(".png", an_rgba())[1].tobytes()[:60], None, "damaged"),
        (None, None, None, "no PNG file"),
    ],
)
def test_a_cutout_that_cannot_be_used_is_refused(tmp_path, name, image, table, sentence):
    if name is not None:
        if isinstance(image, bytes):
            (tmp_path / name).write_bytes(image)
        else:
            write(tmp_path / name, image)
    if table is not None:
        (tmp_path / "heights.csv").write_text(table)
    with pytest.raises(BadInputError, match=sentence):
        read_cutouts(tmp_path)


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="no folder"):
        read_cutouts(tmp_path / "nowhere")


def test_a_cutout_needs_eight_bits():
    with pytest.raises(BadInputError, match="8-bit"):
        Cutout("x", "obstruction", np.zeros((4, 4, 4)), 1.0, 2)


def test_a_sculpture_has_the_size_of_its_bodies():
    thing = Sculpture()
    thing.cylinder((0, 0, 0), (0, 1.2, 0), 0.3, Surface((200, 200, 200)))
    rgba, scale = picture(thing, 80)
    solid = rgba[..., 3] >= 128
    rows, cols = np.flatnonzero(solid.any(axis=1)), np.flatnonzero(solid.any(axis=0))
    assert (rows[-1] - rows[0] + 1) / scale == pytest.approx(1.2, abs=1.5 / scale)
    assert (cols[-1] - cols[0] + 1) / scale == pytest.approx(0.6, abs=1.5 / scale)
    assert (rgba[solid][:, 3] == 255).mean() > 0.9


def test_the_sun_lights_the_side_it_is_on():
    thing = Sculpture()
    thing.ellipsoid((0, 0.5, 0), (0.5, 0.5, 0.5), Surface((200, 200, 200), 0.0))
    rgba, _ = picture(thing, 60, (-1.0, 0.3, 0.3))
    middle = rgba.shape[1] // 2
    left, right = rgba[:, :middle], rgba[:, middle:]
    bright = [part[part[..., 3] > 200][:, 0].mean() for part in (left, right)]
    assert bright[0] > 1.3 * bright[1]


@pytest.mark.parametrize("sort", ["person", "stone"])
def test_built_in_things_are_plausible_and_the_same_every_time(sort):
    thing = built_in(sort, 1)
    low, high = {"person": (0.9, 2.0), "stone": (0.3, 1.9)}[sort]
    assert low < thing.height_m < high
    assert thing.type == SORTS[sort][0]
    again = built_in.__wrapped__(sort, 1)
    np.testing.assert_array_equal(thing.rgba, again.rgba)


def test_people_are_drawn_for_trespassers_alone(monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "railinspect.anomalies.library.built_in", lambda sort, number: drawn.append(sort)
    )
    rng = np.random.default_rng(0)
    for _ in range(60):
        draw_cutout(rng, "obstruction")
    assert set(drawn) == set(SORTS) - {"person"}
    drawn.clear()
    draw_cutout(rng, "trespasser")
    assert drawn == ["person"]
