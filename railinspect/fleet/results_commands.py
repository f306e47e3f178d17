"""``railinspect fleet``: what is made of a finished fleet run."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

Command = Callable[..., argparse.ArgumentParser]


def add_fleet_results(commands: Any, command: Command) -> None:
    """The command and its three parts."""
    fleet = commands.add_parser(
        "fleet",
        help="a fleet run's report, frames to relabel, corrections to train on",
        description="What is made of the run folder that railinspect inspect wrote of many "
        "recordings (docs/fleet-results.md).",
    )
    parts = fleet.add_subparsers(title="parts", metavar="PART", required=True)
    _add_report(parts, command)
    _add_export(parts, command)
    _add_import(parts, command)


def _add_report(parts: Any, command: Command) -> None:
    parser = command(
        parts,
        "report",
        "write the data set, the places and the report of a run again",
        description="Take in a logbook (which line, which vehicle, when, where), then write the "
        "Parquet data set, events.geojson and report.html again. Without options everything is "
        "written as before.",
    )
    parser.add_argument("folder", type=Path, metavar="RUN", help="folder of a fleet run")
    parser.add_argument(
        "--logbook",
        type=Path,
        metavar="CSV",
        help="columns input, line, vehicle, started (ISO 8601 with its zone), positions (.gpx, "
        ".nmea, .mcap); kept with the run (default: what was kept)",
    )
    parser.add_argument(
        "--budget-per-hour",
        type=float,
        metavar="N",
        help="false alarms allowed per hour of known time; kept with the run (default: what was "
        "kept)",
    )
    parser.add_argument(
        "--budget-per-km",
        type=float,
        metavar="N",
        help="false alarms allowed per kilometre; kept with the run (default: what was kept)",
    )
    parser.set_defaults(run=_run_report)


def _run_report(options: argparse.Namespace) -> int:
    from railinspect.cli import DONE
    from railinspect.fleet import dataset, fleet_report
    from railinspect.fleet.budget import read_budget, save_budget
    from railinspect.fleet.finished import finished_inputs, run_id
    from railinspect.fleet.logbook import enter_logbook

    run = options.folder
    run_id(run)  # refuses a folder that holds no fleet run before anything is written
    inputs = finished_inputs(run)
    entered = enter_logbook(options.logbook, inputs, run) if options.logbook else []
    budget = read_budget(run)
    if options.budget_per_hour is not None:
        budget = replace(budget, per_hour=options.budget_per_hour)
    if options.budget_per_km is not None:
        budget = replace(budget, per_km=options.budget_per_km)
    save_budget(budget, run)
    for one in inputs:
        dataset.add(one.folder, run)
    fleet_report.write(run)
    places = run / "events.geojson"
    paths = {
        "report": str(run / "report.html"),
        "dataset": str(run / "dataset"),
        "places": str(places) if places.exists() else None,
    }
    if options.json:
        print(json.dumps({"inputs": len(inputs), "entered": entered, "paths": paths}))
        return DONE
    print(f"{len(inputs)} inputs, of which the logbook spoke of {len(entered)}")
    for name, path in paths.items():
        if path:
            print(f"{name:<8} {path}")
    return DONE


def _add_export(parts: Any, command: Command) -> None:
    parser = command(
        parts,
        "export",
        "write chosen frames for relabelling, as COCO and for CVAT",
        description="Write the frames that show the first events best, the middles of the longest "
        "unknown stretches, and frames at even spacing, with the network's masks of them as "
        "coco.json and cvat.xml (CVAT for images 1.1).",
    )
    parser.add_argument("folder", type=Path, metavar="RUN", help="folder of a fleet run")
    parser.add_argument("--out", type=Path, required=True, help="folder to create")
    parser.add_argument(
        "--events", type=int, default=50, metavar="N", help="frames of events (default: 50)"
    )
    parser.add_argument(
        "--unknown", type=int, default=50, metavar="N", help="unknown frames (default: 50)"
    )
    parser.add_argument(
        "--every", type=float, metavar="S", help="one frame per so many seconds (default: none)"
    )
    parser.add_argument(
        "--limit", type=int, default=500, metavar="N", help="frames in all (default: 500)"
    )
    parser.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    parser.set_defaults(run=_run_export)


def _run_export(options: argparse.Namespace) -> int:
    from railinspect.cli import DONE, FAILED_CHECK, _segmenter
    from railinspect.fleet.chosen import Choice, choose
    from railinspect.fleet.relabel import export_frames

    choice = Choice(options.events, options.unknown, options.every, options.limit)
    chosen = choose(options.folder, choice)
    done = export_frames(options.folder, chosen, options.out, _segmenter(options))
    if options.json:
        print(
            json.dumps(
                {
                    "pictures": done.pictures,
                    "missing": list(done.missing),
                    "paths": {
                        "images": str(done.folder / "images"),
                        "coco": str(done.folder / "coco.json"),
                        "cvat": str(done.folder / "cvat.xml"),
                    },
                }
            )
        )
    else:
        print(f"{done.pictures} pictures in {done.folder}, {len(done.missing)} missing")
        for words in done.missing[:10]:
            print(f"missing  {words}")
    return FAILED_CHECK if done.missing else DONE


def _add_import(parts: Any, command: Command) -> None:
    parser = command(
        parts,
        "import",
        "make a training set of corrected labels",
        description="Turn a corrected COCO .json or CVAT for images 1.1 .xml and the pictures it "
        "labels into a folder in RailSem19's layout, which training reads as data.train_folders. "
        "Pixels without a label are void; pictures without any are left out.",
    )
    parser.add_argument("labels", type=Path, metavar="FILE", help="corrected .json or .xml")
    parser.add_argument(
        "--images", type=Path, required=True, metavar="DIR", help="the pictures it labels (.jpg)"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to create")
    parser.set_defaults(run=_run_import)


def _run_import(options: argparse.Namespace) -> int:
    from railinspect.cli import DONE
    from railinspect.fleet.relabel import import_corrections

    done = import_corrections(options.labels, options.images, options.out)
    if options.json:
        document = {
            "pictures": done.pictures,
            "labelled_share": round(done.labelled_share, 4),
            "paths": {"folder": str(done.folder)},
        }
        print(json.dumps(document))
    else:
        print(
            f"{done.pictures} pairs in {done.folder}, {done.labelled_share:.1%} of their pixels "
            "labelled"
        )
    return DONE
