"""From a cab view to what is on the track, how far, how sure.

The names below are what users script against; everything else may move between minor versions.
They are imported when first used, so that ``import railinspect`` stays instant.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from railinspect.batch import inspect_inputs
    from railinspect.camera import Camera, CameraStd
    from railinspect.errors import BadInputError, BundleError, OutputError, RailInspectError
    from railinspect.events import Event, EventSettings
    from railinspect.inspect_settings import InspectSettings
    from railinspect.pipeline import Inspector, inspect_video
    from railinspect.records import FrameRecord, LocatedFinding
    from railinspect.run_summary import RunSummary
    from railinspect.segmenter import Segmentation, Segmenter
    from railinspect.video import Frame, open_source

_HOMES: Final = {
    "BadInputError": "errors",
    "BundleError": "errors",
    "Camera": "camera",
    "CameraStd": "camera",
    "Event": "events",
    "EventSettings": "events",
    "Frame": "video",
    "FrameRecord": "records",
    "InspectSettings": "inspect_settings",
    "Inspector": "pipeline",
    "LocatedFinding": "records",
    "OutputError": "errors",
    "RailInspectError": "errors",
    "RunSummary": "run_summary",
    "Segmentation": "segmenter",
    "Segmenter": "segmenter",
    "inspect_inputs": "batch",
    "inspect_video": "pipeline",
    "open_source": "video",
}

__all__ = [
    "BadInputError",
    "BundleError",
    "Camera",
    "CameraStd",
    "Event",
    "EventSettings",
    "Frame",
    "FrameRecord",
    "InspectSettings",
    "Inspector",
    "LocatedFinding",
    "OutputError",
    "RailInspectError",
    "RunSummary",
    "Segmentation",
    "Segmenter",
    "inspect_inputs",
    "inspect_video",
    "open_source",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'railinspect' has no attribute {name!r}")
    return getattr(importlib.import_module(f"railinspect.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
