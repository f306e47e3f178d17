"""How fast the rendered world is drawn: pictures per second on one core, everything switched on."""

from __future__ import annotations

import statistics
import time

import cv2

from benchmarks.common import Measure, parser, publish
from railinspect.scenes import Ride, SceneSettings, demo_settings, render


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument(
        "--count", type=int, default=80, help="pictures per measure (default 80)"
    )
    options = arguments.parse_args()
    cv2.setNumThreads(1)
    render(0)
    measures = []
    for size, bar in (((640, 360), 12.0), ((1280, 720), None), ((1920, 1080), None)):
        count = options.count if bar else max(5, options.count // 8)
        times = []
        for seed in range(1, count + 1):
            start = time.perf_counter()
            render(seed, SceneSettings(size_wh=size))
            times.append(time.perf_counter() - start)
        rate = count / sum(times)
        name = f"stills {size[0]}x{size[1]}, one core"
        measures.append(Measure(name, rate, "images/s", bar, "higher"))
        measures.append(Measure(f"{name}, median time", 1e3 * statistics.median(times), "ms"))
    ride = Ride.plan(7, demo_settings(), duration_s=60, anomalies="demo")
    start = time.perf_counter()
    for index in range(options.count):
        ride.frame(index * 7 % len(ride))
    rate = options.count / (time.perf_counter() - start)
    measures.append(Measure("ride 640x360, one core", rate, "frames/s", None, "higher"))
    publish("scenes", measures, options.json)


if __name__ == "__main__":
    main()
