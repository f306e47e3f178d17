"""Is the pilot vehicle's camera up to it? The paper's Appendix D.

The sharp interval, the distance the pilot vehicle needs to stop, and how far a curve moves the
track sideways in the picture.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

from railops.errors import check_range
from railops.traction import Adhesion


@dataclass(frozen=True)
class Optics:
    """A lens focused at the working distance.

    Attributes:
        focal_m: Focal length f_l, metres.
        f_number: Aperture k_f.
        blur_m: Largest acceptable blur circle δ_c on the sensor, metres.
        working_m: Working distance d_w, metres.
    """

    focal_m: float = 0.3
    f_number: float = 2.8
    blur_m: float = 3.5e-5
    working_m: float = 100.0

    def __post_init__(self) -> None:
        check_range("focal_m", self.focal_m, 0.0, 5.0, "m", above=True)
        check_range("f_number", self.f_number, 0.0, 64.0, above=True)
        check_range("blur_m", self.blur_m, 0.0, 1e-2, "m", above=True)
        check_range("working_m", self.working_m, self.focal_m, 1e5, "m", above=True)

    @property
    def sharp_m(self) -> tuple[float, float]:
        """Nearest and farthest sharp distance, metres; the far one may be infinite.

        NL = d·f²/(f² + k·δ·(d − f)),  FL = d·f²/(f² − k·δ·(d − f)): Appendix D-A with the two
        signs exchanged, which are swapped in print.

        Example:
            >>> [round(distance, 2) for distance in Optics().sharp_m]
            [90.21, 112.18]
        """
        squared = self.focal_m**2
        spread = self.f_number * self.blur_m * (self.working_m - self.focal_m)
        near = self.working_m * squared / (squared + spread)
        far = self.working_m * squared / (squared - spread) if squared > spread else math.inf
        return near, far


def braking_distance(speed_mps: float, recognition_s: float, decel_mps2: float) -> float:
    """d_p = v·t_i + v²/(2·b), Appendix D-B, metres.

    Warns where the deceleration is beyond what dry rails transmit to the wheels: the paper's
    3 g needs a magnetic or eddy-current brake, or a parachute.

    Args:
        speed_mps: Speed v, m/s, >= 0.
        recognition_s: Recognition time t_i, s, >= 0.
        decel_mps2: Deceleration b, m/s², > 0.

    Example:
        >>> round(braking_distance(250 / 3.6, 0.1, 1.2), 1)
        2016.3
    """
    check_range("speed_mps", speed_mps, 0.0, 150.0, "m/s")
    check_range("recognition_s", recognition_s, 0.0, 60.0, "s")
    check_range("decel_mps2", decel_mps2, 0.0, 100.0, "m/s²", above=True)
    limit = Adhesion().limit_mps2(speed_mps)
    if decel_mps2 > limit:
        warnings.warn(
            f"a deceleration of {decel_mps2:g} m/s² is beyond wheel–rail adhesion, about "
            f"{limit:.2f} m/s² on dry rails at {speed_mps:.1f} m/s",
            stacklevel=2,
        )
    return speed_mps * recognition_s + speed_mps**2 / (2.0 * decel_mps2)


def lateral_shift(radius_m: float, distance_m: float) -> float:
    """ρ − √(ρ² − d²): how far a curve has moved the track sideways after ``distance_m``, metres.

    Example:
        >>> round(lateral_shift(2000.0, 100.0), 2)
        2.5
    """
    check_range("distance_m", distance_m, 0.0, 1e5, "m")
    check_range("radius_m", radius_m, distance_m, unit="m")
    # ρ − √(ρ² − d²) = d² / (ρ + √(ρ² − d²)): no difference of nearly equal numbers.
    return distance_m**2 / (radius_m + math.sqrt(radius_m**2 - distance_m**2))
