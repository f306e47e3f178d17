"""Monte-Carlo of the stopping distance with the full dynamics.

Eight independent standard normal numbers make one stop: each is turned into one disturbance. That
one mapping serves plain Monte-Carlo here and the rare-event methods of
:mod:`railops.braking.rare`, which have to move in a normal space.

    z₀  speed         true speed V·(1 + e), e uniform in ±speed_error_rel      [paper, eq. 9]
    z₁  brake         deceleration × (1 + σ·z)
    z₂  brake units   number of failed units, binomial; each takes its share of the effort
    z₃  adhesion      factor × exp(σ·z)
    z₄  resistance    Davis terms × (1 + σ·z), never negative
    z₅  gradient      gradient + σ·z over the whole stop
    z₆  dead time     delay × exp(σ·z)
    z₇  build-up      time × exp(σ·z)

Positive z₀, z₂, z₆, z₇ and negative z₁, z₃, z₄, z₅ lengthen the stop. Results depend on the seed
and the number of stops only, never on the number of threads.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import special

from railops._compile import compiled
from railops.braking._lanes import LANES, WORKSPACE, Course, run_lanes, set_lane, table_of
from railops.braking.stopping import BrakeName, stopping_distance
from railops.braking.train import Train
from railops.errors import DomainError, check_range
from railops.traction import GRAVITY_MPS2

Array = npt.NDArray[np.float64]

DIMENSIONS = 8
_CHUNK = 1 << 14


@dataclass(frozen=True)
class Disturbances:
    """What varies from stop to stop; see the module for how each one acts.

    Attributes:
        speed_error_rel: Half-width of the uniform relative speed error (paper: 0.1).
        brake_std: Relative standard deviation of the deceleration.
        unit_failure: Probability that one brake unit does not work.
        adhesion_log_std: Standard deviation of the logarithm of the adhesion factor.
        resistance_std: Relative standard deviation of the running resistance.
        gradient_std: Standard deviation of the gradient's error, rise over run.
        delay_log_std: Standard deviation of the logarithm of the dead time.
        build_up_log_std: Standard deviation of the logarithm of the build-up time.
    """

    speed_error_rel: float = 0.1
    brake_std: float = 0.03
    unit_failure: float = 1e-3
    adhesion_log_std: float = 0.1
    resistance_std: float = 0.1
    gradient_std: float = 5e-4
    delay_log_std: float = 0.1
    build_up_log_std: float = 0.1

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            check_range(name, getattr(self, name), 0.0, 1.0)

    @staticmethod
    def none() -> Disturbances:
        """Nothing varies."""
        return Disturbances(0, 0, 0, 0, 0, 0, 0, 0)


@compiled
def _upper_tail(z: float) -> float:
    """P(Z > z), accurate far out on the upper side."""
    return 0.5 * math.erfc(z / math.sqrt(2.0))


@compiled
def _distances(
    z: Array,
    speed: float,
    nominal: Array,
    course: Course,
    scale: Array,
    failures: Array,
    out: Array,
) -> None:
    """Stopping distance of each row of z, shape (N, 8); ``scale`` as in Disturbances' order.

    ``nominal`` is (delay_s, build_up_s, adhesion); ``failures[i]`` is the probability of more
    than i failed units.
    """
    units, rows = failures.size, z.shape[0]
    workspace, near = np.zeros(WORKSPACE), np.zeros(2 * LANES, np.int64)
    delay, ramp, result = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for start in range(0, rows, LANES):
        for lane in range(LANES):
            row = min(start + lane, rows - 1)  # the last group repeats its last row
            error = scale[0] * (1.0 - 2.0 * _upper_tail(z[row, 0]))
            beyond = _upper_tail(z[row, 2])
            failed = 0
            while failed < units and beyond < failures[failed]:
                failed += 1
            brake = (1.0 + scale[1] * z[row, 1]) * (1.0 - failed / units)
            set_lane(
                workspace,
                lane,
                speed * (1.0 + error),
                max(0.0, brake),
                nominal[2] * math.exp(scale[3] * z[row, 3]),
                max(0.0, 1.0 + scale[4] * z[row, 4]),
                GRAVITY_MPS2 * scale[5] * z[row, 5],
            )
            delay[lane] = nominal[0] * math.exp(scale[6] * z[row, 6])
            ramp[lane] = nominal[1] * math.exp(scale[7] * z[row, 7])
            near[lane], near[LANES + lane] = 0, 0
        run_lanes(workspace, near, delay, ramp, course, result)
        for lane in range(min(LANES, rows - start)):
            out[start + lane] = result[lane]


@dataclass(frozen=True)
class StopLaw:
    """The random stopping distance of a train with one of its brakes.

    Attributes:
        train: The train, at its speed and place.
        brake: Which brake.
        disturbances: What varies.
        nominal_m: Stopping distance with nothing varying, metres.
    """

    train: Train
    brake: BrakeName = "emergency"
    disturbances: Disturbances = field(default_factory=Disturbances)
    nominal_m: float = field(init=False)

    def __post_init__(self) -> None:
        nominal = stopping_distance(self.train, self.brake).distance_m
        object.__setattr__(self, "nominal_m", nominal)

    def distances(self, z: Array, out: Array | None = None) -> Array:
        """Stopping distance of each standard normal row.

        Args:
            z: Shape (N, 8), see the module.
            out: Where to write, shape (N,).

        Returns:
            Distances, metres, shape (N,); inf where the train does not stop.
        """
        d = self.disturbances
        units = self.train.brake_units
        failures: Array = np.asarray(special.bdtrc(np.arange(units), units, d.unit_failure), float)
        scale = np.array([getattr(d, name) for name in d.__dataclass_fields__], float)
        result = np.empty(len(z)) if out is None else out
        train, brake = self.train, getattr(self.train, self.brake)
        adhesion = train.adhesion.factor * train.adhesion.share
        nominal = np.array([brake.delay_s, brake.build_up_s, adhesion])
        davis, line = train.davis, train.line.table(train.length_m)
        course = Course(
            train.position_m,
            davis.c0,
            davis.c1,
            davis.c2,
            train.rotating,
            table_of(*brake.table),
            table_of(*line),
        )
        rows = np.ascontiguousarray(z)
        _distances(rows, train.speed_mps, nominal, course, scale, failures, result)
        return result

    def simulate(self, stops: int, seed: int, threads: int | None = None) -> Campaign:
        """Simulate independent stops.

        Args:
            stops: How many, >= 1.
            seed: Seed; with ``stops`` it determines the result.
            threads: Threads; default: the cores this process may use.
        """
        check_range("stops", stops, 1, 1e9)
        check_range("seed", seed, 0, 2**63)
        if threads is not None:
            check_range("threads", threads, 1, 1024)
        result = np.empty(int(stops))
        starts = range(0, int(stops), _CHUNK)
        seeds = np.random.SeedSequence(seed).spawn(len(starts))

        def fill(start: int, chunk_seed: np.random.SeedSequence) -> None:
            part = result[start : start + _CHUNK]
            z = np.random.default_rng(chunk_seed).standard_normal((part.size, DIMENSIONS))
            self.distances(z, part)

        with ThreadPoolExecutor(threads or usable_cores()) as pool:
            for done in pool.map(fill, starts, seeds):
                assert done is None  # map re-raises what a chunk raised
        return Campaign(result, self.nominal_m, seed)


def usable_cores() -> int:
    """Cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Quantile:
    """A quantile with the order statistics that enclose it with the given confidence."""

    q: float
    value: float
    low: float
    high: float
    confidence: float


