"""The procedural railway world: pictures, masks, depth, stereo pairs and rides, with truth."""

from railinspect.scenes.dataset import write_images
from railinspect.scenes.planting import AnomalyType
from railinspect.scenes.render import Rendered, SceneObject, render, render_stereo
from railinspect.scenes.ride import Ride, demo_settings
from railinspect.scenes.settings import SceneSettings

__all__ = [
    "AnomalyType",
    "Rendered",
    "Ride",
    "SceneObject",
    "SceneSettings",
    "demo_settings",
    "render",
    "render_stereo",
    "write_images",
]
