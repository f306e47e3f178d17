"""What a run gave, over all its inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from railinspect.input_results import InputSummary


@dataclass(frozen=True)
class RunSummary:
    """What a run gave, over all its inputs.

    Attributes:
        folder: The run folder.
        inputs: One summary per input.
        seconds: Wall-clock time of the frame loops, seconds.
        complete: False if the run was interrupted.
    """

    folder: Path
    inputs: tuple[InputSummary, ...]
    seconds: float
    complete: bool

    @property
    def frames(self) -> int:
        """Frames inspected."""
        return sum(one.frames for one in self.inputs)

    @property
    def unknown_frames(self) -> int:
        """Frames in which nothing can be said."""
        return sum(one.unknown_frames for one in self.inputs)

    @property
    def events(self) -> int:
        """Events confirmed."""
        return sum(one.events for one in self.inputs)

    @property
    def frames_per_s(self) -> float:
        """Frames inspected per second of wall-clock time."""
        return self.frames / self.seconds if self.seconds > 0 else 0.0

    @property
    def followed_fraction(self) -> float:
        """Share of the frames in which both rails of the own track were followed."""
        followed = sum(one.followed_frames for one in self.inputs)
        return followed / self.frames if self.frames else 0.0

    def as_json(self) -> dict[str, Any]:
        """The document printed by ``railinspect inspect --json``."""
        return {
            "frames": self.frames,
            "frames_per_s": round(self.frames_per_s, 2),
            "seconds": round(self.seconds, 3),
            "followed_fraction": round(self.followed_fraction, 4),
            "unknown_frames": self.unknown_frames,
            "speed_unknown_frames": sum(one.speed_unknown_frames for one in self.inputs),
            "drift_frames": sum(one.drift_frames for one in self.inputs),
            "finding_frames": sum(one.finding_frames for one in self.inputs),
            "events": self.events,
            "breaks": sum(one.break_count for one in self.inputs),
            "dropped_frames": sum(one.live.dropped for one in self.inputs if one.live),
            "complete": self.complete,
            "paths": {
                "run": str(self.folder),
                "report": str(self.folder / "report.html"),
                "frames": str(self.folder / "frames.jsonl"),
                "events": str(self.folder / "events.jsonl"),
                "table": str(self.folder / "events.parquet"),
                "overlay": [str(self.folder / i.overlay) for i in self.inputs if i.overlay],
            },
        }
