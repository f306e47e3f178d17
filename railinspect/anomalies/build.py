"""Data sets of clear pictures and pictures with one anomaly each, in RailSem19's layout."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.anomalies.ego import NoTrackError
from railinspect.anomalies.generate import (
    MADE_TYPES,
    Generated,
    GeneratorSettings,
    MadeType,
    generate,
)
from railinspect.anomalies.manifest import MANIFEST, AnomalyType, ManifestEntry, write_manifest
from railinspect.anomalies.sources import Base, FolderSource, Source, WorldSource
from railinspect.errors import BadInputError, OutputError
from railinspect.labels import CLASSES, PALETTE
from railinspect.runinfo import installed_version
from railinspect.scenes.dataset import CONFIG, IMAGES, MASKS, encode

DATASET: Final = "dataset.json"
"""What the set was made from, with which settings."""

JPEG_QUALITY: Final = 95
_TRIES: Final = 60


@dataclass(frozen=True)
class Composition:
    """How many pictures of each kind; the default is RailInspect-900.

    Attributes:
        originals: Clear pictures.
        distortion: Pictures with distorted rails.
        obstruction: Pictures with an obstruction.
        trespasser: Pictures with a person.
    """

    originals: int = 450
    distortion: int = 150
    obstruction: int = 150
    trespasser: int = 150

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0 <= value <= 1_000_000:
                raise BadInputError(f"{name} is {value}; give 0 to 1 000 000 pictures")
        if self.total == 0:
            raise BadInputError("the set would hold no picture; ask for at least one")

    @property
    def total(self) -> int:
        """Number of pictures."""
        return self.originals + self.distortion + self.obstruction + self.trespasser

    @property
    def bases(self) -> int:
        """Number of clear pictures needed: each base of an anomaly serves all three types."""
        return self.originals + max(self.distortion, self.obstruction, self.trespasser)

    def first(self, kind: AnomalyType) -> int:
        """Number of the first picture of a type."""
        counts: dict[str, int] = {"none": self.originals}
        counts.update({name: getattr(self, name) for name in MADE_TYPES})
        before = 0
        for name, count in counts.items():
            if name == kind:
                return before
            before += count
        raise BadInputError(f"{kind!r} is no type of anomaly")


@dataclass(frozen=True)
class BuildPlan:
    """Everything a data set depends on.

    Attributes:
        source: Where clear pictures come from.
        seed: Seed of all choices, ≥ 0.
        composition: How many of each kind.
        settings: Settings of the generator.
    """

    source: WorldSource | FolderSource
    seed: int = 0
    composition: Composition = field(default_factory=Composition)
    settings: GeneratorSettings = field(default_factory=GeneratorSettings)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise BadInputError(f"seed is {self.seed}; give a whole number of at least 0")


def build(
    out: Path,
    plan: BuildPlan,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ManifestEntry, ...]:
    """Make a data set; the manifest is written last, so a folder with one is complete.

    Every picture depends on the plan and its own number alone: any number of workers writes the
    same bytes.

    Args:
        out: Folder to fill; it must not hold a set yet.
        plan: What to make.
        workers: Number of processes.
        progress: Told the number of pictures made and of all.

    Returns:
        The manifest's entries.

    Raises:
        BadInputError: if the source has too few usable pictures.
        OutputError: if the folder cannot be written to or holds a set already.
    """
    if workers < 1:
        raise BadInputError(f"workers is {workers}; give at least 1")
    _prepare(out)
    order = _order(plan)
    made: list[ManifestEntry] = []
    slots = range(plan.composition.bases)
    one = partial(_fill, plan=plan, out=out, order=order)
    if workers == 1:
        for entries in map(one, slots):
            made += entries
            if progress:
                progress(len(made), plan.composition.total)
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            for entries in pool.map(one, slots, chunksize=2):
                made += entries
                if progress:
                    progress(len(made), plan.composition.total)
    made.sort(key=lambda entry: entry.image)
    _describe(out, plan)
    write_manifest(out, made)
    return tuple(made)


def _prepare(out: Path) -> None:
    if (out / MANIFEST).exists():
        raise OutputError(
            f"{out} already holds a data set ({MANIFEST}); name another folder, or delete this one"
        )
    try:
        for part in (IMAGES, MASKS):
            (out / part).mkdir(parents=True, exist_ok=True)
        config = {
            "labels": [
                {"name": name, "color": PALETTE[i].tolist()} for i, name in enumerate(CLASSES)
            ]
        }
        (out / CONFIG).write_text(json.dumps(config, indent=1), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write the data set to {out}: {error.strerror}") from error


def _order(plan: BuildPlan) -> npt.NDArray[np.int64] | None:
    """A folder's pictures in the order in which they are used."""
    count = plan.source.count
    if count is None:
        return None
    if count < plan.composition.originals:
        raise BadInputError(
            f"the set needs {plan.composition.originals} different originals, the source has "
            f"{count} pictures; ask for fewer"
        )
    return np.random.default_rng([plan.seed, 0x0DE2]).permutation(count)


