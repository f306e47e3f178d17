"""Render scenes once and keep them as a RailSem19-layout folder, so that epochs only read files.

    python -m fscnn.data.cache --count 8000 --workers 2 --out DIR

The files are those of :func:`railinspect.scenes.write_images`: they depend on the seeds alone, and
a run that was stopped goes on where it stopped.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import get_args

from railinspect.errors import RailInspectError
from railinspect.scenes import SceneSettings, write_images
from railinspect.scenes.settings import Kind


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fscnn.data.cache",
        description="Render scenes into a folder in RailSem19's layout.",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to fill")
    parser.add_argument("--count", type=int, required=True, help="number of scenes")
    parser.add_argument("--start", type=int, default=0, help="seed of the first scene (default 0)")
    parser.add_argument(
        "--crowded", action="store_true", help="one to four anomalies on every ego track"
    )
    parser.add_argument(
        "--kind",
        choices=get_args(Kind),
        default="any",
        help="kind of the scenes (default any)",
    )
    parser.add_argument(
        "--closer",
        type=int,
        default=1,
        help="narrow the view so many times, as a closer look at a wide picture does (default 1)",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    options = parser.parse_args(arguments)
    seeds = range(options.start, options.start + options.count)
    began = time.monotonic()
    try:
        settings = SceneSettings(crowded=options.crowded, kind=options.kind, closer=options.closer)
        for done, _ in enumerate(write_images(options.out, seeds, settings, options.workers), 1):
            if done % 100 == 0 or done == len(seeds):
                rate = done / (time.monotonic() - began)
                print(f"{done} of {len(seeds)} scenes, {rate:.1f} per second", flush=True)
    except RailInspectError as error:
        print(f"fscnn.data.cache: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
