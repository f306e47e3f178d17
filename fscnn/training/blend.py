"""The mean of two checkpoints' weights:  python -m fscnn.training.blend A.ckpt B.ckpt --out C.ckpt.

Two stages of one training lie in one basin of the loss, and the mean of their weights is often
better than either and steadier on pictures of another kind (Wortsman et al., "Robust fine-tuning of
zero-shot models", CVPR 2022): the later stage adds what it learned, the earlier one keeps what the
later forgot.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import torch

from fscnn.training.checkpoint import KEY, read
from railinspect.errors import BadInputError, OutputError, RailInspectError


def blend(first: Path, second: Path, share: float = 0.5) -> dict[str, Any]:
    """A checkpoint with the weighted mean of two checkpoints' averaged weights.

    Args:
        first: One checkpoint.
        second: Another one of the same network; everything but the weights is taken from it.
        share: Share of the second, 0 … 1.

    Returns:
        The content of a checkpoint file, with the averaged weights and nothing to resume from.

    Raises:
        BadInputError: if a file is no checkpoint, the two hold networks of different shapes, or
            the share lies outside 0 … 1.
    """
    if not 0 <= share <= 1:
        raise BadInputError(f"share is {share}; give 0 to 1")
    a, b = read(first)[KEY], read(second)[KEY]
    shape = ("network", "settings", "norms_folded")
    if any(a[key] != b[key] for key in shape):
        raise BadInputError(
            f"{first} and {second} hold networks of different shapes; blend stages of one training"
        )
    mean = {
        name: torch.lerp(a["average"][name], weight, share)
        if weight.is_floating_point()
        else weight
        for name, weight in b["average"].items()
    }
    recipe = {**b["recipe"], "blended_with": {"recipe": a["recipe"], "share": 1 - share}}
    return {KEY: {**b, "average": mean, "recipe": recipe}}


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fscnn.training.blend", description="Average the weights of two checkpoints."
    )
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="checkpoint to write")
    parser.add_argument("--share", type=float, default=0.5, help="of the second (default 0.5)")
    options = parser.parse_args(arguments)
    try:
        content = blend(options.first, options.second, options.share)
        part = options.out.with_name(options.out.name + ".part")
        try:
            torch.save(content, part)
            part.replace(options.out)
        except (OSError, RuntimeError) as error:
            part.unlink(missing_ok=True)
            raise OutputError(f"cannot write {options.out}: {error}") from error
    except RailInspectError as error:
        print(f"blend: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
