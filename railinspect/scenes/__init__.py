"""The procedural railway world: pictures, class masks, depth, stereo pairs and rides, with truth."""

from railinspect.scenes.render import Rendered, SceneObject, render, render_stereo
from railinspect.scenes.settings import SceneSettings

__all__ = ["Rendered", "SceneObject", "SceneSettings", "render", "render_stereo"]
