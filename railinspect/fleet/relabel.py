"""Chosen frames for relabelling, and the corrections as a set to train on.

Out: the pictures, the segmenter's masks of them for CVAT and as COCO, and where each is from.

    DIR/images/<input id>_<frame>.jpg   DIR/cvat.xml   DIR/coco.json   DIR/frames.jsonl

Back: the corrected file and the same pictures become a folder in RailSem19's layout
(:mod:`railinspect.railsem`), which the training reads.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from railinspect.errors import BadInputError, OutputError
from railinspect.fleet.chosen import Chosen
from railinspect.fleet.coco import Labelled, read_coco, write_coco
from railinspect.fleet.cvat import read_cvat, write_cvat
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.logbook import safe_id
from railinspect.images import Image, header_size_wh
from railinspect.labels import CLASSES, VOID
from railinspect.railsem import list_pairs
from railinspect.sinks.json_lines import JsonLines, read_json_lines
from railinspect.video import open_source

JPEG_QUALITY: Final = 95
"""Quality of the pictures written; what is labelled is what is trained on."""

_NAME: Final = re.compile(r"[0-9A-Za-z][0-9A-Za-z_.+=@ -]{0,150}\.jpg")


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        folder: Where to.
        pictures: How many pictures.
        missing: Chosen frames that could not be read, and why, in words.
    """

    folder: Path
    pictures: int
    missing: tuple[str, ...]


@dataclass(frozen=True)
class Imported:
    """What was made of corrections.

    Attributes:
        folder: The data set.
        pictures: How many pairs it has.
        labelled_share: Share of all pixels that have a class.
    """

    folder: Path
    pictures: int
    labelled_share: float


def export_frames(
    run_folder: str | Path,
    chosen: Sequence[Chosen],
    out: str | Path,
    segment: Callable[[Image], Any],
) -> Exported:
    """Write chosen frames with the segmenter's masks of them.

    Args:
        run_folder: The run they were chosen from; the recordings must still lie where they were.
        chosen: The frames.
        out: Folder to create.
        segment: Callable from an RGB image to something with ``labels`` (H, W).

    Raises:
        BadInputError: if not one of the frames can be read.
        OutputError: if the folder exists already.
    """
    inputs = {one.counts.id: one for one in finished_inputs(run_folder)}
    missing: list[str] = []
    with _new_folder(Path(out)) as part:
        (part / "images").mkdir()
        (part / "masks").mkdir()
        notes = JsonLines(part / "frames.jsonl")
        count = 0
        ordered = sorted(chosen, key=lambda one: (one.input_id, one.time_s))
        for input_id, wanted in groupby(ordered, key=lambda one: one.input_id):
            own = list(wanted)
            for one, rgb in _pictures(inputs[input_id], own, missing):
                name = f"{safe_id(input_id)}_{one.index:08d}"
                bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
                jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
                (part / "images" / f"{name}.jpg").write_bytes(jpeg.tobytes())
                mask = cv2.imencode(".png", np.asarray(segment(rgb).labels, np.uint8))[1]
                (part / "masks" / f"{name}.png").write_bytes(mask.tobytes())
                counts = inputs[input_id].counts
                notes.write(
                    {
                        "file_name": f"{name}.jpg",
                        "input": input_id,
                        "name": counts.name,
                        "address": counts.address,
                        "index": one.index,
                        "time_s": one.time_s,
                        "why": one.why,
                    }
                )
                count += 1
        notes.close()
        if not count:
            why = f": {missing[0]}" if missing else "; choose more"
            raise BadInputError(f"not one of {len(chosen)} chosen frames can be written{why}")
        write_coco(part / "coco.json", _masks(part))
        write_cvat(part / "cvat.xml", _masks(part))
        shutil.rmtree(part / "masks")
    return Exported(Path(out), count, tuple(missing))


def _masks(part: Path) -> Iterator[Labelled]:
    for note in read_json_lines(part / "frames.jsonl"):
        path = (part / "masks" / note["file_name"]).with_suffix(".png")
        mask = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
        yield Labelled(note["file_name"], np.asarray(mask, np.uint8))


