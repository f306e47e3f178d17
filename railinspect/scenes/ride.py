"""A ride through one world: continuous frames at a given speed, anomalies planted on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.scenes.draft import Thing, World
from railinspect.scenes.planting import ANOMALY_TYPES, plant
from railinspect.scenes.render import Rendered, view
from railinspect.scenes.settings import SceneSettings
from railinspect.scenes.world import begin, finish

Plan = Literal["clear", "demo"]

DEMO_LEAD_M = 130.0
"""Clear track before the first planted anomaly and between the last one and the end, metres."""


@dataclass(frozen=True)
class Ride:
    """A recorded ride, rendered frame by frame in any order.

    Attributes:
        world: The world it runs through.
        speed_mps: Constant speed, m/s.
        frame_rate: Frames per second.
        count: Number of frames.
        planted: The anomalies on the ego track, in the order they are met.
    """

    world: World
    speed_mps: float
    frame_rate: float
    count: int
    planted: tuple[Thing, ...]

    @staticmethod
    def plan(
        seed: int,
        settings: SceneSettings | None = None,
        speed_mps: float = 20.0,
        duration_s: float = 60.0,
        frame_rate: float = 12.5,
        anomalies: Plan = "clear",
        anomaly_count: int = 11,
    ) -> Ride:
        """Lay out a ride.

        Args:
            seed: Seed of the world, the anomalies and the camera's vibration.
            settings: Choices left to the caller; the demo asks for daylight and wide curves.
            speed_mps: Speed, m/s, > 0.
            duration_s: Length, s, > 0.
            frame_rate: Frames per second, > 0.
            anomalies: ``clear`` for none, ``demo`` for a mix of all three types.
            anomaly_count: How many the demo plants.

        Raises:
            BadInputError: if a number is out of range or the ride is too short for its anomalies.
        """
        for name, value in (
            ("speed_mps", speed_mps),
            ("duration_s", duration_s),
            ("frame_rate", frame_rate),
        ):
            if not (np.isfinite(value) and value > 0):
                raise BadInputError(f"ride {name} is {value}; give a positive number")
        settings = settings or SceneSettings()
        length = speed_mps * duration_s
        draft, alignment, camera = begin(seed, settings, length)
        planted: list[Thing] = []
        if anomalies == "demo":
            rng = np.random.default_rng([seed, 0xA402])
            room = length - 2 * DEMO_LEAD_M
            if room < 40.0 * anomaly_count:
                raise BadInputError(
                    f"a ride of {length:.0f} m has no room for {anomaly_count} anomalies; "
                    "make it longer or plant fewer"
                )
            kinds = [ANOMALY_TYPES[i % 3] for i in range(anomaly_count)]
            rng.shuffle(kinds)
            # one gap in the middle is left clear
            pitch = room / (anomaly_count + 1)
            for i, kind in enumerate(kinds):
                slot = i if i < anomaly_count // 2 else i + 2
                at = DEMO_LEAD_M + slot * pitch + float(rng.uniform(0, 0.35 * pitch))
                planted.append(plant(draft, kind, at, rng, clear_of_m=0.2))
        world = finish(draft, seed, alignment, camera)
        count = max(1, round(duration_s * frame_rate))
        return Ride(world, speed_mps, frame_rate, count, tuple(planted))

    def __len__(self) -> int:
        return self.count

    @property
    def camera(self) -> Camera:
        """The camera at rest."""
        return self.world.camera

    def chainage_m(self, index: int) -> float:
        """Where the observer stands in a frame, metres."""
        return self.speed_mps * index / self.frame_rate

    def frame(self, index: int) -> Rendered:
        """Render frame ``index``; frames may be asked for in any order, on any worker.

        Raises:
            IndexError: if the ride has no such frame.
        """
        if not 0 <= index < self.count:
            raise IndexError(f"frame {index} of a ride of {self.count} frames")
        time = index / self.frame_rate
        rng = np.random.default_rng([self.world.seed, 0xF17E, index])
        phase = np.random.default_rng([self.world.seed, 0x51B]).uniform(0, 2 * np.pi, 6)
        sway = np.sin(2 * np.pi * time * np.array([0.7, 1.9, 0.4, 1.3, 0.9, 2.3]) + phase)
        camera = replace(
            self.camera,
            pitch_rad=self.camera.pitch_rad + 0.0009 * sway[0] + 0.0004 * sway[1],
            roll_rad=self.camera.roll_rad + 0.0012 * sway[2] + 0.0005 * sway[3],
            yaw_rad=self.camera.yaw_rad + 0.0009 * sway[4],
            height_m=self.camera.height_m + 0.006 * sway[5],
        )
        return view(self.world, rng, self.chainage_m(index), time, camera)


def demo_settings(size_wh: tuple[int, int] = (640, 360)) -> SceneSettings:
    """The demo's set-up: a calibrated cab camera, an open line, dry daylight, curves ≥ 400 m."""
    camera = Camera.from_field_of_view(size_wh, np.radians(50.0), 2.6, pitch_rad=0.045)
    return SceneSettings(
        size_wh=size_wh, camera=camera, kind="line", weather=False, min_radius_m=400.0
    )
