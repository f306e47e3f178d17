"""Which of many ranges may count as separate measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

INDEPENDENT_S = 0.16
"""Measurements closer in time than this share their errors: the same masks, the same swing."""


class Timed(Protocol):
    """Something with a media time."""

    @property
    def time_s(self) -> float:
        """Media time, s."""


T = TypeVar("T", bound=Timed)


def last_independent(ranges: Sequence[T], count: int, apart_s: float = INDEPENDENT_S) -> list[T]:
    """The last ``count`` ranges that lie at least ``apart_s`` apart, oldest first.

    Their smallest is what a decision may rest on: k of them all too long at once has the
    probability p^k only if they are independent (source 000).

    Args:
        ranges: Ranges by rising time.
        count: How many to take at most, >= 1.
        apart_s: Least time between two of them, s.

    Example:
        >>> from types import SimpleNamespace as Seen
        >>> ranges = [Seen(time_s=0.08 * i, range_m=50.0 - i) for i in range(10)]
        >>> [seen.range_m for seen in last_independent(ranges, 3)]
        [45.0, 43.0, 41.0]
    """
    taken: list[T] = []
    for one in reversed(ranges):
        if len(taken) == count:
            break
        if not taken or taken[-1].time_s - one.time_s >= apart_s - 1e-9:
            taken.append(one)
    return taken[::-1]
