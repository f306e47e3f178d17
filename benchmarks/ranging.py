"""Ranging against truth: error by instrument and range band, and how often intervals hold it.

Rendered rides of 1920×1080 with a focal length of 3000 px, 2.5 m above the rails, true masks
(``--bundle`` adds the shipped network with its closer looks), frames judged one by one as
``railinspect range`` judges a picture; rendered stereo pairs; a ride that calibrates its own
camera; the rolling-shutter sensor; closing speed from one second of video; time per finding as
processor time. Frames are chosen so that each planted thing is seen from three of six distances.
The error model was set on rides 600–619 and checked on 211–230; figures are stated on others.
``--parts`` runs some of it; the defaults fit into ten minutes on two quiet cores.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import multiprocessing
import statistics
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common import Measure, parser, publish
from benchmarks.ranging_plots import plots
from railinspect.boxes import overlap_share
from railinspect.camera import Camera
from railinspect.evaluation import true_segmentation
from railinspect.findings import Finding, find
from railinspect.fovea import Fovea
from railinspect.ranging import FrameRanging, MotionFilter, Range, RangingSettings
from railinspect.ranging.calibrate_ride import RideCalibrator
from railinspect.ranging.rolling_shutter import ShutterSensor, lateral_error
from railinspect.ranging.shutter_detect import find_stripe
from railinspect.ranging.shutter_scene import render_stripe
from railinspect.ranging.stereo import StereoSettings, match
from railinspect.ranging.stereo_camera import StereoCamera
from railinspect.scenes import Ride, SceneSettings, demo_settings, render_stereo, tables
from railinspect.scenes.render import Rendered, SceneObject
from railinspect.segmenter import Segmentation, Segmenter
from railinspect.thresholds import Thresholds
from railinspect.track import TrackFollower

SIZE_WH = (1920, 1080)
CAMERA = Camera(SIZE_WH, 3000.0, (959.5, 539.5), 2.5, pitch_rad=0.03)
BANDS_M = ((8.0, 50.0), (50.0, 100.0), (100.0, 250.0))
SEEN_FROM_M = (25.0, 45.0, 70.0, 90.0, 130.0, 180.0)
FIRST_SEED = 231
PARTS = ("rides", "closing", "stereo", "calibration", "shutter")


@dataclasses.dataclass(frozen=True)
class _Seen:
    truth_m: float
    range_m: float
    inside: bool
    readings: dict[str, float]
    took_ms: float
    alone_ms: float


@dataclasses.dataclass(frozen=True)
class _Masks:
    """Where masks come from, and what ranging may expect of them."""

    bundle: bool

    def settings(self) -> RangingSettings:
        """As for a calibrated camera: which rails the line has is known."""
        masks = RangingSettings() if self.bundle else RangingSettings.sharp(SIZE_WH[0])
        return dataclasses.replace(masks, bed_std_m=0.0)

    def segment(self, frame: Rendered) -> Segmentation:
        return _network()(frame.rgb) if self.bundle else true_segmentation(frame.labels)


@functools.cache
def _network() -> Fovea:
    return Fovea(Segmenter.default(1, close_ups=False), CAMERA)


def _ride(seed: int) -> Ride:
    settings = SceneSettings(
        size_wh=SIZE_WH, camera=CAMERA, kind="line", weather=False, min_radius_m=400.0
    )
    return Ride.plan(seed, settings, duration_s=60, anomalies="demo")


def _object_of(finding: Finding, frame: Rendered) -> SceneObject | None:
    """The thing whose foot this is; distortions are stretches, not places.

    A foot may be wrong by a quarter of its distance below the horizon: what is looked at is how
    wrong it is, so the match must not choose the good ones. Of several the one whose box shares
    most with the finding's.
    """
    u, v = finding.foot_uv
    horizon = frame.camera.horizon_v()
    matching = []
    for thing in frame.objects:
        left, _, right, bottom = thing.box_xyxy
        if not thing.on_track or thing.type == "distortion" or thing.range_m < BANDS_M[0][0]:
            continue
        slack = max(6.0, 0.25 * (bottom - horizon))
        if left - 6.0 <= u <= right + 6.0 and abs(bottom + 0.5 - v) <= slack:
            matching.append(thing)
    return max(matching, key=lambda t: overlap_share(t.box_xyxy, finding.box_xyxy), default=None)


def _ranged(
    ride: Ride, frame: Rendered, masks: _Masks
) -> Iterator[tuple[SceneObject, Range, float, float]]:
    """Things found in a frame, their range, and the processor time it took, ms.

    With and without the finding's share of the track's scale, which a frame's findings have in
    common. It starts where the loop does: masks, track and findings made just before.
    """
    seen = masks.segment(frame)
    follower = TrackFollower(ride.camera)
    for _ in range(2):
        track = follower.update(seen)
    found_there = find(seen, track, Thresholds().still())
    findings = [finding for finding in found_there if finding.doubt is None]
    start = time.process_time()
    rgb = frame.rgb if masks.bundle else None
    ranging = FrameRanging(track, segmentation=seen, settings=masks.settings(), rgb=rgb)
    _ = ranging.scale
    fitted_ms = 1e3 * (time.process_time() - start)
    taken: set[int] = set()
    for finding in findings:
        thing = _object_of(finding, frame)
        start = time.process_time()
        found = ranging.measure(finding)
        alone_ms = 1e3 * (time.process_time() - start)
        below = isinstance(found, Range) and found.method.startswith("below")
        if thing is None or thing.id in taken or not isinstance(found, Range) or below:
            continue
        taken.add(thing.id)
        yield thing, found, alone_ms + fitted_ms / len(findings), alone_ms


def _one_ride(seed: int, bundle: bool) -> tuple[int, list[_Seen], list[_Seen]]:
    """Things in sight, and what true masks and the bundle say of them."""
    ride = _ride(seed)
    present, by_truth, by_bundle = 0, [], []
    nearest, farthest = BANDS_M[0][0], BANDS_M[-1][1]
    for number, planted in enumerate(ride.planted):
        if planted.type == "distortion":
            continue
        for away in SEEN_FROM_M[number % 2 :: 2]:
            index = round((planted.chainage_m - away) / ride.speed_mps * ride.frame_rate)
            if not 0 <= index < len(ride):
                continue
            frame = ride.frame(index)
            present += sum(
                o.on_track and o.type != "distortion" and nearest <= o.range_m < farthest
                for o in frame.objects
            )
            for masks, out in ((_Masks(False), by_truth), (_Masks(True), by_bundle)):
                if masks.bundle and not bundle:
                    continue
                for thing, found, *took_ms in _ranged(ride, frame, masks):
                    low, high = found.interval_m
                    readings = {r.method: r.range_m for r in found.readings}
                    holds = low <= thing.range_m <= high
                    out.append(_Seen(thing.range_m, found.range_m, holds, readings, *took_ms))
    return present, by_truth, by_bundle


def _rides(pool: Executor, seeds: range, bundle: bool) -> list[Measure]:
    present, seen, coarse = 0, [], []
    for count, by_truth, by_bundle in pool.map(_one_ride, seeds, [bundle] * len(seeds)):
        present += count
        seen += by_truth
        coarse += by_bundle
    measures = [Measure("things in sight, 8–250 m", present, "")]
    measures += _accuracy("true masks", seen, (0.5, 1.5))
    if bundle:
        measures += _accuracy("shipped bundle", coarse, (1.5, 4.0))
    for name, some in (("true masks", seen), ("shipped bundle", coarse)):
        if some:
            took = statistics.median(s.took_ms for s in some)
            alone = statistics.median(s.alone_ms for s in some)
            label = f"{name}, ranging per finding, median CPU"
            measures.append(Measure(label, alone, "ms", 0.3))
            measures.append(Measure(f"{label} with its share of the frame's scale", took, "ms"))
    return measures


def _accuracy(name: str, seen: list[_Seen], bars: tuple[float, float]) -> list[Measure]:
    measures = []
    for low, high in BANDS_M:
        band = [s for s in seen if low <= s.truth_m < high]
        label = f"{name}, {low:.0f}–{high:.0f} m"
        measures.append(Measure(f"{label}, measurements", len(band), ""))
        if not band:
            continue
        instruments = sorted({method for s in band for method in s.readings})
        for method in instruments:
            errors = [abs(s.readings[method] / s.truth_m - 1) for s in band if method in s.readings]
            measures.append(
                Measure(f"{label}, {method} alone", 100 * statistics.median(errors), "%")
            )
        cover = 100 * sum(s.inside for s in band) / len(band)
        measures.append(Measure(f"{label}, truth in the 95 % interval", cover, "%", 93, "higher"))
        measures.append(Measure(f"{label}, the same, not too wide", cover, "%", 97))
    for (low, high), bar in zip(((8.0, 100.0), (100.0, 250.0)), bars, strict=True):
        errors = [abs(s.range_m / s.truth_m - 1) for s in seen if low <= s.truth_m < high]
        if errors:
            error = 100 * statistics.median(errors)
            measures.append(
                Measure(f"{name}, {low:.0f}–{high:.0f} m, median error", error, "%", bar)
            )
    return measures


def _closing_errors(seed: int) -> list[float]:
    """Closing speed less the train's, from a second of video that starts with a thing 88 m ahead.

    Two things of each ride: the frames of one cost half a minute to render.
    """
    ride, errors = _ride(seed), []
    wanted = [t for t in ride.planted if t.type != "distortion" and t.chainage_m > 90.0][:2]
    for thing in wanted:
        first = math.ceil((thing.chainage_m - 88.0) / ride.speed_mps * ride.frame_rate)
        motions, motion = MotionFilter(), None
        for index in range(first, first + 13):
            for found, distance, *_ in _ranged(ride, ride.frame(index), _Masks(False)):
                if found.id == thing.id:
                    motion = motions.update(
                        index / ride.frame_rate,
                        distance.range_m,
                        distance.noise_m,
                        distance.bias_m,
                    )
        if motion is not None and motion.time_s > (first + 10) / ride.frame_rate:
            errors.append(motion.closing.speed_mps - ride.speed_mps)
    return errors


def _closing(pool: Executor, seeds: range) -> list[Measure]:
    errors = [error for some in pool.map(_closing_errors, seeds) for error in some]
    if not errors:
        return []
    rms = math.sqrt(statistics.fmean(e**2 for e in errors))
    return [
        Measure("closing speed from 1 s at 88–68 m, RMS", rms, "m/s", 0.8),
        Measure("closing speed, median error", statistics.median(map(abs, errors)), "m/s"),
        Measure("closing speed, things", len(errors), ""),
    ]


def _stereo(seeds: range, real: Path | None) -> list[Measure]:
    camera = Camera.from_field_of_view((1280, 720), math.radians(50.0), 2.6, pitch_rad=0.03)
    settings = SceneSettings(size_wh=(1280, 720), camera=camera, kind="line", crowded=True)
    pair = StereoCamera(camera.focal_px, 1.5, camera.principal_uv)
    near, far = [], []
    for seed in seeds:
        left, right = render_stereo(seed, 1.5, settings)
        found = pair.range_m(match(left.rgb, right.rgb, StereoSettings(most_px=256)).disparity_px)
        error = np.abs(found / np.where(np.isfinite(left.depth_m), left.depth_m, np.nan) - 1)
        for band, out in (((5.0, 100.0), near), ((100.0, 250.0), far)):
            part = error[(left.depth_m >= band[0]) & (left.depth_m < band[1]) & np.isfinite(error)]
            if len(part) > 50:
                out.append(float(np.median(part)))
    measures = [
        Measure("stereo 1.5 m, 5–100 m, median error", 100 * statistics.median(near), "%", 1.0),
        Measure("stereo 1.5 m, 100–250 m, median error", 100 * statistics.median(far), "%", 3.0),
    ]
    if real is not None:
        measures += _real_pairs(real)
    return measures


def _real_pairs(real: Path) -> list[Measure]:
    measures = []
    cones = cv2.imdecode(
        np.fromfile(real / "stereo_cones/disp_left.tif", np.uint8), cv2.IMREAD_UNCHANGED
    )
    scenes = (
        ("playground", "im0.png", "im1.png", _pfm(real / "stereo_playground/disp0.pfm"), 128),
        ("cones", "left.png", "right.png", cones, 64),
    )
    for name, left, right, truth, most in scenes:
        pictures = [cv2.imread(str(real / f"stereo_{name}" / n), 0) for n in (left, right)]
        found = match(*pictures, StereoSettings(most_px=most)).disparity_px
        known = np.isfinite(truth) & (truth > 0)
        error = np.abs(found - truth)[known & np.isfinite(found)]
        share = 100 * len(error) / np.count_nonzero(known)
        median = float(np.median(error))
        measures += [
            Measure(f"stereo_{name}, median disparity error", median, "px", 0.35),
            Measure(f"stereo_{name}, bad 2.0 of matched", 100 * float((error > 2).mean()), "%", 10),
            Measure(f"stereo_{name}, matched of known", share, "%", None, "higher"),
        ]
    return measures


def _pfm(path: Path) -> np.ndarray:
    with path.open("rb") as file:
        file.readline()
        width, height = (int(word) for word in file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return np.frombuffer(file.read(), order).reshape(height, width)[::-1]


def _calibrated(seed: int, bundle: bool) -> tuple[float, float, float] | None:
    """Relative errors of focal length and height, and the pitch's (rad); None without sleepers."""
    ride = Ride.plan(seed, demo_settings(), duration_s=10)
    pitch = float(ride.world.tracks[0][tables.TRACK_SLEEPER_PITCH])
    if pitch <= 0:
        return None
    calibrator = RideCalibrator((640, 360), sleeper_m=pitch)
    network = Segmenter.default(1) if bundle else None
    for index in range(0, len(ride), 3):
        frame = ride.frame(index)
        masks = network(frame.rgb) if network else true_segmentation(frame.labels)
        calibrator.update(masks, frame.rgb)
    found, truth = calibrator.result().camera, ride.camera
    return (
        abs(found.focal_px / truth.focal_px - 1),
        abs(found.height_m / truth.height_m - 1),
        abs(found.pitch_rad - truth.pitch_rad),
    )


