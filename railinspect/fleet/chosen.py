"""Choosing frames of a run that are worth labelling again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from railinspect.errors import BadInputError
from railinspect.fleet.clips import top_events
from railinspect.fleet.dataset import table_paths
from railinspect.fleet.finished import FinishedInput, finished_inputs


@dataclass(frozen=True)
class Choice:
    """Which frames to take.

    Attributes:
        events: From so many of the events to look at first, the frame that shows each best.
        unknown: From so many of the longest stretches of unknown frames, the one in the middle.
        every_s: Of each input one frame per so many seconds; None for none.
        limit: At most so many in all, in this order.
    """

    events: int = 50
    unknown: int = 50
    every_s: float | None = None
    limit: int = 500

    def __post_init__(self) -> None:
        for name in ("events", "unknown", "limit"):
            if getattr(self, name) < 0:
                raise BadInputError(f"{name} is {getattr(self, name)}; give at least 0")
        if self.every_s is not None and not self.every_s > 0:
            raise BadInputError(f"every is {self.every_s} s; give more than 0 s")


@dataclass(frozen=True)
class Chosen:
    """One frame.

    Attributes:
        input_id: Id of its input.
        index: Index of the frame.
        time_s: Its media time, seconds.
        why: Why it was taken.
    """

    input_id: str
    index: int
    time_s: float
    why: str


def choose(run_folder: str | Path, choice: Choice) -> list[Chosen]:
    """The frames chosen from a run's data set, each once, by their first reason."""
    run = Path(run_folder)
    inputs = [one for one in finished_inputs(run) if table_paths(run, one.counts.id)[0].exists()]
    stretches: list[tuple[int, Chosen]] = []
    spread: list[Chosen] = []
    events = []
    for one in inputs:
        frames, its_events = table_paths(run, one.counts.id)
        columns = ["index", "time_s", "status"]
        table = pq.read_table(frames, columns=columns, partitioning=None)
        index, time_s = table["index"].to_numpy(), table["time_s"].to_numpy()
        unknown = np.array(table["status"].to_pylist()) == "unknown"
        stretches += _stretches(one, index, time_s, unknown)
        stretches = sorted(stretches, key=lambda item: -item[0])[: choice.unknown]
        if choice.every_s is not None and time_s.size:
            _, firsts = np.unique(np.floor(time_s / choice.every_s), return_index=True)
            why = f"every {choice.every_s:g} s"
            spread += [_chosen(one, index[i], time_s[i], why) for i in firsts][: choice.limit]
        for event in pq.read_table(its_events, partitioning=None).to_pylist():
            at = np.flatnonzero(index == event["best_frame"])
            if at.size:
                events.append(event | {"best_time_s": float(time_s[at[0]])})
    shown = [
        Chosen(
            event["input"],
            event["best_frame"],
            event["best_time_s"],
            f"event {event['id']}: {event['type']}",
        )
        for event in top_events(events, choice.events)
    ]
    found: dict[tuple[str, int], Chosen] = {}
    for one_chosen in [*shown, *(item for _, item in stretches), *spread]:
        found.setdefault((one_chosen.input_id, one_chosen.index), one_chosen)
    return list(found.values())[: choice.limit]


def _chosen(one: FinishedInput, index: int, time_s: float, why: str) -> Chosen:
    return Chosen(one.counts.id, int(index), float(time_s), why)


def _stretches(
    one: FinishedInput,
    index: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
    time_s: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    unknown: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
) -> list[tuple[int, Chosen]]:
    """Lengths of the stretches of unknown frames, in frames, and the middle of each."""
    edges = np.diff(np.concatenate([[0], unknown.astype(np.int8), [0]]))
    found = []
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        middle = (start + end - 1) // 2
        why = f"unknown for {end - start} frames"
        found.append((int(end - start), _chosen(one, index[middle], time_s[middle], why)))
    return found
