"""What ``run.json`` says about a run besides its counts: versions, model, camera, settings."""

from __future__ import annotations

import dataclasses
import json
import math
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from railinspect.inspect_settings import InspectSettings

FORMAT: Final = 1
"""Version of the run folder's layout; rises when a reader would have to change."""

_MODEL: Final = (
    "network",
    "package_version",
    "input_size_wh",
    "training_fingerprint",
    "golden_sha256",
    "training",
)
_LIBRARIES: Final = ("numpy", "opencv-python-headless", "onnxruntime", "av", "pyarrow")


def run_info(started: datetime, segmenter: object, settings: InspectSettings) -> dict[str, Any]:
    """Versions, times, model, camera and settings of a run, as JSON values."""
    train, log = settings.train, settings.speed_log
    return {
        "format": FORMAT,
        "started": started.isoformat(timespec="seconds"),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "railinspect": installed_version("railinspect"),
            "python": platform.python_version(),
            **{name: installed_version(name) for name in _LIBRARIES},
        },
        "model": _model(getattr(segmenter, "metadata", None)),
        "camera": jsonable(settings.camera),
        "settings": {
            "overlay": settings.overlay,
            "folder_rate_hz": settings.folder_rate_hz,
            "topic": settings.topic,
            "speed_mps": train.speed_mps if train and log is None else None,
            "speed_is_known": settings.speed_is_known and (log or train) is not None,
            "speed_log": None
            if log is None
            else {
                "source": log.source,
                "first_time_s": log.span_s[0],
                "last_time_s": log.span_s[1],
                "highest_mps": log.highest_mps,
            },
            "events": jsonable(settings.events),
            "thresholds": jsonable(settings.thresholds),
            "train": jsonable(train),
            "policy": jsonable(settings.policy),
        },
    }


def _model(metadata: object) -> dict[str, Any] | None:
    """What identifies the bundle; None for a segmenter that is not one."""
    known = {name: getattr(metadata, name, None) for name in _MODEL}
    return {name: jsonable(value) for name, value in known.items()} if metadata else None


def installed_version(distribution: str) -> str | None:
    """Version of an installed distribution, or None when it runs from a bare checkout."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None


def jsonable(value: object) -> Any:
    """Dataclasses, mappings, sequences, arrays and paths as JSON values; NaN and inf as null.

    Private fields of dataclasses are caches and are left out.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in dataclasses.fields(value) if not f.name.startswith("_")]
        return {name: jsonable(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [jsonable(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int | bool):
        return value
    return str(value)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document as indented UTF-8 JSON."""
    text = json.dumps(jsonable(document), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