def _binomial_quantile(level: float, n: int, p: float) -> int:
    """Smallest k with P(X <= k) >= level; without scipy.stats' second of start-up."""
    k = max(math.ceil(float(special.bdtrik(level, n, p))), 0)
    return k - 1 if k > 0 and special.bdtr(k - 1, n, p) >= level else k


@dataclass(frozen=True)
class Campaign:
    """Simulated stops.

    Attributes:
        distances_m: Stopping distances, metres, shape (N,).
        nominal_m: The distance calculated with nothing varying, metres.
        seed: Seed of the campaign.
    """

    distances_m: Array
    nominal_m: float
    seed: int

    @property
    def errors_m(self) -> Array:
        """ΔS = nominal − actual as the paper signs it: negative is an overrun. Shape (N,)."""
        return self.nominal_m - self.distances_m

    @property
    def not_stopping(self) -> int:
        """Number of stops in which the train ran away."""
        return int(np.isinf(self.distances_m).sum())

    def quantile(self, q: float, confidence: float = 0.95) -> Quantile:
        """The q-quantile of the distance with a distribution-free confidence interval.

        The number of samples below the true quantile is binomial (N, q); the interval runs
        between the order statistics at that law's quantiles.

        Raises:
            DomainError: if the campaign is too small for the upper end of the interval.
        """
        check_range("q", q, 0.0, 1.0, above=True)
        check_range("confidence", confidence, 0.0, 1.0 - 1e-12, above=True)
        n = self.distances_m.size
        tail = (1.0 - confidence) / 2.0
        low, high = _binomial_quantile(tail, n, q), _binomial_quantile(1.0 - tail, n, q) + 1
        middle = min(max(math.ceil(q * n), 1), n)
        if low < 1 or high > n:
            raise DomainError(
                "q", q, f"a quantile that {n} stops can enclose", "simulate more stops"
            )
        ordered = np.partition(self.distances_m, sorted({low - 1, middle - 1, high - 1}))
        return Quantile(
            q,
            float(ordered[middle - 1]),
            float(ordered[low - 1]),
            float(ordered[high - 1]),
            confidence,
        )

    def quantiles(self, levels: tuple[float, ...]) -> Iterator[Quantile]:
        """Those of the levels that the campaign is large enough for."""
        for level in levels:
            try:
                yield self.quantile(level)
            except DomainError:
                return
