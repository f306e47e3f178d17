"""Braking curves in ETCS vocabulary from γ-type data (deceleration tables) and a gradient profile.

After ERTMS/ETCS SUBSET-026, chapter 3.13. Speeds are positive towards the target; positions are
along the track, the target (supervised location) at ``target_m`` with target speed zero.

    A_brake_safe(V) = Kdry_rst·(Kwet_rst + M_NVAVADH·(1 − Kwet_rst))·A_brake_emergency(V)
    A_gradient      = g·gradient / (1 + M_rotating)
    EBD  deceleration A_brake_safe + A_gradient, ending at the supervised location
    SBD  deceleration A_brake_service + A_gradient, ending at the end of authority
    EBI  the EBD less speed inaccuracy and what happens until the emergency brake has built up
    SBI  the nearer of SBD − V·T_bs1 (SBI1) and EBI − V·T_bs2 (SBI2)
    Permitted   SBI − V·T_driver                      (4 s)
    Warning     SBI − V·T_warning                     (2 s)
    Indication  Permitted − V·T_indication            (max(0.8·T_bs, 5 s) + T_driver)

γ trains give A_brake_emergency and A_brake_service as step functions of speed; the conversion of
braked-weight percentages (λ trains) is left out, since no reference values were at hand against
which it could be reproduced exactly. The guidance curve (GUI), release speed and the national
option that inhibits the service brake feedback are left out as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from railops.braking.train import Train
from railops.errors import CannotStopError, DomainError, check_range
from railops.traction import LEVEL, MAX_SPEED_MPS, Line

Array = npt.NDArray[np.float64]

GRAVITY_MPS2 = 9.81  # SUBSET-026's value, so that its curves are reproduced
Steps = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class BrakingData:
    """Train and national values that shape the curves, under their SUBSET-026 names.

    Attributes:
        A_brake_emergency: (speed_mps, decel_mps2) steps; each holds from its speed to the next.
        A_brake_service: The same for the full service brake.
        T_be: Equivalent build-up time of the emergency brake, s.
        T_bs: Equivalent build-up time of the service brake, s (T_bs1 = T_bs2).
        Kdry_rst: Rolling-stock correction factor on dry rails, [0.01, 1].
        Kwet_rst: Rolling-stock correction factor on wet rails, [0.01, 1].
        M_NVAVADH: Weighting of available adhesion, 0 … 1 (1: dry rails assumed).
        M_rotating: Rotating-mass share; None: 0.02 downhill and 0.15 uphill.
        A_est1: Acceleration that may persist until traction is cut off, m/s².
        T_traction: Time until traction is cut off, s.
        A_est2: Acceleration from then until the emergency brake has built up, 0 … 0.4 m/s².
        V_inaccuracy: Relative amount by which the speed may be underestimated; None: the
            accuracy SUBSET-041 asks of odometry, 2 km/h up to 30 km/h rising to 12 km/h at 500.
        T_driver: Driver's reaction time, s.
        T_warning: Time between warning and service brake intervention, s.
    """

    A_brake_emergency: Steps
    A_brake_service: Steps
    T_be: float
    T_bs: float
    Kdry_rst: float = 1.0
    Kwet_rst: float = 1.0
    M_NVAVADH: float = 0.0
    M_rotating: float | None = None
    A_est1: float = 0.0
    T_traction: float = 0.0
    A_est2: float = 0.0
    V_inaccuracy: float | None = None
    T_driver: float = 4.0
    T_warning: float = 2.0

    def __post_init__(self) -> None:
        for name in ("A_brake_emergency", "A_brake_service"):
            steps = getattr(self, name)
            speeds = [speed for speed, _ in steps]
            if not steps or speeds[0] != 0.0 or speeds != sorted(set(speeds)):
                raise DomainError(name, steps, "(m/s, m/s²) steps from speed 0 with rising speeds")
            for _, decel in steps:
                check_range(name, decel, 0.0, 5.0, "m/s²", above=True)
        for name in ("T_be", "T_bs", "T_traction", "T_driver", "T_warning"):
            check_range(name, getattr(self, name), 0.0, 120.0, "s")
        for name in ("Kdry_rst", "Kwet_rst"):
            check_range(name, getattr(self, name), 0.01, 1.0)
        check_range("M_NVAVADH", self.M_NVAVADH, 0.0, 1.0)
        check_range("A_est1", self.A_est1, 0.0, 5.0, "m/s²")
        check_range("A_est2", self.A_est2, 0.0, 0.4, "m/s²")
        if self.V_inaccuracy is not None:
            check_range("V_inaccuracy", self.V_inaccuracy, 0.0, 1.0)
        if self.M_rotating is not None:
            check_range("M_rotating", self.M_rotating, 0.0, 0.5)

    @staticmethod
    def of(train: Train, **national: float) -> BrakingData:
        """The data of a train: its brake tables as steps, dead time plus half the build-up.

        A table that is linear between its points becomes a step function that nowhere brakes
        better: each step takes the weaker end of its interval.
        """
        emergency, service = train.emergency, train.service
        return BrakingData(
            A_brake_emergency=_as_steps(emergency.points),
            A_brake_service=_as_steps(service.points),
            T_be=emergency.delay_s + emergency.build_up_s / 2.0,
            T_bs=service.delay_s + service.build_up_s / 2.0,
            M_rotating=train.rotating,
            V_inaccuracy=train.speed_error_rel,
            **national,
        )

    def speed_inaccuracy(self, speed_mps: Array) -> Array:
        """V_delta0: by how much the speed may be underestimated, m/s."""
        if self.V_inaccuracy is not None:
            return self.V_inaccuracy * speed_mps
        return np.interp(speed_mps, [30.0 / 3.6, 500.0 / 3.6], [2.0 / 3.6, 12.0 / 3.6])

    @property
    def A_brake_safe(self) -> Steps:  # noqa: N802 - the name SUBSET-026 gives it
        """The emergency deceleration after the correction factors."""
        wet = self.Kwet_rst + self.M_NVAVADH * (1.0 - self.Kwet_rst)
        return tuple((v, self.Kdry_rst * wet * a) for v, a in self.A_brake_emergency)


def _as_steps(points: Steps) -> Steps:
    """A step function below a piecewise linear one."""
    speeds = [0.0, *(v for v, _ in points if v > 0.0)]
    decels = np.interp(speeds, [v for v, _ in points], [a for _, a in points])
    weakest = [min(pair) for pair in zip(decels, [*decels[1:], decels[-1]], strict=True)]
    return tuple((v, float(a)) for v, a in zip(speeds, weakest, strict=True))


def a_gradient(gradient: float, M_rotating: float | None = None) -> float:
    """A_gradient, m/s²: positive (helps braking) uphill. ``gradient`` is rise over run.

    Example:
        SUBSET-026: g·grad / (1000 + 10·M_rotating), grad in ‰, M_rotating in %.

        >>> round(a_gradient(-0.01, 0.05), 5)
        -0.09343
    """
    rotating = M_rotating if M_rotating is not None else (0.15 if gradient > 0 else 0.02)
    return GRAVITY_MPS2 * gradient / (1.0 + rotating)


@dataclass(frozen=True)
class Parabola:
    """A deceleration curve as arcs v² = v₀² + 2·a·(s₀ − s), backwards from the target.

    Attributes:
        position_m: Positions of the arcs' ends, falling from the target. Shape (K + 1,).
        speed_mps: Speeds there, rising. Shape (K + 1,).
        decel_mps2: Deceleration of each arc. Shape (K,).
    """

    position_m: Array
    speed_mps: Array
    decel_mps2: Array

    def distance(self, speed_mps: npt.ArrayLike) -> Array:
        """Position at which the curve has this speed, metres; NaN above its highest speed."""
        v = np.asarray(speed_mps, float)
        arc = np.clip(np.searchsorted(self.speed_mps, v, "right") - 1, 0, self.decel_mps2.size - 1)
        start = self.position_m[arc]
        s = start - (v**2 - self.speed_mps[arc] ** 2) / (2.0 * self.decel_mps2[arc])
        return np.where((v >= 0.0) & (v <= self.speed_mps[-1] * (1 + 1e-12)), s, np.nan)


def deceleration_curve(
    steps: Steps,
    target_m: float,
    speed_max_mps: float,
    line: Line = LEVEL,
    length_m: float = 0.0,
    M_rotating: float | None = None,
) -> Parabola:
    """The curve that ends at standstill at ``target_m`` (EBD or SBD by its deceleration).

    The gradient at a place is the lowest under the train whose front is there, as the
    specification compensates it.

    Raises:
        CannotStopError: if somewhere before the target the gradient outweighs the brake.
    """
    check_range("target_m", target_m, unit="m")
    check_range("speed_max_mps", speed_max_mps, 0.0, MAX_SPEED_MPS, "m/s", above=True)
    starts, grades = np.array(line.gradients).T

    def gradient(s: float) -> float:
        """Lowest gradient under a train whose front lies just before s."""
        ends = np.append(starts[1:], math.inf)
        under = (starts < s - 1e-9) & (ends > s - length_m - 1e-9)
        under[0] |= s - length_m < starts[0]
        if not under.any():
            under[max(int(np.searchsorted(starts, s)) - 1, 0)] = True
        return float(grades[under].min())

    changes = np.unique(np.concatenate([starts, starts + length_m]))
    changes = changes[changes < target_m][::-1]
    s, v = float(target_m), 0.0
    positions, speeds, decels = [s], [v], []
    while v < speed_max_mps:
        step = max(i for i, (speed, _) in enumerate(steps) if speed <= v)
        next_speed = steps[step + 1][0] if step + 1 < len(steps) else speed_max_mps
        next_speed = min(next_speed, speed_max_mps)
        before = [c for c in changes if c < s - 1e-9]
        next_change = float(before[0]) if before else -math.inf
        grade = gradient(s)
        decel = steps[step][1] + a_gradient(grade, M_rotating)
        if decel <= 0.0:
            raise CannotStopError(
                f"the train cannot stop: at {s:.1f} m the gradient of {1000 * grade:.1f} ‰ "
                f"outweighs the brake's {steps[step][1]:.3f} m/s²; it runs away"
            )
        reach = (next_speed**2 - v**2) / (2.0 * decel)
        if s - reach >= next_change:
            s, v = s - reach, next_speed
        else:
            v = math.sqrt(v**2 + 2.0 * decel * (s - next_change))
            s = next_change
        positions.append(s)
        speeds.append(v)
        decels.append(decel)
    return Parabola(np.array(positions), np.array(speeds), np.array(decels))


@dataclass(frozen=True)
class Curves:
    """Position of each supervision limit at each speed, metres, all of shape (N,).

    A train that runs at ``speed_mps`` reaches Indication first and EBI last; a position is NaN
    where the inaccuracy lifts the speed above the curve's end.
    """

    speed_mps: Array
    indication_m: Array
    permitted_m: Array
    warning_m: Array
    sbi_m: Array
    ebi_m: Array
    ebd_m: Array
    sbd_m: Array
    data: BrakingData = field(repr=False)

    def at(self, speed_mps: float) -> dict[str, float]:
        """All limits at one speed, by name, metres."""
        names = ("indication", "permitted", "warning", "sbi", "ebi", "ebd", "sbd")
        return {
            name: float(np.interp(speed_mps, self.speed_mps, getattr(self, f"{name}_m")))
            for name in names
        }


def curves(
    data: BrakingData,
    target_m: float,
    speed_max_mps: float,
    line: Line = LEVEL,
    length_m: float = 0.0,
    points: int = 201,
) -> Curves:
    """All supervision limits towards one stopping point.

    Args:
        data: The train's braking data and national values.
        target_m: Supervised location and end of authority, metres.
        speed_max_mps: Highest speed of interest, m/s.
        line: Gradients.
        length_m: Train length for the gradient compensation, metres.
        points: Number of speeds from 0 to ``speed_max_mps``.

    Raises:
        CannotStopError: if the gradient outweighs the brake somewhere on the way.
    """
    check_range("points", points, 2, 1_000_000)
    v = np.linspace(0.0, speed_max_mps, points)
    check_range("speed_max_mps", speed_max_mps, 0.0, MAX_SPEED_MPS / 1.5, "m/s", above=True)
    # The emergency brake comes T_berem after the traction cut-off; meanwhile the speed may be
    # underestimated by V_delta0 and grow by V_delta1, then V_delta2.   [3.13.9.3.2]
    t_traction = data.T_traction
    t_berem = max(data.T_be - t_traction, 0.0)
    v_delta1, v_delta2 = data.A_est1 * t_traction, data.A_est2 * t_berem
    v_fast = v + data.speed_inaccuracy(v)
    v_bec = np.where(v > 0.0, v_fast + v_delta1 + v_delta2, 0.0)
    d_bec = (v_fast + v_delta1 / 2.0) * t_traction + (v_fast + v_delta1 + v_delta2 / 2.0) * t_berem
    top = float(v_bec.max()) * (1.0 + 1e-9)
    common = (target_m, max(top, speed_max_mps), line, length_m, data.M_rotating)
    ebd = deceleration_curve(data.A_brake_safe, *common)
    sbd = deceleration_curve(data.A_brake_service, *common)

    ebi = ebd.distance(v_bec) - np.where(v > 0.0, d_bec, 0.0)
    sbi = np.minimum(sbd.distance(v) - v * data.T_bs, ebi - v * data.T_bs)
    permitted = sbi - v * data.T_driver
    t_indication = max(0.8 * data.T_bs, 5.0) + data.T_driver
    return Curves(
        speed_mps=v,
        indication_m=permitted - v * t_indication,
        permitted_m=permitted,
        warning_m=sbi - v * data.T_warning,
        sbi_m=sbi,
        ebi_m=ebi,
        ebd_m=ebd.distance(v),
        sbd_m=sbd.distance(v),
        data=data,
    )
