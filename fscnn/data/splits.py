"""Which images train, validate and test: named protocols, their file lists, and lists of one's own.

    python -m fscnn.data.splits DIR --protocol paper --seed 0 --out paper.json

A split is a JSON file with a name, the seed it was drawn with, and the names (no suffix) of the
images of each part. It, not the seed, is what a run can be repeated from on another machine.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from railinspect.errors import BadInputError, RailInspectError
from railinspect.railsem import Pair, list_pairs

PROTOCOLS = {"paper": (3000, 500, 500), "full": (6800, 850, 850)}
"""Images that train, validate and test. ``paper``: 4000 random ones (Wang et al. 2023, V-A);
``full``: all 8500 of RailSem19, as later works cut it."""

PARTS = ("train", "val", "test")


@dataclass(frozen=True)
class Split:
    """A division of a data set.

    Attributes:
        name: Name of the protocol, or one's own.
        seed: Seed it was drawn with; -1 for a list made otherwise.
        train: Names of the images trained on.
        val: Names of those validated on.
        test: Names of those only tested on.
    """

    name: str
    seed: int
    train: tuple[str, ...]
    val: tuple[str, ...]
    test: tuple[str, ...]

    def save(self, path: Path) -> None:
        """Write the split as JSON."""
        path.write_text(json.dumps(asdict(self), indent=0), encoding="utf-8")


def draw(names: Sequence[str], counts: tuple[int, int, int], name: str, seed: int) -> Split:
    """Draw a split at random.

    Args:
        names: Names of all images; their order does not matter.
        counts: Images of each part.
        name: Name of the split.
        seed: Seed of the draw.

    Raises:
        BadInputError: if there are fewer images than the parts need, or one part is empty.
    """
    if min(counts) < 1:
        raise BadInputError(f"split {name} leaves a part empty: {counts}; each needs an image")
    if len(names) < sum(counts):
        raise BadInputError(
            f"split {name} needs {sum(counts)} images but there are {len(names)}; give counts that "
            "fit, e.g. --counts 80 10 10"
        )
    order = np.random.default_rng(seed).permutation(sorted(names))
    ends = np.cumsum(counts)
    parts = (order[: ends[0]], order[ends[0] : ends[1]], order[ends[1] : ends[2]])
    train, val, test = (tuple(sorted(str(n) for n in part)) for part in parts)
    return Split(name, seed, train, val, test)


def load(path: Path) -> Split:
    """Read a split.

    Raises:
        BadInputError: if the file cannot be read, lacks a part, or names an image twice.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        parts = [tuple(str(name) for name in data[part]) for part in PARTS]
        split = Split(str(data.get("name", path.stem)), int(data.get("seed", -1)), *parts)
    except OSError as error:
        raise BadInputError(f"cannot read split {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise BadInputError(
            f"{path} is no split ({type(error).__name__}: {error}); it must be JSON with the lists "
            "train, val and test of image names"
        ) from error
    every = [name for part in parts for name in part]
    if len(set(every)) < len(every):
        twice = next(name for name in every if every.count(name) > 1)
        raise BadInputError(f"split {path} names image {twice} twice; parts must not overlap")
    return split


def of_folder(folder: Path, which: str, seed: int) -> Split:
    """The split ``which`` of a data set: the name of a protocol, or a file.

    Raises:
        BadInputError: as :func:`draw` and :func:`load`.
    """
    if which in PROTOCOLS:
        return draw([p.image.stem for p in list_pairs(folder)], PROTOCOLS[which], which, seed)
    return load(Path(which))


def pairs_of(folder: Path, split: Split, part: str) -> tuple[Pair, ...]:
    """The image and mask files of one part.

    Raises:
        BadInputError: if the part is unknown or empty, or one of its images is missing.
    """
    if part not in PARTS:
        raise BadInputError(f"unknown part {part!r} of a split; known: {', '.join(PARTS)}")
    found = {pair.image.stem: pair for pair in list_pairs(folder)}
    names = getattr(split, part)
    if not names:
        raise BadInputError(f"part {part} of split {split.name} is empty")
    if missing := [name for name in names if name not in found]:
        raise BadInputError(
            f"{len(missing)} images of split {split.name} are not in {folder}, {missing[0]} first; "
            "fetch the whole data set or draw a new split"
        )
    return tuple(found[name] for name in names)


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fscnn.data.splits", description="Draw a split and save its file list."
    )
    parser.add_argument("folder", type=Path, help="data set in RailSem19's layout")
    how = parser.add_mutually_exclusive_group(required=True)
    how.add_argument("--protocol", choices=sorted(PROTOCOLS), help="paper: 3000/500/500")
    how.add_argument(
        "--counts", type=int, nargs=3, metavar=("TRAIN", "VAL", "TEST"), help="images of each part"
    )
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--out", type=Path, required=True, help="file to write, *.json")
    options = parser.parse_args(arguments)
    try:
        names = [pair.image.stem for pair in list_pairs(options.folder)]
        name = options.protocol or options.out.stem
        counts = PROTOCOLS[name] if options.protocol else tuple(options.counts)
        split = draw(names, counts, name, options.seed)
        split.save(options.out)
    except RailInspectError as error:
        print(f"fscnn.data.splits: {error}", file=sys.stderr)
        return 2
    parts = ", ".join(f"{len(getattr(split, part))} {part}" for part in PARTS)
    print(f"{options.out}: {parts} of {len(names)} images, seed {split.seed}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
