"""The inspector after segmentation: time, rail error, ranges, and what it finds or invents.

Everything is measured with true masks, on rendered rides and, for the smallest distortion that is
found, on tracks drawn for it; so the figures are those of the geometry alone. ``railinspect demo``
and ``railinspect evaluate`` show the same with the shipped network. Times are processor times of
one core.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, field

import cv2
import numpy as np

from benchmarks.common import Measure, parser, publish
from railinspect.evaluation import true_segmentation
from railinspect.evaluation.drawn_tracks import camera, draw
from railinspect.findings import find
from railinspect.ranging import range_of
from railinspect.scenes import Ride, demo_settings
from railinspect.track import TrackFollower


@dataclass
class _Tally:
    times_ms: list[float] = field(default_factory=list)
    rail_errors_px: list[float] = field(default_factory=list)
    range_errors: list[tuple[float, float, bool]] = field(default_factory=list)
    found: set[float] = field(default_factory=set)
    planted: int = 0
    false_frames: int = 0
    frames: int = 0
    followed: int = 0


def _ride(ride: Ride, stride: int, calibrated: bool, tally: _Tally) -> None:
    follower = TrackFollower(ride.camera if calibrated else None)
    tally.planted += len(ride.planted)
    for index in range(0, len(ride), stride):
        frame = ride.frame(index)
        masks = true_segmentation(frame.labels)
        start = time.process_time()
        track = follower.update(masks)
        findings = find(masks, track)
        tally.times_ms.append(1e3 * (time.process_time() - start))
        tally.frames += 1
        tally.followed += track.followed
        for line, truth in zip((track.left_uv, track.right_uv), frame.ego_rails, strict=True):
            if len(line) and not findings:
                errors = np.interp(line[:, 1], truth[:, 1], truth[:, 0]) - line[:, 0]
                tally.rail_errors_px.append(float(np.median(np.abs(errors))))
        here = ride.chainage_m(index)
        for finding in findings:
            distance = range_of(finding, track)
            if distance is None:
                continue
            ahead = [t for t in ride.planted if t.type == finding.type]
            nearest = min(
                ahead, key=lambda t: abs(t.chainage_m - here - distance.range_m), default=None
            )
            gap = float("inf") if nearest is None else nearest.chainage_m - here
            slack = max(8.0, 0.25 * distance.range_m) + (
                14.0 if finding.type == "distortion" else 0
            )
            if nearest is None or abs(gap - distance.range_m) > slack:
                tally.false_frames += 1
                continue
            tally.found.add(nearest.chainage_m)
            if finding.type != "distortion" and gap > 8:
                low, high = distance.interval_m
                tally.range_errors.append((gap, distance.range_m / gap - 1, low <= gap <= high))


def _ranges(tally: _Tally, name: str) -> list[Measure]:
    measures = []
    for low, high in ((8, 50), (50, 100), (100, 250)):
        band = [(e, inside) for gap, e, inside in tally.range_errors if low <= gap < high]
        if len(band) < 5:
            continue
        error = 100 * statistics.median(abs(e) for e, _ in band)
        cover = 100 * sum(inside for _, inside in band) / len(band)
        measures.append(Measure(f"{name}, range error {low}–{high} m, median", error, "%"))
        measures.append(
            Measure(
                f"{name}, 95 % interval holds the truth {low}–{high} m", cover, "%", None, "higher"
            )
        )
    return measures


def smallest_bend_m(range_m: float, length_m: float, period_m: float) -> float:
    """Smallest amplitude that is found of a bend whose middle lies at this range, to 8 %, metres.

    A bulge for a period of 0, else a ripple; a camera of 55° and 640 pixels, 2.8 m high.
    """
    view = camera()

    def found(amplitude_m: float) -> bool:
        def bend(s: np.ndarray) -> np.ndarray:
            t = s - range_m + length_m / 2
            wave = (
                np.sin(2 * np.pi * t / period_m) if period_m else np.sin(np.pi * t / length_m) ** 2
            )
            return np.where((t > 0) & (t < length_m), amplitude_m * wave, 0.0)

        masks = draw(view, bend=bend)
        follower = TrackFollower(view)
        follower.update(masks)
        return any(f.type == "distortion" for f in find(masks, follower.update(masks)))

    # From below: a bend so large that the rails cannot be followed over it is unknown, not found.
    amplitude_m = 0.02
    while not found(amplitude_m):
        amplitude_m *= 1.08
        if amplitude_m > 0.6:
            return float("inf")
    return amplitude_m


def _smallest_bends() -> list[Measure]:
    measures = []
    for name, length_m, period_m in (("bulge of 10 m", 10.0, 0.0), ("ripple of 5 m", 15.0, 5.0)):
        for range_m in (15, 20, 30, 40, 50):
            metres = smallest_bend_m(range_m, length_m, period_m)
            pixels = metres * camera().focal_px / range_m
            measures.append(Measure(f"smallest {name} found at {range_m} m", 100 * metres, "cm"))
            measures.append(Measure("the same in the image", pixels, "px", 1.5))
    return measures


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--seed", type=int, default=1, help="seed of the rides (default 1)")
    arguments.add_argument(
        "--stride", type=int, default=4, help="every how many frames are judged (default 4)"
    )
    options = arguments.parse_args()
    cv2.setNumThreads(1)
    measures: list[Measure] = []
    for calibrated in (True, False):
        name = "calibrated" if calibrated else "unknown camera"
        demo, clear = _Tally(), _Tally()
        settings = demo_settings()
        _ride(
            Ride.plan(options.seed, settings, duration_s=60, anomalies="demo"),
            options.stride,
            calibrated,
            demo,
        )
        _ride(
            Ride.plan(options.seed + 100, settings, duration_s=60),
            options.stride,
            calibrated,
            clear,
        )
        if calibrated:
            times = sorted(demo.times_ms[3:] + clear.times_ms[3:])
            measures.append(
                Measure("640x360 after segmentation, median", statistics.median(times), "ms", 4.0)
            )
            quiet = times[len(times) // 10]
            measures.append(Measure("the same, fastest tenth", quiet, "ms"))
        measures += [
            Measure(
                f"{name}, ego rails, median error",
                statistics.median(demo.rail_errors_px + clear.rail_errors_px),
                "px",
                0.5,
            ),
            Measure(
                f"{name}, clear ride followed",
                100 * clear.followed / clear.frames,
                "%",
                95,
                "higher",
            ),
            Measure(
                f"{name}, anomalies found", 100 * len(demo.found) / demo.planted, "%", 90, "higher"
            ),
            Measure(
                f"{name}, clear ride, frames with a false finding",
                100 * clear.false_frames / clear.frames,
                "%",
                0.5,
            ),
            *_ranges(demo, name),
        ]
    measures += _smallest_bends()
    publish("inspector", measures, options.json)


if __name__ == "__main__":
    main()
