"""Recording a rendered ride as a video file, with its truth beside it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import asdict, dataclass
from fractions import Fraction
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, Literal

import av
import cv2
import numpy as np
import numpy.typing as npt

from railinspect._threads import usable_cores
from railinspect.errors import OutputError
from railinspect.runinfo import write_json
from railinspect.scenes import Ride, SceneSettings

Image = npt.NDArray[np.uint8]

MAX_WORKERS: Final = 2
"""Rendering processes unless the caller says otherwise; each needs about 300 MB."""


@dataclass(frozen=True)
class RidePlan:
    """Everything a ride follows from, so that any worker can lay out the same one.

    Attributes:
        seed: Seed of the world and its anomalies.
        settings: Choices left to the caller.
        speed_mps: Constant speed, m/s.
        duration_s: Length, seconds.
        frame_rate: Frames per second.
        anomalies: "clear" for none, "demo" for a mix of all types.
        anomaly_count: How many anomalies "demo" plants.
    """

    seed: int
    settings: SceneSettings
    speed_mps: float = 20.0
    duration_s: float = 50.0
    frame_rate: float = 12.5
    anomalies: Literal["clear", "demo"] = "demo"
    anomaly_count: int = 11

    def ride(self) -> Ride:
        """Lay out the ride."""
        return Ride.plan(
            self.seed,
            self.settings,
            self.speed_mps,
            self.duration_s,
            self.frame_rate,
            self.anomalies,
            self.anomaly_count,
        )


def truth_of(plan: RidePlan, ride: Ride) -> dict[str, Any]:
    """What a ride is known to contain: the plan's numbers and every planted anomaly.

    Chainages are metres along the track from the camera's place in the first frame; the camera is
    at ``speed_mps · time_s``.
    """
    return {
        "seed": plan.seed,
        "speed_mps": plan.speed_mps,
        "frame_rate": plan.frame_rate,
        "frames": len(ride),
        "camera": asdict(ride.camera),
        "planted": [
            {
                "id": thing.id,
                "type": thing.type,
                "chainage_m": round(thing.chainage_m, 3),
                "length_m": round(thing.length_m, 3),
                "lateral_m": round(thing.lateral_m, 3),
                "height_m": round(thing.height_m, 3),
            }
            for thing in ride.planted
        ],
    }


def record_ride(
    plan: RidePlan,
    video: Path,
    truth: Path,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Ride:
    """Render a ride into an MP4 (H.264, constant rate factor 17) and write its truth as JSON.

    Args:
        plan: The ride.
        video: Video file to write.
        truth: JSON file to write, see :func:`truth_of`.
        workers: Rendering processes; default: the processor's cores, at most two. The frames do
            not depend on it.
        progress: Called with the frames done and their total.

    Returns:
        The ride.

    Raises:
        OutputError: if a file cannot be written.
    """
    ride = plan.ride()
    part = video.with_name(video.name + ".part")
    try:
        write_json(truth, truth_of(plan, ride))
        with av.open(str(part), "w", format="mp4", options={"movflags": "faststart"}) as container:
            rate = Fraction(plan.frame_rate).limit_denominator(1001)
            stream = container.add_stream("libx264", rate=rate)
            stream.width, stream.height = plan.settings.size_wh
            stream.pix_fmt = "yuv420p"
            stream.codec_context.thread_count = 1
            stream.options = {"preset": "veryfast", "crf": "17"}
            for index, rgb in enumerate(rendered(plan, workers or default_workers())):
                picture = av.VideoFrame.from_ndarray(rgb)
                picture.pts, picture.time_base = index, 1 / rate
                container.mux(stream.encode(picture))
                if progress is not None:
                    progress(index + 1, len(ride))
            container.mux(stream.encode())
        part.replace(video)
    except OSError as error:
        raise OutputError(f"cannot write the ride to {video}: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
    return ride


def default_workers() -> int:
    """Rendering processes for this machine: one per core this process may use, at most two."""
    return min(MAX_WORKERS, usable_cores())


def rendered(plan: RidePlan, workers: int) -> Iterator[Image]:
    """The ride's pictures in order, rendered by ``workers`` processes a few frames ahead."""
    count = len(plan.ride())
    if workers <= 1:
        ride = plan.ride()
        yield from (ride.frame(index).rgb for index in range(count))
        return
    with ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_lay_out, initargs=(plan,)
    ) as pool:
        waiting: deque[Future[Image]] = deque()
        try:
            for index in range(count):
                waiting.append(pool.submit(_picture, index))
                if len(waiting) >= 4 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


_ride: Ride | None = None  # one ride per worker process, laid out once


def _lay_out(plan: RidePlan) -> None:
    global _ride
    cv2.setNumThreads(1)
    _ride = plan.ride()


def _picture(index: int) -> Image:
    assert _ride is not None
    return _ride.frame(index).rgb
