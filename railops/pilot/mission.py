"""Is a pilot vehicle worth it? Missions with an obstacle, simulated by the thousand.

Every mission has one obstacle on the track. Three systems meet the same one, with the same train,
brakes, adhesion and luck:

* ``pilot``: the camera rides on the pilot vehicle, a gap ahead; it brakes and warns over the radio;
* ``camera``: the same camera on the mother train itself;
* ``driver``: nobody but the driver, who sees so far and no further.

Stops come from :class:`railops.braking.StopLaw` (full dynamics, disturbances). What happens between
them is arithmetic, so a mission costs no more than its two stops. All distances are along the
track, from the mother train's front.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy import special

from railops.braking import Brake, Disturbances, StopLaw, Train, largest_probability
from railops.braking.montecarlo import usable_cores
from railops.errors import check_range
from railops.pilot.vehicle import PilotVehicle
from railops.traction import Adhesion, Line

Array = npt.NDArray[np.float64]

SYSTEMS = ("pilot", "camera", "driver")
_CHUNK = 1 << 14
_STOP_DIMENSIONS = 8


@dataclass(frozen=True)
class Camera:
    """What recognises the obstacle.

    Attributes:
        working_m: Distance at which an obstacle becomes recognisable, metres (App. D: 100 m).
        working_log_std: Standard deviation of that distance's logarithm (weather, light, size).
        recognition_s: Time from an image to its verdict, s (App. D: 0.1 s).
        frame_s: Time between two images, s.
        hit_rate: Probability that one image of a recognisable obstacle is recognised.
        blind: Probability that the camera does not recognise this obstacle in any image.
    """

    working_m: float = 100.0
    working_log_std: float = 0.1
    recognition_s: float = 0.1
    frame_s: float = 0.1
    hit_rate: float = 0.94
    blind: float = 0.01

    def __post_init__(self) -> None:
        check_range("working_m", self.working_m, 0.0, 1e5, "m", above=True)
        check_range("working_log_std", self.working_log_std, 0.0, 3.0)
        check_range("recognition_s", self.recognition_s, 0.0, 60.0, "s")
        check_range("frame_s", self.frame_s, 0.0, 60.0, "s", above=True)
        check_range("hit_rate", self.hit_rate, 0.0, 1.0, above=True)
        check_range("blind", self.blind, 0.0, 1.0)


@dataclass(frozen=True)
class Radio:
    """The warning's way to the mother train.

    Attributes:
        delay_s: Time one message takes, s.
        interval_s: Time between two transmissions of the warning, s.
        loss: Probability that one transmission is lost.
        outage: Probability that nothing gets through when it matters (tunnel, jamming).
        timeout_s: The mother train brakes by itself after hearing nothing for so long, s; inf:
            it never does, and an outage is a missed warning.
    """

    delay_s: float = 0.1
    interval_s: float = 0.1
    loss: float = 0.05
    outage: float = 1e-3
    timeout_s: float = 2.0

    def __post_init__(self) -> None:
        check_range("delay_s", self.delay_s, 0.0, 60.0, "s")
        check_range("interval_s", self.interval_s, 0.0, 60.0, "s", above=True)
        check_range("loss", self.loss, 0.0, 1.0)
        check_range("outage", self.outage, 0.0, 1.0)
        if not self.timeout_s > 0.0:
            check_range("timeout_s", self.timeout_s, 0.0, unit="s", above=True)


@dataclass(frozen=True)
class Driver:
    """The driver without any system.

    Attributes:
        sight_m: Distance at which the driver sees an obstacle, metres.
        sight_log_std: Standard deviation of its logarithm.
        reaction_s: Time from seeing to the brake command, s.
    """

    sight_m: float = 300.0
    sight_log_std: float = 0.4
    reaction_s: float = 2.0

    def __post_init__(self) -> None:
        check_range("sight_m", self.sight_m, 0.0, 1e5, "m", above=True)
        check_range("sight_log_std", self.sight_log_std, 0.0, 3.0)
        check_range("reaction_s", self.reaction_s, 0.0, 60.0, "s")


@dataclass(frozen=True)
class Mission:
    """A run of the mother train with its pilot vehicle towards an obstacle.

    Attributes:
        train: The mother train, at its speed.
        vehicle: The pilot vehicle (running resistance and mass).
        pilot_brake: The pilot vehicle's emergency brake. The paper's 3 g is far beyond what
            wheels transmit; adhesion caps whatever is given here.
        gap_m: Gap between the two, metres.
        gap_std_m: Its standard deviation (tracking error), metres.
        pilot_length_m: Length of the pilot vehicle, metres.
        camera: The camera.
        radio: The radio.
        driver: The driver.
        sudden: Share of obstacles that appear while the train is near, uniformly within
            ``sudden_within_m`` ahead of the mother train, some of them behind the pilot vehicle;
            the others have lain there before.
        sudden_within_m: See ``sudden``, metres.
        reaction_s: Time from the warning's arrival to the mother train's brake command, s.
        disturbances: What varies in the mother train's stop.
        pilot_disturbances: What varies in the pilot vehicle's stop.
    """

    train: Train = field(default_factory=lambda: Train(speed_mps=120.0 / 3.6))
    vehicle: PilotVehicle = field(default_factory=PilotVehicle)
    pilot_brake: Brake = field(default_factory=lambda: Brake(1.5, 0.1, 0.3))
    gap_m: float = 1500.0
    gap_std_m: float = 5.0
    pilot_length_m: float = 4.0
    camera: Camera = field(default_factory=Camera)
    radio: Radio = field(default_factory=Radio)
    driver: Driver = field(default_factory=Driver)
    sudden: float = 0.1
    sudden_within_m: float = 3000.0
    reaction_s: float = 0.2
    disturbances: Disturbances = field(default_factory=lambda: Disturbances(speed_error_rel=0.02))
    pilot_disturbances: Disturbances = field(
        default_factory=lambda: Disturbances(speed_error_rel=0.0, unit_failure=0.0)
    )

    def __post_init__(self) -> None:
        check_range("gap_m", self.gap_m, 0.0, 1e5, "m", above=True)
        check_range("gap_std_m", self.gap_std_m, 0.0, 1e4, "m")
        check_range("pilot_length_m", self.pilot_length_m, 0.0, 100.0, "m")
        check_range("sudden", self.sudden, 0.0, 1.0)
        check_range("sudden_within_m", self.sudden_within_m, 0.0, 1e5, "m", above=True)
        check_range("reaction_s", self.reaction_s, 0.0, 60.0, "s")
        check_range("train speed_mps", self.train.speed_mps, 0.0, 150.0, "m/s", above=True)

    @property
    def pilot_train(self) -> Train:
        """The pilot vehicle as the stopping model sees it."""
        return Train(
            speed_mps=self.train.speed_mps,
            position_m=self.train.position_m + self.gap_m,
            line=self.train.line,
            length_m=self.pilot_length_m,
            mass_kg=self.vehicle.mass_kg,
            rotating=0.0,
            davis=self.vehicle.davis,
            adhesion=self.train.adhesion,
            emergency=self.pilot_brake,
            brake_units=2,
        )

    @staticmethod
    def certain(speed_mps: float, **changes: float) -> Mission:
        """A mission in which nothing varies, for checks against hand calculation."""
        mission = Mission(
            train=Train(speed_mps=speed_mps, line=Line(), adhesion=Adhesion(1.5)),
            gap_std_m=0.0,
            camera=Camera(working_log_std=0.0, hit_rate=1.0, blind=0.0),
            radio=Radio(loss=0.0, outage=0.0),
            driver=Driver(sight_log_std=0.0),
            sudden=0.0,
            disturbances=Disturbances.none(),
            pilot_disturbances=Disturbances.none(),
        )
        return replace(mission, **changes)  # type: ignore[arg-type]  # floats only, by signature


@dataclass(frozen=True)
class Share:
    """A simulated probability with its Clopper–Pearson bounds (each at 97.5 %)."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Campaign:
    """Simulated missions.

    Attributes:
        mission: What was simulated.
        seed: Seed of the campaign.
        pilot_margin_m: Track left before the obstacle when the pilot vehicle stands, metres;
            negative: it hits it at speed. NaN where it has passed before the obstacle appeared.
        margin_m: The same for the mother train, per system, shape (N,).
        reaches_pilot: Whether the mother train runs into the pilot vehicle that stopped or hit.
        sudden: Whether the obstacle appeared while the train was near.
    """

    mission: Mission
    seed: int
    pilot_margin_m: Array
    margin_m: Mapping[str, Array]
    reaches_pilot: npt.NDArray[np.bool_]
    sudden: npt.NDArray[np.bool_]

    @property
    def missions(self) -> int:
        """Number of missions."""
        return self.pilot_margin_m.size

    def stops(self, system: str) -> Share:
        """Probability that the mother train stops before the obstacle."""
        return share_of(int((self.margin_m[system] >= 0.0).sum()), self.missions)

    @property
    def pilot_stops(self) -> Share:
        """Probability that the pilot vehicle stops before an obstacle that is ahead of it."""
        ahead = ~np.isnan(self.pilot_margin_m)
        return share_of(int((self.pilot_margin_m[ahead] >= 0.0).sum()), max(1, int(ahead.sum())))

    def quantiles(self, system: str, levels: tuple[float, ...] = (0.01, 0.5, 0.99)) -> Array:
        """Quantiles of the mother train's margin, metres."""
        return np.asarray(np.quantile(self.margin_m[system], levels, method="lower"))


