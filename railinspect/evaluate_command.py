"""``railinspect evaluate``: the inspector against a data set with known truth."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from railinspect.errors import BadInputError
from railinspect.progress import ProgressLine

FILES: Final = ("evaluation.json", "evaluation.md", "evaluation.html")
"""What ``--out`` receives."""

AddCommand = Callable[..., argparse.ArgumentParser]


def add_evaluate(commands: Any, command: AddCommand) -> None:
    """Add the command to the parser's commands."""
    parser = command(
        commands,
        "evaluate",
        "judge the inspector on a data set with known truth",
        description="Inspect every picture of DATASET (made by railinspect anomalies build, or "
        "any folder in RailSem19's layout whose notes name the anomalies) and print accuracy, "
        "sensitivity per type, specificity, recall by range and size, and the time per picture; "
        "with --clear-rides also false alarms per hour and per km.",
    )
    parser.add_argument("data_set", type=Path, metavar="DATASET", help="folder of the data set")
    parser.add_argument(
        "--truth", action="store_true", help="judge on the true masks instead of a bundle's"
    )
    parser.add_argument("--bundle", type=Path, help="ONNX bundle (default: the shipped one)")
    parser.add_argument(
        "--no-camera",
        action="store_true",
        help="do not tell the inspector the cameras, even where the set knows them",
    )
    parser.add_argument(
        "--svm",
        type=Path,
        metavar="TRAINSET",
        help="judge with the linear support vector machine of the published baseline, trained on "
        "this data set, instead of the inspector",
    )
    parser.add_argument(
        "--no-close-ups",
        action="store_true",
        help="judge by the masks alone, without a second look at the picture itself",
    )
    parser.add_argument(
        "--clear-rides",
        type=int,
        default=0,
        metavar="N",
        help="also ride through N rendered rides without anomalies (default 0)",
    )
    parser.add_argument(
        "--ride-s", type=float, default=60.0, metavar="T", help="length of each, s (default 60)"
    )
    parser.add_argument(
        "--seed", type=int, default=100, help="seed of the first ride (default 100)"
    )
    parser.add_argument(
        "--out", type=Path, help="folder for evaluation.json, .md and .html (default: none)"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from railinspect.close_ups import CloseUpNetwork
    from railinspect.evaluation import Judge, evaluated, inspect_still, judge_set, read_samples
    from railinspect.evaluation.page import html, markdown
    from railinspect.runfolder import RunFolder, refuse_taken
    from railinspect.runinfo import write_json

    if options.truth and options.bundle:
        raise BadInputError("--truth and --bundle exclude each other; give one of them")
    if options.clear_rides < 0 or not 0 < options.ride_s <= 3600 or options.seed < 0:
        raise BadInputError(
            f"clear-rides {options.clear_rides}, ride-s {options.ride_s}, seed {options.seed}: "
            "give at least 0 rides of more than 0 and at most 3600 s and a seed of at least 0"
        )
    samples = read_samples(options.data_set)
    segmenter, close_ups = None, None
    if not options.truth:
        segmenter = _segmenter(options.bundle, not options.no_close_ups)
    elif not options.no_close_ups:
        close_ups = CloseUpNetwork.default()
    folder = None
    if options.out is not None:
        refuse_taken(options.out, FILES)
        folder = RunFolder.claim(options.out)
    judge: Judge = inspect_still
    if options.svm is not None:
        from railinspect.evaluation.svm import train_svm

        training = read_samples(options.svm)
        judge = _with_line(
            "training",
            lambda show: train_svm(training, segmenter, not options.no_camera, progress=show),
            options.json,
        )
    answers = _with_line(
        "judging",
        lambda show: judge_set(samples, segmenter, judge, not options.no_camera, show, close_ups),
        options.json,
    )
    rides = _rides(options, segmenter, close_ups) if options.clear_rides else None
    name = "the inspector" if options.svm is None else "the linear SVM"
    masks = "true masks"
    if segmenter is not None:
        masks = f"masks of {options.bundle or 'the shipped bundle'}"
    masks += "" if options.no_close_ups or options.svm else " and close-ups"
    evaluation = evaluated(options.data_set, samples, answers, name, masks, rides)
    document = evaluation.as_json()
    if folder is not None:
        write_json(folder.part("evaluation.json"), document)
        folder.part("evaluation.md").write_text(markdown(evaluation), encoding="utf-8")
        folder.part("evaluation.html").write_text(html(evaluation), encoding="utf-8")
        folder.publish()
        document["paths"] = {Path(name).suffix[1:]: str(options.out / name) for name in FILES}
    print(json.dumps(document) if options.json else markdown(evaluation), end="\n")
    return 0


def _segmenter(bundle: Path | None, close_ups: bool) -> Any:
    from railinspect.segmenter import Segmenter

    if bundle is None:
        return Segmenter.default(close_ups=close_ups)
    return Segmenter.load(bundle, close_ups=close_ups)


def _rides(options: argparse.Namespace, segmenter: Any, close_ups: Any) -> Any:
    from railinspect.evaluation import clear_rides, ride_through

    rides = clear_rides(options.clear_rides, options.seed, options.ride_s)
    return _with_line(
        "riding",
        lambda show: ride_through(rides, segmenter, not options.no_camera, show, close_ups),
        options.json,
    )


def _with_line(title: str, work: Callable[[Callable[[int, float], None]], Any], quiet: bool) -> Any:
    line = ProgressLine(title, quiet=quiet)
    try:
        return work(line.show)
    finally:
        line.close()
