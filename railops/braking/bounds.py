"""How often an error may exceed its bound, given trials in which it never (or rarely) did.

Zero exceedances in n independent trials refute, at confidence β, every probability above

    p_max = 1 − (1 − β)^(1/n)                                        [SIL-4 paper, eq. 8]

and conversely n = ⌈ln(1 − β) / ln(1 − p)⌉ trials are needed. With r exceedances the bound is the
one-sided Clopper–Pearson limit, the β-quantile of Beta(r + 1, n − r), of which eq. 8 is the case
r = 0. Taking the (r + 1)-th largest of n observed errors *as* the bound ΔL_max gives the same
number (Wilks 1941: the probability beyond that order statistic is Beta(r + 1, n − r)
distributed), so a bound read off the data is as good as one set beforehand, provided r was.

Zero-failure testing is IEC 61508-7, D.2.1; its conditions are part of every result here.
"""

from __future__ import annotations

import csv
import decimal
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import special

from railops.errors import DomainError, EvidenceError, FileError, check_range

Array = npt.NDArray[np.float64]

CONDITIONS = (
    "the trials are independent of one another",
    "the trials are drawn from the same distribution as in use (same sensor, scenes, weather)",
    "every trial is counted; none was left out after its result was seen",
    "the number of exceedances to allow was fixed before the errors were looked at",
)


@dataclass(frozen=True)
class Bound:
    """What n trials say about the probability of an exceedance.

    Attributes:
        p_max: Largest exceedance probability not refuted.
        confidence: β, the share of such campaigns in which the statement is true.
        trials: n.
        exceedances: r, how many trials exceeded.
        error_max_m: The error that was exceeded r times, metres; None if none was given.
        conditions: What the statement rests on.
    """

    p_max: float
    confidence: float
    trials: int
    exceedances: int = 0
    error_max_m: float | None = None
    conditions: tuple[str, ...] = CONDITIONS

    @property
    def statement(self) -> str:
        """The result as one sentence with its conditions."""
        what = "the bound" if self.error_max_m is None else f"{self.error_max_m:.3f} m"
        return (
            f"With confidence {self.confidence:g} an error exceeds {what} with probability at most "
            f"{self.p_max:.4g} ({self.exceedances} exceedances in {self.trials} trials), provided "
            + "; ".join(self.conditions)
            + "."
        )


def _check_confidence(confidence: float) -> None:
    check_range("confidence", confidence, 0.0, 1.0 - 1e-12, above=True)


def _check_probability(name: str, value: float) -> None:
    check_range(name, value, 0.0, 1.0 - 1e-12, above=True)


def trials_needed(p: float, confidence: float, exceedances: int = 0) -> int:
    """Smallest number of trials that supports exceedance probability ``p``.

    For zero exceedances n = ⌈ln(1 − β) / ln(1 − p)⌉ in 50-digit decimal arithmetic on the decimal
    values as written, so that no rounding of ``p`` or of the quotient shifts the integer.

    Args:
        p: Exceedance probability to support, in [1e-30, 1).
        confidence: β in (0, 1).
        exceedances: r, exceedances allowed among the trials, >= 0.

    Example:
        The first cell of the paper's Table 1 is printed as 229, one short of what its own
        formula gives:

        >>> trials_needed(1e-2, 0.9), trials_needed(1e-2, 0.99), trials_needed(1e-8, 0.9)
        (230, 459, 230258509)
    """
    check_range("p", p, 1e-30, 1.0 - 1e-12)  # 50 digits tell 1 − p from 1 down to there
    _check_confidence(confidence)
    check_range("exceedances", exceedances, 0, 10**9)
    if exceedances == 0:
        with decimal.localcontext() as context:
            context.prec = 50
            one = decimal.Decimal(1)
            doubt = one - decimal.Decimal(repr(float(confidence)))
            quotient = doubt.ln() / (one - decimal.Decimal(repr(float(p)))).ln()
            # The tolerance keeps exact quotients (p = 0.9, β = 0.99) from being rounded up.
            count = int((quotient - decimal.Decimal("1e-40")).to_integral_value("ROUND_CEILING"))
            return max(count, 1)
    low, high = exceedances, 2 * exceedances + 2
    while largest_probability(high, confidence, exceedances) > p:
        low, high = high, 2 * high
    while high - low > 1:  # invariant: low does not support p, high does
        middle = (low + high) // 2
        if largest_probability(middle, confidence, exceedances) > p:
            low = middle
        else:
            high = middle
    return high


def largest_probability(trials: int, confidence: float, exceedances: int = 0) -> float:
    """p_max: the largest exceedance probability not refuted by the trials (Clopper–Pearson).

    Example:
        >>> round(largest_probability(459, 0.99), 6)
        0.009983
        >>> round(largest_probability(459, 0.99, exceedances=1), 6)
        0.014374
    """
    check_range("trials", trials, 1, 1e15)
    check_range("exceedances", exceedances, 0, trials)
    _check_confidence(confidence)
    if exceedances == trials:
        return 1.0
    if exceedances == 0:
        # −expm1 keeps the digits where (1 − β)^(1/n) is nearly one.
        return -math.expm1(math.log1p(-confidence) / trials)
    return float(special.betaincinv(exceedances + 1.0, trials - exceedances, confidence))


