"""Frames out to labelling tools and corrections back, hostile files among them."""

from __future__ import annotations

import contextlib
import json
import re
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from railinspect.cli import main
from railinspect.errors import BadInputError, OutputError
from railinspect.fleet import dataset
from railinspect.fleet.chosen import Choice, choose
from railinspect.fleet.coco import Labelled, read_coco, write_coco
from railinspect.fleet.cvat import read_cvat, write_cvat
from railinspect.fleet.finished import finished_inputs
from railinspect.fleet.masks import from_run_lengths, pack, run_lengths, unpack
from railinspect.fleet.relabel import export_frames, import_corrections
from railinspect.labels import CLASSES, HUMAN, RAIL_RAISED, SKY, VOID
from railinspect.railsem import list_pairs, read_pair
from tests.railinspect.fleet import made_run as made
from tests.railinspect.painted_ride import paint, read_paint, write_video

MASKS = arrays(
    np.uint8,
    st.tuples(st.integers(32, 40), st.integers(32, 40)),
    elements=st.sampled_from([0, 1, 17, 18, 255]),
)


@given(MASKS)
def test_run_lengths_go_there_and_back(mask):
    bits = mask == 17
    lengths = run_lengths(bits)
    assert sum(lengths) == bits.size
    assert (from_run_lengths(lengths, bits.size) == bits.ravel()).all()
    assert unpack(pack(lengths), bits.size) == lengths


@pytest.mark.parametrize("kind", ["coco", "cvat"])
@given(masks=st.lists(MASKS, min_size=1, max_size=3))
def test_masks_go_out_and_come_back(tmp_path_factory, kind, masks):
    path = tmp_path_factory.mktemp("masks") / ("a.json" if kind == "coco" else "a.xml")
    sent = [Labelled(f'p{i} <&"ü>.jpg', mask) for i, mask in enumerate(masks)]
    write, read = (write_coco, read_coco) if kind == "coco" else (write_cvat, read_cvat)
    assert write(path, sent) == len(masks)
    back = list(read(path))
    assert [one.file_name for one in back] == [one.file_name for one in sent]
    for one, other in zip(sent, back, strict=True):
        assert (one.mask == other.mask).all()


