"""The pilot vehicle and the numbers of the paper's Table I.

"The paper" is Wang, Li, Chen and Liu (2023), *A Railway Accident Prevention System Using An
Intelligent Pilot Vehicle*.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from railops.errors import check_range
from railops.traction import Davis


@dataclass(frozen=True)
class PilotVehicle:
    """What moves ahead of the train; the defaults are the paper's Table I.

    Forces are per unit mass throughout the package (u/m, in m/s²); multiply by ``mass_kg`` for
    newtons.

    Attributes:
        mass_kg: Mass m, kg.
        davis: Running resistance, eq. 1.
        epsilon: Acceleration coefficient ε of eq. 2: the share of the force that accelerates.
        traction_mps2: Largest traction force over mass the plan may use, Ū/m, m/s².
        braking_mps2: Largest braking force over mass the plan may use, U̲/m, m/s², > 0.
        reserve: What the power system really has beyond the plan's limits, as a share of them;
            the paper's Remark 7 plans with 0.6 where 0.65 is there.
    """

    mass_kg: float = 2000.0
    davis: Davis = field(default_factory=lambda: Davis(0.01176, 7.7616e-4, 1.6e-5))
    epsilon: float = 1.0
    traction_mps2: float = 0.6
    braking_mps2: float = 0.5
    reserve: float = 0.05 / 0.6

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 1e6, "kg", above=True)
        check_range("epsilon", self.epsilon, 0.0, 1.5, above=True)
        check_range("traction_mps2", self.traction_mps2, 0.0, 10.0, "m/s²", above=True)
        check_range("braking_mps2", self.braking_mps2, 0.0, 50.0, "m/s²", above=True)
        check_range("reserve", self.reserve, 0.0, 10.0)

    @property
    def available_mps2(self) -> tuple[float, float]:
        """The power system's true limits (lowest, highest), reserve included, m/s²."""
        more = 1.0 + self.reserve
        return -more * self.braking_mps2, more * self.traction_mps2
