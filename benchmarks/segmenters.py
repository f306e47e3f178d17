"""FSCNN against its rivals, same training code and same budget, in one run.

    python -m benchmarks.segmenters [--json] [--steps 800] [--parts speed train …]

Parts: ``speed`` exports the mobile networks with random weights and times them in ONNX Runtime;
``overfit`` trains on eight small rendered images; ``train`` trains the mobile FSCNN and the mobile
LR-ASPP from random weights on rendered scenes, both on the same samples in the same order for the
same number of steps, for every seed, and scores both on held-out scenes; ``gpu`` times training
steps on ResNet-50, where there is a GPU. The rendered sets are kept in ``--out`` and used again.

The budget is one two cores can pay: a few hundred steps on small pictures from random weights. It
shows which network learns rails sooner, not what either reaches in the end.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

import torch

from benchmarks.common import Measure, alternating_medians, parser, publish
from benchmarks.short_training import (
    BATCH,
    HELD_OUT_SEED,
    SMALL_WH,
    TRAIN_SEED,
    rendered,
    scored,
    settings,
    trained,
)
from export.bundle import Exported, export
from fscnn.models import build
from fscnn.training.checkpoint import Trained
from railinspect.bundle import golden_image
from railinspect.scenes import SceneSettings
from railinspect.segmenter import Segmenter

PARTS = ("speed", "overfit", "train", "gpu")
OURS, RIVAL = "fscnn_mobilenet_v3_large", "lraspp_mobilenet_v3_large"
SIZE_WH = (640, 384)


def speed(folder: Path, threads: int, repeats: int) -> list[Measure]:
    """Export with random weights and time in ONNX Runtime, in turn."""
    bundles: dict[str, Exported] = {}
    for name in (OURS, RIVAL):
        chosen = settings(name)
        torch.manual_seed(0)
        network = build(chosen.network, chosen.settings).eval()
        trained = Trained(network, chosen.network, dict(chosen.settings), False, {}, "", 0)
        bundles[name] = export(trained, folder / f"{name}.onnx", SIZE_WH)
    loaded = {name: Segmenter.load(bundle.path, threads) for name, bundle in bundles.items()}
    image = golden_image(SIZE_WH)
    times = dict(
        zip(
            loaded,
            alternating_medians(
                [lambda s=s: s(image) for s in loaded.values()],
                repeats,
                warm_up=3,
            ),
            strict=True,
        )
    )
    shape = f"384×640, {threads} threads"
    measures = [Measure(f"{name}, {shape}", s * 1e3, "ms") for name, s in times.items()]
    measures.append(Measure(f"{OURS} / {RIVAL}", times[OURS] / times[RIVAL], "", 1.0))
    for name, bundle in bundles.items():
        measures.append(Measure(f"graph nodes, {name}", sum(bundle.nodes.values()), ""))
        equal = 100 * bundle.agreement
        measures.append(Measure(f"labels equal to torch's, {name}", equal, "%", 99.9, "higher"))
    return measures


def compare(
    folder: Path,
    seeds: list[int],
    steps: int,
    scenes: int,
    held_out: int,
    workers: int,
    more: list[str],
) -> list[Measure]:
    """The same budget for both mobile networks, every seed."""
    train = rendered(folder / "train", TRAIN_SEED, scenes, workers)
    val = rendered(folder / "val", HELD_OUT_SEED, held_out, workers)
    reached: dict[str, list[float]] = {OURS: [], RIVAL: []}
    spent_s = dict.fromkeys(reached, 0.0)
    for seed in seeds:
        for name, found in reached.items():
            began = time.perf_counter()
            out = folder / f"{name}_{seed}"
            found.append(scored(trained(name, seed, steps, train, out, *more), val)["rail_iou"])
            spent_s[name] += time.perf_counter() - began
    measures = [
        Measure(f"rail IoU, {name}, seed {seed}", value, "", None, "higher")
        for name, found in reached.items()
        for seed, value in zip(seeds, found, strict=True)
    ]
    gain = statistics.mean(reached[OURS]) - statistics.mean(reached[RIVAL])
    spread = max(max(found) - min(found) for found in reached.values())
    crops = f"{BATCH} crops of {SMALL_WH[0]}×{SMALL_WH[1]}"
    held = f"{steps} steps of {crops} each, {scenes} scenes, {held_out} held out"
    measures += [
        Measure(f"time of a training and its scoring, {name}", s / len(seeds), "s")
        for name, s in spent_s.items()
    ]
    measures.append(Measure(f"spread over seeds ({held})", spread, ""))
    measures.append(
        Measure("rail IoU gained over LR-ASPP, less the spread", gain - spread, "", 1e-3, "higher")
    )
    return measures


def overfit(folder: Path, steps: int, workers: int, more: list[str]) -> list[Measure]:
    """Rail IoU on the eight images it was trained on."""
    eight = rendered(folder / "eight", TRAIN_SEED, 8, workers, SceneSettings(size_wh=SMALL_WH))
    plain = ("data.zoom=[1, 1]", "data.aspect=1", "data.rail_share=0", "data.strength=0")
    free = ("settings.dropout=0", "optimiser.weight_decay=0", "optimiser.average=0.95")
    began = time.perf_counter()
    checkpoint = trained(OURS, 0, steps, eight, folder / "overfit", *plain, *free, *more)
    reached = scored(checkpoint, eight)["rail_iou"]
    shape = f"eight images of {SMALL_WH[0]}×{SMALL_WH[1]}, {steps} steps, {OURS}"
    return [
        Measure(f"time of overfitting {shape}", time.perf_counter() - began, "s"),
        Measure(f"rail IoU on the {shape}", reached, "", 0.95, "higher"),
    ]


def gpu() -> list[Measure]:
    """Training steps per second on ResNet-50, forward and backward in bfloat16, where possible."""
    if not torch.cuda.is_available():
        return []
    rates = {}
    for name in ("fscnn_resnet50", "deeplabv3_resnet50"):
        chosen = settings(name)
        network = build(chosen.network, chosen.settings).cuda()
        network = network.to(memory_format=torch.channels_last)
        images = torch.rand(8, 3, 544, 960, device="cuda")
        images = images.contiguous(memory_format=torch.channels_last)
        seen = []
        for turn in range(12):
            torch.cuda.synchronize()
            began = time.perf_counter()
            with torch.autocast("cuda", torch.bfloat16):
                loss = network(images).float().square().mean()
            loss.backward()
            network.zero_grad()
            torch.cuda.synchronize()
            if turn >= 4:
                seen.append(len(images) / (time.perf_counter() - began))
        rates[name] = statistics.median(seen)
    ours, rival = rates["fscnn_resnet50"], rates["deeplabv3_resnet50"]
    return [
        *(
            Measure(f"training, {n}, 960×544", r, "images/s", None, "higher")
            for n, r in rates.items()
        ),
        Measure("training, FSCNN / DeepLabV3 on ResNet-50", ours / rival, "", 1.0, "higher"),
    ]


def main() -> None:
    arguments = parser("FSCNN against its rivals.")
    arguments.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    arguments.add_argument("--steps", type=int, default=800, help="per training (default 800)")
    arguments.add_argument(
        "--overfit-steps", type=int, default=2400, help="of the overfit test (default 2400)"
    )
    arguments.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="default 0 1 2")
    arguments.add_argument("--scenes", type=int, default=600, help="trained on (default 600)")
    arguments.add_argument("--held-out", type=int, default=40, help="scored on (default 40)")
    arguments.add_argument("--workers", type=int, default=2, help="rendering (default 2)")
    arguments.add_argument("--threads", type=int, default=2, help="of ONNX Runtime (default 2)")
    arguments.add_argument("--repeats", type=int, default=40, help="timed frames (default 40)")
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
        measures: list[Measure] = []
        if "speed" in options.parts:
            measures += speed(folder, options.threads, options.repeats)
        if "overfit" in options.parts:
            measures += overfit(folder, options.overfit_steps, options.workers, options.set)
        if "train" in options.parts:
            measures += compare(
                folder,
                options.seeds,
                options.steps,
                options.scenes,
                options.held_out,
                options.workers,
                options.set,
            )
        if "gpu" in options.parts:
            measures += gpu()
    publish("segmenters", measures, options.json)


if __name__ == "__main__":
    main()
