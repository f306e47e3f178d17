"""Export a checkpoint:  python -m export CHECKPOINT --out BUNDLE.onnx [--size 640x368] [--json]."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from railinspect.errors import RailInspectError


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT in pixels, e.g. 640x368")
    return int(match[1]), int(match[2])


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status (1: the bundle failed its check)."""
    parser = argparse.ArgumentParser(
        prog="python -m export", description="Turn a checkpoint into a verified one-file bundle."
    )
    parser.add_argument("checkpoint", type=Path, help=".ckpt file written by train.py")
    parser.add_argument("--out", type=Path, required=True, help="bundle to write, *.onnx")
    parser.add_argument(
        "--size",
        type=_size,
        default=(640, 368),
        metavar="WxH",
        help="input size, pixels, divisible by 16 (default 640x368)",
    )
    parser.add_argument(
        "--scenes", type=int, default=4, help="rendered scenes compared on (default 4)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    try:
        import cv2

        from export.bundle import ParityError, export, to_json
        from fscnn.training import checkpoint
        from railinspect import scenes

        trained = checkpoint.load(options.checkpoint)
        images = tuple(
            cv2.resize(scenes.render(seed).rgb, options.size, interpolation=cv2.INTER_AREA)
            for seed in range(options.scenes)
        )
        exported = export(trained, options.out, options.size, images)
    except RailInspectError as error:
        print(f"python -m export: {error}", file=sys.stderr)
        return 1 if isinstance(error, ParityError) else 2
    if options.json:
        print(to_json(exported))
    else:
        nodes = ", ".join(f"{count} {name}" for name, count in exported.nodes.items())
        print(
            f"{exported.path}: {exported.size_bytes / 2**20:.2f} MiB, "
            f"{exported.agreement:.4%} of labels as the checkpoint's, "
            f"rail score within {exported.score_difference}/255\n"
            f"{sum(exported.nodes.values())} nodes: {nodes}"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
