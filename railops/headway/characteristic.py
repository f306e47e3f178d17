"""The regulating characteristic: the shortest interval over all pairs of run times.

It is kept as the two parts of :mod:`railops.headway.interval`, A and B, so that any dwell is read
from it without a further simulation   [the paper's eqs. 1 and 2].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, check_range
from railops.headway.interval import Succession, level_name
from railops.headway.motion import STEP_S
from railops.headway.section import Section

Array = npt.NDArray[np.float64]
Levels = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Characteristic:
    """Shortest intervals for every pair of run times of two successive trains.

    Attributes:
        second_s: Run times of the second train T(n), s, rising, shape (N,).
        first_s: Run times of the train in front T(n−1), s, rising, shape (M,).
        before_s: Part A, s, shape (N, M); −inf where it is not known (a published table).
        after_s: Part B, the interval for a dwell of zero, s, shape (N, M); NaN where unknown.
        dwell_s: The dwell it is shown for, s.
        name: The section's name.
        critical: What the tail must leave in the deciding moment, at that dwell, shape (N, M);
            empty where not known.
    """

    second_s: Array
    first_s: Array
    before_s: Array
    after_s: Array
    dwell_s: float = 20.0
    name: str = "section"
    critical: tuple[tuple[str, ...], ...] = ()

    @staticmethod
    def published(
        rows: Sequence[tuple[float, float, float]], dwell_s: float, name: str
    ) -> Characteristic:
        """From the rows of a printed table: (run time, run time in front, interval), all s."""
        second = np.unique([row[0] for row in rows])
        first = np.unique([row[1] for row in rows])
        after = np.full((second.size, first.size), np.nan)
        for run, front, interval in rows:
            after[np.searchsorted(second, run), np.searchsorted(first, front)] = interval - dwell_s
        before = np.where(np.isnan(after), np.nan, -np.inf)
        return Characteristic(second, first, before, after, dwell_s, name)

    def interval_s(self, dwell_s: float | None = None) -> Array:
        """Shortest intervals for a dwell of the train in front, s, shape (N, M)."""
        dwell = self.dwell_s if dwell_s is None else check_range("dwell_s", dwell_s, 0.0, unit="s")
        interval: Array = np.maximum(self.before_s, self.after_s + dwell)
        return interval

    @property
    def linear_from_s(self) -> Array:
        """The dwell from which on eq. 2 holds exactly, s, shape (N, M); 0 where A is unknown."""
        dwell: Array = np.maximum(self.before_s - self.after_s, 0.0)
        return dwell

    def required_s(self, second_s: float, first_s: float, dwell_s: float | None = None) -> float:
        """The shortest interval of one pair, s; NaN where the table says nothing about it.

        Where a table has no entry (the published ones have none for a second train slower than the
        one in front), that of the next faster second train stands in: a slower one never needs
        longer.
        A run time of the train in front between two columns takes the longer of their intervals.
        There is no interpolation between run times of the second train: at a code boundary the
        characteristic jumps.

        Raises:
            DomainError: if the second train's run time is none of the table's, or that of the train
                in front lies outside it.
        """
        row = int(np.argmin(np.abs(self.second_s - second_s)))
        if abs(self.second_s[row] - second_s) > 1e-6:
            raise DomainError("run time", f"{second_s:g} s", f"one of {_list(self.second_s)} s")
        low, high = float(self.first_s[0]), float(self.first_s[-1])
        if not low - 1e-6 <= first_s <= high + 1e-6:
            raise DomainError(
                "run time of the train in front", f"{first_s:g} s", f"{low:g} … {high:g} s"
            )
        after = int(
            np.clip(np.searchsorted(self.first_s, first_s - 1e-6), 0, self.first_s.size - 1)
        )
        exact = abs(self.first_s[after] - first_s) <= 1e-6
        columns = [after] if exact else [after - 1, after]
        known = self.interval_s(dwell_s)[: row + 1, columns]
        values = []
        for column in known.T:
            there = column[~np.isnan(column)]
            values.append(float(there[-1]) if there.size else math.nan)
        return max(values) if not any(map(math.isnan, values)) else math.nan

    def rows(self, dwell_s: float | None = None) -> list[dict[str, float | str]]:
        """One mapping per pair with an interval, as CSV and JSON carry them."""
        interval, linear = self.interval_s(dwell_s), self.linear_from_s
        dwell = self.dwell_s if dwell_s is None else dwell_s
        result: list[dict[str, float | str]] = []
        for j in range(self.first_s.size)[::-1]:
            for i in range(self.second_s.size)[::-1]:
                if math.isnan(interval[i, j]):
                    continue
                row: dict[str, float | str] = {
                    "interval_s": float(interval[i, j]),
                    "run_s": float(self.second_s[i]),
                    "front_run_s": float(self.first_s[j]),
                    "dwell_s": float(dwell),
                    "linear_from_dwell_s": float(linear[i, j]),
                }
                if self.critical:
                    row["critical"] = self.critical[i][j]
                result.append(row)
        return result


def _list(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)


def default_run_times(pair: Succession, count: int = 21) -> tuple[float, ...]:
    """The section's own run times, or ``count`` from its shortest to a quarter more."""
    own = pair.section.run_times_s
    if own:
        return own
    shortest = math.ceil(pair.regulator.shortest_s)
    longest = min(math.ceil(1.25 * shortest), math.floor(pair.regulator.longest().run_time_s))
    return tuple(np.unique(np.linspace(shortest, longest, count).round(1)).tolist())


def characteristic(
    section: Section,
    second_s: Sequence[float] | None = None,
    first_s: Sequence[float] | None = None,
    *,
    name_critical: bool = True,
    step_s: float = STEP_S,
) -> Characteristic:
    """Compute the regulating characteristic of a section.

    Args:
        section: The section with its trains and protection.
        second_s: Run times of the second train, s, rising; default: those the section allows.
        first_s: Run times of the train in front, s, rising; default: the same.
        name_critical: Whether to name the circuit or block that decides each pair.
        step_s: Step of the runs, s.

    Raises:
        RunTimeError: if the section cannot be run in one of the times.

    Example:
        >>> table = characteristic(Section(1500.0), [100.0, 110.0])
        >>> bool(np.all(np.diff(table.interval_s(), axis=0) < 0.0))  # slower behind: shorter
        True
    """
    pair = Succession(section, step_s)
    second = tuple(second_s) if second_s is not None else default_run_times(pair)
    first = tuple(first_s) if first_s is not None else second
    demand = np.array([pair.demand_s(time) for time in second])  # (N, levels)
    given = np.array([pair.given_s(time) for time in first])  # (M, levels)
    early = given[None, :, :] - demand[:, None, :]
    late = pair.away_s[None, :] - demand
    before = np.max(early, axis=2) + pair.delay_s
    after = np.max(late, axis=1)[:, None] + np.array(first)[None, :] + pair.delay_s
    dwell = section.dwell.mean_s
    critical: tuple[tuple[str, ...], ...] = ()
    if name_critical:
        by_level = np.where(
            after + dwell >= before, np.argmax(late, axis=1)[:, None], np.argmax(early, axis=2)
        )
        critical = tuple(
            tuple(level_name(section, int(level)) for level in row) for row in by_level
        )
    return Characteristic(
        np.array(second), np.array(first), before, after, dwell, section.name, critical
    )
