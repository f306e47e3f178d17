import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from railinspect.errors import BadInputError
from railinspect.labels import CLASSES
from railinspect.railsem import Pair, list_pairs, read_annotation, read_pair
from tests.fscnn.drawing import write_set


def test_reads_what_was_written(tmp_path: Path) -> None:
    drawn = write_set(tmp_path, 2)
    pairs = list_pairs(tmp_path)
    assert [pair.image.name for pair in pairs] == ["rs00000.jpg", "rs00001.jpg"]
    image, mask = read_pair(pairs[1])
    assert np.array_equal(mask, drawn[1][1])
    assert np.abs(image.astype(int) - drawn[1][0]).mean() < 6  # JPEG
    assert image[0, 0].argmax() == drawn[1][0][0, 0].argmax()  # RGB, not BGR


def test_reads_the_archive_layout(tmp_path: Path) -> None:
    write_set(tmp_path, 1, inner="rs19_val")
    assert list_pairs(tmp_path)[0].mask.parent.name == "rs19_val"


def change_mask(folder: Path, mask: np.ndarray) -> Pair:
    pair = list_pairs(folder)[0]
    cv2.imwrite(str(pair.mask), mask)
    return pair


def test_foreign_class_id(tmp_path: Path) -> None:
    write_set(tmp_path, 1)
    mask = np.full((64, 96), 255, np.uint8)
    mask[3, 4] = 19
    with pytest.raises(BadInputError, match=r"rs00000\.png holds class id 19; allowed are 0…18"):
        read_pair(change_mask(tmp_path, mask))


def test_mask_of_another_size(tmp_path: Path) -> None:
    write_set(tmp_path, 1)
    with pytest.raises(BadInputError, match=r"png is 32×20 but its image is 96×64"):
        read_pair(change_mask(tmp_path, np.zeros((20, 32), np.uint8)))


@pytest.mark.parametrize("mask", [np.zeros((64, 96, 3), np.uint8), np.zeros((64, 96), np.uint16)])
def test_mask_of_another_kind(tmp_path: Path, mask: np.ndarray) -> None:
    write_set(tmp_path, 1)
    with pytest.raises(BadInputError, match="expected one channel of 8-bit class ids"):
        read_pair(change_mask(tmp_path, mask))


def test_missing_mask(tmp_path: Path) -> None:
    write_set(tmp_path, 2)
    list_pairs(tmp_path)[1].mask.unlink()
    with pytest.raises(BadInputError, match=r"rs00001\.jpg has no mask; expected it at .*\.png"):
        list_pairs(tmp_path)


@pytest.mark.parametrize("damage", ["truncated", "empty", "text"])
def test_corrupt_jpeg(tmp_path: Path, damage: str) -> None:
    write_set(tmp_path, 1)
    pair = list_pairs(tmp_path)[0]
    data = pair.image.read_bytes()
    pair.image.write_bytes({"truncated": data[:-200], "empty": b"", "text": b"hello"}[damage])
    with pytest.raises(BadInputError, match=r"rs00000\.jpg is damaged or not an image"):
        read_pair(pair)


def test_unreadable_file(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"cannot read .*gone\.jpg: No such file"):
        read_pair(Pair(tmp_path / "gone.jpg", tmp_path / "gone.png"))


def test_folder_of_another_layout(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="is not in RailSem19's layout: there is no folder"):
        list_pairs(tmp_path)
    for part in ("jpgs", "uint8"):
        (tmp_path / part).mkdir()
    with pytest.raises(BadInputError, match=r"no \*\.jpg image lies under"):
        list_pairs(tmp_path)


def write_annotation(folder: Path, content: object) -> Pair:
    write_set(folder, 1, inner="rs19_val")
    path = folder / "jsons/rs19_val/rs00000.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(content))
    return list_pairs(folder)[0]


def test_reads_the_geometry_beside_an_image(tmp_path: Path) -> None:
    things = [
        {"label": "rail", "polyline-pair": [[[80, 60], [50, 20]], [[10, 60], [40, 20]]]},
        {"label": "guard-rail", "polyline": [[1, 2], [3, 4]]},
        {"label": "platform", "polygon": [[1, 2], [3, 4], [5, 6]]},
        {"label": "buffer-stop", "boundingbox": [1, 2, 30, 40]},
    ]
    pair = write_annotation(
        tmp_path, {"frame": "rs00000", "imgWidth": 96, "imgHeight": 64, "objects": things}
    )
    annotation = read_annotation(pair)
    assert (annotation.name, annotation.size_wh) == ("rs00000", (96, 64))
    (track,) = annotation.rails
    assert track.left_uv.tolist() == [[40, 20], [10, 60]]  # ordered, though given right first
    assert track.right_uv.tolist() == [[50, 20], [80, 60]]
    assert [(s.label, s.closed, len(s.points_uv)) for s in annotation.shapes] == [
        ("guard-rail", False, 2),
        ("platform", True, 3),
    ]
    assert annotation.boxes[0].box_xyxy == (1, 2, 30, 40)


def test_geometry_of_another_form(tmp_path: Path) -> None:
    pair = write_annotation(tmp_path, {"frame": "rs00000", "objects": [{"label": "rail"}]})
    with pytest.raises(BadInputError, match=r"rs00000\.json is not in RailSem19's form"):
        read_annotation(pair)
    notes = tmp_path / "jsons/rs19_val/rs00000.json"
    endless = {"label": "rail", "polyline": [[1, 2], [float("inf"), 4]]}
    data = {"frame": "rs00000", "imgWidth": 96, "imgHeight": 64, "objects": [endless]}
    notes.write_text(json.dumps(data))
    with pytest.raises(BadInputError, match="not finite"):
        read_annotation(pair)
    notes.write_text("[]")
    with pytest.raises(BadInputError, match="must hold a JSON object"):
        read_annotation(pair)
    notes.write_bytes(b" " * 20_000_001)
    with pytest.raises(BadInputError, match="larger than 20 MB"):
        read_annotation(pair)
    notes.write_text("{")
    with pytest.raises(BadInputError, match="is not JSON"):
        read_annotation(pair)
    (tmp_path / "jsons/rs19_val/rs00000.json").unlink()
    with pytest.raises(BadInputError, match=r"cannot read .*rs00000\.json"):
        read_annotation(pair)


def test_the_sets_own_classes_must_be_ours(tmp_path: Path) -> None:
    write_set(tmp_path, 1)
    labels = [{"name": name} for name in CLASSES]
    config = tmp_path / "rs19-config.json"
    config.write_text(json.dumps({"labels": labels}))
    assert len(list_pairs(tmp_path)) == 1
    config.write_text(json.dumps({"labels": labels[1:]}))
    with pytest.raises(BadInputError, match=r"orders other classes than RailSem19 \(sidewalk"):
        list_pairs(tmp_path)
    config.write_text("{}")
    with pytest.raises(BadInputError, match="holds no list of labels"):
        list_pairs(tmp_path)
