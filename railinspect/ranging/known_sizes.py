"""Sizes of things a cab camera meets, with their own spread: the goniometer's bases."""

from __future__ import annotations

from dataclasses import dataclass

from railinspect.labels import CAR, HUMAN, ON_RAILS, TRUCK


@dataclass(frozen=True)
class KnownSize:
    """A size that varies from specimen to specimen.

    Attributes:
        name: What is measured.
        size_m: Mean, metres.
        std_m: Standard deviation between specimens, metres: a bias of each measurement.
        upright: Whether it is a height (else a width).
    """

    name: str
    size_m: float
    std_m: float
    upright: bool


KNOWN_SIZES: dict[int, KnownSize] = {
    # Standing adults 1.72 ± 0.09 m; the rest is for those who stoop or crouch.
    HUMAN: KnownSize("person's height", 1.66, 0.22, True),
    # Cars 1.45–1.9 m with vans; its side or its front may face us, so only the height is known.
    CAR: KnownSize("car's height", 1.55, 0.2, True),
    TRUCK: KnownSize("lorry's height", 3.2, 0.5, True),
    # The paper's car width of 2.7 m; main-line stock is up to 3.1 m wide.
    ON_RAILS: KnownSize("train's width", 2.8, 0.15, False),
}
"""Known size by class."""

WHEELED = (CAR, TRUCK, ON_RAILS)
"""Classes that stand on wheels."""
