"""What every benchmark prints: its measures with their bars, for people or as one JSON document."""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Measure:
    """One measured quantity beside the bar it should reach.

    Attributes:
        name: What was measured.
        value: The figure.
        unit: Its unit.
        bar: The figure it should reach, or None where none is set.
        better: Whether lower or higher is better.
    """

    name: str
    value: float
    unit: str
    bar: float | None = None
    better: Literal["lower", "higher"] = "lower"

    @property
    def met(self) -> bool | None:
        """Whether the bar is reached; None without a bar."""
        if self.bar is None:
            return None
        held = self.value <= self.bar if self.better == "lower" else self.value >= self.bar
        return bool(held)  # a NumPy value would make a NumPy answer, which JSON does not know


def machine() -> str:
    """The machine in words: processor architecture, cores, Python and NumPy."""
    import os

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (
        f"{platform.machine()}, {cores} cores, Python {platform.python_version()}, "
        f"NumPy {np.__version__}"
    )


def median_seconds(work: Callable[[], object], repeats: int, warm_up: int = 1) -> float:
    """Median wall-clock time of ``work`` over ``repeats`` runs after ``warm_up`` uncounted ones."""
    for _ in range(warm_up):
        work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def alternating_medians(
    works: Sequence[Callable[[], object]], repeats: int, warm_up: int = 1
) -> list[float]:
    """Median time of each of several works run in turn, so that drift meets all of them alike."""
    for _ in range(warm_up):
        for work in works:
            work()
    times: list[list[float]] = [[] for _ in works]
    for _ in range(repeats):
        for work, seen in zip(works, times, strict=True):
            start = time.perf_counter()
            work()
            seen.append(time.perf_counter() - start)
    return [statistics.median(seen) for seen in times]


def parser(description: str) -> argparse.ArgumentParser:
    """An argument parser with ``--json``."""
    result = argparse.ArgumentParser(description=description)
    result.add_argument("--json", action="store_true", help="print one JSON document")
    return result


def publish(name: str, measures: Sequence[Measure], as_json: bool) -> None:
    """Print the measures."""
    if as_json:
        rows = [{**asdict(measure), "met": measure.met} for measure in measures]
        print(json.dumps({"name": name, "machine": machine(), "measures": rows}))
        return
    print(f"{name} on {machine()}")
    for measure in measures:
        bar = "" if measure.bar is None else f"   bar {measure.bar:g}"
        verdict = {True: "  met", False: "  NOT met", None: ""}[measure.met]
        print(f"  {measure.name:<58} {measure.value:>10.4g} {measure.unit}{bar}{verdict}")
