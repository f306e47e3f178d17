"""The anomaly generator: time per 1920×1080 picture, heights against the camera, and its mask.

Times are processor time of one thread (what a quiet core would take), in memory: neither reading
nor writing of files is in them, nor the drawing of the built-in things, which happens once. The
bars are a tenth of what the paper's authors' generator takes on two cores.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.common import Measure, parser, publish
from railinspect.anomalies import (
    Distortion,
    EgoTrack,
    NoTrackError,
    WorldSource,
    built_in,
    distort,
    generate,
    place,
    track_of_mask,
)
from railinspect.anomalies.cutouts import trimmed
from railinspect.anomalies.generate import MADE_TYPES
from railinspect.anomalies.library import SORTS, VARIETY
from railinspect.anomalies.sources import Base
from railinspect.labels import HUMAN, RAILS
from railinspect.scenes import SceneSettings

BARS_MS = {"distortion": 24.0, "obstruction": 30.0, "trespasser": 41.0}
"""A tenth of the rival's 0.24, 0.30 and 0.41 s per picture."""


def bases(count: int) -> list[Base]:
    source = WorldSource(90_000, SceneSettings(size_wh=(1920, 1080)))
    found: list[Base] = []
    index = 0
    while len(found) < count:
        try:
            base = source.base(index)
            base.track.section(0.3, 0.8)
            track_of_mask(base.labels, base.track.camera)
            found.append(base)
        except NoTrackError:
            pass
        index += 1
    return found


def milliseconds(work: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(1e3 * (time.process_time() - start))
    return min(times)


def time_of(kind: str, pictures: list[Base], known: bool, repeats: int) -> list[float]:
    times = []
    for number, base in enumerate(pictures):

        def work(base: Base = base, number: int = number) -> None:
            track = base.track if known else None
            rng = np.random.default_rng(number)
            generate(base.rgb, base.labels, kind, rng, track, camera=base.track.camera)

        try:
            work()
        except NoTrackError:
            continue
        times.append(milliseconds(work, repeats))
    return times


def height_errors(pictures: list[Base]) -> list[float]:
    """Measured against true height of a 1.8 m board, per cent, at ten ranges in each picture."""
    board = trimmed("board", "trespasser", np.full((360, 120, 4), 255, np.uint8), 1.8, HUMAN)
    errors = []
    for base in pictures:
        track = base.track
        for along in np.linspace(*track.section(0.1, 0.93), 10):
            rgb, labels = base.rgb.copy(), base.labels.copy()
            foot, head = track.pixels(along, 0.0, [track.ground_m, track.ground_m + 1.8])
            if not 4 <= head[1] < foot[1] < labels.shape[0] - 4:
                continue
            placed = place(rgb, labels, track, board, float(along), 0.0, 1.0)
            column = placed.matte.max(axis=1)
            true = float(np.hypot(*(head - foot)))
            upright = abs(head[0] - foot[0]) < 0.06 * true
            if upright:
                errors.append(100 * (float(column.sum()) / true - 1))
    return errors


def rail_errors(pictures: list[Base]) -> list[float]:
    """Distance of labelled rails from where the distortion puts them, pixels."""
    errors = []
    for base in pictures:
        track: EgoTrack = base.track
        near, far = track.section(0.3, 0.8)
        plan = Distortion("ripple", near, 0.9 * (far - near), 0.2)
        rgb, labels = base.rgb.copy(), base.labels.copy()
        before = np.isin(base.labels, RAILS)
        _, _, moved = distort(rgb, labels, track, plan)
        assert moved is not None
        after = np.isin(labels, RAILS)
        for row in np.linspace(moved.v[0] + 2, moved.v[-1] - 2, 25).astype(int):
            left = np.interp(row, moved.v, moved.left_px)
            scale = np.interp(row, moved.v, moved.metre_px)
            shift = np.interp(row, moved.v, moved.shift_px)
            window = max(3, round(0.2 * scale))
            places = []
            for mask, centre in ((before, left), (after, left + shift)):
                low = round(centre) - window
                hits = np.flatnonzero(mask[row, max(0, low) : low + 2 * window + 1])
                places.append(hits.mean() + max(0, low) if len(hits) else np.nan)
            errors.append(places[1] - places[0] - shift)
    return [abs(e) for e in errors if np.isfinite(e)]


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--count", type=int, default=12, help="pictures (default 12)")
    arguments.add_argument("--repeats", type=int, default=5, help="best of so many (default 5)")
    options = arguments.parse_args()
    cv2.setNumThreads(1)
    pictures = bases(options.count)
    for sort in SORTS:
        for number in range(VARIETY):
            built_in(sort, number)
    measures = []
    for kind in MADE_TYPES:
        for known in (True, False):
            times = time_of(kind, pictures, known, options.repeats)
            what = "rails known" if known else "rails to be found"
            name = f"{kind}, 1920x1080, {what}"
            measures.append(
                Measure(f"{name}, median", statistics.median(times), "ms", BARS_MS[kind])
            )
            measures.append(Measure(f"{name}, slowest", max(times), "ms"))
    heights = np.abs(height_errors(pictures))
    measures.append(
        Measure("height against the camera, median error", float(np.median(heights)), "%")
    )
    measures.append(
        Measure("height against the camera, largest error", float(heights.max()), "%", 3.0)
    )
    rails = rail_errors(pictures)
    middle = float(np.median(rails))
    measures.append(Measure("mask of distorted rails, median error", middle, "px"))
    publish("generator", measures, options.json)


if __name__ == "__main__":
    main()
