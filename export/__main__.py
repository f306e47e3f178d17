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
        "--scenes",
        type=int,
        default=4,
        help="images compared on, and that int8 is calibrated and judged on (default 4)",
    )
    parser.add_argument(
        "--precision",
        choices=("fp32", "fp16", "int8"),
        default="fp32",
        help="int8 is calibrated, and kept only where it is faster here and keeps the rails "
        "(default fp32)",
    )
    parser.add_argument(
        "--folder", type=Path, help="labelled images for int8 instead of --scenes, RailSem19 layout"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    try:
        import cv2

        from export.bundle import export, to_json
        from fscnn.data.datasets import FolderSource, SceneSource
        from fscnn.training import checkpoint

        trained = checkpoint.load(options.checkpoint)
        scenes = SceneSource(0, options.scenes)
        source = FolderSource(options.folder, options.scenes) if options.folder else scenes
        labelled = [
            (
                cv2.resize(image, options.size, interpolation=cv2.INTER_AREA),
                cv2.resize(mask, options.size, interpolation=cv2.INTER_NEAREST_EXACT),
            )
            for image, mask in map(source, range(len(source)))
        ]
        images = tuple(image for image, _ in labelled)
        exported = export(trained, options.out, options.size, images, options.precision, labelled)
    except RailInspectError as error:
        print(f"python -m export: {error}", file=sys.stderr)
        return 1 if isinstance(error, ArithmeticError) else 2  # parity and refusal
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
        if exported.comparison:
            found = exported.comparison
            print(
                f"int8: {found.frame_s * 1e3:.1f} ms a frame, float {found.float_frame_s * 1e3:.1f}"
                f" ms; rail IoU {found.rail_iou:.3f}, float {found.float_rail_iou:.3f}"
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
