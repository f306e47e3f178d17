"""``railinspect inspect`` over many inputs: its options and what it prints."""

from __future__ import annotations

import argparse
import json
from typing import Any

from railinspect.errors import BadInputError


def add_fleet_options(parser: argparse.ArgumentParser) -> None:
    """The options that make a run a fleet run, and those that only such a run has."""
    fleet = parser.add_argument_group(
        "many recordings (docs/fleet.md)",
        "With one of these, or where an input is a folder of recordings, a pattern, a list (.csv, "
        ".parquet) or an address (s3://…), the inputs are inspected by several workers, and the "
        "same command goes on where a run was stopped. No overlay videos are drawn.",
    )
    fleet.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="worker processes, one core each (default: one per core)",
    )
    fleet.add_argument(
        "--engine",
        choices=("processes", "ray", "serial"),
        help="processes of this machine, actors of a Ray cluster, or this process alone (default: "
        "processes)",
    )
    fleet.add_argument(
        "--address", metavar="RAY", help="the Ray cluster's address (default: start a local one)"
    )
    fleet.add_argument(
        "--segment",
        type=float,
        metavar="S",
        help="cut recordings into stretches of this length, seconds of media time, 0 for none "
        "(default: 600)",
    )
    fleet.add_argument(
        "--fetch-limit",
        type=float,
        metavar="GB",
        help="largest remote object that is fetched, GB (default: 64)",
    )


def is_fleet_run(options: argparse.Namespace) -> bool:
    """Whether the options ask for a fleet run."""
    from railinspect.fleet.inputs import names_many

    given = (options.workers, options.engine, options.address, options.segment)
    asked = any(one is not None for one in (*given, options.fetch_limit))
    return asked or any(names_many(str(one)) for one in options.inputs)


def run_fleet(options: argparse.Namespace, settings: Any) -> int:
    """Inspect many recordings; exit status 1 if some could not be inspected to their end."""
    from railinspect.cli import DONE, FAILED_CHECK
    from railinspect.fleet.run import inspect_fleet
    from railinspect.fleet.storage import DEFAULT_LIMIT_BYTES
    from railinspect.fleet.tasks import Cut
    from railinspect.watching import watch

    if options.address is not None and options.engine != "ray":
        raise BadInputError("--address is that of a Ray cluster; give --engine ray with it")
    cut = Cut()
    if options.segment is not None:
        cut = Cut(stretch_s=options.segment or float("inf"))
    limit = DEFAULT_LIMIT_BYTES
    if options.fetch_limit is not None:
        limit = round(1e9 * options.fetch_limit)
        if limit <= 0:
            raise BadInputError(f"fetch limit is {options.fetch_limit} GB; give more than 0")
    with watch(options, "inspecting") as report:
        summary = inspect_fleet(
            [str(one) for one in options.inputs],
            options.out,
            _loader(options),
            settings,
            cut=cut,
            engine=options.engine or "processes",
            workers=options.workers,
            address=options.address,
            limit_bytes=limit,
            progress=report,
        )
    document = summary.as_json()
    if options.json:
        print(json.dumps(document))
    elif not options.quiet:
        print(
            f"{document['done']} of {document['inputs']} inputs done, {document['bad']} bad; "
            f"{document['frames']} frames, {document['unknown_frames']} unknown, "
            f"{document['events']} events; {document['new_frames']} new frames at "
            f"{document['frames_per_s']:.1f} frames/s"
        )
        for one in summary.bad[:20]:
            print(f"{one['state']:<5} {one['address']}: {one['reason']}")
        if len(summary.bad) > 20:
            print(f"… and {len(summary.bad) - 20} more, see {document['paths']['state']}")
        for name in ("report", "state", "dataset", "inputs"):
            print(f"{name:<8} {document['paths'][name]}")
    return FAILED_CHECK if summary.bad else DONE


def _loader(options: argparse.Namespace) -> Any:
    """The bundle, read once and sent to every worker."""
    import importlib.resources

    from railinspect.bundle import read_bytes
    from railinspect.fleet.worker import BundleLoader
    from railinspect.segmenter import Segmenter

    if options.threads is not None and options.threads != 1:
        raise BadInputError(
            f"threads is {options.threads}; a worker of a fleet run has one, take more workers"
        )
    if options.bundle is not None:
        data, name = read_bytes(options.bundle), f"bundle {options.bundle}"
    else:
        shipped = importlib.resources.files("railinspect") / "bundles" / "fscnn_s.onnx"
        data, name = shipped.read_bytes(), "shipped bundle"
    Segmenter(data, name, 1)  # a bundle that cannot be run is refused before anything is written
    return BundleLoader(data, name)