def _candidates(
    slot: int, bases: int, is_original: bool, order: npt.NDArray[np.int64] | None
) -> list[int]:
    """Which pictures a slot tries, in this order; no two originals ever share one."""
    if order is None:
        return [slot + turn * bases for turn in range(_TRIES)]
    own = [int(i) for i in order[slot::bases]]
    if is_original:
        return own
    # a small folder: what belongs to others may be used again, as a last resort
    rest = [int(i) for i in np.roll(order, -slot) if int(i) not in own]
    return (own + rest)[:_TRIES]


def _fill(
    slot: int, plan: BuildPlan, out: Path, order: npt.NDArray[np.int64] | None
) -> list[ManifestEntry]:
    """Make the pictures of one base: an original, or one for each type of anomaly."""
    cv2.setNumThreads(1)
    composition = plan.composition
    is_original = slot < composition.originals
    number = slot - composition.originals
    kinds: list[MadeType] = (
        [] if is_original else [k for k in MADE_TYPES if number < getattr(composition, k)]
    )
    reason = "it has no picture left"
    for candidate in _candidates(slot, composition.bases, is_original, order):
        try:
            base = plan.source.base(candidate)
            base.track.section(plan.settings.near_share, plan.settings.far_share)
            made = [_make(base, kind, plan, number) for kind in kinds]
        except NoTrackError as error:
            reason = str(error)
            continue
        except BadInputError as error:
            if plan.source.count is None:
                raise
            reason = str(error)
            continue
        if is_original:
            return [_write_original(out, slot, base)]
        return [
            _write(out, composition.first(kind) + number, base, seed, one)
            for kind, (seed, one) in zip(kinds, made, strict=True)
        ]
    raise BadInputError(
        f"the source has no usable picture for number {slot + 1} of {composition.bases}; the last "
        f"one tried failed because {reason}"
    )


def _make(base: Base, kind: MadeType, plan: BuildPlan, number: int) -> tuple[int, Generated]:
    state = np.random.SeedSequence([plan.seed, 0xA110, MADE_TYPES.index(kind), number])
    seed = int(state.generate_state(1)[0])
    rng = np.random.default_rng(seed)
    return seed, generate(base.rgb, base.labels, kind, rng, base.track, plan.settings)


def _files(number: int) -> tuple[str, str]:
    return (IMAGES / f"ri{number:05d}.jpg").as_posix(), (MASKS / f"ri{number:05d}.png").as_posix()


def _write_original(out: Path, number: int, base: Base) -> ManifestEntry:
    image, mask = _files(number)
    _write_pair(out, image, mask, base.rgb, base.labels)
    camera = base.track.camera if base.track.calibrated else None
    return ManifestEntry(image, mask, base.name, number, "none", camera=camera)


def _write(out: Path, number: int, base: Base, seed: int, one: Generated) -> ManifestEntry:
    image, mask = _files(number)
    _write_pair(out, image, mask, one.rgb, one.labels)
    left, top, right, bottom = (round(edge, 2) for edge in one.box_xyxy)
    return ManifestEntry(
        image,
        mask,
        base.name,
        seed,
        one.type,
        one.kind,
        tuple((round(float(u), 2), round(float(v), 2)) for u, v in one.polygon_uv),
        (left, top, right, bottom),
        None if one.range_m is None else round(one.range_m, 3),
        round(one.lateral_m, 3),
        round(one.height_m, 4),
        one.label,
        one.blend,
        base.track.camera if base.track.calibrated else None,
    )


def _write_pair(
    out: Path, image: str, mask: str, rgb: npt.NDArray[np.uint8], labels: npt.NDArray[np.uint8]
) -> None:
    bgr = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
    try:
        (out / mask).write_bytes(encode(".png", labels))
        (out / image).write_bytes(encode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))
    except OSError as error:
        raise OutputError(f"cannot write to {out}: {error.strerror or error}") from error


def _describe(out: Path, plan: BuildPlan) -> None:
    settings = asdict(replace(plan.settings, cutouts=()))
    settings["cutouts"] = [c.name for c in plan.settings.cutouts] or "built in"
    document: dict[str, Any] = {
        "version": installed_version("railinspect"),
        "seed": plan.seed,
        "composition": asdict(plan.composition),
        "settings": settings,
        "source": _source_json(plan.source),
    }
    (out / DATASET).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _source_json(source: Source) -> dict[str, Any]:
    if isinstance(source, WorldSource):
        scene = source.settings
        return {
            "kind": "world",
            "first_seed": source.first_seed,
            "size_wh": list(scene.size_wh),
            "weather": scene.weather,
        }
    return {"kind": "folder", "pictures": source.count}
