"""The demo: a ride with known anomalies, inspected like any recording, judged against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from railinspect.batch import inspect_inputs
from railinspect.errors import OutputError
from railinspect.inspect_settings import InspectSettings
from railinspect.pipeline import SegmentFunction, Steps
from railinspect.progress import Progress, ProgressLine
from railinspect.ride_file import RidePlan, record_ride, truth_of
from railinspect.run_summary import RunSummary
from railinspect.runfolder import RUN_FILES, RunFolder, refuse_taken
from railinspect.runinfo import write_json
from railinspect.scenes import demo_settings
from railinspect.sinks.json_lines import read_json_lines
from railops.braking import Train

TOLERANCE_M: Final = 10.0
"""An event belongs to a planted anomaly if it lies within this of its extent, metres."""

DEMO_SEED: Final = 1
"""Seed of the demo ride unless another is asked for."""

FOUND_SHARE: Final = 0.9
"""The demo's bar: at least this share of the planted anomalies is found …"""

FALSE_EVENTS: Final = 1
"""… with at most this many false events."""

DEMO_FILES: Final = ("ride.mp4", "truth.json", "camera.yaml", "demo.json")
"""Files of a demo besides those of its run."""


@dataclass(frozen=True)
class Judgement:
    """Events against planted anomalies.

    The rule: an event lies where the train was when the event was closest, plus that closest
    range. It matches a planted anomaly if that place is within 10 m of the anomaly's extent
    along the track; each anomaly takes at most one event, those of the right type and then the
    nearest first. An anomaly is *found* if its event also has its type. An anomaly whose event
    has another type is *missed*, and its event counts as confused, not as false. Every event
    left over is *false*: at a place with nothing planted, a second event for one anomaly, or
    without a range.

    Attributes:
        found: (planted, event) pairs of the same type.
        confused: (planted, event) pairs of different types; these anomalies count as missed.
        unseen: Planted anomalies without any event.
        false_events: Events that belong to nothing planted.
    """

    found: tuple[tuple[Mapping[str, Any], Mapping[str, Any]], ...]
    confused: tuple[tuple[Mapping[str, Any], Mapping[str, Any]], ...]
    unseen: tuple[Mapping[str, Any], ...]
    false_events: tuple[Mapping[str, Any], ...]

    @property
    def passed(self) -> bool:
        """Whether the bar is met: nine of ten planted anomalies found, one false event at most."""
        planted = len(self.found) + len(self.confused) + len(self.unseen)
        return len(self.found) >= FOUND_SHARE * planted and len(self.false_events) <= FALSE_EVENTS


def place_m(event: Mapping[str, Any], speed_mps: float) -> float | None:
    """Chainage of an event: the train's at the closest sighting plus the range, metres."""
    if event["closest_range_m"] is None:
        return None
    return float(speed_mps * event["closest_time_s"] + event["closest_range_m"])


def judge(
    planted: Sequence[Mapping[str, Any]],
    events: Sequence[Mapping[str, Any]],
    speed_mps: float,
    tolerance_m: float = TOLERANCE_M,
) -> Judgement:
    """Match events to planted anomalies (the rule is in :class:`Judgement`).

    Args:
        planted: Objects with ``type``, ``chainage_m`` and ``length_m``, as in ``truth.json``.
        events: Objects as in ``events.jsonl``.
        speed_mps: Constant speed of the ride, m/s.
        tolerance_m: How far an event may lie outside an anomaly's extent, metres.
    """
    pairs: list[tuple[bool, float, int, int]] = []
    for e, event in enumerate(events):
        at = place_m(event, speed_mps)
        if at is None:
            continue
        for p, truth in enumerate(planted):
            beyond = at - truth["chainage_m"] - truth["length_m"]
            outside = max(truth["chainage_m"] - at, beyond, 0.0)
            if outside <= tolerance_m:
                pairs.append((event["type"] != truth["type"], outside, p, e))
    matched: dict[int, int] = {}
    for _, _, p, e in sorted(pairs):
        if p not in matched and e not in matched.values():
            matched[p] = e
    both = [(planted[p], events[e]) for p, e in sorted(matched.items())]
    return Judgement(
        found=tuple(pair for pair in both if pair[0]["type"] == pair[1]["type"]),
        confused=tuple(pair for pair in both if pair[0]["type"] != pair[1]["type"]),
        unseen=tuple(truth for p, truth in enumerate(planted) if p not in matched),
        false_events=tuple(event for e, event in enumerate(events) if e not in matched.values()),
    )


