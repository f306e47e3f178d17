"""``railinspect scenes``: rendered image sets, stereo pairs and rides from the command line."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from railinspect.errors import BadInputError, OutputError
from railinspect.progress import ProgressLine

AddCommand = Callable[..., argparse.ArgumentParser]


def add_scenes(commands: Any, add: AddCommand) -> None:
    """Add the command ``scenes`` and its three kinds to the parser."""
    scenes = commands.add_parser(
        "scenes",
        help="render railway scenes with their truth",
        description="Render railway scenes with their truth; the same seed gives the same files "
        "on any number of workers.",
    )
    kinds = scenes.add_subparsers(title="what to render", metavar="KIND", required=True)
    images = add(kinds, "images", "images, masks and notes in RailSem19's layout")
    images.add_argument("--count", type=int, default=10, help="number of images (default: 10)")
    images.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
    _common(images)
    images.set_defaults(run=_run_images)
    stereo = add(kinds, "stereo", "rectified stereo pairs with true depth")
    stereo.add_argument("--count", type=int, default=1, help="number of pairs (default: 1)")
    stereo.add_argument(
        "--baseline-m", type=float, default=0.5, help="distance of the cameras, m (default: 0.5)"
    )
    _common(stereo)
    stereo.set_defaults(run=_run_stereo)
    ride = add(kinds, "ride", "the video of a ride, with its planted anomalies as JSON")
    ride.add_argument("--speed-kmh", type=float, default=72.0, help="km/h (default: 72)")
    ride.add_argument("--duration-s", type=float, default=50.0, help="s (default: 50)")
    ride.add_argument("--frame-rate", type=float, default=12.5, help="frames/s (default: 12.5)")
    ride.add_argument(
        "--anomalies", type=int, default=0, help="anomalies on the own track (default: 0)"
    )
    ride.add_argument("--workers", type=int, default=None, help="processes (default: cores, ≤ 2)")
    _common(ride)
    ride.set_defaults(run=_run_ride)


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--seed", type=int, default=0, help="first seed, ≥ 0 (default: 0)")
    parser.add_argument(
        "--size", default="640x360", metavar="WxH", help="pixels (default: 640x360)"
    )


def size_of(text: str) -> tuple[int, int]:
    """Width and height from ``640x360``."""
    width, cross, height = text.partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise BadInputError(f"size is {text!r}; write width and height in pixels, as in 640x360")
    return int(width), int(height)


def _checked(options: argparse.Namespace) -> Any:
    """The scene settings, once the numbers that every kind shares are in range."""
    from railinspect.scenes import SceneSettings

    if options.seed < 0:
        raise BadInputError(f"seed is {options.seed}; give a whole number of at least 0")
    for name in ("count", "workers"):
        value = getattr(options, name, None)
        if value is not None and value < 1:
            raise BadInputError(f"{name} is {value}; give at least 1")
    return SceneSettings(size_wh=size_of(options.size))


def _finish(options: argparse.Namespace, document: dict[str, Any]) -> int:
    if options.json:
        print(json.dumps(document))
    else:
        print("\n".join(f"{key:<9}{value}" for key, value in document.items()))
    return 0


def _run_images(options: argparse.Namespace) -> int:
    from railinspect.scenes import write_images

    settings = _checked(options)
    seeds = range(options.seed, options.seed + options.count)
    line = ProgressLine("rendering")
    try:
        for done, _ in enumerate(write_images(options.out, seeds, settings, options.workers), 1):
            line.show(done, done / options.count)
    finally:
        line.close()
    document = {"out": str(options.out), "images": options.count, "seed": options.seed}
    return _finish(options, document)


def _run_stereo(options: argparse.Namespace) -> int:
    from railinspect.scenes import render_stereo

    settings = _checked(options)
    if not (math.isfinite(options.baseline_m) and options.baseline_m > 0):
        raise BadInputError(f"baseline is {options.baseline_m} m; give a positive number")
    line = ProgressLine("rendering")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        for done, seed in enumerate(range(options.seed, options.seed + options.count), 1):
            left, right = render_stereo(seed, options.baseline_m, settings)
            write_pair(options.out, f"pair{seed:05d}", left, right, options.baseline_m)
            line.show(done, done / options.count)
    except OSError as error:
        raise OutputError(f"cannot write to {options.out}: {error.strerror or error}") from error
    finally:
        line.close()
    document = {"out": str(options.out), "pairs": options.count, "seed": options.seed}
    return _finish(options, document)


def write_pair(out: Path, name: str, left: Any, right: Any, baseline_m: float) -> None:
    """Left and right image as PNG, depth in metres and the camera: ``NAME_….png|npy|yaml``."""
    import cv2
    import numpy as np

    for side, rgb in (("left", left.rgb), ("right", right.rgb)):
        data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1]
        (out / f"{name}_{side}.png").write_bytes(data.tobytes())
    np.save(out / f"{name}_depth_m.npy", left.depth_m)
    left.camera.save(out / f"{name}_camera.yaml")
    (out / f"{name}.json").write_text(
        json.dumps({"baseline_m": baseline_m, "focal_px": left.camera.focal_px}) + "\n",
        encoding="utf-8",
    )


def _run_ride(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from railinspect.ride_file import RidePlan, record_ride
    from railinspect.runfolder import RunFolder, refuse_taken
    from railinspect.scenes import demo_settings

    size_wh = _checked(options).size_wh
    if options.anomalies < 0:
        raise BadInputError(f"anomalies is {options.anomalies}; give a number of at least 0")
    plan = RidePlan(
        options.seed,
        demo_settings(size_wh),
        options.speed_kmh / 3.6,
        options.duration_s,
        options.frame_rate,
        "demo" if options.anomalies else "clear",
        options.anomalies,
    )
    refuse_taken(options.out, ("ride.mp4", "truth.json"))
    RunFolder.claim(options.out)
    line = ProgressLine("rendering")
    video, truth = options.out / "ride.mp4", options.out / "truth.json"
    try:
        ride = record_ride(
            replace(plan),
            video,
            truth,
            options.workers,
            lambda done, total: line.show(done, done / total),
        )
    finally:
        line.close()
    ride.camera.save(options.out / "camera.yaml")
    return _finish(options, {"video": str(video), "truth": str(truth), "frames": len(ride)})
