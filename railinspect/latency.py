"""Counting latencies in memory that does not grow."""

from __future__ import annotations

from typing import Final

BIN_S: Final = 0.01
_BINS: Final = 1000


class Latencies:
    """A histogram of 10 ms up to 10 s, with the last and the worst.

    Example:
        >>> seen = Latencies()
        >>> for latency_s in (0.101, 0.102, 0.204, 0.103):
        ...     seen.add(latency_s)
        >>> seen.last_s, seen.worst_s, seen.quantile_s(0.5)
        (0.103, 0.204, 0.11)
    """

    def __init__(self) -> None:
        self._bins = [0] * (_BINS + 1)
        self.count = 0
        self.last_s: float | None = None
        self.worst_s: float | None = None

    def add(self, latency_s: float) -> None:
        """Count one, seconds."""
        self._bins[min(max(int(latency_s / BIN_S), 0), _BINS)] += 1
        self.count += 1
        self.last_s = latency_s
        self.worst_s = latency_s if self.worst_s is None else max(self.worst_s, latency_s)

    def quantile_s(self, share: float) -> float | None:
        """Upper edge of the bin this share of them lies in or below, seconds; None if empty."""
        seen = 0
        for index, count in enumerate(self._bins):
            seen += count
            if count and seen >= share * self.count:
                return self.worst_s if index == _BINS else round((index + 1) * BIN_S, 2)
        return None
