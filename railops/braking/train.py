"""The train as the brake decision sees it, and its file ``train.yaml``."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from railops.errors import DomainError, FileError, check_range
from railops.files import build, read_mapping, write_mapping
from railops.traction import LEVEL, MAX_SPEED_MPS, Adhesion, Davis, Line

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Brake:
    """One way of braking: how hard, and how long until it bites.

    Attributes:
        decel_mps2: Deceleration on dry level track without running resistance, m/s², > 0; or
            (speed_mps, decel_mps2) pairs with increasing speeds, linear in between.
        delay_s: Dead time from the command until the effort starts to rise, s, >= 0.
        build_up_s: Time of the linear rise to the full effort, s, >= 0.
    """

    decel_mps2: float | tuple[tuple[float, float], ...]
    delay_s: float
    build_up_s: float

    def __post_init__(self) -> None:
        hint = "a brake that does not decelerate cannot stop the train"
        for _, decel in self.points:
            check_range("decel_mps2", decel, 0.0, 5.0, "m/s²", above=True, hint=hint)
        speeds = [speed for speed, _ in self.points]
        if speeds != sorted(set(speeds)):
            raise DomainError("decel_mps2", self.decel_mps2, "pairs with increasing speeds in m/s")
        for speed in speeds:
            check_range("decel_mps2 speed", speed, 0.0, MAX_SPEED_MPS, "m/s")
        check_range("delay_s", self.delay_s, 0.0, 60.0, "s")
        check_range("build_up_s", self.build_up_s, 0.0, 60.0, "s")
        if not isinstance(self.decel_mps2, (int, float)):
            object.__setattr__(self, "decel_mps2", self.points)

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """The (speed_mps, decel_mps2) pairs, one pair where the deceleration is constant."""
        if isinstance(self.decel_mps2, (int, float)):
            return ((0.0, float(self.decel_mps2)),)
        try:
            points = tuple((float(speed), float(decel)) for speed, decel in self.decel_mps2)
        except (TypeError, ValueError):
            points = ()
        if not points:
            raise DomainError(
                "decel_mps2", self.decel_mps2, "a number in m/s² or [m/s, m/s²] pairs"
            )
        return points

    @property
    def table(self) -> tuple[Array, Array]:
        """Speeds and decelerations as arrays, each of shape (K,)."""
        speeds, decels = np.array(self.points).T.copy()
        return speeds, decels

    def scaled(self, factor: float) -> Brake:
        """The same brake with its deceleration multiplied by ``factor``."""
        return replace(self, decel_mps2=tuple((v, factor * b) for v, b in self.points))


@dataclass(frozen=True)
class Train:
    """A train at a place on a line; the defaults are a suburban multiple unit on level track.

    Attributes:
        speed_mps: Measured speed, m/s, 0 … 150.
        position_m: Position of its front on ``line``, metres.
        line: Gradient and curves around it.
        length_m: Train length, metres.
        mass_kg: Mass, kg (multi-vehicle dynamics and reports; the rest is per unit mass).
        rotating: Rotating-mass share γ of the equation of motion, 0 … 0.5.
        davis: Running resistance.
        adhesion: Wheel–rail adhesion; caps the brake effort.
        service: Full service brake.
        emergency: Emergency brake.
        speed_error_rel: Largest relative error of the measured speed; the decision assumes the
            train is that much faster. Default: a tenth, the paper's eq. 9.
        speed_error_mps: Largest absolute error on top of that, m/s: of a log read between its
            entries, of a speed derived from positions.
        brake_units: Number of independent brake units.
    """

    speed_mps: float
    position_m: float = 0.0
    line: Line = LEVEL
    length_m: float = 200.0
    mass_kg: float = 480_000.0
    rotating: float = 0.06
    davis: Davis = field(default_factory=Davis)
    adhesion: Adhesion = field(default_factory=Adhesion)
    service: Brake = field(default_factory=lambda: Brake(0.7, 0.6, 1.5))
    emergency: Brake = field(default_factory=lambda: Brake(1.0, 0.4, 1.2))
    speed_error_rel: float = 0.1
    speed_error_mps: float = 0.0
    brake_units: int = 20

    def __post_init__(self) -> None:
        hint = "speeds are in metres per second; 100 km/h is 27.8 m/s"
        check_range("speed_mps", self.speed_mps, 0.0, MAX_SPEED_MPS, "m/s", hint=hint)
        check_range("position_m", self.position_m, unit="m")
        check_range("length_m", self.length_m, 0.0, 10_000.0, "m")
        check_range("mass_kg", self.mass_kg, 0.0, 1e9, "kg", above=True)
        check_range("rotating", self.rotating, 0.0, 0.5)
        check_range("speed_error_rel", self.speed_error_rel, 0.0, 1.0)
        check_range("speed_error_mps", self.speed_error_mps, 0.0, MAX_SPEED_MPS, "m/s")
        check_range("brake_units", self.brake_units, 1, 1000)

    @property
    def fastest_mps(self) -> float:
        """The speed the train may really have, measured speed plus its largest errors, m/s."""
        return self.speed_mps * (1.0 + self.speed_error_rel) + self.speed_error_mps

    @staticmethod
    def load(path: str | Path, speed_mps: float | None = None) -> Train:
        """Read a train from YAML: the attributes above as keys, nested ones as mappings.

        Args:
            path: The file.
            speed_mps: Replaces the file's speed, m/s; needed where the file has none.

        Raises:
            FileError: if the file cannot be read, has unknown keys, or a value is mistyped or
                outside its range; names the file, the key, the value and the range.
        """
        data = read_mapping(path, "train file")
        if speed_mps is not None:
            data["speed_mps"] = speed_mps
        if "speed_mps" not in data:
            raise FileError(f"train file {path} has no speed_mps, and no speed was given")
        return build(Train, data, f"train file {path}")

    def save(self, path: str | Path) -> None:
        """Write the train as YAML that :meth:`load` reads back to an equal train."""
        write_mapping(path, self)
