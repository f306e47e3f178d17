"""Fleet runs: scaling, engines, overhead, seams and memory.

Throughput is in frames per second of wall-clock time after the start: from each run the frames and
the time of a run over two clips of three frames are taken off, which starts the same workers. The
overhead is in CPU time. ``--only`` measures a part.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

from benchmarks.common import Measure, parser, publish
from benchmarks.inspect_video import real_clip, synthetic
from railinspect.fleet.finished import FinishedInput, finished_inputs
from railinspect.fleet.run import inspect_fleet
from railinspect.fleet.tasks import Cut
from railinspect.fleet.worker import BundleLoader
from railinspect.inspect_settings import InspectSettings
from railinspect.ride_file import RidePlan, rendered
from railinspect.scenes import demo_settings
from railinspect.scenes.ride import DEMO_LEAD_M
from railinspect.video import open_source
from railinspect.warmup import warm_up
from railops.braking import Train

EXACT = ("id", "type", "first_frame", "last_frame", "confirmed_time_s", "frames_seen", "advice")
RANGES = ("first_range_m", "closest_range_m")
SETTINGS = InspectSettings(train=Train(speed_mps=20.0))
PARTS = ("workers", "ray", "overhead", "seams", "memory")


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--clips", type=int, default=8, help="clips of a run (default 8)")
    arguments.add_argument(
        "--seconds", type=float, default=20.0, help="length of each clip, seconds (default 20)"
    )
    arguments.add_argument(
        "--minutes", type=float, default=120.0, help="video for the memory, minutes (default 120)"
    )
    arguments.add_argument(
        "--memory-rate", type=float, default=10.0, help="its pictures a second (default 10)"
    )
    arguments.add_argument(
        "--only", choices=PARTS, action="append", help="what to measure (default: everything)"
    )
    options = arguments.parse_args()
    chosen = options.only or PARTS
    measures: list[Measure] = []
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        if {"workers", "ray", "overhead"} & set(chosen):
            clips = make_clips(base / "clips", options.clips, options.seconds)
            measures += engines(clips, base, chosen)
        if "overhead" in chosen:
            measures += overhead(sorted(clips.iterdir())[0], base)
        if "seams" in chosen:
            measures += seams(base, real_clip())
        if "memory" in chosen:
            measures += memory(base, options.minutes, options.memory_rate)
    publish("batch", measures, options.json)


def make_clips(folder: Path, count: int, seconds: float) -> Path:
    """Rendered rides past anomalies, one seed each."""
    folder.mkdir()
    for seed in range(count):
        ride_clip(folder / f"clip-{seed}.mp4", seed, seconds)
    return folder


def ride_clip(path: Path, seed: int, seconds: float) -> Path:
    """A rendered ride of ten pictures a second, every picture shown."""
    import av

    count = int((20.0 * seconds - 2 * DEMO_LEAD_M) / 60)
    mode: Literal["clear", "demo"] = "demo" if count > 0 else "clear"
    plan = RidePlan(seed, demo_settings(), 20.0, seconds, 10.0, mode, max(count, 1))
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height = plan.settings.size_wh
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "20"}
        for picture in rendered(plan, 1):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(stream.encode())
    return path


def fleet(inputs: Path, out: Path, *options: str) -> dict[str, Any]:
    """Run the command in a process of its own; its JSON."""
    command = [sys.executable, "-m", "railinspect", "inspect", str(inputs), "--out", str(out)]
    done = subprocess.run(
        [*command, "--json", "--speed", "20", *options], stdout=subprocess.PIPE, check=False
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"inspect ended with status {done.returncode}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def engines(clips: Path, base: Path, chosen: Sequence[str]) -> list[Measure]:
    """Frames per second by one worker, two workers and two Ray actors, after their start."""
    runs = {}
    if {"workers", "ray"} & set(chosen):
        runs["two"] = ("--workers", "2")
    if "workers" in chosen:
        runs["one"] = ("--workers", "1")
    if "ray" in chosen:
        runs["ray"] = ("--engine", "ray", "--workers", "2")
    rates: dict[str, float] = {}
    for name, options in runs.items():
        empty = base / f"start-{name}"
        empty.mkdir()
        begin = fleet(first_frames(clips, empty), base / f"run-start-{name}", *options)
        whole = fleet(clips, base / f"run-{name}", *options)
        frames = whole["frames"] - begin["frames"]
        rates[name] = frames / max(whole["seconds"] - begin["seconds"], 1e-9)
    measures = [Measure(f"{n} worker(s), after start", r, "frames/s") for n, r in rates.items()]
    if "workers" in chosen:
        ratio = rates["two"] / rates["one"]
        measures.append(Measure("two workers against one", ratio, "x", 1.7, "higher"))
        same = differing(base / "run-one", base / "run-two")
        measures.append(Measure("files that differ, one and two workers", same, "1", 0.0))
    if "ray" in chosen:
        ratio = rates["ray"] / rates["two"]
        measures.append(Measure("Ray against --workers", ratio, "x", 0.85, "higher"))
        same = differing(base / "run-two", base / "run-ray")
        measures.append(Measure("files that differ, --workers and Ray", same, "1", 0.0))
    return measures


def first_frames(clips: Path, folder: Path) -> Path:
    """Two clips of a few frames, to measure the start alone."""
    import av

    for number, clip in enumerate(sorted(clips.iterdir())[:2]):
        with av.open(str(folder / f"start-{number}.mp4"), "w") as container:
            source = open_source(clip)
            stream = container.add_stream("libx264", rate=10)
            stream.width, stream.height = source.size_wh
            stream.pix_fmt = "yuv420p"
            for frame in list(source)[:3]:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame.rgb)))
            container.mux(stream.encode())
            source.close()
    return folder


def differing(one: Path, other: Path) -> int:
    """How many result files of two runs are not equal byte for byte."""
    names = {
        path.relative_to(run)
        for run in (one, other)
        for path in (run / "inputs").rglob("*")
        if path.is_file()
    }
    return sum(
        not (one / name).exists()
        or not (other / name).exists()
        or (one / name).read_bytes() != (other / name).read_bytes()
        for name in names
    )


def overhead(clip: Path, base: Path) -> list[Measure]:
    """CPU time of the engine beside the bare loop and beside decoding and the network alone."""
    load = BundleLoader(shipped_bundle())
    segmenter = load()
    warm_up()
    began_s = time.process_time()
    with closing(open_source(clip, decoder_threads=1)) as source:
        for frame in source:
            segmenter(frame.rgb)
    network_s = time.process_time() - began_s
    began_s = time.process_time()
    with closing(open_source(clip, decoder_threads=1)) as source:
        inspector = SETTINGS.inspector(segmenter, "video")
        for frame in source:
            inspector.feed(frame)
        inspector.finish()
    loop_s = time.process_time() - began_s
    began_s = time.process_time()
    load()
    load_s = time.process_time() - began_s
    began_s = time.process_time()
    inspect_fleet([str(clip)], base / "overhead", load, SETTINGS, engine="serial")
    engine_s = time.process_time() - began_s - load_s
    return [
        Measure("decode and network", network_s, "s CPU"),
        Measure("decode, network and inspection (the bare loop)", loop_s, "s CPU"),
        Measure("fleet run, loading left out", engine_s, "s CPU"),
        Measure("fleet run over the bare loop", engine_s / loop_s - 1.0, "1", 0.15),
        Measure("fleet run over decode and network alone", engine_s / network_s - 1.0, "1"),
    ]


def shipped_bundle() -> bytes:
    """The bundle that ships with the package."""
    import importlib.resources

    return (importlib.resources.files("railinspect") / "bundles" / "fscnn_s.onnx").read_bytes()


def seams(base: Path, real: Path | None) -> list[Measure]:
    """Events of a recording cut into stretches beside those of the whole."""
    measures = []
    cases = [("rendered ride, 60 s", ride_clip(base / "seams.mp4", 3, 60.0), Cut(15.0, 10.0))]
    if real is not None:
        cases.append(("real clip, 21 s", real, Cut(7.0, 7.0)))
    for name, clip, cut in cases:
        whole, other = base / f"whole-{clip.stem}", base / f"cut-{clip.stem}"
        load = BundleLoader(shipped_bundle())
        inspect_fleet([str(clip)], whole, load, SETTINGS, cut=Cut(float("inf")))
        inspect_fleet([str(clip)], other, load, SETTINGS, cut=cut)
        (one,), (two,) = finished_inputs(whole), finished_inputs(other)
        events, apart_m, frames = compared(one, two)
        measures += [
            Measure(f"{name}: seams", two.counts.segments - 1, "1"),
            Measure(f"{name}: events of the whole", one.counts.events, "1"),
            Measure(f"{name}: events that differ", events, "1", 0.0),
            Measure(f"{name}: ranges of events differ by at most", apart_m, "m"),
            Measure(f"{name}: frames of another status", frames, "1"),
        ]
    return measures


def compared(one: FinishedInput, two: FinishedInput) -> tuple[int, float, int]:
    """Events that differ in kind, times or frames; largest difference of a range; frames."""
    events, others = list(one.events()), list(two.events())
    same = [
        (a, b)
        for a, b in zip(events, others, strict=False)
        if all(a[key] == b[key] for key in EXACT)
    ]
    apart_m = [
        abs(a[key] - b[key]) for a, b in same for key in RANGES if a[key] and b[key] is not None
    ]
    pairs = zip(one.frames(), two.frames(), strict=True)
    frames = sum(a["status"] != b["status"] for a, b in pairs)
    return max(len(events), len(others)) - len(same), max(apart_m, default=0.0), frames


def memory(base: Path, minutes: float, frame_rate: float) -> list[Measure]:
    """Resident memory of one worker over a long recording: the last tenth against the second."""
    clip = synthetic(base / "long.mp4", minutes, frame_rate)
    command = [sys.executable, "-m", "railinspect", "inspect", str(clip), "--workers", "1"]
    command += ["--out", str(base / "long"), "--speed", "20"]
    driver = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    seen: list[float] = []
    over = threading.Event()
    watcher = threading.Thread(target=watch, args=(driver.pid, seen, over))
    watcher.start()
    driver.wait()
    over.set()
    watcher.join()
    tenth = max(len(seen) // 10, 1)
    early, late = (sum(part) / len(part) for part in (seen[tenth : 2 * tenth], seen[-tenth:]))
    return [
        Measure(f"a worker's memory early in {minutes:g} minutes", early, "MB"),
        Measure("the same late", late, "MB"),
        Measure("late against early", late / early - 1.0, "1", 0.05),
    ]


def watch(driver: int, seen: list[float], over: threading.Event) -> None:
    """Note the resident memory of the driver's worker every half second, MB."""
    page_mb = os.sysconf("SC_PAGE_SIZE") / 2**20
    while not over.wait(0.5):
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rsplit(")", 1)[1].split()
                if int(fields[1]) != driver:
                    continue
                if "spawn_main" not in (stat.parent / "cmdline").read_text():
                    continue
                pages = int((stat.parent / "statm").read_text().split()[1])
            except (OSError, IndexError, ValueError):
                continue
            seen.append(pages * page_mb)


if __name__ == "__main__":
    main()
