"""How often the inspection raises an alarm, against how often it may.

Alarms are taken to come independently of each other, so their number in a stretch is Poisson
distributed. Of n alarms in an exposure T the rate lies, with 95 % confidence, between

    χ²(0.025; 2n) / (2T)   and   χ²(0.975; 2n + 2) / (2T)        (Garwood, Biometrika 28, 1936)
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal

from scipy.stats import chi2

from railinspect.errors import BadInputError
from railinspect.fleet.published import publish

CONFIDENCE: Final = 0.95
"""Confidence of the intervals."""

Verdict = Literal["kept", "broken", "open"]


@dataclass(frozen=True)
class Budget:
    """How many false alarms a run may raise; None where nothing is stated.

    Attributes:
        per_hour: Alarms per hour of inspected time, > 0.
        per_km: Alarms per kilometre, > 0.
    """

    per_hour: float | None = None
    per_km: float | None = None

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is not None and not (math.isfinite(value) and value > 0):
                raise BadInputError(f"budget {name} is {value}; give a positive number of alarms")


@dataclass(frozen=True)
class Rate:
    """Alarms over an exposure, per unit of it (hours or kilometres).

    Attributes:
        alarms: How many.
        exposure: Over how much, >= 0.
        low: Lower bound of the rate; 0 without any exposure.
        high: Upper bound; infinite without any exposure.
    """

    alarms: int
    exposure: float
    low: float
    high: float

    @property
    def value(self) -> float:
        """The observed rate; NaN without any exposure."""
        return self.alarms / self.exposure if self.exposure > 0 else math.nan

    def against(self, budget: float) -> Verdict:
        """``kept`` and ``broken`` only where the whole interval says so, else ``open``."""
        if self.high <= budget:
            return "kept"
        return "broken" if self.low > budget else "open"

    def still_needed(self, budget: float) -> float:
        """Exposure without another alarm after which the budget would be shown to be kept."""
        return max(_most(self.alarms) / budget - self.exposure, 0.0)


def rate(alarms: int, exposure: float) -> Rate:
    """The rate of so many alarms with its 95 % interval.

    Args:
        alarms: Number of alarms, >= 0.
        exposure: Hours or kilometres, >= 0.

    Example:
        >>> one = rate(3, 10.0)
        >>> f"{one.low:.4f} {one.value:.1f} {one.high:.4f}"
        '0.0619 0.3 0.8767'
        >>> one.against(1.0), one.against(0.5), round(one.still_needed(0.5), 1)
        ('kept', 'open', 7.5)
    """
    if exposure <= 0:
        return Rate(alarms, 0.0, 0.0, math.inf)
    tail = (1 - CONFIDENCE) / 2
    low = float(chi2.ppf(tail, 2 * alarms)) / 2 if alarms else 0.0
    return Rate(alarms, exposure, low / exposure, _most(alarms) / exposure)


def _most(alarms: int) -> float:
    """Upper bound of the expected number of alarms."""
    return float(chi2.ppf((1 + CONFIDENCE) / 2, 2 * alarms + 2)) / 2


def save_budget(budget: Budget, run_folder: Path) -> None:
    """Keep a budget with the run."""
    with publish(run_folder / "budget.json") as part:
        part.write_text(json.dumps(asdict(budget)) + "\n", encoding="utf-8")


def read_budget(run_folder: Path) -> Budget:
    """The budget kept with a run; an empty one if none is.

    Raises:
        BadInputError: if the file is damaged.
    """
    path = run_folder / "budget.json"
    try:
        return Budget(**json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return Budget()
    except (OSError, TypeError, ValueError) as error:
        raise BadInputError(f"cannot read {path} ({error}); state the budget again") from error
