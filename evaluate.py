"""Measure models on labelled images:  python evaluate.py MODEL … --folder DIR [--out DIR]."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

from railinspect.errors import RailInspectError


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT in pixels, e.g. 640x368")
    return int(match[1]), int(match[2])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python evaluate.py", description=__doc__)
    parser.add_argument("models", type=Path, nargs="+", help="checkpoints (.ckpt), bundles (.onnx)")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--folder", type=Path, help="images and masks in RailSem19's layout")
    where.add_argument(
        "--scenes",
        type=int,
        nargs=2,
        metavar=("START", "COUNT"),
        help="render scenes from seed START on",
    )
    parser.add_argument("--split", type=Path, help="split of the folder, see fscnn.data.splits")
    parser.add_argument("--part", default="test", help="part of the split (default test)")
    parser.add_argument("--limit", type=int, help="use the first images only")
    parser.add_argument(
        "--size", type=_size, default=(640, 368), metavar="WxH", help="size a checkpoint works at"
    )
    parser.add_argument(
        "--tolerance", type=float, default=4.0, help="for thin structures, pixels (default 4)"
    )
    parser.add_argument(
        "--zooms",
        type=float,
        nargs="+",
        default=[1.0],
        help="look through sliding windows of 1/ZOOM of the image too (default 1: the whole image)",
    )
    parser.add_argument("--flip", action="store_true", help="look at the mirrored image too")
    parser.add_argument("--camera", type=Path, help="camera.yaml; gives results by range")
    parser.add_argument("--out", type=Path, help="folder for evaluation.json, .md and .html")
    parser.add_argument(
        "--pictures", type=int, default=4, help="best and worst frames shown (default 4)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        from fscnn.data import splits
        from fscnn.data.datasets import FolderSource, SceneSource
        from fscnn.training.evaluation import evaluate_source, load_model
        from fscnn.training.evaluation_report import printable, write
        from fscnn.training.tables import appendix_e, markdown, printed_rows, row_of, table_iii
        from fscnn.training.views import views
        from railinspect.camera import Camera

        split = splits.load(options.split) if options.split else None
        source = (
            FolderSource(options.folder, options.limit, split, options.part)
            if options.folder
            else SceneSource(*options.scenes)
        )
        count = min(len(source), options.limit or len(source))
        camera = Camera.load(options.camera) if options.camera else None
        segments = [
            views(load_model(path, options.size), options.zooms, options.flip)
            for path in options.models
        ]
        done = [
            evaluate_source(path.name, segment, source, count, options.tolerance, camera)
            for path, segment in zip(options.models, segments, strict=True)
        ]
        if options.out:
            write(options.out, done, segments, source, options.pictures)
    except RailInspectError as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return 2
    if options.json:
        documents = [printable(one.document()) for one in done]
        print(json.dumps(documents[0] if len(documents) == 1 else {"models": documents}))
        return 0
    for one in done:
        summary = one.scores.summary()
        classes = summary.pop("iou")
        print(one.model)
        for name, value in summary.items():
            shown = f"{value:>10.4f}" if isinstance(value, float) else f"{value:>10}"
            print(f"  {name:20} {shown}")
        for name, value in classes.items():
            print(f"    IoU {name:16} {value:>8.4f}")
        for name, band in (one.bands.summary() if one.bands else {}).items():
            print(f"  {name:14} rail IoU {band['rail_iou']:.4f}, thin F {band['thin_f']:.4f}")
    rows = printed_rows() | {one.model: row_of(one.scores) for one in done}
    print(f"\n{markdown(table_iii(rows))}\n\n{markdown(appendix_e(rows))}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
