"""Evaluation: several looks, ranges, tables and the page, on drawings and hand-made models."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import evaluate as command
import railinspect
from fscnn.data.datasets import FolderSource, SceneSource
from fscnn.training.bands import BandScores, ground_range_m
from fscnn.training.evaluation import evaluate_source
from fscnn.training.evaluation_report import write
from fscnn.training.tables import appendix_e, mean_iou, printed_rows, row_of, table_iii
from fscnn.training.views import views, windows
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, HUMAN, RAIL_EMBEDDED, RAIL_RAISED, SKY, TRACKBED
from railinspect.segmenter import Segmentation
from tests.fscnn.drawing import write_set

Image = np.ndarray


def by_colour(rgb: Image) -> Segmentation:
    """Red above a half is rail, more of it surer; else green is human, else sky."""
    red, green = rgb[..., 0], rgb[..., 1]
    labels = np.where(red >= 128, RAIL_RAISED, np.where(green >= 128, HUMAN, SKY))
    sure = np.where(red >= 128, red, np.where(green >= 128, green, 255 - green))
    return Segmentation(labels.astype(np.uint8), sure.astype(np.uint8), red.copy())


def picture(seed: int = 0) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (24, 40, 3)).astype(np.uint8)


@pytest.mark.parametrize("zoom", [1.0, 1.3, 2.0, 3.7])
def test_windows_cover_the_image_and_stay_inside(zoom: float) -> None:
    seen = np.zeros((37, 101), int)
    for left, top, w, h in windows(101, 37, zoom):
        assert 0 <= left <= 101 - w
        assert 0 <= top <= 37 - h
        seen[top : top + h, left : left + w] += 1
    assert seen.min() >= 1


def test_looks_at_what_depends_on_a_pixel_alone_change_nothing() -> None:
    rgb = picture()
    once = by_colour(rgb)
    for zooms, flip in (((1.0,), True), ((2.0,), False), ((1.0, 1.6, 3.0), True)):
        many = views(by_colour, zooms, flip)(rgb)
        np.testing.assert_array_equal(many.labels, once.labels)
        np.testing.assert_array_equal(many.confidence, once.confidence)
        np.testing.assert_array_equal(many.rail_score, once.rail_score)


def test_two_looks_that_disagree_are_averaged() -> None:
    # The model sees rail on the left half only, so each half is rail in one of two looks.
    def left_half(rgb: Image) -> Segmentation:
        labels = np.full(rgb.shape[:2], TRACKBED, np.uint8)
        score = np.zeros_like(labels)
        labels[:, : rgb.shape[1] // 2] = RAIL_EMBEDDED
        score[:, : rgb.shape[1] // 2] = 240
        return Segmentation(labels, np.full_like(labels, 200), score)

    seen = views(left_half, flip=True)(picture())
    assert np.unique(seen.rail_score).tolist() == [120]
    assert np.unique(seen.labels).tolist() == [TRACKBED]  # 120 of 255 is below one half
    assert np.unique(seen.confidence).tolist() == [100]


def test_looks_need_a_zoom() -> None:
    with pytest.raises(BadInputError, match=r"zooms must be at least 1, got \[0\.5\]"):
        views(by_colour, [0.5])


def test_bands_by_hand() -> None:
    truth = np.array([[RAIL_RAISED, TRACKBED, RAIL_RAISED, SKY]], np.uint8)
    predicted = np.array([[RAIL_RAISED, RAIL_RAISED, TRACKBED, SKY]], np.uint8)
    bands = BandScores()
    bands.add(truth, predicted, np.array([[10, 19.9, 20, np.inf]], np.float32))
    found = bands.summary()
    assert list(found) == ["0–20 m", "20–50 m", "50–100 m", "100–200 m", "from 200 m"]
    assert found["0–20 m"]["rail_iou"] == 0.5  # one hit, one false
    assert found["20–50 m"]["rail_iou"] == 0  # one missed
    assert found["0–20 m"]["pixels"] == 2
    assert math.isnan(found["100–200 m"]["rail_iou"])


def test_range_of_the_ground_is_the_cameras() -> None:
    camera = Camera.from_field_of_view((64, 48), 1.0, 2.0)
    ranges = ground_range_m(camera, (64, 48))
    assert np.isnan(ranges[:24]).all()
    assert (np.diff(ranges[24:, 32]) < 0).all()
    u, v = camera.project([ranges[40, 32], 0.0, 0.0])
    assert v == pytest.approx(40, abs=1e-3)
    assert abs(u - 32) < 1


def test_the_papers_rows_have_the_means_of_table_iii() -> None:
    rows = printed_rows()
    means = [100 * mean_iou(row) for row in rows.values()]
    assert means == pytest.approx([55.0, 56.9, 62.5], abs=0.11)  # as printed, to its last digit
    table = table_iii(rows)
    assert [row[2:] for row in table[1:]] == [["68.8", "40.3"], ["71.5", "45.0"], ["72.4", "54.2"]]
    assert appendix_e(rows)[0] == ["Method", *CLASSES]
    assert mean_iou({"a": 0.5, "b": math.nan}) == 0.5


def test_page_shows_best_and_worst(tmp_path: Path) -> None:
    write_set(tmp_path / "set", 5)
    source = FolderSource(tmp_path / "set")
    truths = {source(i)[0].tobytes(): (i, source(i)[1]) for i in range(5)}

    def worse_and_worse(rgb: Image) -> Segmentation:
        index, mask = truths[rgb.tobytes()]
        labels = mask.copy()
        labels[: 12 * index] = SKY  # cuts ever more off the rails
        return Segmentation(labels, np.full_like(labels, 255), np.zeros_like(labels))

    camera = Camera.from_field_of_view((96, 64), 1.0, 2.0)
    done = evaluate_source("m<1>", worse_and_worse, source, 5, camera=camera)
    best, worst = done.extremes(2)
    ious = [frame.rail_iou for frame in done.frames]
    assert best[0].rail_iou == max(ious) == 1.0
    assert worst[0].rail_iou == min(ious)
    assert not {f.name for f in best} & {f.name for f in worst}

    write(tmp_path / "out", [done], [worse_and_worse], source, 2)
    page = (tmp_path / "out/evaluation.html").read_text()
    assert page.count("<figure>") == 4
    assert "m&lt;1&gt;" in page
    assert "http" not in page.replace("http-equiv", "")
    document = json.loads((tmp_path / "out/evaluation.json").read_text())
    assert mean_iou(row_of(done.scores)) == done.scores.summary()["mean_iou"]
    (model,) = document["models"]
    assert model["iou"]["human"] is None
    assert np.array(model["confusion"]).sum() == model["pixels"] == 5 * 64 * 96
    assert model["by_range"]["20–50 m"]["rail_iou"] is not None
    text = (tmp_path / "out/evaluation.md").read_text()
    assert "| FSCNN (printed) | 62.5 | 72.4 | 54.2 |" in text


def test_scenes_bring_their_own_ranges() -> None:
    source = SceneSource(3, 1)
    truth = source(0)[1]
    sizes = {truth.shape}

    def perfect(rgb: Image) -> Segmentation:
        assert rgb.shape[:2] in sizes
        return Segmentation(truth, np.full_like(truth, 255), np.zeros_like(truth))

    done = evaluate_source("perfect", perfect, source, 1)
    assert done.bands is not None
    judged = [b["rail_iou"] for b in done.bands.summary().values() if b["pixels"] > 1000]
    assert judged
    assert set(judged) <= {1.0} | {v for v in judged if math.isnan(v)}


def test_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_set(tmp_path / "set", 1)
    assert command.main([str(tmp_path / "m.ckpt"), "--folder", str(tmp_path / "set")]) == 2
    assert "cannot read checkpoint" in capsys.readouterr().err
    assert command.main(["m.ckpt", "--folder", str(tmp_path / "none")]) == 2
    assert "is not in RailSem19's layout" in capsys.readouterr().err


def test_command_prints_the_papers_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_set(tmp_path / "set", 1)
    bundle = Path(railinspect.__file__).parent / "bundles" / "fscnn_s.onnx"
    assert command.main([str(bundle), "--folder", str(tmp_path / "set")]) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if " | " in line]
    names = [row[0] for row in rows if len(row) == 4]
    assert names[0] == "| Method"
    assert names[-2:] == ["| FSCNN (printed)", "| fscnn_s.onnx"]
    assert [row[0] for row in rows if len(row) == 1 + len(CLASSES)] == names
    assert rows[-1][1 + CLASSES.index("human")] == "–"  # the drawing holds none
