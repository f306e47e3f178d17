"""What a caller may choose about rendered scenes; everything else is drawn from the seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from railinspect.camera import Camera
from railinspect.errors import BadInputError

Kind = Literal["any", "line", "station", "tram", "none"]


@dataclass(frozen=True)
class SceneSettings:
    """Choices for a rendered scene; ``None`` leaves a quantity to the seed.

    Attributes:
        size_wh: Picture width and height, pixels.
        camera: The camera; by default a random cab camera (height 1.5–4 m, horizontal field of
            view 35–80°, pitch, roll, yaw, gauge).
        kind: Surroundings: open line, station, street with embedded track, or no rail at all.
        distractors: Draw rail-like things that are no rails: kerbs, lane markings, wipers, troughs.
        weather: Vary light, weather and camera; otherwise a dry overcast day.
        occluders: Let people, vehicles and objects stand on and beside the track.
        crowded: Put one to four anomalies on every ego track, most of them near, as training needs
            that is to find things by themselves and not by what surrounds them.
        closer: How much narrower the random camera's field of view is, as a closer look's
            (:mod:`railinspect.fovea`): 2 or 4 halve it once or twice, around the horizon. Anomalies
            stand where such a look shows them, and what is out of focus blurs as much more. 1 for
            a whole picture.
        min_radius_m: Tightest curve, metres, ≥ 200.
    """

    size_wh: tuple[int, int] = (640, 360)
    camera: Camera | None = None
    kind: Kind = "any"
    distractors: bool = True
    weather: bool = True
    occluders: bool = True
    crowded: bool = False
    closer: int = 1
    min_radius_m: float = 200.0

    def __post_init__(self) -> None:
        width, height = self.size_wh
        if not (64 <= width <= 4096 and 64 <= height <= 4096):
            raise BadInputError(
                f"scene size_wh is {width}x{height}; both must lie within 64…4096 pixels"
            )
        if self.camera is not None and self.camera.size_wh != self.size_wh:
            raise BadInputError(
                f"the camera delivers {self.camera.size_wh}, the scene asks for {self.size_wh}; "
                "use camera.resized(size_wh)"
            )
        if not (self.closer == 1 or (self.camera is None and 1 <= self.closer <= 8)):
            raise BadInputError(
                f"closer is {self.closer}; a random camera's view is narrowed by 1…8 times, a "
                "given camera's by none"
            )
        if not self.min_radius_m >= 200:
            raise BadInputError(
                f"min_radius_m is {self.min_radius_m}; main-line curves are 200 m or wider"
            )
