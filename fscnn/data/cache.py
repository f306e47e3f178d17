"""Render scenes once and keep them as a RailSem19-layout folder, so that epochs only read files.

    python -m fscnn.data.cache --count 8000 --workers 2 --out DIR

Scene ``seed`` always lands in ``jpgs/s{seed:08d}.jpg``. A run that was stopped goes on where it
stopped, and the files do not depend on the number of workers.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2

from fscnn.data.railsem import Image, Pair, write_pair

Render = Callable[[int], tuple[Image, Image]]


def render_scene(seed: int) -> tuple[Image, Image]:
    """Image and mask of one procedural scene with the renderer's default settings."""
    from railinspect import scenes

    rendered = scenes.render(seed)
    return rendered.rgb, rendered.labels


def pair_of(folder: Path, seed: int) -> Pair:
    """Where the scene of ``seed`` is kept."""
    return Pair(folder / "jpgs" / f"s{seed:08d}.jpg", folder / "uint8" / f"s{seed:08d}.png")


def _store(seed: int, folder: Path, render: Render) -> None:
    cv2.setNumThreads(1)
    pair = pair_of(folder, seed)
    if not pair.mask.exists():
        write_pair(pair, *render(seed))


def fill(
    folder: Path, start: int, count: int, workers: int = 1, render: Render = render_scene
) -> int:
    """Render the scenes ``start … start + count − 1`` that ``folder`` does not hold yet.

    Returns:
        Number of scenes rendered now.
    """
    missing = [s for s in range(start, start + count) if not pair_of(folder, s).mask.exists()]
    store = partial(_store, folder=folder, render=render)
    began = time.monotonic()

    def report(done: int) -> None:
        if done % 100 == 0 or done == len(missing):
            rate = done / (time.monotonic() - began)
            print(f"{done} of {len(missing)} scenes, {rate:.1f} per second", flush=True)

    if workers <= 1:
        for done, seed in enumerate(missing, 1):
            store(seed)
            report(done)
    elif missing:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            for done, _ in enumerate(pool.imap_unordered(store, missing, chunksize=4), 1):
                report(done)
    return len(missing)


def main(arguments: list[str] | None = None) -> int:
    """Command line entry."""
    parser = argparse.ArgumentParser(prog="python -m fscnn.data.cache", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to fill")
    parser.add_argument("--count", type=int, required=True, help="number of scenes")
    parser.add_argument("--start", type=int, default=0, help="seed of the first scene (default 0)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    options = parser.parse_args(arguments)
    fill(options.out, options.start, options.count, options.workers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