def bound(trials: int, confidence: float, exceedances: int = 0, p: float | None = None) -> Bound:
    """The bound ``trials`` support; refuses a claimed ``p`` below it.

    Raises:
        EvidenceError: if ``p`` is smaller than the trials support; says how many would.
    """
    p_max = largest_probability(trials, confidence, exceedances)
    if p is not None:
        _check_probability("p", p)
        needed = trials_needed(p, confidence, exceedances)
        if trials < needed:
            raise EvidenceError(
                f"{trials} trials with {exceedances} exceedances support p >= {p_max:.4g} at "
                f"confidence {confidence:g}, not p = {p:g}; that needs {needed} trials"
            )
    return Bound(p_max, confidence, trials, exceedances)


def allowed_exceedances(trials: int, p: float, confidence: float) -> int:
    """The most exceedances with which ``trials`` still support ``p``.

    Raises:
        EvidenceError: if not even zero exceedances would.
    """
    bound(trials, confidence, 0, p)
    low, high = 0, trials
    while high - low > 1:  # invariant: low exceedances support p, high do not
        middle = (low + high) // 2
        if largest_probability(trials, confidence, middle) <= p:
            low = middle
        else:
            high = middle
    return low


def error_bound(
    errors_m: npt.ArrayLike,
    confidence: float,
    p: float | None = None,
    exceedances: int | None = None,
) -> Bound:
    """ΔL_max from measured errors, with the probability and confidence it carries.

    Args:
        errors_m: Measured minus true range, metres, shape (N,). Positive is the dangerous side:
            the obstacle is nearer than measured. Relative errors (one per unit) work as well.
        confidence: β.
        p: Exceedance probability wanted. By default what the sample maximum supports; where the
            sample supports more, the largest errors that may exceed are left out.
        exceedances: r, largest errors to leave out; fixed beforehand. Default: zero, or with
            ``p`` the most that still support it (which depends on n, p and β only).

    Raises:
        DomainError: if there are no errors, or one is not finite.
        EvidenceError: if ``p`` is below what the sample supports.

    Example:
        >>> errors = np.linspace(-10.0, 9.18, 459)
        >>> result = error_bound(errors, 0.99, p=1e-2)
        >>> round(result.error_max_m, 2), result.exceedances, f"{result.p_max:.4f}"
        (9.18, 0, '0.0100')
    """
    errors = np.asarray(errors_m, float).ravel()
    if errors.size == 0:
        raise DomainError("errors_m", "empty", "at least one error in m")
    if not np.isfinite(errors).all():
        where = int(np.flatnonzero(~np.isfinite(errors))[0])
        raise DomainError(f"errors_m[{where}]", f"{errors[where]} m", "a finite error in m")
    if exceedances is None:
        exceedances = 0 if p is None else allowed_exceedances(errors.size, p, confidence)
    check_range("exceedances", exceedances, 0, errors.size - 1)
    result = bound(errors.size, confidence, exceedances, p)
    largest = float(np.partition(errors, errors.size - 1 - exceedances)[-1 - exceedances])
    return Bound(result.p_max, confidence, errors.size, exceedances, max(0.0, largest))


def read_errors(path: str | Path) -> Array:
    """Read measured errors, metres, from a text or CSV file.

    One number per line; or a header with a column ``error_m``; or with ``measured_m`` and
    ``true_m``. Lines starting with ``#`` are comments.

    Raises:
        FileError: if the file cannot be read, holds no errors, or a line is not a number.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read error file {path}: {error}") from error
    try:
        rows = [
            (number, [cell.strip() for cell in row])
            for number, row in enumerate(csv.reader(text.splitlines()), start=1)
            if row and not row[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise FileError(f"cannot read error file {path}: {error}") from error
    if not rows:
        raise FileError(f"error file {path} holds no errors")
    names = rows[0][1]
    if "error_m" in names or {"measured_m", "true_m"} <= set(names):
        rows = rows[1:]
    else:
        names = ["error_m"]
    errors = []
    for number, cells in rows:
        try:
            values = dict(zip(names, map(float, cells), strict=True))
            if "error_m" in values:
                difference = values["error_m"]
            else:
                difference = values["measured_m"] - values["true_m"]
            if not math.isfinite(difference):
                raise ValueError
        except ValueError:
            raise FileError(
                f"error file {path}, line {number}: {','.join(cells)!r} is not a finite error in "
                "m; give one number per line, or columns error_m or measured_m,true_m"
            ) from None
        errors.append(difference)
    if not errors:
        raise FileError(f"error file {path} holds no errors")
    return np.array(errors)
