"""Measure a checkpoint or a bundle:  python evaluate.py MODEL --folder DIR [--json]."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

from railinspect.errors import RailInspectError


def _printable(value: Any) -> Any:
    """JSON has no NaN: what could not be judged becomes null."""
    if isinstance(value, dict):
        return {key: _printable(part) for key, part in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python evaluate.py", description=__doc__)
    parser.add_argument("model", type=Path, help="checkpoint (.ckpt) or bundle (.onnx)")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--folder", type=Path, help="images and masks in RailSem19's layout")
    where.add_argument(
        "--scenes",
        type=int,
        nargs=2,
        metavar=("START", "COUNT"),
        help="render scenes from seed START on",
    )
    parser.add_argument("--limit", type=int, help="use the first images only")
    parser.add_argument(
        "--tolerance", type=float, default=4.0, help="for thin structures, pixels (default 4)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    try:
        from fscnn.data.datasets import FolderSource, SceneSource
        from fscnn.training.evaluation import evaluate, load_model

        source = (
            FolderSource(options.folder, options.limit)
            if options.folder
            else SceneSource(*options.scenes)
        )
        count = min(len(source), options.limit or len(source))
        segment = load_model(options.model)
        pairs = (source(index) for index in range(count))
        summary = evaluate(segment, pairs, options.tolerance).summary()
    except RailInspectError as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(_printable(summary)))
        return 0
    classes = summary.pop("iou")
    for name, value in summary.items():
        print(f"{name:20} {value:>10.4f}" if isinstance(value, float) else f"{name:20} {value:>10}")
    for name, value in classes.items():  # type: ignore[union-attr]
        print(f"  IoU {name:16} {value:>8.4f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
