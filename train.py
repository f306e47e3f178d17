"""Train a network:  python train.py fit --config configs/fscnn_s.yaml [key=value …]."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from railinspect.errors import RailInspectError


def main(arguments: list[str] | None = None) -> int:
    """Command line entry; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python train.py", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    fit = commands.add_parser("fit", help="train from a configuration file")
    fit.add_argument("--config", type=Path, help="YAML file; settings it lacks keep their defaults")
    fit.add_argument("--resume", type=Path, help="checkpoint of the same run to go on from")
    fit.add_argument("--json", action="store_true", help="print the last metrics as JSON")
    fit.add_argument("overrides", nargs="*", metavar="key=value", help="e.g. optimiser.rate=0.001")
    options = parser.parse_args(arguments)
    # Threads that wait by spinning take the cores from the loader's processes: 3 × slower here.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        from lightning.pytorch.utilities import rank_zero_only

        from fscnn.training import config
        from fscnn.training.fit import fit as run

        settings = config.load(options.config, options.overrides)
        metrics = run(settings, options.resume)
    except RailInspectError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    if rank_zero_only.rank:  # of several processes the first one speaks
        return 0
    if options.json:
        print(json.dumps(metrics))
    else:
        for name, value in metrics.items():
            print(f"{name:16} {value:.4f}")
        print(f"checkpoints lie in {settings.run.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
