"""How fast a video is inspected, with and without overlay, and whether memory stays flat."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from benchmarks.common import Measure, parser, publish
from railinspect.ride_file import RidePlan, rendered
from railinspect.scenes import demo_settings


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument(
        "--video",
        type=Path,
        help="recording for the speed (default: cab_ride.mp4 in $RAILINSPECT_REAL or in "
        "../shared/real, else a rendered ride)",
    )
    arguments.add_argument(
        "--minutes", type=float, default=30.0, help="length of the long video (default 30)"
    )
    arguments.add_argument(
        "--frame-rate", type=float, default=10.0, help="of the synthetic videos (default 10)"
    )
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        video = options.video or real_clip() or synthetic(base / "ride.mp4", 0.5, 12.5)
        measures = speed(video, base)
        measures += memory(base, options.minutes, options.frame_rate)
    publish("inspect_video", measures, options.json)


def real_clip() -> Path | None:
    """The real clip where it is present."""
    folder = os.environ.get("RAILINSPECT_REAL") or Path(__file__).parents[1] / "../shared/real"
    clip = Path(folder) / "cab_ride.mp4"
    return clip if clip.exists() else None


def inspect(video: Path, out: Path, *options: str) -> tuple[dict[str, Any], float]:
    """Run the command in its own process; its JSON and its peak resident memory, MB."""
    command = [sys.executable, "-m", "railinspect", "inspect", str(video), "--out", str(out)]
    process = subprocess.Popen([*command, "--json", *options], stdout=subprocess.PIPE)
    assert process.stdout is not None
    text = process.stdout.read()
    process.stdout.close()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"inspect ended with status {process.returncode}")
    return json.loads(text), usage.ru_maxrss / 1024


def speed(video: Path, base: Path) -> list[Measure]:
    """Frames per second without and with the overlay, and what was followed."""
    plain, plain_mb = inspect(video, base / "plain", "--no-overlay")
    drawn, _ = inspect(video, base / "drawn")
    name = video.name
    return [
        Measure(f"{name}, no overlay", plain["frames_per_s"], "frames/s", 24.0, "higher"),
        Measure(f"{name}, overlay", drawn["frames_per_s"], "frames/s", 15.0, "higher"),
        Measure(f"{name}, both rails followed", plain["followed_fraction"], "1", 0.9, "higher"),
        Measure(f"{name}, events", plain["events"], "1"),
        Measure(f"{name}, peak resident memory", plain_mb, "MB"),
    ]


def memory(base: Path, minutes: float, frame_rate: float) -> list[Measure]:
    """Peak resident memory on a long synthetic video against a one-minute one."""
    peaks = []
    for length in (1.0, minutes):
        video = synthetic(base / f"{length:g}min.mp4", length, frame_rate)
        summary, peak_mb = inspect(video, base / f"run-{length:g}")
        assert summary["frames"] == round(60 * length * frame_rate)
        peaks.append(peak_mb)
        video.unlink()
    return [
        Measure("peak resident memory, 1 minute", peaks[0], "MB"),
        Measure(f"peak resident memory, {minutes:g} minutes", peaks[1], "MB"),
        Measure(f"memory, {minutes:g} minutes against 1", peaks[1] / peaks[0], "x", 1.1),
    ]


def synthetic(path: Path, minutes: float, frame_rate: float) -> Path:
    """A ride of ten seconds with an anomaly, repeated to the wanted length."""
    plan = RidePlan(7, demo_settings(), 30.0, 10.0, frame_rate, "demo", 1)
    pictures = list(rendered(plan, 1))
    rate = Fraction(frame_rate).limit_denominator(1000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = plan.settings.size_wh
        stream.pix_fmt = "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "23"}
        for index in range(round(60 * minutes * frame_rate)):
            picture = av.VideoFrame.from_ndarray(pictures[index % len(pictures)])
            picture.pts, picture.time_base = index, 1 / rate
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path


if __name__ == "__main__":
    main()
