"""``railinspect anomalies``: data sets of pictures with known anomalies from the command line."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from railinspect.errors import BadInputError
from railinspect.progress import ProgressLine

WORLDS_PER_SEED = 10_000_000
"""Worlds set aside for each seed. The first ten millions stay free for training and validation,
so that a data set of any seed shows a network worlds it was not trained on."""

AddCommand = Callable[..., argparse.ArgumentParser]


def add_anomalies(commands: Any, add: AddCommand) -> None:
    """Add the command ``anomalies`` and its subcommand ``build`` to the parser."""
    anomalies = commands.add_parser(
        "anomalies",
        help="make pictures with known anomalies",
        description="Make pictures with known anomalies from pictures of clear tracks.",
    )
    kinds = anomalies.add_subparsers(title="what to do", metavar="ACTION", required=True)
    build = add(
        kinds,
        "build",
        "make a data set with a manifest",
        description="Make a data set of clear pictures and pictures with one anomaly each, with "
        "masks and a manifest. The defaults make RailInspect-900 from the rendered world; the same "
        "seed gives the same files on any number of workers.",
    )
    build.add_argument("--out", type=Path, required=True, help="folder to fill")
    build.add_argument(
        "--source",
        type=Path,
        metavar="DIR",
        help="folder in RailSem19's layout (default: the rendered world)",
    )
    build.add_argument("--camera", type=Path, metavar="YAML", help="camera of all pictures")
    build.add_argument("--cutouts", type=Path, metavar="DIR", help="own cut-outs (RGBA PNG files)")
    build.add_argument("--seed", type=int, default=0, help="seed of all choices (default: 0)")
    for name, count in (
        ("originals", 450),
        ("distortion", 150),
        ("obstruction", 150),
        ("trespasser", 150),
    ):
        build.add_argument(
            f"--{name}", type=int, default=count, metavar="N", help=f"pictures (default: {count})"
        )
    build.add_argument(
        "--size",
        metavar="WxH",
        help="pixels of rendered pictures (default: the camera's, else 640x360)",
    )
    build.add_argument(
        "--weather",
        choices=("varied", "dry"),
        default="varied",
        help="light and weather of rendered pictures: varied, or a dry overcast day "
        "(default: varied)",
    )
    build.add_argument(
        "--kinds",
        default="ripple,buckle",
        help="distortions to draw from: ripple, buckle, break, gap (default: ripple,buckle)",
    )
    build.add_argument(
        "--obstruction-alpha",
        type=float,
        default=0.3,
        metavar="A",
        help="share of alpha blending for obstructions, 0…1 (default: 0.3)",
    )
    build.add_argument(
        "--trespasser-alpha",
        type=float,
        default=0.5,
        metavar="A",
        help="share of alpha blending for people, 0…1 (default: 0.5)",
    )
    build.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
    build.set_defaults(run=_run_build)


def _run_build(options: argparse.Namespace) -> int:
    from railinspect.anomalies import (
        BuildPlan,
        Composition,
        FolderSource,
        GeneratorSettings,
        WorldSource,
        build,
        read_cutouts,
    )
    from railinspect.camera import Camera
    from railinspect.scenes import SceneSettings
    from railinspect.scenes_command import size_of

    camera = Camera.load(options.camera) if options.camera else None
    settings = GeneratorSettings(
        obstruction_alpha=options.obstruction_alpha,
        trespasser_alpha=options.trespasser_alpha,
        distortions=cast(Any, tuple(k.strip() for k in options.kinds.split(","))),
        cutouts=read_cutouts(options.cutouts) if options.cutouts else (),
    )
    if options.seed < 0:
        raise BadInputError(f"seed is {options.seed}; give a whole number of at least 0")
    source: WorldSource | FolderSource
    if options.source is None:
        size = size_of(options.size) if options.size else camera.size_wh if camera else (640, 360)
        scene = SceneSettings(
            size_wh=size,
            camera=camera.resized(size) if camera else None,
            weather=options.weather == "varied",
        )
        source = WorldSource(WORLDS_PER_SEED * (options.seed + 1), scene)
    else:
        if options.size:
            raise BadInputError(
                "--size is for rendered pictures; pictures of a folder keep their own size"
            )
        source = FolderSource(options.source, camera)
    composition = Composition(
        options.originals, options.distortion, options.obstruction, options.trespasser
    )
    plan = BuildPlan(source, options.seed, composition, settings)
    line = ProgressLine("building", quiet=options.json)
    try:
        entries = build(
            options.out, plan, options.workers, lambda done, total: line.show(done, done / total)
        )
    finally:
        line.close()
    counts = Counter(entry.type for entry in entries)
    kinds = Counter(entry.kind for entry in entries if entry.kind)
    document = {
        "out": str(options.out),
        "manifest": str(options.out / "manifest.jsonl"),
        "images": len(entries),
        "types": dict(sorted(counts.items())),
        "kinds": dict(sorted(kinds.items())),
        "seed": options.seed,
    }
    if options.json:
        print(json.dumps(document))
        return 0
    print(f"{len(entries)} pictures in {options.out}")
    for name, count in [*sorted(counts.items()), *sorted(kinds.items())]:
        print(f"  {name:<14}{count:>5}")
    print(f"manifest {document['manifest']}")
    return 0
