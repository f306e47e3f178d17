"""The ``railinspect`` command: parse, call the library, print for people or as one JSON document.

Exit status: 0 done, 1 done but something failed its check, 2 bad input (one sentence on standard
error). An interrupt ends with 130 after what was finished has been kept.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from railinspect.errors import BadInputError, RailInspectError
from railops.errors import RailOpsError

if TYPE_CHECKING:
    from railinspect.run_summary import RunSummary
    from railinspect.speed_log import SpeedLog
    from railops.braking import Train

DONE: Final = 0
FAILED_CHECK: Final = 1
BAD_INPUT: Final = 2
INTERRUPTED: Final = 130

ASSUMED_SPEED_KMH: Final = 80.0
"""Speed the advice assumes where none is given, km/h; the report says that it is assumed."""


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except (RailInspectError, RailOpsError) as error:
        return _refuse(str(error))
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _refuse(f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        print("railinspect: interrupted; what was finished is kept", file=sys.stderr)
        return INTERRUPTED


def _refuse(message: str) -> int:
    print("railinspect: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def build_parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    from railinspect.runinfo import installed_version

    parser = _Parser(
        prog="railinspect",
        description="From a cab view to what is on the track, how far, how sure, and whether the "
        "train must brake.",
    )
    version = installed_version("railinspect") or "(not installed)"
    parser.add_argument("--version", action="version", version=f"railinspect {version}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_demo(commands)
    _add_inspect(commands)
    _add_scenes(commands)
    _add_anomalies(commands)
    _add_evaluate(commands)
    _add_ranging(commands)
    _add_fleet_results(commands)
    _add_verify(commands)
    return parser


def _command(commands: Any, name: str, help_: str, **rest: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=help_, description=rest.pop("description", help_), **rest
    )
    parser.add_argument(
        "--json", action="store_true", help="print exactly one JSON document on standard output"
    )
    return parser


def _add_demo(commands: Any) -> None:
    parser = _command(
        commands,
        "demo",
        "render a ride with known anomalies, inspect it, compare with the truth",
        description="Render a ride of 50 s at 72 km/h with eleven anomalies (distorted rails, "
        "obstructions, people) and a clear stretch, inspect it with the shipped bundle, and say "
        "what was found, missed and false. An event matches an anomaly if its place (train's "
        "chainage plus range) is within 10 m of it; it counts as found if the type agrees too. The "
        "exit status is 1 if fewer than nine of ten are found or more than one event is false.",
    )
    parser.add_argument("--out", type=Path, required=True, help="run folder to create")
    parser.add_argument("--seed", type=int, default=None, help="seed of the ride (default: 1)")
    parser.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    parser.set_defaults(run=_run_demo)


def _run_demo(options: argparse.Namespace) -> int:
    from railinspect.demo import DEMO_SEED, run_demo
    from railinspect.ride_file import RidePlan
    from railinspect.scenes import demo_settings

    seed = DEMO_SEED if options.seed is None else options.seed
    if seed < 0:
        raise BadInputError(f"seed is {seed}; give a whole number of at least 0")
    plan = RidePlan(seed, demo_settings())
    document = run_demo(options.out, _segmenter(options), plan, quiet=options.json)
    status = DONE if document["passed"] else FAILED_CHECK
    if options.json:
        print(json.dumps(document))
        return status
    for one in document["anomalies"]:
        where = f"{one['type']:<12} at {one['chainage_m']:7.1f} m"
        if one["outcome"] == "found":
            seen = one["first_range_m"]
            first = "range unknown" if seen is None else f"first seen {seen:.0f} m ahead"
            print(f"  found     {where}   event {one['event']}, {first}")
        elif one["outcome"] == "confused":
            print(f"  MISSED    {where}   event {one['event']} calls it {one['event_type']}")
        else:
            print(f"  MISSED    {where}   no event")
    for event in document["false"]:
        print(
            f"  FALSE     {event['type']:<12} at {event['first_time_s']:.1f} s, event "
            f"{event['event']}"
        )
    print(
        f"{document['found']} of {document['planted']} anomalies found, {document['missed']} "
        f"missed, {document['false_events']} false events; {document['frames']} frames at "
        f"{document['frames_per_s']:.1f} frames/s"
    )
    if status == FAILED_CHECK:
        bar = document["bar"]
        print(
            f"below the bar: {100 * bar['found_share']:.0f} % found, at most "
            f"{bar['false_events']} false"
        )
    _print_paths(document["paths"])
    return status


def _add_inspect(commands: Any) -> None:
    from railinspect.fleet.commands import add_fleet_options
    from railinspect.live_commands import add_follow, input_of
    from railinspect.watching import add_watching

    parser = _command(
        commands,
        "inspect",
        "inspect videos, image folders or images and write a report",
        description="Inspect each input in turn (video file, folder of images, single image) and "
        "write a run folder: run.json, frames.jsonl, events.jsonl, events.parquet, "
        "overlay/NAME.mp4 and report.html. Many recordings make a fleet run, see below.",
    )
    parser.add_argument("inputs", nargs="+", metavar="INPUT", type=input_of)
    parser.add_argument("--out", type=Path, required=True, help="run folder to create")
    parser.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="YAML",
        help="calibrated camera (default: estimated from the track's gauge and vanishing point)",
    )
    parser.add_argument(
        "--train",
        type=Path,
        metavar="YAML",
        help="train the advice is for (default: a suburban multiple unit on level track)",
    )
    speed = parser.add_mutually_exclusive_group()
    speed.add_argument(
        "--speed",
        metavar="V|FILE",
        help="the train's speed, m/s, or with its unit (20m/s, 72km/h), or a file of speeds over "
        "time (.csv, .gpx, .nmea, .mcap); sizes the advice and helps following objects (default: "
        f"that of --train, else unknown, and the advice assumes {ASSUMED_SPEED_KMH:.0f} km/h)",
    )
    speed.add_argument(
        "--speed-kmh", type=float, metavar="V", help="the same as --speed Vkm/h, km/h"
    )
    parser.add_argument(
        "--started",
        metavar="TIME",
        help="clock time of the recording's time zero, for a speed file with clock times, such as "
        "2026-05-01T12:00:00Z (default: the file's times are media times)",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="frames per second of an image folder (default: times from the file names where all "
        "have one, else 10)",
    )
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="threads of the network: so many frames at once, or with --follow one frame on all "
        "(default: all cores; with --follow all but one, which follows the track)",
    )
    parser.add_argument("--no-overlay", action="store_true", help="write no overlay video")
    parser.add_argument(
        "--right",
        type=Path,
        metavar="INPUT",
        help="right-hand recording of a rectified stereo pair whose left one is the input",
    )
    parser.add_argument(
        "--calibration", type=Path, help="the pair's file: Middlebury calib.txt or KITTI"
    )
    parser.add_argument(
        "--closer-look",
        action="store_true",
        help="run the network again on the middle of pictures 1000 pixels wide or wider; "
        "needs --camera",
    )
    parser.add_argument(
        "--topic",
        metavar="NAME",
        help="topic of a bag's pictures (default: the only one there is)",
    )
    parser.add_argument(
        "--rerun",
        type=Path,
        metavar="FILE.rrd",
        help="also write pictures, rails, region, findings and ranges for the Rerun viewer",
    )
    add_follow(parser)
    add_watching(parser)
    add_fleet_options(parser)
    parser.set_defaults(run=_run_inspect)


def _run_inspect(options: argparse.Namespace) -> int:
    from railinspect.batch import inspect_inputs
    from railinspect.camera import Camera
    from railinspect.fleet.commands import is_fleet_run, run_fleet
    from railinspect.fovea import Fovea
    from railinspect.inspect_settings import InspectSettings
    from railinspect.live_commands import run_follow
    from railinspect.ranging.stereo_camera import StereoCamera
    from railinspect.sinks.rerun_file import opened_viewer
    from railinspect.watching import watch

    if (options.right is None) != (options.calibration is None):
        raise BadInputError("a stereo pair needs both --right and --calibration")
    train, log, known = _train(options)
    settings = InspectSettings(
        camera=Camera.load(options.camera) if options.camera else None,
        train=train,
        speed_log=log,
        speed_is_known=known,
        folder_rate_hz=options.rate,
        topic=options.topic,
        overlay=not options.no_overlay,
        right=options.right,
        stereo=StereoCamera.load(options.calibration) if options.calibration else None,
    )
    if is_fleet_run(options):
        if options.right is not None or options.closer_look or options.rerun or options.follow:
            raise BadInputError(
                "--right, --closer-look, --rerun and --follow go with one recording; leave them "
                "out of a fleet run"
            )
        return run_fleet(options, settings)
    segmenter = _segmenter(options)
    if options.closer_look:
        if settings.camera is None:
            raise BadInputError("--closer-look needs --camera to know where the horizon lies")
        segmenter = Fovea(segmenter, settings.camera)
    with watch(options, "inspecting") as report, opened_viewer(options.rerun) as viewer:
        if options.follow:
            summary = run_follow(options, segmenter, settings, report, viewer)
        else:
            summary = inspect_inputs(
                options.inputs, options.out, segmenter, settings, progress=report, viewer=viewer
            )
    if options.json:
        print(json.dumps(summary.as_json()))
    elif not options.quiet:
        _print_summary(summary)
    return DONE


def _train(options: argparse.Namespace) -> tuple[Train, SpeedLog | None, bool]:
    """The train, its speed log if there is one, and whether its speed is known at all."""
    from railinspect.clock import clock_time
    from railinspect.speed_files import constant_speed_mps, read_speed_log
    from railops.braking import Train
    from railops.files import read_mapping

    started = clock_time(options.started) if options.started else None
    log, speed = None, None
    if options.speed_kmh is not None:
        if not 0 <= options.speed_kmh <= 500:
            raise BadInputError(f"speed is {options.speed_kmh} km/h; give 0 to 500 km/h")
        speed = options.speed_kmh / 3.6
    elif options.speed is not None:
        speed = constant_speed_mps(options.speed)
        if speed is None:
            log = read_speed_log(options.speed, started)
            speed = log.highest_mps
    if started is not None and log is None:
        raise BadInputError("--started says when a file of speeds begins; give one with --speed")
    known = speed is not None
    if options.train:
        known = known or "speed_mps" in read_mapping(options.train, "train file")
        if not known:
            speed = ASSUMED_SPEED_KMH / 3.6
        return Train.load(options.train, speed), log, known
    return Train(speed if speed is not None else ASSUMED_SPEED_KMH / 3.6), log, known


def _print_summary(summary: RunSummary) -> None:
    print(
        f"{summary.frames} frames at {summary.frames_per_s:.1f} frames/s, rails followed in "
        f"{summary.followed_fraction:.1%}, {summary.unknown_frames} frames unknown, "
        f"{summary.events} events"
    )
    for one in summary.inputs:
        if one.live is not None:
            print(f"{one.name}: {one.live.dropped} of {one.live.received} live frames dropped")
        for broken in one.breaks[:5]:
            print(f"{one.name}: broke after {broken.time_s:.2f} s: {broken.reason}")
    _print_paths(summary.as_json()["paths"])


def _print_paths(paths: dict[str, Any]) -> None:
    print(f"report   {paths['report']}")
    for overlay in paths["overlay"]:
        print(f"overlay  {overlay}")
    print(f"frames   {paths['frames']}\nevents   {paths['events']}\ntable    {paths['table']}")


def _segmenter(options: argparse.Namespace) -> Any:
    from railinspect._threads import usable_cores
    from railinspect.segmenter import Segmenter

    threads = getattr(options, "threads", None)
    if threads is None:
        threads = usable_cores()
        if getattr(options, "follow", None):
            # One frame on every core waits at each layer for the thread that is held up by
            # following, ranging and writing.
            threads = max(1, threads - 1)
    elif threads < 1:
        raise BadInputError(f"threads is {threads}; give at least 1")
    if options.bundle is None:
        return Segmenter.default(threads)
    return Segmenter.load(options.bundle, threads)


def _add_scenes(commands: Any) -> None:
    from railinspect.scenes_command import add_scenes

    add_scenes(commands, _command)


def _add_anomalies(commands: Any) -> None:
    from railinspect.anomalies_command import add_anomalies

    add_anomalies(commands, _command)


def _add_evaluate(commands: Any) -> None:
    from railinspect.evaluate_command import add_evaluate

    add_evaluate(commands, _command)


def _add_ranging(commands: Any) -> None:
    from railinspect.ranging_commands import add_ranging

    add_ranging(commands, _command)


def _add_fleet_results(commands: Any) -> None:
    from railinspect.fleet.results_commands import add_fleet_results

    add_fleet_results(commands, _command)


def _add_verify(commands: Any) -> None:
    parser = _command(
        commands,
        "verify",
        "check a bundle: metadata, hashes and golden output on this machine",
    )
    parser.add_argument("bundle", type=Path, metavar="BUNDLE", help="ONNX bundle")
    parser.set_defaults(run=_run_verify)


def _run_verify(options: argparse.Namespace) -> int:
    from railinspect.segmenter import Segmenter, verify

    segmenter = Segmenter.load(options.bundle)
    result = verify(segmenter)
    document = {
        "bundle": str(options.bundle),
        "network": segmenter.metadata.network,
        "input_size_wh": list(segmenter.metadata.input_size_wh),
        "package_version": segmenter.metadata.package_version,
        "training_fingerprint": segmenter.metadata.training_fingerprint,
        "identical": result.identical,
        "agreement": result.agreement,
        "passed": result.passed,
        "frame_ms": round(1000 * result.frame_s, 2),
    }
    if options.json:
        print(json.dumps(document))
    else:
        width, height = segmenter.metadata.input_size_wh
        same = "identical" if result.identical else f"{result.agreement:.4%} of the labels equal"
        print(
            f"{'passed' if result.passed else 'FAILED'}: {options.bundle} "
            f"({segmenter.metadata.network}, {width}×{height} pixels), golden output {same}, "
            f"{1000 * result.frame_s:.1f} ms per frame"
        )
    return DONE if result.passed else FAILED_CHECK


if __name__ == "__main__":
    sys.exit(main())