def run_demo(
    out: Path,
    segmenter: SegmentFunction,
    plan: RidePlan | None = None,
    *,
    quiet: bool = False,
    steps: Steps | None = None,
) -> dict[str, Any]:
    """Render a ride into the folder, inspect the video, and compare with the truth.

    Args:
        out: Folder to create; holds the ride, its truth and the run.
        segmenter: Callable from an RGB image to a ``Segmentation``.
        plan: The ride; default: 50 s at 72 km/h with eleven anomalies.
        quiet: No progress on standard error.
        steps: Replaces single steps of the frame loop.

    Returns:
        The document printed by ``railinspect demo --json``, also stored as ``demo.json``.

    Raises:
        OutputError: if the folder cannot be written to or already holds a run or a demo.
    """
    plan = plan or RidePlan(DEMO_SEED, demo_settings())
    refuse_taken(out, DEMO_FILES)
    refuse_taken(out, RUN_FILES)
    RunFolder.claim(out)
    video = out / "ride.mp4"
    line = ProgressLine("rendering ", quiet=quiet)
    try:
        ride = record_ride(
            plan, video, out / "truth.json", progress=lambda n, total: line.show(n, n / total)
        )
        ride.camera.save(out / "camera.yaml")
    except OSError as error:
        raise OutputError(f"cannot write to {out}: {error.strerror or error}") from error
    finally:
        line.close()
    settings = InspectSettings(camera=ride.camera, train=Train(speed_mps=plan.speed_mps))
    summary = _inspect(video, out, segmenter, settings, quiet, steps)
    planted = truth_of(plan, ride)["planted"]
    events = list(read_json_lines(out / "events.jsonl"))
    document = demo_document(plan, planted, judge(planted, events, plan.speed_mps), summary)
    write_json(out / "demo.json", document)
    return document


def _inspect(
    video: Path,
    out: Path,
    segmenter: SegmentFunction,
    settings: InspectSettings,
    quiet: bool,
    steps: Steps | None,
) -> RunSummary:
    line = ProgressLine("inspecting", quiet=quiet)

    def show(progress: Progress) -> None:
        line.show(progress.frames, progress.share)

    try:
        return inspect_inputs([video], out, segmenter, settings, progress=show, steps=steps)
    finally:
        line.close()


def demo_document(
    plan: RidePlan,
    planted: Sequence[Mapping[str, Any]],
    verdict: Judgement,
    summary: RunSummary,
) -> dict[str, Any]:
    """Counts, one entry per anomaly and per false event, speed and paths."""
    speed = plan.speed_mps
    results = {id(truth): ("found", event) for truth, event in verdict.found}
    results |= {id(truth): ("confused", event) for truth, event in verdict.confused}
    anomalies = []
    for truth in planted:
        outcome, event = results.get(id(truth), ("unseen", None))
        entry = {**truth, "outcome": outcome}
        if event is not None:
            at = place_m(event, speed)
            assert at is not None
            first = event["first_range_m"]
            entry |= {
                "event": event["id"],
                "event_type": event["type"],
                "first_range_m": first,
                "place_error_m": round(at - truth["chainage_m"], 2),
            }
        anomalies.append(entry)
    run = summary.as_json()
    return {
        "planted": len(planted),
        "found": len(verdict.found),
        "missed": len(planted) - len(verdict.found),
        "confused": len(verdict.confused),
        "false_events": len(verdict.false_events),
        "frames_per_s": run["frames_per_s"],
        "frames": run["frames"],
        "followed_fraction": run["followed_fraction"],
        "unknown_frames": run["unknown_frames"],
        "passed": verdict.passed,
        "bar": {"found_share": FOUND_SHARE, "false_events": FALSE_EVENTS},
        "tolerance_m": TOLERANCE_M,
        "seed": plan.seed,
        "anomalies": anomalies,
        "false": [
            {"event": e["id"], "type": e["type"], "first_time_s": e["first_time_s"]}
            for e in verdict.false_events
        ],
        "paths": {
            **run["paths"],
            "video": str(summary.folder / "ride.mp4"),
            "truth": str(summary.folder / "truth.json"),
        },
    }