def share_of(hits: int, count: int) -> Share:
    """A share with two one-sided Clopper–Pearson bounds.

    Example:
        >>> round(share_of(0, 100).high, 6)
        0.036217
    """
    high = largest_probability(count, 0.975, hits)
    low = 1.0 - largest_probability(count, 0.975, count - hits)
    return Share(hits / count, low, high)


def simulate(
    mission: Mission, missions: int, seed: int = 0, threads: int | None = None
) -> Campaign:
    """Simulate independent missions.

    Args:
        mission: What to simulate.
        missions: How many, >= 1.
        seed: Seed; with ``missions`` it determines the result, whatever the threads.
        threads: Threads; default: the cores this process may use.

    Raises:
        CannotStopError: if one of the two vehicles cannot stop even undisturbed.
    """
    check_range("missions", missions, 1, 1e8)
    check_range("seed", seed, 0, 2**63)
    laws = (
        StopLaw(mission.train, "emergency", mission.disturbances),
        StopLaw(mission.pilot_train, "emergency", mission.pilot_disturbances),
    )
    starts = range(0, int(missions), _CHUNK)
    seeds = np.random.SeedSequence(seed).spawn(len(starts))

    def part(start: int, one: np.random.SeedSequence) -> tuple[Array, ...]:
        count = min(_CHUNK, int(missions) - start)
        return _chunk(mission, laws, count, np.random.default_rng(one))

    with ThreadPoolExecutor(threads or usable_cores()) as pool:
        parts = list(pool.map(part, starts, seeds))
    joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    pilot, with_pilot, camera, driver, reaches, sudden = joined
    margins = {"pilot": with_pilot, "camera": camera, "driver": driver}
    return Campaign(mission, seed, pilot, margins, reaches > 0.5, sudden > 0.5)