def _pictures(
    one: FinishedInput, wanted: list[Chosen], missing: list[str]
) -> Iterator[tuple[Chosen, Image]]:
    """The chosen frames of one input in order; those that cannot be had are noted."""
    left = list(wanted)
    path = Path(one.counts.address)
    try:
        source = open_source(path)
    except (BadInputError, OSError) as error:
        missing += [f"frame {w.index} of {one.counts.name}: {error}" for w in left]
        return
    with closing(source):
        source.seek(left[0].time_s)
        for frame in source:
            if left and abs(frame.time_s - left[0].time_s) < 1e-5:
                yield left.pop(0), frame.rgb
            while left and frame.time_s > left[0].time_s + 1e-5:
                gone = left.pop(0)
                missing.append(
                    f"frame {gone.index} of {one.counts.name}: no frame at {gone.time_s} s"
                )
            if not left:
                return
    missing += [f"frame {w.index} of {one.counts.name}: the recording ends before it" for w in left]


def import_corrections(labels: str | Path, images: str | Path, out: str | Path) -> Imported:
    """Make a training set in RailSem19's layout of a corrected COCO or CVAT file.

    Args:
        labels: The corrected file: COCO ``.json`` or CVAT for images 1.1 ``.xml``.
        images: Folder of the pictures it names, ``.jpg``; no other folder is looked into.
        out: Folder to create.

    Raises:
        BadInputError: if the file is neither, names a picture twice or one that is not there or
            has another size, or labels nothing.
        OutputError: if the folder exists already.
    """
    path, folder = Path(labels), Path(images)
    if path.suffix.lower() not in (".json", ".xml"):
        raise BadInputError(f"{path} is neither a COCO .json nor a CVAT .xml file")
    pictures = read_coco(path) if path.suffix.lower() == ".json" else read_cvat(path)
    taken: set[str] = set()
    count = labelled = pixels = 0
    with _new_folder(Path(out)) as part:
        for kind in ("jpgs", "uint8"):
            (part / kind).mkdir()
        for one in pictures:
            name = _safe_name(one.file_name, path)
            if name.casefold() in taken:
                raise BadInputError(f"{path} names picture {name} twice; leave one")
            taken.add(name.casefold())
            data = _jpeg(folder / name, one, path)
            covered = int((one.mask != VOID).sum())
            if not covered:
                continue
            (part / "jpgs" / name).write_bytes(data)
            mask = cv2.imencode(".png", one.mask)[1].tobytes()
            (part / "uint8" / name).with_suffix(".png").write_bytes(mask)
            count, labelled, pixels = count + 1, labelled + covered, pixels + one.mask.size
        if not count:
            raise BadInputError(
                f"{path} labels no picture; export the corrected job with its shapes"
            )
        config = {"labels": [{"name": name} for name in CLASSES]}
        (part / "rs19-config.json").write_text(json.dumps(config, indent=1) + "\n", "utf-8")
        list_pairs(part)
    return Imported(Path(out), count, labelled / pixels)


def _safe_name(file_name: str, path: Path) -> str:
    """The last part of a picture's name; what is before it is only a folder of the tool's.

    Raises:
        BadInputError: if it is no plain name of a JPEG.
    """
    name = file_name.replace("\\", "/").rpartition("/")[2]
    if not _NAME.fullmatch(name):
        raise BadInputError(
            f"{path} names a picture {file_name[:200]!r}; expected the .jpg files exported"
        )
    return name


def _jpeg(picture: Path, one: Labelled, path: Path) -> bytes:
    """A picture's file, checked to be a JPEG of the mask's size."""
    try:
        if picture.is_symlink() or not picture.is_file():
            raise BadInputError(
                f"{path} labels {picture.name}, which is not in {picture.parent}; give the folder "
                "of the pictures that were labelled with --images"
            )
        data = picture.read_bytes()
    except OSError as error:
        raise BadInputError(f"cannot read {picture}: {error.strerror or error}") from error
    size = header_size_wh(data) if data.startswith(b"\xff\xd8") else None
    height, width = one.mask.shape
    if size != (width, height):
        there = f"{size[0]}×{size[1]}" if size else "no JPEG"
        raise BadInputError(
            f"{picture} is {there}, but {path} labels it as {width}×{height}; give the pictures "
            "that were labelled"
        )
    return data


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """A folder that appears whole or not at all.

    Raises:
        OutputError: if it exists already.
    """
    if os.path.lexists(out):
        raise OutputError(f"output folder {out} exists already; name another one")
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    part.mkdir()
    try:
        yield part
        part.rename(out)
    finally:
        shutil.rmtree(part, ignore_errors=True)