def _calibration(pool: Executor, seeds: tuple[int, ...], bundle: bool) -> list[Measure]:
    found = [e for e in pool.map(_calibrated, seeds, [bundle] * len(seeds)) if e is not None]
    focal, height, tilt = np.array(found).max(axis=0)
    name = f"self-calibration from 10 s, {'shipped bundle' if bundle else 'true masks'}"
    return [
        Measure(f"{name}, worst focal length", 100 * focal, "%", 3.0),
        Measure(f"{name}, worst height", 100 * height, "%", 2.0),
        Measure(f"{name}, worst pitch", math.degrees(tilt), "°", 0.1),
    ]


def _shutter() -> list[Measure]:
    sensor = ShutterSensor(size_wh=(1600, 1024))
    rng = np.random.default_rng(0)
    errors = []
    for k in range(20):
        roll = math.radians(1.0) * math.sin(2 * math.pi * 0.7 * 1.3 * k)
        image = render_stripe(
            sensor, 40 / 3.6, 1.0 + float(rng.uniform(0, 0.01)), rng, start_m=-0.45, roll_rad=roll
        )
        errors.append(find_stripe(image, sensor).speed(1.0, sensor).speed_mps - 40 / 3.6)
    worst = max(abs(e) for e in errors)
    formula = lateral_error(1.0, 796, 836, ShutterSensor(), 0.01, math.radians(1.0))
    rms = math.sqrt(statistics.fmean(e**2 for e in errors))
    return [
        Measure("lateral speed at 40 km/h, worst of the simulation", worst, "m/s", 0.13),
        Measure("lateral speed, RMS of the simulation", rms, "m/s"),
        Measure("lateral speed, worst case by (16)", formula, "m/s", 0.13),
    ]