def _chunk(
    mission: Mission, laws: tuple[StopLaw, StopLaw], count: int, rng: np.random.Generator
) -> tuple[Array, ...]:
    """One batch of missions; see :class:`Campaign` for what comes back."""
    camera, radio, driver = mission.camera, mission.radio, mission.driver
    z = rng.standard_normal((count, _STOP_DIMENSIONS))
    pilot_z = rng.standard_normal((count, _STOP_DIMENSIONS))
    pilot_z[:, 3] = z[:, 3]  # the same rails: adhesion is common to both
    normal = rng.standard_normal((count, 3))
    uniform = rng.random((count, 6))
    stop, pilot_stop = laws[0].distances(z), laws[1].distances(pilot_z)
    # The law's own speed error: the run before the brake command is at that speed as well.
    error = mission.disturbances.speed_error_rel * (2.0 * special.ndtr(z[:, 0]) - 1.0)
    speed = mission.train.speed_mps * (1.0 + error)

    gap = np.maximum(mission.gap_m + mission.gap_std_m * normal[:, 0], 1.0)
    front = gap + mission.pilot_length_m  # the pilot vehicle's front
    sudden = uniform[:, 0] < mission.sudden
    appears = mission.sudden_within_m * uniform[:, 1]
    behind = sudden & (appears < front)
    working = camera.working_m * np.exp(camera.working_log_std * normal[:, 1])
    sight = driver.sight_m * np.exp(driver.sight_log_std * normal[:, 2])
    blind = uniform[:, 2] < camera.blind
    misses = _geometric(uniform[:, 3], 1.0 - camera.hit_rate)
    verdict_s = camera.recognition_s + camera.frame_s * misses

    # On the mother train (camera or driver) the obstacle is met at the distance of recognition,
    # or where it appears if that is nearer.
    ahead = np.where(sudden, appears, np.inf)
    own = np.minimum(ahead, working) - speed * (verdict_s + mission.reaction_s) - stop
    # A blind camera leaves the driver, as no camera does.
    by_driver = np.minimum(ahead, sight) - speed * driver.reaction_s - stop
    by_camera = np.where(blind, by_driver, own)

    # On the pilot vehicle, at its speed; it brakes at once, and warns.
    pilot_speed = mission.train.speed_mps
    seen = np.minimum(ahead - front, working)  # before its front
    pilot_margin = seen - pilot_speed * verdict_s - pilot_stop
    pilot_margin = np.where(blind, -pilot_stop, pilot_margin)
    # Unrecognised, the obstacle is hit, which the collision detector reports at once.
    found_s = np.where(blind, seen / pilot_speed, np.minimum(verdict_s, seen / pilot_speed))
    tries = _geometric(uniform[:, 4], radio.loss)
    heard_s = found_s + radio.delay_s + radio.interval_s * tries
    # The last sign of life came at the latest when the outage began, at recognition.
    silent_s = found_s + radio.timeout_s
    warned_s = np.where(uniform[:, 5] < radio.outage, silent_s, np.minimum(heard_s, silent_s))
    needed = speed * (warned_s + mission.reaction_s) + stop
    with_pilot = front + seen - needed
    # Without a warning, or with the obstacle behind the pilot vehicle, there is still the driver.
    with_pilot = np.where(behind, by_driver, np.maximum(with_pilot, by_driver))
    rest = front + np.minimum(seen, pilot_speed * found_s + pilot_stop) - mission.pilot_length_m
    reaches = ~behind & (needed > rest)
    return (
        np.where(behind, np.nan, pilot_margin),
        with_pilot,
        by_camera,
        by_driver,
        reaches.astype(float),
        sudden.astype(float),
    )


def _geometric(uniform: Array, fail: float) -> Array:
    """Number of failures before the first success, from uniform numbers in [0, 1)."""
    if fail <= 0.0:
        return np.zeros_like(uniform)
    if fail >= 1.0:
        return np.full_like(uniform, np.inf)
    return np.asarray(np.floor(np.log1p(-uniform) / np.log(fail)))
