"""The second look: what it costs, and what it changes in what single pictures are told.

    python -m benchmarks.close_ups [--size 1920x1080] [--seed N] [--count N] [--rides N] [--json]

Times are of one core. The pictures are those of ``railinspect anomalies build --seed SEED``: half
of them clear, a sixth with each type of anomaly, judged by the shipped bundle with its close-ups
and without them in turn. The rides are the demo's from seed 9 on, inspected frame by frame. Where
close-ups alone found something, the range it got is held against the true one.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common import Measure, median_seconds, parser, publish
from railinspect.anomalies.build import BuildPlan, Composition, build
from railinspect.anomalies.sources import WorldSource
from railinspect.anomalies_command import WORLDS_PER_SEED
from railinspect.camera import Camera
from railinspect.close_ups import CloseUpNetwork, places
from railinspect.evaluation import inspect_still, read_samples
from railinspect.evaluation.run import masks_of
from railinspect.evaluation.scores import right
from railinspect.findings import find
from railinspect.findings.second_look import WATCH_EVERY
from railinspect.ranging import FrameRanging, Range
from railinspect.scenes import Ride, SceneSettings, demo_settings
from railinspect.segmenter import Segmenter
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower
from railinspect.track.geometry import SegmentationLike

FIRST_RIDE = 9
NOT_THERE = 1.6
"""What is farther off its nearest anomaly than by this ratio of its range is no sighting of it."""


def _costs() -> list[Measure]:
    network = CloseUpNetwork.default()
    ride = Ride.plan(5, demo_settings(), duration_s=2)
    picture = ride.frame(0)
    track = TrackFollower(ride.camera).update(Segmenter.default(1)(picture.rgb))
    whole = median_seconds(lambda: network(picture.rgb, track), 30, 3)
    one = median_seconds(lambda: network(picture.rgb, track, 20 / 1.2, 20 * 1.2), 60, 3)
    limits = Thresholds()
    watch = limits.watch_from_m, limits.watch_to_m, WATCH_EVERY
    watched = median_seconds(lambda: network(picture.rgb, track, *watch), 60, 3)
    return [
        Measure("all along the track of a 640x360 picture", 1e3 * whole, "ms"),
        Measure("windows of it", len(places(track)), ""),
        Measure("one finding at 20 m", 1e3 * one, "ms"),
        Measure("places watched in every frame of a recording", 1e3 * watched, "ms"),
        Measure("windows of them", len(places(track, *watch)), ""),
    ]


def _pictures(size_wh: tuple[int, int], seed: int, count: int) -> list[Measure]:
    sixth = count // 6
    plan = BuildPlan(
        WorldSource(WORLDS_PER_SEED * (seed + 1), SceneSettings(size_wh=size_wh)),
        seed,
        Composition(3 * sixth, sixth, sixth, sixth),
    )
    segmenter = Segmenter.default(1)
    told: dict[tuple[str, bool], list[bool]] = {}
    times, ranged = [], []
    with tempfile.TemporaryDirectory() as folder:
        build(Path(folder) / "set", plan, workers=2)
        for sample in read_samples(Path(folder) / "set"):
            seen = masks_of(sample, segmenter, sample.camera)
            kind = sample.anomaly.type if sample.anomaly else "clear"
            for closer in (True, False):
                masks = seen if closer else replace(seen, close_ups=None)
                began = time.process_time()
                answer = inspect_still(masks, sample.camera)
                if closer:
                    times.append(1e3 * (time.process_time() - began))
                told.setdefault((kind, closer), []).append(right(sample, answer))
            if sample.anomaly is not None and sample.anomaly.type != "distortion":
                true_m = sample.anomaly.range_m
                if true_m is not None:
                    ranged += _alone(seen, sample.camera, true_m)
    measures = []
    for closer, name in ((True, "with close-ups"), (False, "without")):
        every = [one for (_, c), ones in told.items() if c is closer for one in ones]
        measures.append(_share(f"{name}, told right", every, 94.0 if closer else None))
        for kind, bar in _BARS.items():
            measures.append(_share(f"{name}, {kind}", told[kind, closer], bar if closer else None))
    measures.append(Measure("time of the inspector and close-ups", statistics.median(times), "ms"))
    if ranged:
        errors = [abs(found.range_m / true_m - 1.0) for found, true_m in ranged]
        inside = [f.interval_m[0] <= true_m <= f.interval_m[1] for f, true_m in ranged]
        measures += [
            Measure("things close-ups alone found and ranged", len(ranged), ""),
            Measure("range error of those, median", 100 * statistics.median(errors), "%"),
            _share("95 % interval holds the truth", inside, None),
        ]
    return measures


def _on_rides(count: int) -> list[Measure]:
    """What only close-ups show in the frames of rides with planted anomalies, and its range."""
    segmenter = Segmenter.default(1)
    errors: dict[str, list[float]] = {}
    inside: dict[str, list[bool]] = {}
    nowhere = frames = 0
    for seed in range(FIRST_RIDE, FIRST_RIDE + count):
        ride = Ride.plan(seed, demo_settings(), duration_s=50, anomalies="demo")
        follower = TrackFollower(ride.camera)
        for index in range(len(ride)):
            seen = segmenter(ride.frame(index).rgb)
            track = follower.update(seen)
            frames += 1
            ahead = [(p.type, p.chainage_m - ride.chainage_m(index)) for p in ride.planted]
            for finding in find(seen, track):
                if finding.place_rel == 0.0 or finding.doubt is not None:
                    continue
                measured = FrameRanging(track, segmentation=seen).measure(finding)
                if not isinstance(measured, Range):
                    continue
                places = [(abs(math.log(measured.range_m / m)), t, m) for t, m in ahead if m > 0]
                away, kind, true_m = min(places, default=(math.inf, "", 0.0))
                if away > math.log(NOT_THERE):
                    nowhere += 1
                    continue
                errors.setdefault(kind, []).append(measured.range_m / true_m - 1.0)
                low, high = measured.interval_m
                inside.setdefault(kind, []).append(low <= true_m <= high)
    measures = [
        Measure("rides, frames", frames, ""),
        Measure("rides, seen by close-ups alone where nothing is", nowhere, ""),
    ]
    for kind, some in sorted(errors.items()):
        name = f"rides, {kind} by close-ups alone"
        measures += [
            Measure(f"{name}, ranged", len(some), ""),
            Measure(f"{name}, range error, median", 100 * statistics.median(some), "%"),
            Measure(f"{name}, standard deviation", 100 * statistics.pstdev(some), "%"),
            _share(f"{name}, 95 % interval holds the truth", inside[kind], None),
        ]
    return measures


_BARS = {"clear": None, "distortion": 95.3, "obstruction": 94.7, "trespasser": 92.0}


def _alone(
    seen: SegmentationLike, camera: Camera | None, true_m: float
) -> list[tuple[Range, float]]:
    """The range of what close-ups alone found in a picture, with the true one."""
    track = TrackFollower(camera).update(seen)
    ranging = FrameRanging(track, segmentation=seen)
    found = []
    for finding in find(seen, track, Thresholds().still()):
        if finding.place_rel > 0 and finding.doubt is None:
            measured = ranging.measure(finding)
            near = isinstance(measured, Range) and 0.6 < measured.range_m / true_m < 1.6
            if isinstance(measured, Range) and near:
                found.append((measured, true_m))
    return found


def _share(name: str, hits: list[bool], bar: float | None) -> Measure:
    return Measure(name, 100 * float(np.mean(hits)), "%", bar, "higher")


def main() -> None:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--size", default="1920x1080", help="size of the pictures")
    arguments.add_argument("--seed", type=int, default=16, help="seed of the set (default 16)")
    arguments.add_argument(
        "--count", type=int, default=90, help="pictures, a multiple of 6; 0 for none (default 90)"
    )
    arguments.add_argument(
        "--rides", type=int, default=2, help="rides of 50 s to inspect, 0 for none (default 2)"
    )
    options = arguments.parse_args()
    cv2.setNumThreads(1)
    measures = _costs()
    if options.count:
        width, height = (int(side) for side in options.size.split("x"))
        measures += _pictures((width, height), options.seed, options.count)
    if options.rides:
        measures += _on_rides(options.rides)
    publish("close-ups", measures, options.json)


if __name__ == "__main__":
    main()
