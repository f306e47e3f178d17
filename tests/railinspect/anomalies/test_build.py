import hashlib
import json
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest

from railinspect import cli
from railinspect.anomalies import (
    BuildPlan,
    Composition,
    FolderSource,
    GeneratorSettings,
    ManifestEntry,
    WorldSource,
    build,
    read_manifest,
    write_manifest,
)
from railinspect.errors import BadInputError, OutputError
from railinspect.labels import HUMAN
from railinspect.scenes import SceneSettings
from tests.railinspect.anomalies.flat_track import a_camera, flat_picture, rails
from tests.railinspect.anomalies.test_generate import a_board

SMALL = Composition(2, 2, 1, 2)
BOARDS = GeneratorSettings(cutouts=(a_board(), a_board("obstruction", 0.8, 2)))


def digests(folder):
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def a_folder(root, masks=True, notes=True, count=5, camera=None):
    camera = camera or a_camera((640, 360))
    rgb, labels, _ = flat_picture(camera)
    pair = [rail.tolist() for rail in rails(camera)]
    for part in ("jpgs", "uint8", "jsons"):
        (root / part / "rs19_val").mkdir(parents=True)
    for i in range(count):
        name = f"rs19_val/rs{i:05d}"
        tinted = np.clip(rgb.astype(int) + 5 * i, 0, 255).astype(np.uint8)
        (root / "jpgs" / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", tinted)[1].tobytes())
        if masks:
            (root / "uint8" / f"{name}.png").write_bytes(cv2.imencode(".png", labels)[1].tobytes())
        if notes:
            things = [{"label": "rail", "polyline-pair": pair}]
            data = {"frame": name, "imgWidth": 640, "imgHeight": 360, "objects": things}
            text = json.dumps(data)
            (root / "jsons" / f"{name}.json").write_text(text)
    return camera


def test_any_number_of_workers_writes_the_same_bytes(tmp_path):
    a_folder(tmp_path / "in")
    plan = BuildPlan(FolderSource(tmp_path / "in"), 7, SMALL, BOARDS)
    build(tmp_path / "one", plan)
    build(tmp_path / "two", plan, workers=2)
    assert digests(tmp_path / "one") == digests(tmp_path / "two")
    build(tmp_path / "other", replace(plan, seed=8))
    assert digests(tmp_path / "one") != digests(tmp_path / "other")


@pytest.mark.parametrize(("masks", "notes"), [(True, True), (True, False), (False, True)])
def test_a_folder_with_masks_or_polylines_or_both(tmp_path, masks, notes):
    camera = a_folder(tmp_path / "in", masks, notes)
    entries = build(
        tmp_path / "out", BuildPlan(FolderSource(tmp_path / "in", camera), 1, SMALL, BOARDS)
    )
    assert Counter(e.type for e in entries) == {
        "none": 2,
        "distortion": 2,
        "obstruction": 1,
        "trespasser": 2,
    }
    assert entries == read_manifest(tmp_path / "out")
    originals = {e.base for e in entries if e.type == "none"}
    assert len(originals) == 2
    for e in entries:
        rgb, mask = (cv2.imread(str(tmp_path / "out" / f), -1) for f in (e.image, e.mask))
        assert rgb.shape == (360, 640, 3)
        assert mask.shape == (360, 640)
        assert e.camera == camera
        if e.type == "trespasser":
            left, top, right, bottom = (round(x) for x in e.box_xyxy)
            part = mask[top : bottom + 1, left : right + 1]
            assert (part == HUMAN).mean() > 0.95
            assert 5 < e.range_m < 60


def test_the_rendered_world_makes_a_set(tmp_path, capsys):
    out = tmp_path / "set"
    arguments = ["--originals", 1, "--distortion", 1, "--obstruction", 0, "--trespasser", 0]
    call = ["anomalies", "build", "--out", out, *arguments, "--size", "320x180", "--json"]
    assert cli.main([str(a) for a in call]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["types"] == {"distortion": 1, "none": 1}
    clear, bent = read_manifest(out)
    assert clear.type == "none"
    assert bent.camera is not None
    assert bent.range_m > 0
    assert bent.base.startswith("world ")
    assert cli.main([str(a) for a in call]) == 2  # it does not write over a set
    assert "already holds" in capsys.readouterr().err


def test_defaults_are_railinspect_900():
    composition = Composition()
    assert composition.total == 900
    assert composition.bases == 600
    assert composition.first("distortion") == 450
    assert composition.first("trespasser") == 750


def test_a_source_without_a_usable_picture_is_refused(tmp_path):
    with pytest.raises(BadInputError, match="RailSem19"):
        build(tmp_path / "o", BuildPlan(FolderSource(tmp_path / "none"), 0, SMALL, BOARDS))
    (tmp_path / "empty" / "jpgs").mkdir(parents=True)
    with pytest.raises(BadInputError, match="no picture"):
        build(tmp_path / "o", BuildPlan(FolderSource(tmp_path / "empty"), 0, SMALL, BOARDS))
    a_folder(tmp_path / "bare", masks=False, notes=False)
    with pytest.raises(BadInputError, match="neither a mask"):
        build(tmp_path / "o", BuildPlan(FolderSource(tmp_path / "bare"), 0, SMALL, BOARDS))
    a_folder(tmp_path / "few", count=1)
    with pytest.raises(BadInputError, match="2 different originals"):
        build(tmp_path / "o", BuildPlan(FolderSource(tmp_path / "few"), 0, SMALL, BOARDS))


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{",
        '{"objects": 3}',
        '{"objects": [{"polyline-pair": [[[1, "x"]], null]}]}',
        '{"frame": "a", "imgWidth": 640, "imgHeight": 360, "objects": '
        '[{"label": "rail", "polyline-pair": [[[1, 2]], [[3, 4]]]}]}',
        "[" * 100_000,
    ],
)
def test_damaged_notes_are_passed_over_or_refused_in_a_sentence(tmp_path, text):
    a_folder(tmp_path / "in", masks=False, count=2)
    for path in (tmp_path / "in/jsons/rs19_val").iterdir():
        path.write_text(text)
    with pytest.raises(BadInputError, match="no usable picture"):
        build(tmp_path / "o", BuildPlan(FolderSource(tmp_path / "in"), 0, SMALL, BOARDS))


def test_bad_numbers_are_refused(tmp_path):
    with pytest.raises(BadInputError, match="workers"):
        build(tmp_path, BuildPlan(WorldSource(0, SceneSettings()), 0, SMALL), workers=0)
    with pytest.raises(BadInputError, match="no picture"):
        Composition(0, 0, 0, 0)
    with pytest.raises(BadInputError, match="-1"):
        Composition(-1)
    with pytest.raises(BadInputError, match="seed"):
        BuildPlan(WorldSource(0, SceneSettings()), -1)
    assert issubclass(OutputError, OSError)


GOOD = ManifestEntry(
    "a.jpg",
    "a.png",
    "b.jpg",
    3,
    "trespasser",
    "person",
    ((1.0, 2.0), (3.0, 2.0), (3.0, 4.0)),
    (1.0, 2.0, 3.0, 4.0),
    12.0,
    0.1,
    1.8,
    11,
    {"alpha": 0.5},
)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"type": "ufo"}, "ufo"),
        ({"image": "../a.jpg"}, "leaves"),
        ({"image": "/a.jpg"}, "leaves"),
        ({"box_xyxy": None}, "box_xyxy"),
        ({"box_xyxy": [1, 2, 3]}, "3 numbers"),
        ({"box_xyxy": [1, 2, 3, "x"]}, "'x'"),
        ({"range_m": float("inf")}, "inf"),
        ({"polygon_uv": [[1, 2]]}, "polygon_uv"),
        ({"camera": {"size_wh": [1, 1]}}, "line 1"),
        ({"mask": None}, "line 1"),
    ],
)
def test_a_damaged_manifest_is_refused_with_its_line(tmp_path, change, sentence):
    write_manifest(tmp_path, [GOOD])
    assert read_manifest(tmp_path) == (GOOD,)
    data = {**GOOD.as_json(), **change}
    (tmp_path / "manifest.jsonl").write_text(json.dumps(data))
    with pytest.raises(BadInputError, match=sentence):
        read_manifest(tmp_path)


@pytest.mark.parametrize("text", ["", "{}", "[]", "{", "null"])
def test_a_manifest_that_is_none(tmp_path, text):
    (tmp_path / "manifest.jsonl").write_text(text)
    with pytest.raises(BadInputError):
        read_manifest(tmp_path)
    with pytest.raises(BadInputError, match="cannot read"):
        read_manifest(tmp_path / "nowhere")
