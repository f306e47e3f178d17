"""How late the inspector's answer is behind a live source, end to end, and what it drops.

A second process makes 25 pictures a second, encodes them, and sends them in real time: into a
growing MPEG-TS file, a growing fragmented MP4 file, over UDP, and as an RTSP server. Each picture
carries its number, so its age is known when its record has been written: encoding, transport,
decoding, network, track, findings and writing are all in it. A second run slows the inspector down
to three frames a second, so that frames must be dropped.

The last two frames are left out: MPEG-TS ends a picture only where the next one begins.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.common import Measure, parser, publish
from benchmarks.live_senders import number_of
from railinspect.batch import inspect_live
from railinspect.inspect_settings import InspectSettings
from railinspect.live import LiveSettings, LiveSource
from railinspect.pipeline import SegmentFunction
from railinspect.records import FrameRecord
from railinspect.scenes import Ride, SceneSettings
from railinspect.segmenter import Segmenter
from railinspect.source import Frame, LiveCount
from railinspect.warmup import warm_up

RATE = 25
BAR_S = 0.5
SLOW_S = 0.33


class Ages:
    """Collects how old each frame was when its record had been written, seconds."""

    def __init__(self) -> None:
        self.begin_unix_s = 0.0
        self.seen: list[tuple[int, float]] = []

    def write(self, name: str, frame: Frame, record: FrameRecord) -> None:
        """Note when the record was written."""
        self.seen.append((number_of(frame.rgb), time.time()))

    def seconds(self, last: int) -> np.ndarray:
        """Ages of the frames before number ``last``."""
        return np.array([at - self.begin_unix_s - n / RATE for n, at in self.seen if n < last])


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def follow(
    kind: str, segmenter: SegmentFunction, pictures: Path, seconds: float, folder: Path
) -> tuple[Ages, LiveCount]:
    """Send by another process, follow, and return the ages and the counts."""
    port = free_port()
    target, address = {
        "ts": (str(folder / "a.ts"), str(folder / "a.ts")),
        "mp4": (str(folder / "a.mp4"), str(folder / "a.mp4")),
        "udp": (f"udp://127.0.0.1:{port}", f"udp://127.0.0.1:{port}"),
        "rtsp": (str(port), f"rtsp://127.0.0.1:{port}/cab"),
    }[kind]
    command = [sys.executable, "-m", "benchmarks.live_senders", kind, target]
    command += ["--pictures", str(pictures), "--seconds", str(seconds), "--rate", str(RATE)]
    ages = Ages()
    sender = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert sender.stdout is not None
    try:
        if kind == "rtsp":
            wait_for_port(port)
        else:
            ages.begin_unix_s = float(sender.stdout.readline())
            time.sleep(0.5)
        source = LiveSource(address, LiveSettings(idle_s=1.5, open_s=20))
        if kind == "rtsp":
            ages.begin_unix_s = float(sender.stdout.readline())
        summary = inspect_live(
            source, folder / "run", segmenter, InspectSettings(overlay=False), viewer=ages
        )
    finally:
        sender.wait(timeout=30)
        sender.stdout.close()
    live = summary.inputs[0].live
    assert live is not None
    return ages, live


def wait_for_port(port: int) -> None:
    """Wait until a server listens, without connecting to it."""
    wanted = f":{port:04X} "
    for _ in range(300):
        listening = Path("/proc/net/tcp").read_text() if Path("/proc/net/tcp").exists() else wanted
        if wanted in listening:
            return
        time.sleep(0.05)


def main() -> None:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--seconds", type=float, default=20.0, help="per source (default: 20)")
    arguments.add_argument("--kinds", default="ts,mp4,udp,rtsp", help="sources, with commas")
    options = arguments.parse_args()
    segmenter = Segmenter.default(1)
    warm_up()
    ride = Ride.plan(3, SceneSettings(size_wh=(640, 360)), 20.0, 1.0, float(RATE), "clear", 0)
    pictures = np.stack([ride.frame(index).rgb for index in range(0, len(ride), 3)])
    for picture in pictures[:3]:
        segmenter(picture)

    def slow(rgb: np.ndarray) -> object:
        time.sleep(SLOW_S)
        return segmenter(rgb)

    measures: list[Measure] = []
    last = round(options.seconds * RATE) - 2
    with tempfile.TemporaryDirectory() as name:
        stored = Path(name) / "pictures.npy"
        np.save(stored, pictures)
        plan = [(kind, segmenter, kind) for kind in options.kinds.split(",")]
        plan.append((options.kinds.split(",")[0], slow, f"{options.kinds.split(',')[0]}, slowed"))
        for kind, function, title in plan:
            folder = Path(name) / title
            folder.mkdir()
            ages, live = follow(kind, function, stored, options.seconds, folder)
            seconds = ages.seconds(last)
            inspected = len(ages.seen)
            measures += [
                Measure(f"{title}: latency, median", float(np.median(seconds)), "s"),
                Measure(f"{title}: latency, 95 %", float(np.quantile(seconds, 0.95)), "s"),
                Measure(
                    f"{title}: latency, worst",
                    float(seconds.max()),
                    "s",
                    None if function is slow else BAR_S,
                ),
                Measure(f"{title}: frames inspected", inspected, "frames", better="higher"),
                Measure(f"{title}: frames dropped", live.dropped, "frames"),
                Measure(
                    f"{title}: frames neither inspected nor counted as dropped",
                    live.received - live.dropped - inspected,
                    "frames",
                    0,
                ),
            ]
    publish("live", measures, options.json)


if __name__ == "__main__":
    main()
