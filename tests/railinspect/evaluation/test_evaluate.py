"""Scores worked by hand, data sets read or refused, and the command from folder to page."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest

from railinspect import cli, labels
from railinspect.anomalies.manifest import ManifestEntry, write_manifest
from railinspect.camera import Camera
from railinspect.close_ups import CloseUps, places
from railinspect.errors import BadInputError
from railinspect.evaluation import (
    Anomaly,
    Answer,
    ClearRides,
    Rate,
    Sample,
    judge_set,
    read_samples,
    ride_through,
    score,
)
from railinspect.evaluation.drawn_tracks import Thing, camera, draw
from railinspect.evaluation.svm import fit
from railinspect.scenes import Ride, demo_settings
from railinspect.scenes.dataset import IMAGES, MASKS, NOTES
from railinspect.segmenter import Segmentation
from railinspect.track.geometry import TrackGeometry

BOX = (100.0, 100.0, 116.0, 116.0)


def sample(name: str, type_: str | None = None, range_m: float = 30.0) -> Sample:
    anomaly = None if type_ is None else Anomaly(type_, BOX, range_m)
    return Sample(name, image=None, mask=None, anomaly=anomaly)


def answer(said: str, box=BOX, ms: float = 1.0) -> Answer:
    boxes = ((said, box),) if said not in ("clear", "unknown") else ()
    return Answer(said, boxes, time_ms=ms)


def test_scores_by_hand():
    cases = [
        (sample("a"), answer("clear")),
        (sample("b"), answer("clear")),
        (sample("c"), answer("unknown")),  # right for nothing
        (sample("d"), answer("distortion")),
        (sample("e", "distortion", 25.0), answer("distortion")),
        (sample("f", "distortion", 70.0), answer("obstruction")),  # seen, but misnamed
        (sample("g", "obstruction", 25.0), answer("obstruction", (300.0, 300.0, 320.0, 320.0))),
        (sample("h", "trespasser", 130.0), answer("clear")),
        (sample("i", "trespasser", 30.0), answer("unknown", ms=9.0)),
    ]
    scores = score(*zip(*cases, strict=True))
    assert scores.accuracy == Rate(5, 9)
    assert scores.sensitivity == {
        "distortion": Rate(2, 2),
        "obstruction": Rate(1, 1),
        "trespasser": Rate(0, 2),
    }
    assert scores.specificity == Rate(2, 4)
    assert scores.named["distortion"] == Rate(1, 2)
    assert scores.named["obstruction"] == Rate(1, 1)
    assert scores.placed["obstruction"] == Rate(0, 1)
    assert scores.unknown == Rate(2, 9)
    assert scores.confusion[("trespasser", "unknown")] == 1
    assert sum(scores.confusion.values()) == 9
    by_range = {band.low: band.rate for band in scores.by_range}
    assert by_range[20.0] == Rate(2, 3)
    assert by_range[60.0] == Rate(1, 1)
    assert by_range[120.0] == Rate(0, 1)
    assert [band.rate.of for band in scores.by_size] == [0, 0, 5, 0, 0]
    assert scores.median_ms == 1.0


def test_an_empty_share_is_no_number():
    assert math.isnan(Rate(0, 0).share)
    assert Rate(0, 0).interval() == (0.0, 1.0)
    low, high = Rate(10, 10).interval()
    assert 0.7 < low < 0.75  # Wilson: n / (n + z²)
    assert high == pytest.approx(1.0)


def test_no_event_in_an_hour_still_allows_three():
    assert ClearRides(1, 1.0, 72.0, 1, 0, ()).at_most() == pytest.approx(-math.log(0.05))


BY_MASKS = ("--truth", "--no-close-ups")
"""The pictures of these sets are masks in false colours: no network has seen such."""


@pytest.fixture(scope="module")
def data_set(tmp_path_factory):
    """Four pictures of a known track: clear, a person, a crate, a bulge in the rails."""
    folder = tmp_path_factory.mktemp("set")
    cam = camera()

    def bulge(s):
        inside = (s > 28) & (s < 38)
        return np.where(inside, 0.25 * np.sin(np.pi * (s - 28) / 10) ** 2, 0.0)

    person = Thing(labels.HUMAN, 25.0, 0.2, 0.6, 1.8)
    crate = Thing(labels.CONSTRUCTION, 40.0, -0.2, 1.0, 1.0)
    pictures = [
        ("none", draw(cam), None),
        ("trespasser", draw(cam, things=[person]), person),
        ("obstruction", draw(cam, things=[crate]), crate),
        ("distortion", draw(cam, bend=bulge), Thing(labels.TRACKBED, 32.0, 0.0, 1.8, 0.1)),
    ]
    entries = []
    for number, (type_, masks, thing) in enumerate(pictures):
        name = f"{number}.png"
        for part in ("images", "masks"):
            (folder / part).mkdir(exist_ok=True)
        cv2.imwrite(str(folder / "masks" / name), masks.labels)
        cv2.imwrite(str(folder / "images" / name), labels.PALETTE[masks.labels % 19][..., ::-1])
        box, polygon = None, ()
        if thing is not None:
            at, half, up = thing.range_m, thing.width_m / 2, thing.height_m
            corners = [(at, y + thing.lateral_m, z) for y in (-half, half) for z in (0, up)]
            uv = cam.project(np.array(corners))
            box = (*uv.min(axis=0).tolist(), *uv.max(axis=0).tolist())
            polygon = tuple((float(u), float(v)) for u, v in uv)
        entries.append(
            ManifestEntry(
                f"images/{name}",
                f"masks/{name}",
                "drawn",
                number,
                type_,
                polygon_uv=polygon,
                box_xyxy=box,
                range_m=None if thing is None else thing.range_m,
                camera=cam,
            )
        )
    write_manifest(folder, entries)
    return folder


def test_the_command_judges_a_set_and_writes_its_pages(data_set, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["evaluate", str(data_set), *BY_MASKS, "--out", str(out), "--json"]
    assert cli.main(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["accuracy"]["hits"] == document["pictures"] == 4
    assert document["masks"] == "true masks"
    for name in ("distortion", "obstruction", "trespasser"):
        assert document["sensitivity"][name]["share"] == 1.0
        assert document["named_and_placed_right"][name]["hits"] == 1, name
    assert document["clear_rides"] is None
    stored = json.loads((out / "evaluation.json").read_text())
    assert stored["confusion"] == document["confusion"]
    assert "| accuracy | 100.0 % |" in (out / "evaluation.md").read_text()
    page = (out / "evaluation.html").read_text()
    assert "Failures: 0" in page
    assert "http" not in page.replace("http-equiv", "")
    assert cli.main(arguments) == 2  # never over an older evaluation
    assert "already holds" in capsys.readouterr().err


def test_failures_are_shown(data_set, tmp_path, capsys):
    # The true class of the person lies under another name: a person nobody can see.
    broken = tmp_path / "set"
    for part in ("images", "masks"):
        (broken / part).mkdir(parents=True)
        for file in (data_set / part).iterdir():
            (broken / part / file.name).write_bytes(file.read_bytes())
    (broken / "manifest.jsonl").write_bytes((data_set / "manifest.jsonl").read_bytes())
    mask = cv2.imread(str(broken / "masks" / "1.png"), cv2.IMREAD_GRAYSCALE)
    clear = cv2.imread(str(broken / "masks" / "0.png"), cv2.IMREAD_GRAYSCALE)
    assert (mask != clear).any()
    cv2.imwrite(str(broken / "masks" / "1.png"), clear)
    out = tmp_path / "out"
    assert cli.main(["evaluate", str(broken), *BY_MASKS, "--out", str(out)]) == 0
    assert "trespasser at 25 m, called clear" in capsys.readouterr().out
    page = (out / "evaluation.html").read_text()
    assert page.count("<figure>") == 1
    assert "data:image/jpeg;base64," in page


def test_a_set_in_railsem19s_layout_is_read_from_its_notes(tmp_path):
    cam = camera()
    for part in (IMAGES, MASKS, NOTES):
        (tmp_path / part).mkdir(parents=True)
    cv2.imwrite(str(tmp_path / IMAGES / "rs1.jpg"), np.zeros((360, 640, 3), np.uint8))
    notes = {
        "imgWidth": 640,
        "imgHeight": 360,
        "objects": [
            {"label": "rail", "polyline": [[0, 0]]},
            {"anomaly": "trespasser", "boundingbox": [1, 2, 3, 4], "range_m": 50.0},
            {"anomaly": "obstruction", "boundingbox": [5, 6, 7, 8], "range_m": 20.0},
        ],
        "camera": {"focal_px": cam.focal_px, "height_m": cam.height_m, "pitch_rad": cam.pitch_rad},
    }
    path = tmp_path / NOTES / "rs1.json"
    path.write_text(json.dumps(notes))
    (one,) = read_samples(tmp_path)
    assert one.anomaly == Anomaly("obstruction", (5, 6, 7, 8), 20.0)  # the nearest counts
    assert isinstance(one.camera, Camera)
    assert one.camera.principal_uv == cam.principal_uv
    with pytest.raises(BadInputError, match="no class mask"):
        one.labels()
    path.write_text("[]")
    with pytest.raises(BadInputError, match="do not say what"):
        read_samples(tmp_path)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ([], "holds no picture"),
        (["--truth", "--bundle", "x.onnx"], "exclude each other"),
        (["--clear-rides", "-1"], "at least 0 rides"),
    ],
)
def test_bad_input_is_one_sentence(extra, words, tmp_path, capsys):
    assert cli.main(["evaluate", str(tmp_path), *extra]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_no_folder_is_no_data_set(tmp_path, capsys):
    assert cli.main(["evaluate", str(tmp_path / "none")]) == 2
    assert "is not a folder" in capsys.readouterr().err


def test_a_clear_ride_raises_nothing():
    ride = Ride.plan(7, demo_settings((320, 180)), duration_s=1.0)
    rides = ride_through([ride], None)
    assert rides.false_events == ()
    assert rides.frames == len(ride)
    assert rides.hours == pytest.approx(len(ride) / ride.frame_rate / 3600)
    assert rides.km == pytest.approx(0.020, rel=0.05)


# The baseline


def test_the_machine_separates_what_a_line_can_separate():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(200, 3))
    anomalous = points @ [2.0, -1.0, 0.0] + 0.3 > 0
    points += 0.4 * np.where(anomalous, 1, -1)[:, None] * np.array([2.0, -1.0, 0.0])
    machine = fit(points, anomalous, softness=10.0)
    assert [machine.margin(p) > 0 for p in points] == anomalous.tolist()
    normal = machine.weights / machine.scale
    assert normal / np.linalg.norm(normal) == pytest.approx([2 / 5**0.5, -1 / 5**0.5, 0], abs=0.12)


def test_the_machine_needs_both_kinds():
    with pytest.raises(BadInputError, match="needs both kinds"):
        fit(np.zeros((3, 2)), np.array([True, True, True]))


def test_the_baseline_has_the_same_interface(data_set, capsys):
    assert cli.main(["evaluate", str(data_set), "--truth", "--svm", str(data_set), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["judge"] == "the linear SVM"
    assert document["accuracy"]["of"] == 4
    assert document["named_and_placed_right"]["trespasser"]["hits"] == 0  # it tells no place


@pytest.mark.parametrize(("size_wh", "looks"), [((1280, 720), 2), ((640, 360), 1)])
@pytest.mark.parametrize("use_camera", [True, False])
def test_wide_pictures_are_looked_at_closely(tmp_path, size_wh, looks, use_camera):
    cam = camera(size_wh)
    masks = draw(cam)
    path = tmp_path / "one.png"
    cv2.imwrite(str(path), np.repeat(masks.rail_score[..., None], 3, axis=2))

    class Network:
        class metadata:  # noqa: N801  # stands for the bundle's
            input_size_wh = (640, 360)

        seen: ClassVar[list[tuple[int, ...]]] = []

        def __call__(self, rgb):
            self.seen.append(rgb.shape[:2])
            rail = np.ascontiguousarray(rgb[..., 0])
            labelled = np.where(rail > 128, labels.RAIL_RAISED, labels.TRACKBED).astype(np.uint8)
            return Segmentation(labelled, np.full_like(rail, 230), rail)

    sample = Sample("one", path, None, None, cam)
    (answer,) = judge_set([sample], Network(), use_camera=use_camera)
    assert Network.seen == [size_wh[::-1], (360, 640)][:looks]
    assert answer.said == "clear"


def test_true_masks_get_their_second_look_from_the_picture(data_set: Path) -> None:
    class Looking:
        """Close-ups that note what they were shown and see nothing."""

        def __init__(self) -> None:
            self.shown: list[tuple[int, ...]] = []

        def __call__(self, rgb: np.ndarray, track: TrackGeometry, *_: float) -> CloseUps:
            self.shown.append(rgb.shape)
            at = places(track)
            return CloseUps(at, np.eye(4)[np.zeros(len(at), int)])

    samples, looking = read_samples(data_set), Looking()
    answers = judge_set(samples, None, close_ups=looking)
    assert [a.said for a in judge_set(samples, None)][1] == "trespasser"
    assert {a.said for a in answers} == {"clear"}  # what a clear close-up shows is not there
    assert set(looking.shown) == {(360, 640, 3)}
