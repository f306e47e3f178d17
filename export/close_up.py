"""Export the close-ups' network:  python -m export.close_up CHECKPOINT --out close_up.onnx."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from export.bundle import ParityError, package_version, to_onnx
from fscnn.close_ups.fit import load
from fscnn.models.blocks import fold_norms
from railinspect.close_ups import (
    METADATA_KEY,
    WINDOW_WH,
    CloseUpNetwork,
    expected_metadata,
    golden_windows,
)
from railinspect.errors import BadInputError, RailInspectError

MOST_DIFFERENCE = 1e-4
"""Largest difference of a probability, checkpoint against graph."""


class _Chances(nn.Module):
    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = fold_norms(network).requires_grad_(False)

    def forward(self, windows: Tensor) -> Tensor:
        return self.network(windows).softmax(1)


def export(checkpoint: Path, out: Path) -> float:
    """Write the network as one ONNX file and prove that it agrees with the checkpoint.

    Args:
        checkpoint: File written by ``python -m fscnn.close_ups.fit``.
        out: File to write.

    Returns:
        The largest difference of a probability on the golden windows and on noise.

    Raises:
        BadInputError: if the checkpoint cannot be read or ``out`` not be written.
        ParityError: if they disagree. No file is left then.
    """
    network, said = load(checkpoint)
    width, height = WINDOW_WH
    noise = np.random.default_rng(0).integers(0, 256, (4, height, width, 3), dtype=np.uint8)
    windows = np.concatenate([golden_windows(), noise])
    with torch.no_grad():
        exact = network(torch.from_numpy(windows)).softmax(1).numpy()
    example = torch.zeros(2, height, width, 3, dtype=torch.uint8)
    model = to_onnx(_Chances(network), example, "windows", ("chances",))
    entry = model.metadata_props.add()
    entry.key = METADATA_KEY
    entry.value = json.dumps(
        {
            **expected_metadata(),
            "package_version": package_version(),
            "training": said,
            "golden_chances": exact[:2].round(6).tolist(),
        },
        sort_keys=True,
    )
    data = bytes(model.SerializeToString(deterministic=True))
    difference = float(np.abs(CloseUpNetwork(data, "the new graph").chances(windows) - exact).max())
    if not difference <= MOST_DIFFERENCE:
        raise ParityError(
            f"the graph's probabilities differ by {difference:.1e} from the checkpoint's, at most "
            f"{MOST_DIFFERENCE:.0e} is allowed; nothing was written"
        )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    except OSError as error:
        raise BadInputError(f"cannot write {out}: {error.strerror}") from error
    return difference


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status (1: the graph failed its check)."""
    parser = argparse.ArgumentParser(
        prog="python -m export.close_up",
        description="Turn a checkpoint of the close-ups' network into one verified ONNX file.",
    )
    parser.add_argument("checkpoint", type=Path, help=".ckpt file of fscnn.close_ups.fit")
    parser.add_argument("--out", type=Path, required=True, help="file to write, *.onnx")
    options = parser.parse_args(arguments)
    try:
        difference = export(options.checkpoint, options.out)
    except RailInspectError as error:
        print(f"python -m export.close_up: {error}", file=sys.stderr)
        return 1 if isinstance(error, ArithmeticError) else 2
    size = options.out.stat().st_size / 2**20
    told = f"probabilities within {difference:.1e} of the checkpoint's"
    print(f"{options.out}: {size:.2f} MiB, {told}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