def test_packed_run_lengths_are_those_of_the_reference_tools():
    # Packed by hand as maskApi.c does: 6 → "6"; 1 → "1"; 40 = 8 + 1·32 → "X" "1"; then 4 − 1 = 3.
    assert pack([6, 1, 40, 4]) == "61X13"
    assert unpack("61X13", 60) == [6, 1, 40, 4]
    # A run shorter than the one before but one: 2 − 40 = −38 = 26 − 2·32.
    assert unpack(pack([0, 1, 40, 1, 2]), 60) == [0, 1, 40, 1, 2]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run over a painted video with events, unknown stretches, and a lost recording."""
    base = tmp_path_factory.mktemp("relabel")
    pictures = [paint([60.0 - i]) for i in range(30)]
    video = write_video(base / "ride.mp4", pictures, rate=10.0)
    folder = base / "run"
    folder.mkdir()
    frames = [
        made.frame(i, i / 10, "unknown" if i in (3, 4, 5, 20) else "clear") for i in range(30)
    ]
    events = [made.event(1, 1.0), made.event(2, 1.5, advice="emergency")]
    made.write_input(folder, made.FIRST, "ride", frames, events, address=str(video))
    made.write_input(folder, made.SECOND, "gone", frames[:3], [], address=str(base / "gone.mp4"))
    (folder / "fleet.json").write_text(json.dumps({"run": made.RUN_ID, "inputs": []}))
    for one in finished_inputs(folder):
        dataset.add(one.folder, folder)
    return folder


def test_frames_are_chosen_by_event_by_doubt_and_by_time(run):
    chosen = choose(run, Choice(events=1, unknown=2, every_s=1.0))
    assert [(one.input_id, one.index, one.why) for one in chosen] == [
        (made.FIRST, 20, "event 2: obstruction"),
        (made.FIRST, 4, "unknown for 3 frames"),
        (made.FIRST, 0, "every 1 s"),
        (made.FIRST, 10, "every 1 s"),
        (made.SECOND, 0, "every 1 s"),
    ]
    assert choose(run, Choice(events=1, unknown=2, every_s=1.0, limit=2)) == chosen[:2]
    assert choose(run, Choice(0, 0)) == []
    with pytest.raises(BadInputError, match="every is 0 s; give more than 0 s"):
        Choice(every_s=0)


@pytest.fixture(scope="module")
def exported(run, tmp_path_factory):
    out = tmp_path_factory.mktemp("export") / "out"
    done = export_frames(run, choose(run, Choice(1, 2, 1.0)), out, read_paint)
    assert done.pictures == 4
    return out, done


def test_the_right_pictures_are_written(exported):
    out, done = exported
    assert len(done.missing) == 1
    assert done.missing[0].startswith("frame 0 of gone: input")
    notes = made.read_lines(out / "frames.jsonl")
    assert [note["index"] for note in notes] == [0, 4, 10, 20]
    assert {path.name for path in out.iterdir()} == {
        "images",
        "coco.json",
        "cvat.xml",
        "frames.jsonl",
    }
    for note in notes:
        rgb = cv2.imread(str(out / "images" / note["file_name"]), cv2.IMREAD_COLOR_RGB)
        expected = paint([60.0 - note["index"]])
        assert np.abs(rgb.astype(int) - expected).mean() < 4
        people = [(read_paint(p).labels == HUMAN).sum() for p in (rgb, expected)]
        assert people[0] == pytest.approx(people[1], rel=0.3)


@pytest.mark.parametrize("name", ["coco.json", "cvat.xml"])
def test_untouched_labels_come_back_as_the_segmenters_masks(exported, tmp_path, name):
    out, _ = exported
    done = import_corrections(out / name, out / "images", tmp_path / "set")
    assert (done.pictures, done.labelled_share) == (4, 1.0)
    pairs = list_pairs(tmp_path / "set")
    assert len(pairs) == 4
    shown = {one.file_name: one.mask for one in read_coco(out / "coco.json")}
    for pair in pairs:
        image, mask = read_pair(pair)
        assert (mask == shown[pair.image.name]).all()
        assert image.shape[:2] == mask.shape
        assert pair.image.read_bytes() == (out / "images" / pair.image.name).read_bytes()


def test_the_training_reads_it(exported, tmp_path):
    datasets = pytest.importorskip("fscnn.data.datasets")
    out, _ = exported
    import_corrections(out / "cvat.xml", out / "images", tmp_path / "set")
    source = datasets.FolderSource(tmp_path / "set")
    image, mask = datasets.SegmentationDataset(source, len(source))[0]
    assert image.shape == (3, 360, 640)
    assert set(np.unique(mask)) >= {RAIL_RAISED, SKY}


def picture(folder, name="a.jpg", size_wh=(40, 36)):
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / name), np.full((size_wh[1], size_wh[0], 3), 90, np.uint8))
    return folder


def cvat(shapes, name="a.jpg", width=40, height=36):
    return (
        f'<annotations><image id="0" name="{name}" width="{width}" height="{height}">{shapes}'
        "</image></annotations>"
    )


def imported(tmp_path, text, suffix=".xml"):
    (tmp_path / f"labels{suffix}").write_text(text, encoding="utf-8")
    import_corrections(tmp_path / f"labels{suffix}", picture(tmp_path / "images"), tmp_path / "set")
    return read_pair(list_pairs(tmp_path / "set")[0])[1]


def test_a_correction_covers_what_lies_below_it_and_the_rest_is_void(tmp_path):
    mask = imported(
        tmp_path,
        cvat(
            '<polygon label="sky" points="10,10;20,10;20,20;10,20" z_order="1"/>'
            '<box label="terrain" xtl="0" ytl="5" xbr="40" ybr="30" z_order="0"/>'
            '<mask label="human" rle="1, 2" left="0" top="0" width="3" height="1" z_order="2"/>'
            '<polygon label="void" points="0,28;40,28;40,30;0,30" z_order="3"/>',
            name="task/1/a.jpg",
        ),
    )
    assert mask[15, 15] == SKY
    assert (mask[12:18, 12:18] == SKY).all()
    assert mask[6, 0] == mask[26, 39] == CLASSES.index("terrain")
    assert mask[0, :4].tolist() == [VOID, HUMAN, HUMAN, VOID]
    assert mask[34, 0] == mask[29, 20] == VOID


def coco(segmentation, category=11, **image):
    return json.dumps(
        {
            "images": [{"id": 5, "file_name": "a.jpg", "width": 40, "height": 36, **image}],
            "categories": [{"id": 11, "name": "human"}, {"id": 12, "name": "zebra"}],
            "annotations": [
                {"id": 1, "image_id": 5, "category_id": category, "segmentation": segmentation}
            ],
        }
    )


@pytest.mark.parametrize(
    "segmentation",
    [
        [[10, 10, 20, 10, 20, 20, 10, 20]],
        {"size": [36, 40], "counts": [10 * 36 + 10, *[10, 26] * 10]},
        {"size": [36, 40], "counts": pack([10 * 36 + 10, *[10, 26] * 10])},
    ],
)
def test_coco_in_its_three_forms(tmp_path, segmentation):
    mask = imported(tmp_path, coco(segmentation), ".json")
    assert (mask[11:19, 11:19] == HUMAN).all()
    assert (mask == HUMAN).sum() == pytest.approx(100, abs=22)
    assert mask[5, 5] == VOID


BIG = '<mask label="sky" rle="0,9" left="0" top="0" width="3" height="{}"/>'


@pytest.mark.parametrize(
    ("text", "suffix", "message"),
    [
        ("", ".xml", "is not a file of CVAT"),
        ("<osm/>", ".xml", "its root is <osm>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><annotations/>', ".xml", "declares a document type"),
        ("<annotations/>", ".xml", "labels no picture"),
        (cvat(""), ".xml", "labels no picture"),
        (
            cvat('<box label="zebra" xtl="0" ytl="0" xbr="9" ybr="9"/>'),
            ".xml",
            "'zebra' is none of",
        ),
        (cvat('<polyline label="sky" points="1,1;2,2"/>'), ".xml", "a polyline is no area"),
        (cvat('<polygon label="sky" points="1,1;2,2"/>'), ".xml", "expected 3 to"),
        (cvat('<polygon label="sky" points="1,1;2,2;nan,4"/>'), ".xml", "are no pixels"),
        (cvat('<polygon label="sky" points="1,1;2,2;1e30,4"/>'), ".xml", "are no pixels"),
        (cvat('<polygon label="sky" points="1;2;3"/>'), ".xml", "1 numbers where 2"),
        (cvat(BIG.format(10**12)), ".xml", "lies outside the picture"),
        (cvat(BIG.format(2)), ".xml", "do not fit 6 pixels"),
        (cvat(BIG.format("-1")), ".xml", "lies outside the picture"),
        (cvat("", width=10**6, height=10**6), ".xml", "1000000"),
        (cvat("", width="x"), ".xml", "has no width and height"),
        (
            cvat('<box label="sky" xtl="0" ytl="0" xbr="9" ybr="9"/>', width=50),
            ".xml",
            "40×36, but",
        ),
        ("[]", ".json", "must hold a JSON object"),
        ("{}", ".json", "is no COCO file"),
        ("[" * 100_000, ".json", "is not JSON"),
        (coco([[1, 2, 3, 4]]), ".json", "expected 3 to"),
        (coco([[1, 2, 3]]), ".json", "an annotation holds"),
        (coco([[0, 0, 9, 0, 9, 9]], category=12), ".json", "'zebra' is none of"),
        (coco([[0, 0, 9, 0, 9, 9]], category=13), ".json", "an annotation holds 13"),
        (coco({"size": [36, 40], "counts": [10**15]}), ".json", "do not fit 1440 pixels"),
        (coco({"size": [36, 40], "counts": [1000, 1000]}), ".json", "do not fit 1440 pixels"),
        (coco({"size": [36, 40], "counts": [-5, 5]}), ".json", "do not fit 1440 pixels"),
        (coco({"size": [9, 9], "counts": [5]}), ".json", "a mask of size"),
        (coco({"size": [36, 40], "counts": "oooooooooooo"}), ".json", "as COCO packs them"),
        (coco({"size": [36, 40], "counts": "\u00fc"}), ".json", "as COCO packs them"),
        (coco([], width=10**9), ".json", "1000000000"),
    ],
)
def test_a_hostile_file_is_one_sentence_and_leaves_nothing(tmp_path, text, suffix, message):
    with pytest.raises(BadInputError, match=message):
        imported(tmp_path, text, suffix)
    assert {path.name for path in tmp_path.iterdir()} <= {"images", f"labels{suffix}"}


BOX = '<box label="sky" xtl="0" ytl="0" xbr="9" ybr="9"/>'


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("../../etc/passwd", "expected the .jpg files"),
        ("..", "expected the .jpg files"),
        ("a.png", "expected the .jpg files"),
        (".hidden.jpg", "expected the .jpg files"),
        ("../secret.jpg", "secret.jpg, which is not in"),
        ("/elsewhere/secret.jpg", "secret.jpg, which is not in"),
        ("link.jpg", "link.jpg, which is not in"),
        ("text.jpg", "is no JPEG, but"),
    ],
)
def test_no_name_leads_out_of_the_folder_of_pictures(tmp_path, name, message):
    images = picture(tmp_path / "images")
    picture(tmp_path, "secret.jpg")
    (images / "link.jpg").symlink_to(tmp_path / "secret.jpg")
    (images / "text.jpg").write_text("no picture")
    (tmp_path / "a.xml").write_text(cvat(BOX, name=name))
    with pytest.raises(BadInputError, match=message):
        import_corrections(tmp_path / "a.xml", images, tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_a_picture_named_twice_is_refused(tmp_path):
    text = cvat(BOX).replace("</annotations>", "") + cvat(BOX, name="x/a.jpg").replace(
        "<annotations>", ""
    )
    with pytest.raises(BadInputError, match=r"names picture a.jpg twice"):
        imported(tmp_path, text)


def test_a_folder_that_exists_is_left_alone(exported, run, tmp_path):
    out, _ = exported
    (tmp_path / "set").mkdir()
    with pytest.raises(OutputError, match="exists already"):
        import_corrections(out / "coco.json", out / "images", tmp_path / "set")
    with pytest.raises(OutputError, match="exists already"):
        export_frames(run, [], tmp_path / "set", read_paint)
    with pytest.raises(BadInputError, match="not one of 0 chosen frames"):
        export_frames(run, [], tmp_path / "none", read_paint)
    assert not (tmp_path / "none").exists()


def test_the_commands(run, exported, tmp_path, monkeypatch, capsys):
    import railinspect.cli

    monkeypatch.setattr(railinspect.cli, "_segmenter", lambda _: read_paint)
    out = tmp_path / "out"
    arguments = ["fleet", "export", str(run), "--out", str(out), "--every", "2", "--json"]
    assert main(arguments) == 1  # one recording is gone
    document = json.loads(capsys.readouterr().out)
    assert len(document["missing"]) == 1
    assert document["pictures"] == len(list((out / "images").iterdir()))
    arguments = ["fleet", "import", str(out / "cvat.xml"), "--images", str(out / "images")]
    assert main([*arguments, "--out", str(tmp_path / "set")]) == 0
    assert re.match(r"\d+ pairs in .*, 100.0% of their pixels labelled", capsys.readouterr().out)
    assert main([*arguments, "--out", str(tmp_path / "set")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["fleet", "report", str(tmp_path / "none")]) == 2
    assert not (tmp_path / "none").exists()


@dataclass(frozen=True)
class NoLabels:
    labels: np.ndarray


def test_a_recording_that_ends_early_gives_what_it_has(run, tmp_path):
    chosen = [one for one in choose(run, Choice(1, 1)) if one.input_id == made.FIRST]
    from dataclasses import replace

    late = replace(chosen[0], index=99, time_s=9.9)
    between = replace(chosen[0], index=98, time_s=0.55)
    done = export_frames(
        run,
        [*chosen, late, between],
        tmp_path / "out",
        lambda rgb: NoLabels(np.zeros(rgb.shape[:2], np.uint8)),
    )
    assert done.pictures == 2
    assert [words.split(": ")[1] for words in done.missing] == [
        "no frame at 0.55 s",
        "the recording ends before it",
    ]


@pytest.mark.parametrize("name", ["coco.json", "cvat.xml"])
@given(damage=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=6))
def test_a_damaged_file_of_labels_is_read_or_refused(tmp_path_factory, name, damage):
    path = tmp_path_factory.getbasetemp() / f"damaged-{name}"
    mask = np.full((36, 40), SKY, np.uint8)
    mask[10:20, 5:30] = HUMAN
    write, read = (write_coco, read_coco) if name == "coco.json" else (write_cvat, read_cvat)
    write(path, [Labelled("a.jpg", mask)])
    data = bytearray(path.read_bytes())
    for share, byte in damage:
        data[int(share * len(data))] = byte
    path.write_bytes(bytes(data))
    with contextlib.suppress(BadInputError):  # any other error fails the test
        for one in read(path):
            assert one.mask.dtype == np.uint8
