"""Make training windows once and keep them.

    python -m fscnn.close_ups.cache --out DIR --drawn 3000 --rendered 4000 --workers 2

One ``.npz`` file for fifty worlds, that depends on their seeds alone; a run that was stopped goes
on where it stopped.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from fscnn.close_ups.windows import SIZE_WH, Windows, drawn, rendered
from railinspect.errors import BadInputError, RailInspectError

CHUNK = 50
SOURCES: dict[str, Callable[[int], Windows | None]] = {"drawn": drawn, "rendered": rendered}


def fill(out: Path, source: str, seeds: range, workers: int) -> Iterator[Path]:
    """Make the files of one source.

    Args:
        out: Folder, made if needed; files already there are kept.
        source: ``drawn`` or ``rendered``.
        seeds: Seeds of the worlds.
        workers: Number of processes; the files do not depend on it.

    Yields:
        The path of each file, in order.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"cannot write to {out}: {error.strerror or error}") from error
    firsts = seeds[::CHUNK]
    one = partial(_chunk, out=out, source=source, end=seeds.stop)
    if workers <= 1:
        yield from map(one, firsts)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(one, firsts)


def _chunk(first: int, out: Path, source: str, end: int) -> Path:
    cv2.setNumThreads(1)
    target = out / f"{source}{first:010d}.npz"
    if target.exists():
        return target
    images, answers = [], []
    for seed in range(first, min(first + CHUNK, end)):
        windows = SOURCES[source](seed)
        if windows is not None:
            images += windows.images
            answers += windows.answers
    scratch = target.with_name(f".{target.name}.{os.getpid()}")
    stack = np.stack(images) if images else np.zeros((0, SIZE_WH[1], SIZE_WH[0], 3), np.uint8)
    with scratch.open("wb") as file:
        np.savez(file, images=stack, answers=np.array(answers, np.uint8))
    scratch.replace(target)
    return target


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fscnn.close_ups.cache",
        description="Make windows of rendered pictures to train the close-ups on.",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to fill")
    parser.add_argument(
        "--drawn", type=int, default=0, metavar="N", help="wide pictures to draw anomalies into"
    )
    parser.add_argument(
        "--rendered", type=int, default=0, metavar="N", help="pictures of worlds with anomalies"
    )
    parser.add_argument(
        "--start",
        type=int,
        default=30_500_000,
        help="seed of the first world (default %(default)s)",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    options = parser.parse_args(arguments)
    began = time.monotonic()
    try:
        for source in SOURCES:
            seeds = range(options.start, options.start + getattr(options, source))
            for done, path in enumerate(fill(options.out, source, seeds, options.workers), 1):
                took = time.monotonic() - began
                print(f"{path.name}: {done * CHUNK} of {len(seeds)}, {took:.0f} s", flush=True)
    except RailInspectError as error:
        print(f"fscnn.close_ups.cache: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
