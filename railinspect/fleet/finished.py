"""One finished input of a fleet run, read from its folder; see ``docs/fleet.md`` for the files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from railinspect.errors import BadInputError
from railinspect.runinfo import jsonable
from railinspect.sinks.json_lines import read_json_lines
from railinspect.video import Break


@dataclass(frozen=True)
class InputCounts:
    """What an input gave; counts are frames, times are media seconds. ``summary.json`` holds it.

    Attributes:
        id: First 16 hex digits of the SHA-256 of the input's content.
        name: A short name for people, made from the address; not unique.
        address: Where the input was read from.
        kind: "video", "folder" or "image".
        size_wh: Size of the first picture, pixels.
        frames: Frames inspected.
        clear_frames: Frames with nothing on a followed track.
        finding_frames: Frames with a finding.
        unknown_frames: Frames in which nothing can be said.
        followed_frames: Frames in which both rails of the own track were followed.
        speed_unknown_frames: Frames at an unknown speed.
        first_time_s: Time of the first frame; None without any.
        last_time_s: Time of the last frame; None without any.
        events: Events confirmed.
        break_count: How often reading failed.
        breaks: Where, the first thousand.
        segments: Into how many pieces the input was cut.
    """

    id: str
    name: str
    address: str
    kind: str
    size_wh: tuple[int, int]
    frames: int = 0
    clear_frames: int = 0
    finding_frames: int = 0
    unknown_frames: int = 0
    followed_frames: int = 0
    speed_unknown_frames: int = 0
    first_time_s: float | None = None
    last_time_s: float | None = None
    events: int = 0
    break_count: int = 0
    breaks: tuple[Break, ...] = field(default=())
    segments: int = 1

    @property
    def duration_s(self) -> float:
        """Media time from the first frame to the last, seconds."""
        if self.first_time_s is None or self.last_time_s is None:
            return 0.0
        return self.last_time_s - self.first_time_s

    def as_json(self) -> dict[str, Any]:
        """The document ``summary.json``."""
        document: dict[str, Any] = jsonable(self)
        return document

    @staticmethod
    def from_json(document: dict[str, Any]) -> InputCounts:
        """Read it back.

        Raises:
            TypeError, ValueError, KeyError: if it is no such document.
        """
        breaks = tuple(Break(**one) for one in document["breaks"])
        width, height = document["size_wh"]
        return InputCounts(**{**document, "breaks": breaks, "size_wh": (width, height)})


@dataclass(frozen=True)
class FinishedInput:
    """A finished input: its counts, its frames and its events.

    Attributes:
        folder: ``RUN/inputs/<id>``.
        counts: What ``summary.json`` says.
    """

    folder: Path
    counts: InputCounts

    @staticmethod
    def read(folder: str | Path) -> FinishedInput:
        """Open the folder of a finished input.

        Raises:
            BadInputError: if it is none.
        """
        folder = Path(folder)
        try:
            document = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
            counts = InputCounts.from_json(document)
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise BadInputError(
                f"{folder} is no finished input of a fleet run ({type(error).__name__}: {error}); "
                "give a folder RUN/inputs/ID"
            ) from error
        return FinishedInput(folder, counts)

    def frames(self) -> Iterator[dict[str, Any]]:
        """The lines of ``frames.jsonl`` in order; ``input`` is the id, ``name`` the name."""
        return read_json_lines(self.folder / "frames.jsonl")

    def events(self) -> Iterator[dict[str, Any]]:
        """The lines of ``events.jsonl``, by id, which rises with the time of confirmation."""
        return read_json_lines(self.folder / "events.jsonl")

    def thumbnail(self, event: dict[str, Any]) -> Path | None:
        """The picture of one of the events (JPEG), or None."""
        return self.folder / event["thumbnail"] if event["thumbnail"] else None


def finished_inputs(run_folder: str | Path) -> tuple[FinishedInput, ...]:
    """The finished inputs of a run, by id."""
    folders = sorted(Path(run_folder, "inputs").glob("*/summary.json"))
    return tuple(FinishedInput.read(summary.parent) for summary in folders)


def run_id(run_folder: str | Path) -> str:
    """The id of a run, 16 hex digits, as ``fleet.json`` states it.

    Raises:
        BadInputError: if the folder holds no fleet run.
    """
    path = Path(run_folder, "fleet.json")
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["run"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInputError(
            f"{run_folder} holds no fleet run (fleet.json: {error}); give the folder that "
            "railinspect inspect was given by --out"
        ) from error
