"""The errors of the decision packages; each is also a ``ValueError``.

RailOpsError
├── DomainError            a value outside its range (name, value, range and unit are attributes)
│   └── MeasurementError   measurements that are empty, unsorted or from the future
├── CannotStopError        brake and adhesion cannot hold the train on the gradient
├── UnreachableError       a plan that breaks a limit (constraint, shortfall and unit attached)
├── EvidenceError          a claim the trials at hand do not support
├── MissingExtraError      an optional dependency that is not installed
└── FileError              a file that cannot be read as what it should be
"""

from __future__ import annotations

import math
from typing import Any


class RailOpsError(Exception):
    """Root of the package's own errors. Its message is one sentence a user can act on."""


class DomainError(RailOpsError, ValueError):
    """A value outside the range in which the computation means anything.

    Attributes:
        name: The argument's name.
        value: What arrived.
        expected: The range, in words or as an interval, with the unit.
    """

    def __init__(self, name: str, value: object, expected: str, hint: str = "") -> None:
        self.name, self.value, self.expected = name, value, expected
        super().__init__(f"{name} is {value}; expected {expected}" + (f" ({hint})" if hint else ""))


class MeasurementError(DomainError):
    """Range measurements that cannot be a time series: empty, unsorted, or from the future."""


class CannotStopError(RailOpsError, ValueError):
    """The brake cannot bring the train to a stand on this line.

    Attributes:
        advice: The decision that still has to be taken (emergency), where one was asked for.
    """

    def __init__(self, message: str, advice: Any = None) -> None:
        self.advice = advice
        super().__init__(message)


class UnreachableError(RailOpsError, ValueError):
    """A request that no plan can meet.

    Attributes:
        constraint: The limit that cannot be kept.
        shortfall: By how much, in ``unit``; NaN where no plan was found at all.
        unit: Unit of the shortfall.
    """

    def __init__(
        self, message: str, constraint: str, shortfall: float = math.nan, unit: str = ""
    ) -> None:
        self.constraint, self.shortfall, self.unit = constraint, shortfall, unit
        super().__init__(message)


class MissingExtraError(RailOpsError, ImportError):
    """An optional dependency is not installed; the message names the extra that brings it."""


class EvidenceError(RailOpsError, ValueError):
    """A probability was claimed that the number of trials does not support."""


class FileError(RailOpsError, ValueError):
    """A file that is missing, unreadable, or has wrong keys or values."""


def check_range(
    name: str,
    value: float,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
    *,
    above: bool = False,
    hint: str = "",
) -> float:
    """Return ``value`` if it is a number in [low, high] (in (low, high] with ``above``).

    Raises:
        DomainError: if it is not a finite number, or lies outside; the message names the
            argument, its value, the range and the unit.

    Example:
        >>> check_range("speed_mps", 20.0, 0.0, 150.0, "m/s")
        20.0
    """
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    inside = low < number <= high if above else low <= number <= high
    if not (inside and math.isfinite(number)):
        opening = "(" if above or low == -math.inf else "["
        # A limit just below a round number is printed as that number, left out of the range.
        closing = ")" if high == math.inf or float(f"{high:g}") > high else "]"
        dimension = f" {unit}" if unit else ""
        raise DomainError(
            name,
            f"{value}{dimension}",
            f"a number in {opening}{low:g}, {high:g}{closing}{dimension}",
            hint,
        )
    return number
