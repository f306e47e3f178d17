"""The train as the headway computation sees it."""

from __future__ import annotations

from dataclasses import dataclass, field

from railops.errors import check_range
from railops.traction import Davis, Effort


@dataclass(frozen=True)
class Stock:
    """Rolling stock: what pulls, what drags, what brakes, and how long it is.

    The service brake is a *controlled* deceleration: the automatic train operation holds it on
    any gradient, as it must to stop at the mark. The defaults are a metro train.

    Attributes:
        length_m: Train length, m, > 0.
        effort: Traction, per unit mass.
        davis: Running resistance, per unit mass.
        rotating: Rotating-mass share γ of the equation of motion, 0 … 0.5.
        brake_mps2: Deceleration held when braking for a stop or a lower limit, m/s², > 0.
    """

    length_m: float = 120.0
    effort: Effort = field(default_factory=lambda: Effort(1.0, 12.0))
    davis: Davis = field(default_factory=Davis)
    rotating: float = 0.08
    brake_mps2: float = 0.9

    def __post_init__(self) -> None:
        check_range("length_m", self.length_m, 0.0, 2_000.0, "m", above=True)
        check_range("rotating", self.rotating, 0.0, 0.5)
        check_range("brake_mps2", self.brake_mps2, 0.0, 3.0, "m/s²", above=True)