def main() -> None:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--rides", type=int, default=5, help="rides (default 5)")
    arguments.add_argument(
        "--closing-rides", type=int, default=5, help="rides for the closing speed (default 5)"
    )
    arguments.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    arguments.add_argument("--bundle", action="store_true", help="the shipped network as well")
    arguments.add_argument("--real", type=Path, help="folder with stereo_cones and the like")
    arguments.add_argument("--plots", type=Path, help="folder for the docs' plots")
    arguments.add_argument(
        "--parts", default=",".join(PARTS), help="what to run (default: %(default)s)"
    )
    arguments.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    options = arguments.parse_args()
    parts = options.parts.split(",")
    if unknown := sorted(set(parts) - set(PARTS)):
        arguments.error(f"unknown parts {unknown}; known: {', '.join(PARTS)}")
    cv2.setNumThreads(1)
    if options.plots:
        plots(options.plots)
    seeds = range(options.first, options.first + options.rides)
    measures = []
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, fresh, cv2.setNumThreads, (1,)) as pool:
        if "rides" in parts:
            measures += _rides(pool, seeds, options.bundle)
        if "closing" in parts:
            last = options.first + options.closing_rides
            measures += _closing(pool, range(options.first, last))
        if "calibration" in parts:
            measures += _calibration(pool, (1, 2, 4), False)
            if options.bundle:
                measures += _calibration(pool, (1, 2, 4), True)
    if "stereo" in parts:
        measures += _stereo(range(40, 48), options.real)
    if "shutter" in parts:
        measures += _shutter()
    publish("ranging", measures, options.json)


if __name__ == "__main__":
    main()
