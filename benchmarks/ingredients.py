"""What each ingredient of the rendered world is worth: trainings without it, three seeds each.

    python -m benchmarks.ingredients [--json] [--real FOLDER]

Every variant trains FSCNN-S from random weights, for the same number of steps on the same number of
scenes, with one ingredient left out: rail-like distractors, weather and camera faults, things and
people on and beside the track, or the photometric transforms of training. All are scored on the
same held-out scenes with everything in them, and on ``--real``, labelled photographs in RailSem19's
layout, seen at 640×352. A short training: it ranks ingredients, it does not reach what ships.
"""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.common import Measure, parser, publish
from benchmarks.short_training import (
    BATCH,
    HELD_OUT_SEED,
    SMALL_WH,
    TRAIN_SEED,
    rendered,
    scored,
    trained,
)
from railinspect.scenes import SceneSettings

NETWORK = "fscnn_s_small"
REAL_WH = (640, 352)
REAL_TOLERANCE_PX = 8.0
"""Of masks 1920 pixels wide: 4 px at 960×540."""


@dataclass(frozen=True)
class Variant:
    """A training set and how it is trained on."""

    name: str
    scenes: SceneSettings
    more: tuple[str, ...] = ()


VARIANTS = (
    Variant("everything", SceneSettings()),
    Variant("without distractors", SceneSettings(distractors=False)),
    Variant("without weather and camera faults", SceneSettings(weather=False)),
    Variant("without things and people", SceneSettings(occluders=False)),
    Variant("without photometric transforms", SceneSettings(), ("data.strength=0",)),
)


def measures(
    folder: Path,
    seeds: list[int],
    steps: int,
    scenes: int,
    held_out: int,
    workers: int,
    more: list[str],
    real: Path | None,
) -> list[Measure]:
    """Mean and range over the seeds of every variant's scores."""
    judged = {"held out": (rendered(folder / "val", HELD_OUT_SEED, held_out, workers), None, 4.0)}
    if real is not None:
        judged["real"] = (real, REAL_WH, REAL_TOLERANCE_PX)
    rows = []
    for variant in VARIANTS:
        chosen = variant.scenes
        # Variants of the same scenes differ in training alone.
        kept = f"{chosen.distractors:d}{chosen.weather:d}{chosen.occluders:d}"
        train = rendered(folder / f"train_{kept}", TRAIN_SEED, scenes, workers, chosen)
        reached: dict[str, list[float]] = {}
        for seed in seeds:
            out = folder / f"{variant.name.replace(' ', '_')}_{seed}"
            checkpoint = trained(NETWORK, seed, steps, train, out, *variant.more, *more)
            for name, (pictures, size_wh, tolerance_px) in judged.items():
                found = scored(checkpoint, pictures, size_wh, tolerance_px)
                for key in ("rail_iou", "thin_precision", "thin_recall", "thin_f"):
                    reached.setdefault(f"{name}: {key}", []).append(float(found[key]))
        for key, values in reached.items():
            spread = max(values) - min(values)
            rows += [
                Measure(f"{variant.name}, {key}", statistics.mean(values), "", None, "higher"),
                Measure(f"{variant.name}, {key}, spread over {len(seeds)} seeds", spread, ""),
            ]
    crops = SMALL_WH[0] * SMALL_WH[1] * BATCH * steps
    return [*rows, Measure("pixels each training saw", crops / 1e6, "Mpx")]


def main() -> None:
    arguments = parser("What each ingredient of the rendered world is worth.")
    arguments.add_argument("--steps", type=int, default=300, help="per training (default 300)")
    arguments.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="default 0 1 2")
    arguments.add_argument("--scenes", type=int, default=600, help="trained on (default 600)")
    arguments.add_argument("--held-out", type=int, default=40, help="scored on (default 40)")
    arguments.add_argument("--workers", type=int, default=2, help="rendering (default 2)")
    arguments.add_argument("--real", type=Path, help="labelled photographs in RailSem19's layout")
    arguments.add_argument(
        "--set",
        nargs="*",
        default=[],
        metavar="KEY=VALUE",
        help="settings of the trainings, e.g. run.precision=bf16-mixed",
    )
    arguments.add_argument("--out", type=Path, help="folder to keep (default: a temporary one)")
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        rows = measures(
            folder,
            options.seeds,
            options.steps,
            options.scenes,
            options.held_out,
            options.workers,
            options.set,
            options.real,
        )
    publish("ingredients", rows, options.json)


if __name__ == "__main__":
    main()
