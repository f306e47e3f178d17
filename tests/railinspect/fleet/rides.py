"""Painted rides for fleet tests, and the command that inspects them in a process of its own.

``python -m tests.railinspect.fleet.rides RIDES OUT ENGINE WORKERS`` is a fleet run over the painted
rides of a folder; killed, it goes on when called again.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from railinspect.fleet.run import FleetSummary, inspect_fleet
from railinspect.fleet.tasks import Cut
from railinspect.inspect_settings import InspectSettings
from railops.braking import Train
from tests.railinspect.painted_ride import CAMERA, SPEED_MPS, read_paint, ride, write_video

SETTINGS = InspectSettings(camera=CAMERA, train=Train(speed_mps=SPEED_MPS))
CUT = Cut(stretch_s=2.0, lead_in_s=0.8, run_on_s=5.0)


def load() -> Callable[[np.ndarray], Any]:
    """The segmenter of painted pictures, as a worker loads it."""
    return read_paint


def inspect(inputs: Sequence[str | Path], out: Path, **rest: Any) -> FleetSummary:
    """A fleet run over painted rides, in this process unless said otherwise."""
    rest = {"settings": SETTINGS, "cut": CUT, "engine": "serial", **rest}
    return inspect_fleet([str(one) for one in inputs], out, load, **rest)


def paint_rides(folder: Path, count: int, frames: int = 50) -> list[Path]:
    """Short rides past people at different places."""
    folder.mkdir(exist_ok=True)
    return [
        write_video(folder / f"ride {i}.mp4", ride([35.0 + 7.0 * i, 80.0], frames))
        for i in range(count)
    ]


def results(run: Path) -> dict[str, str]:
    """What a run leaves, each file with its hash; its lock is not a result."""
    return {
        str(path.relative_to(run)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(run.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


if __name__ == "__main__":
    rides, out, engine, workers = sys.argv[1:]
    inspect([rides], Path(out), engine=engine, workers=int(workers))
