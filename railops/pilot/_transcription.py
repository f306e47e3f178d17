"""A leg as a nonlinear programme on Legendre–Gauss–Lobatto nodes, for CasADi and IPOPT.

Eqs. 17 and 18 are differentially flat in the gap. With the speed ratio y = v / v_m they read

    dx/dp_m = y − 1,   dy/dp_m = b,   ε·u/m = b·v_m² + y·a_m + c₀ + c₁v + c₂v² + w(p_m + x),

where a_m = v_m·dv_m/dp_m is the mother train's acceleration. The dynamics proper are a double
integrator whatever the line and the mother train do; gradients, curves, tunnels and speed changes
only enter the force, that is, bounds and cost. Polynomials therefore meet the dynamics exactly, and
rough profiles cost resolution of the force only, not accuracy of the motion.

The leg is cut into elements, each with n nodes that neighbours share; b is the polynomial through
its nodes, and x and y are its exact integrals. One element of 40 nodes is the mesh of the paper's
Table II. Unknowns per node: gap over the leg's length, y, b times the length, u/m and its slope;
and the leg's length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from railops._extras import extra
from railops.errors import DomainError, check_range
from railops.pilot._smooth import SmoothRamp
from railops.pilot.leg import Leg
from railops.pilot.lobatto import Lobatto, evaluate, lobatto
from railops.pilot.route import Ramp

Array = npt.NDArray[np.float64]

_GAP, _SPEED, _LENGTH = 100.0, 10.0, 1000.0
_SLOWEST_MPS = 0.5  # position is the independent variable: nobody may stand still
# Profiles are rounded over this share of the spacing of nodes, but at least over so many metres:
# what the nodes cannot resolve would only be noise in the length of the leg.
_ROUNDING, _ROUNDING_M = 0.25, 1.0
_TIE = 1e-3  # share of the total jerk that decides between equals


@dataclass(frozen=True)
class Mesh:
    """Elements over the leg.

    Attributes:
        widths: Share of the leg each element takes, shape (K,); they sum to one.
        nodes: Nodes per element, both ends included, 3 … 100.
    """

    widths: tuple[float, ...]
    nodes: int

    def __post_init__(self) -> None:
        check_range("nodes", self.nodes, 3, 100)
        if not self.widths or min(self.widths) <= 0 or abs(sum(self.widths) - 1.0) > 1e-9:
            raise DomainError("widths", self.widths, "positive shares that sum to one")

    @staticmethod
    def uniform(elements: int, nodes: int) -> Mesh:
        """Elements of equal width."""
        check_range("elements", elements, 1, 1000)
        return Mesh((1.0 / elements,) * elements, nodes)

    @property
    def rule(self) -> Lobatto:
        """The rule every element uses."""
        return lobatto(self.nodes)

    @property
    def edges(self) -> Array:
        """Element boundaries on [0, 1], shape (K + 1,)."""
        edges = np.concatenate([[0.0], np.cumsum(self.widths)])
        edges[-1] = 1.0
        return edges

    @property
    def points(self) -> Array:
        """All nodes on [0, 1], each once, shape (K·(n − 1) + 1,)."""
        edges, inner = self.edges, self.rule.nodes[:-1]
        starts = edges[:-1, None] + np.diff(edges)[:, None] * inner
        return np.append(starts.ravel(), 1.0)


#: The paper's mesh.
PAPER_MESH = Mesh.uniform(1, 40)


@dataclass(frozen=True)
class Guess:
    """Where the solver starts, or what it found, at the mesh's points, shape (M,).

    Attributes:
        gap_m: Gap x, metres.
        ratio: y = v / v_m.
        bend: dy/dp_m times the length of the leg.
        force_mps2: u/m, m/s².
        length_m: Length of the leg, metres.
        multipliers: Of bounds and constraints, for a warm start on the same mesh.
    """

    gap_m: Array
    ratio: Array
    bend: Array
    force_mps2: Array
    length_m: float
    multipliers: tuple[Array, Array] | None = None


@dataclass(frozen=True)
class RawSolution:
    """What IPOPT returned, unscaled."""

    guess: Guess
    objective: float
    energy: float
    jerk: float
    iterations: int
    status: str
    solved: bool
    excess: float


class Transcription:
    """The programme of one leg on one mesh; the weights stay parameters."""

    def __init__(
        self, leg: Leg, mesh: Mesh, guess: Guess | None = None, *, elastic: bool = False
    ) -> None:
        """Build the programme.

        Args:
            leg: The leg.
            mesh: Its mesh.
            guess: Where about the nodes will be; default: evenly over the room for the leg.
            elastic: Instead of keeping the force limits, minimise the factor by which they are
                exceeded: the answer to "how much too small is U?".
        """
        self.leg, self.mesh, self._guess, self._elastic = leg, mesh, guess, elastic
        self._casadi = extra("pilot", "casadi", "planning a reference trajectory")
        self._build()

    def _build(self) -> None:
        ca, leg, mesh, vehicle = self._casadi, self.leg, self.mesh, self.leg.vehicle
        count = mesh.points.size
        share, ratio = ca.SX.sym("share", count), ca.SX.sym("ratio", count)
        bend, force = ca.SX.sym("bend", count), ca.SX.sym("force", count)
        length, weights = ca.SX.sym("length"), ca.SX.sym("weights", 2)
        self._unknowns: list[Any] = [share, ratio, bend, force, length]
        self._low: list[Array] = []
        self._high: list[Array] = []
        self._start: list[Array] = []
        self._rows: list[tuple[Any, Array, Array]] = []
        distance = length * _LENGTH
        gap, position = share * distance, leg.position_m(ca.DM(mesh.points), distance)

        nodes = mesh.rule.nodes[1:]
        once, twice = (evaluate(mesh.rule, nodes, times) for times in (1, 2))
        for first, width in zip(self._firsts(), mesh.widths, strict=True):
            span = slice(first, first + mesh.nodes)
            rise = share[span][1:] - share[span][0] - width * nodes * (ratio[first] - 1.0)
            self._require(rise - ca.DM(width**2 * twice) @ bend[span], 0.0, 0.0)
            turn = ratio[span][1:] - ratio[span][0]
            self._require(turn - ca.DM(width * once) @ bend[span], 0.0, 0.0)

        low, high = leg.reach_m
        ahead = high + max(leg.from_gap_m, leg.to_gap_m)
        accel_ramp = self._smooth(leg.route.mother.accel, high, pilot=False)
        low_speed = float(leg.route.mother.speed_at(low))
        mother_accel, gained = accel_ramp.value_and_integral(position)
        mother_squared = low_speed**2 + 2.0 * gained
        mother = ca.sqrt(mother_squared)
        # Resistances at the pilot vehicle's place.
        davis, here, speed = vehicle.davis, position + gap, ratio * mother
        air = davis.c2 * self._smooth(leg.route.tunnel, ahead, pilot=True).value(here)
        line = self._smooth(leg.route.resistance, ahead, pilot=True).value(here)
        running = davis.c0 + (davis.c1 + air * speed) * speed + line
        accel = bend / distance * mother_squared + ratio * mother_accel
        self._require(vehicle.epsilon * force - accel - running, 0.0, 0.0)

        relative = (ratio - 1.0) * mother / _SPEED
        self._require(relative, -np.inf, leg.relative_speed_mps / _SPEED)
        self._require(speed / _SPEED, _SLOWEST_MPS / _SPEED, leg.speed_limit_mps / _SPEED)
        # Force beyond what would hold the gap right here (eq. 19).
        faster = (ratio - 1.0) * mother
        drag = faster * (davis.c1 + air * (speed + mother))
        extra_force = bend / distance * mother_squared + (ratio - 1.0) * mother_accel
        self._ends(gap, ratio, bend, (extra_force + drag) / vehicle.epsilon)

        energy = self._energy(force * vehicle.mass_kg * ratio, distance)
        jerk, tie = self._jerk(force, mother, distance)
        self._bound()
        cost = distance + weights[0] * energy + weights[1] * jerk
        if self._elastic:
            excess = self._unknown("excess", 1, 1.0, 0.0)
            self._require(force - (1.0 + excess) * vehicle.traction_mps2, -np.inf, 0.0)
            self._require(force + (1.0 + excess) * vehicle.braking_mps2, 0.0, np.inf)
            cost = leg.longest_m * (1.0 + leg.objective.energy_weight) * 1e4 * excess
        self._compile(cost, energy, jerk, weights, cost + weights[1] * tie)

    def _compile(self, cost: Any, energy: Any, jerk: Any, weights: Any, aim: Any) -> None:
        """Hand the programme to IPOPT."""
        ca, leg = self._casadi, self.leg
        typical = (0.1 * leg.vehicle.mass_kg) ** (2 if leg.objective.energy == "squared" else 1)
        scale = 1.0 / (leg.longest_m * (1.0 + leg.objective.energy_weight * typical))
        unknowns = ca.vertcat(*self._unknowns)
        programme = {
            "x": unknowns,
            "p": weights,
            "f": scale * aim,
            "g": ca.vertcat(*[row for row, _, _ in self._rows]),
        }
        cold = {
            "print_time": False,
            # Sensitivities to the weights: never asked for, and a second set of derivatives.
            "calc_lam_p": False,
            "no_nlp_grad": True,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": 1e-7,
            "ipopt.max_iter": 300,
            "ipopt.acceptable_tol": 1e-5,
            "ipopt.acceptable_iter": 15,
        }
        warm = cold | {
            "ipopt.warm_start_init_point": "yes",
            "ipopt.mu_init": 1e-5,
            "ipopt.warm_start_bound_push": 1e-7,
            "ipopt.warm_start_mult_bound_push": 1e-7,
        }
        self._cold = ca.nlpsol("leg", "ipopt", programme, cold)
        self._programme, self._warm_options = programme, warm
        self._parts = ca.Function("parts", [unknowns, weights], [cost, energy, jerk])

    def _firsts(self) -> range:
        """Index of the first node of each element."""
        step = self.mesh.nodes - 1
        return range(0, step * len(self.mesh.widths), step)

    def _smooth(self, ramp: Ramp, high_m: float, *, pilot: bool) -> SmoothRamp:
        """A table's smooth twin, as sharp at each knot as the nodes are close there."""
        leg, guess = self.leg, self._guess
        rounding: Array | float = _ROUNDING * leg.room_m / self.mesh.points.size
        if guess is not None:
            at = leg.position_m(self.mesh.points, guess.length_m) + guess.gap_m * pilot
            rounding = _ROUNDING * np.interp(ramp.position_m, at, np.gradient(at))
        return SmoothRamp(ramp, leg.reach_m[0], high_m, np.maximum(rounding, _ROUNDING_M))

    def _ends(self, gap: Any, ratio: Any, bend: Any, extra_force: Any) -> None:
        """Boundary conditions 24, 25 (33, 34) and the continuity constraints 27, 28 (36, 37).

        The constraints are degenerate at the very ends (their right side is zero there, so that
        they have no interior): there the gap is held (b = 0), inside they apply as printed. They
        are read relative to the force that holds the gap locally, which on the paper's flat line
        is the constant u₀ they print, and which stays meaningful where the gradient changes.
        """
        leg, aim = self.leg, self.leg.objective
        last = self.mesh.points.size - 1
        inner = slice(1, last)
        far = max(leg.from_gap_m, leg.to_gap_m)
        for index, end in ((0, leg.from_gap_m), (last, leg.to_gap_m)):
            self._require((gap[index] - end) / _GAP, 0.0, 0.0)
            self._require(ratio[index] - 1.0, 0.0, 0.0)
            if aim.continuous:
                self._require(bend[index], 0.0, 0.0)
                away = gap[inner] - end if end < far else end - gap[inner]
                alpha = aim.alpha_near if end < far else aim.alpha_far
                self._require(extra_force[inner] ** 2 - alpha * away, -np.inf, 0.0)
        low, high = sorted((leg.from_gap_m, leg.to_gap_m))
        self._require(gap[inner] / _GAP, low / _GAP, high / _GAP)

    def _quadrature(self, values: Any, distance: Any) -> Any:
        """∫ over the leg of something given at the nodes."""
        weights = np.zeros(self.mesh.points.size)
        for first, width in zip(self._firsts(), self.mesh.widths, strict=True):
            weights[first : first + self.mesh.nodes] += width * self.mesh.rule.weights
        return distance * self._casadi.dot(self._casadi.DM(weights), values)

    def _energy(self, power: Any, distance: Any) -> Any:
        """The energy term; ``power`` is u·v/v_m at the nodes, newtons."""
        kind = self.leg.objective.energy
        if kind == "signed":
            return self._quadrature(power, distance)
        if kind == "squared":
            return self._quadrature(power**2, distance)
        # The kink of |·| and max(0, ·) becomes two linear constraints on an extra unknown.
        mass = self.leg.vehicle.mass_kg
        above = self._unknown("above", power.shape[0], 0.1, 0.0)
        self._require(above - power / mass, 0.0, np.inf)
        if kind == "absolute":
            self._require(above + power / mass, 0.0, np.inf)
        return self._quadrature(mass * above, distance)

    def _jerk(self, force: Any, mother: Any, distance: Any) -> tuple[Any, Any]:
        """The jerk term, from d(u/m)/dp_m at the nodes of every element, 1/s²; and a tie-breaker.

        The largest jerk, or a bound on it, says nothing about forces that jitter below it: of such
        equals the tie-breaker, a grain of the total, takes the smoothest.
        """
        ca, aim, mass = self._casadi, self.leg.objective, self.leg.vehicle.mass_kg
        slopes = []
        for first, width in zip(self._firsts(), self.mesh.widths, strict=True):
            # An unknown of its own: what couples nodes stays linear, and the programme sparse.
            lifted = self._unknown(f"slope{first}", self.mesh.nodes, 0.0, -np.inf)
            change = ca.DM(self.mesh.rule.derivative / width)
            self._require(lifted - change @ force[first : first + self.mesh.nodes], 0.0, 0.0)
            slopes.append(lifted / distance)
        weights = ca.DM(self.mesh.rule.weights)
        parts = [
            width * ca.dot(weights, slope**2)
            for width, slope in zip(self.mesh.widths, slopes, strict=True)
        ]
        total = mass * distance * sum(parts)
        if aim.jerk == "total":
            return total, 0.0
        if aim.jerk == "worst":
            # γ in (1/m)·(du/dp)² <= γ, as its root: linear constraints instead of squares.
            root = self._unknown("root", 1, 5e-3 * 1e3, 0.0)
            for slope in slopes:
                self._require(1e3 * slope - root, -np.inf, 0.0)
                self._require(1e3 * slope + root, 0.0, np.inf)
            return mass * (1e-3 * root) ** 2, _TIE * total
        for first, slope in zip(self._firsts(), slopes, strict=True):
            per_second = slope * mother[first : first + self.mesh.nodes]
            self._require(per_second, -aim.jerk_limit_mps3, aim.jerk_limit_mps3)
        return ca.SX(0), _TIE * total

    def _unknown(self, name: str, count: int, start: float, low: float) -> Any:
        """A further unknown with its starting value and lower bound."""
        symbol = self._casadi.SX.sym(name, count)
        self._unknowns.append(symbol)
        self._low.append(np.full(count, low))
        self._high.append(np.full(count, np.inf))
        self._start.append(np.full(count, start))
        return symbol

    def _require(self, expression: Any, low: float, high: float) -> None:
        """A constraint low <= expression <= high, element by element."""
        count = expression.shape[0]
        self._rows.append((expression, np.full(count, low), np.full(count, high)))

    def _bound(self) -> None:
        """Simple bounds on the force and the length."""
        leg, count = self.leg, self.mesh.points.size
        longest = leg.room_m if leg.length_m is None else leg.length_m
        shortest = 1.0 if leg.length_m is None else leg.length_m
        strong = np.inf if self._elastic else 1.0
        bounds = [
            (0.0, np.inf, count),
            (0.0, np.inf, count),
            (-np.inf, np.inf, count),
            (-leg.vehicle.braking_mps2 * strong, leg.vehicle.traction_mps2 * strong, count),
            (shortest / _LENGTH, longest / _LENGTH, 1),
        ]
        self._low = [np.full(n, low) for low, _, n in bounds] + self._low
        self._high = [np.full(n, high) for _, high, n in bounds] + self._high

    def solve(self, guess: Guess, weights: tuple[float, float] | None = None) -> RawSolution:
        """Run IPOPT from a guess; with multipliers in the guess, as a warm start."""
        aim = self.leg.objective
        weight = weights or (aim.energy_weight, aim.jerk_weight)
        start = [guess.gap_m / guess.length_m, guess.ratio, guess.bend, guess.force_mps2]
        start += [np.array([guess.length_m / _LENGTH]), *self._start]
        arguments = {
            "x0": np.concatenate(start),
            "p": np.array(weight),
            "lbx": np.concatenate(self._low),
            "ubx": np.concatenate(self._high),
            "lbg": np.concatenate([low for _, low, _ in self._rows]),
            "ubg": np.concatenate([high for _, _, high in self._rows]),
        }
        solver = self._cold
        if guess.multipliers is not None:
            solver = self._casadi.nlpsol("leg", "ipopt", self._programme, self._warm_options)
            arguments["lam_x0"], arguments["lam_g0"] = guess.multipliers
        result = solver(**arguments)
        stats = solver.stats()
        values = np.asarray(result["x"], float).ravel()
        cost, energy, jerk = (float(part) for part in self._parts(values, np.array(weight)))
        count = self.mesh.points.size
        multipliers = tuple(np.asarray(result[key], float).ravel() for key in ("lam_x", "lam_g"))
        return RawSolution(
            Guess(
                values[:count] * float(values[4 * count] * _LENGTH),
                values[count : 2 * count],
                values[2 * count : 3 * count],
                values[3 * count : 4 * count],
                float(values[4 * count] * _LENGTH),
                (multipliers[0], multipliers[1]),
            ),
            cost,
            energy,
            jerk,
            int(stats["iter_count"]),
            str(stats["return_status"]),
            bool(stats["success"]),
            float(values[-1]) if self._elastic else 0.0,
        )
