"""Planning one leg: solve, re-integrate, refine the mesh until the two agree, or say why not."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from railops.errors import UnreachableError, check_range
from railops.pilot._transcription import PAPER_MESH, Guess, Mesh, RawSolution, Transcription
from railops.pilot.leg import Leg
from railops.pilot.lobatto import evaluate
from railops.pilot.reference import Reference
from railops.pilot.refusal import refuse_early, refuse_unsolved
from railops.pilot.reintegration import STEP_M, Course, Trajectory, course_of, drive

Array = npt.NDArray[np.float64]

#: Forty nodes like the paper's mesh, but as thirteen elements: sparser, hence faster.
DEFAULT_MESH = Mesh.uniform(13, 4)

__all__ = ["DEFAULT_MESH", "PAPER_MESH", "Check", "LegPlan", "Mesh", "Tolerance", "plan_leg"]


@dataclass(frozen=True)
class Tolerance:
    """When a plan counts as accurate.

    Attributes:
        gap_m: Largest difference of the gap between plan and re-integration, metres.
        speed_mps: The same for the speed, m/s.
        force_mps2: Largest excess of the force over its limits between nodes, m/s².
        excess_mps: Largest excess of the relative speed over its limit, m/s.
        rounds: Mesh refinements at most.
        nodes: Nodes at most.
    """

    gap_m: float = 0.05
    speed_mps: float = 0.005
    force_mps2: float = 0.005
    excess_mps: float = 0.02
    rounds: int = 8
    nodes: int = 600

    def __post_init__(self) -> None:
        for name in ("gap_m", "speed_mps", "force_mps2", "excess_mps"):
            check_range(name, getattr(self, name), 0.0, 100.0, above=True)
        check_range("rounds", self.rounds, 0, 50)
        check_range("nodes", self.nodes, 4, 5000)


@dataclass(frozen=True)
class Check:
    """Plan against re-integration of its force from the leg's first state.

    Attributes:
        end_gap_m: Difference of the gap at the end, metres.
        end_speed_mps: Difference of the speed at the end, m/s.
        gap_m: Largest difference of the gap anywhere, metres.
        speed_mps: Largest difference of the speed anywhere, m/s.
        force_excess_mps2: Largest excess of the force over its limits anywhere, m/s².
        speed_excess_mps: Largest excess of the speed over its limits anywhere, m/s.
        gap_excess_m: How far the gap leaves the interval between its two ends, metres.
    """

    end_gap_m: float
    end_speed_mps: float
    gap_m: float
    speed_mps: float
    force_excess_mps2: float
    speed_excess_mps: float
    gap_excess_m: float

    def within(self, tolerance: Tolerance) -> bool:
        """Whether everything is within tolerance."""
        return all(found <= most for _, found, most, _ in self._against(tolerance))

    def worst(self, tolerance: Tolerance) -> tuple[str, float, str]:
        """What misses its tolerance by the largest factor: in words, by how much, its unit."""
        what, found, _, unit = max(self._against(tolerance), key=lambda row: row[1] / row[2])
        return what, found, unit

    def _against(self, tolerance: Tolerance) -> tuple[tuple[str, float, float, str], ...]:
        return (
            ("the gap is off", self.gap_m, tolerance.gap_m, "m"),
            ("the speed is off", self.speed_mps, tolerance.speed_mps, "m/s"),
            ("the force passes its limit", self.force_excess_mps2, tolerance.force_mps2, "m/s²"),
            ("the speed passes its limit", self.speed_excess_mps, tolerance.excess_mps, "m/s"),
            ("the gap leaves its range", self.gap_excess_m, max(tolerance.gap_m, 0.1), "m"),
        )


@dataclass(frozen=True)
class LegPlan:
    """A planned leg.

    Attributes:
        leg: What was asked for.
        mesh: The mesh it was solved on.
        length_m: p′ (or p″): how far the mother train runs meanwhile, metres.
        cost: The objective's value, in the paper's units.
        energy: Its energy term before weighting.
        jerk: Its jerk term before weighting.
        position_m: Mother-train positions of the nodes, metres, shape (M,).
        gap_m: Gap there, metres.
        ratio: Pilot vehicle's speed over the mother train's there.
        bend: Its derivative by position, times the length of the leg.
        force_mps2: Force over mass there, m/s².
        reference: The gap and its derivatives every few metres.
        trajectory: The same re-integrated under the plan's force.
        check: How far the two differ.
        iterations: Iterations of the solver, all rounds.
        rounds: Mesh refinements that were made.
        solve_s: Wall-clock time of building and solving, all rounds, s.
    """

    leg: Leg
    mesh: Mesh
    length_m: float
    cost: float
    energy: float
    jerk: float
    position_m: Array
    gap_m: Array
    ratio: Array
    bend: Array
    force_mps2: Array
    reference: Reference
    trajectory: Trajectory
    check: Check
    iterations: int
    rounds: int
    solve_s: float

    @property
    def force_n(self) -> Array:
        """The force at the nodes, newtons."""
        return self.leg.vehicle.mass_kg * self.force_mps2

    @property
    def speed_mps(self) -> Array:
        """Pilot vehicle's speed at the nodes, m/s."""
        return self.ratio * self.leg.route.mother.speed_at(self.position_m)

    @property
    def span_m(self) -> tuple[float, float]:
        """Mother-train positions at the leg's start and end, metres."""
        return float(self.position_m[0]), float(self.position_m[-1])


def plan_leg(
    leg: Leg,
    mesh: Mesh = DEFAULT_MESH,
    *,
    refine: bool = True,
    tolerance: Tolerance | None = None,
    start: LegPlan | None = None,
) -> LegPlan:
    """Plan one leg of the reference gap x_ref (eqs. 21–38).

    Args:
        leg: The leg.
        mesh: First mesh; ``PAPER_MESH`` is the paper's.
        refine: Whether to refine the mesh until plan and re-integration agree.
        tolerance: When they do.
        start: An earlier plan to start from, on any mesh.

    Raises:
        UnreachableError: if no plan meets the limits; it says which one is short and by how much.
        MissingExtraError: if CasADi is not installed.

    Example:
        >>> plan = plan_leg(Leg.paper_acceleration())
        >>> round(plan.length_m, -1), round(plan.cost, -4)
        (5720.0, 1070000.0)
    """
    tolerance = tolerance or Tolerance()
    refuse_early(leg)
    course = course_of(leg.route, leg.vehicle)
    begin, iterations = time.perf_counter(), 0
    guesses = [_from_plan(start, mesh)] if start is not None else []
    guesses += [_first_guess(leg, mesh, stretch) for stretch in (1.25, 2.0)]
    raw = _solve(leg, mesh, guesses)
    iterations += raw.iterations
    solve_s = time.perf_counter() - begin
    for round_ in range(tolerance.rounds + 1):
        check, reference, trajectory, marks = _verify(leg, mesh, raw.guess, course, tolerance)
        finer = _split(mesh, marks)
        done = not refine or check.within(tolerance) or round_ == tolerance.rounds
        if done or finer.points.size > tolerance.nodes:
            break
        begin = time.perf_counter()
        moved = _move(raw.guess, mesh.points, finer.points)
        better = Transcription(leg, finer, moved).solve(moved)
        solve_s += time.perf_counter() - begin
        if not better.solved:
            break
        raw, mesh, iterations = better, finer, iterations + better.iterations
    if refine and not check.within(tolerance):
        what, by, unit = check.worst(tolerance)
        raise UnreachableError(
            f"no plan of the leg at {leg.anchor_m:.0f} m survives its re-integration: after "
            f"{round_} mesh refinements {what} by {by:.2g} {unit}; allow more refinements or a "
            f"smoother objective (a larger λ₂)",
            "accuracy",
            by,
            unit,
        )
    return LegPlan(
        leg,
        mesh,
        raw.guess.length_m,
        raw.objective,
        raw.energy,
        raw.jerk,
        leg.position_m(mesh.points, raw.guess.length_m),
        raw.guess.gap_m,
        raw.guess.ratio,
        raw.guess.bend,
        raw.guess.force_mps2,
        reference,
        trajectory,
        check,
        iterations,
        round_,
        solve_s,
    )


def _solve(leg: Leg, mesh: Mesh, guesses: list[Guess]) -> RawSolution:
    """Try the guesses in turn, then find out why none leads anywhere."""
    programme = Transcription(leg, mesh)
    for guess in guesses:
        raw = programme.solve(guess)
        if raw.solved:
            return raw

    def attempt(changed: Leg, elastic: bool) -> RawSolution | None:
        relaxed = Transcription(changed, mesh, elastic=elastic)
        for stretch in (1.25, 3.0):
            result = relaxed.solve(_first_guess(changed, mesh, stretch))
            if result.solved:
                return result
        return None

    refuse_unsolved(leg, attempt)
    raise AssertionError("refuse_unsolved always raises")


def _first_guess(leg: Leg, mesh: Mesh, stretch: float) -> Guess:
    """A smooth step of the gap over a length that the speeds suggest, holding force throughout."""
    change, points = leg.to_gap_m - leg.from_gap_m, mesh.points
    mother = float(leg.route.mother.speed_at(leg.anchor_m))
    relative = 0.8 * leg.relative_speed_mps if change > 0 else 0.4 * mother
    length = min(stretch * mother * abs(change) / relative, 0.95 * leg.room_m)
    length = leg.length_m or length
    slope = change / length
    hold = leg.route.hold_mps2(leg.vehicle, leg.position_m(points, length), leg.from_gap_m)
    return Guess(
        leg.from_gap_m + change * points**2 * (3.0 - 2.0 * points),
        1.0 + slope * 6.0 * points * (1.0 - points),
        slope * (6.0 - 12.0 * points),
        np.clip(hold, -leg.vehicle.braking_mps2, leg.vehicle.traction_mps2),
        length,
    )


def _from_plan(plan: LegPlan, mesh: Mesh) -> Guess:
    """An earlier plan as a guess on this mesh."""
    points = (plan.position_m - plan.position_m[0]) / plan.length_m
    old = Guess(plan.gap_m, plan.ratio, plan.bend, plan.force_mps2, plan.length_m)
    return _move(old, points, mesh.points)


def _move(guess: Guess, coarse: Array, fine: Array) -> Guess:
    """A solution carried from the points of one mesh to those of another."""
    values = [
        np.interp(fine, coarse, value)
        for value in (guess.gap_m, guess.ratio, guess.bend, guess.force_mps2)
    ]
    return Guess(values[0], values[1], values[2], values[3], guess.length_m)


def _split(mesh: Mesh, marks: npt.NDArray[np.bool_]) -> Mesh:
    """Halve the marked elements; elements of many nodes become several of four."""
    widths: list[float] = []
    if mesh.nodes > 6:
        parts = max(2, mesh.nodes // 3)
        return Mesh(tuple(np.repeat(mesh.widths, parts) / parts), 4)
    for width, marked in zip(mesh.widths, marks, strict=True):
        widths += [width / 2, width / 2] if marked else [width]
    return Mesh(tuple(widths), mesh.nodes)


def _verify(
    leg: Leg, mesh: Mesh, guess: Guess, course: Course, tolerance: Tolerance
) -> tuple[Check, Reference, Trajectory, npt.NDArray[np.bool_]]:
    """Re-integrate under the plan's force on the exact profiles; say which elements to refine."""
    edges, step, rule = mesh.edges, mesh.nodes - 1, mesh.rule
    points, planned, ends = [], [], [0]
    for index, width in enumerate(mesh.widths):
        halves = 2 * max(2, math.ceil(width * guess.length_m / STEP_M))
        local = np.linspace(0.0, 1.0, halves + 1)[0 if index == 0 else 1 :]
        first = index * step
        bend = guess.bend[first : first + mesh.nodes]
        turn = width * (evaluate(rule, local, 1) @ bend)
        shift = width * local * (guess.ratio[first] - 1.0)
        shift += width**2 * (evaluate(rule, local, 2) @ bend)
        gap = guess.gap_m[first] + guess.length_m * shift
        planned.append([gap, guess.ratio[first] + turn, evaluate(rule, local) @ bend])
        points.append(edges[index] + width * local)
        ends.append(ends[-1] + halves)
    gap, ratio, bend = np.concatenate(planned, axis=1)
    position = leg.position_m(np.concatenate(points), guess.length_m)
    force = _force(leg, position, gap, ratio, bend / guess.length_m)
    mother = leg.route.mother.speed_at(position)
    path = drive(course, position, force, float(gap[0]), float(ratio[0] * mother[0]))

    vehicle = leg.vehicle
    limit = np.minimum(mother + leg.relative_speed_mps, leg.speed_limit_mps)
    low, high = sorted((leg.from_gap_m, leg.to_gap_m))
    force_excess = np.maximum(force - vehicle.traction_mps2, -vehicle.braking_mps2 - force)
    speed_excess = ratio * mother - limit
    gap_excess = np.maximum(gap - high, low - gap)
    gap_error = np.abs(path.gap_m - gap[::2])
    speed_error = np.abs(path.speed_mps - (ratio * mother)[::2])
    check = Check(
        float(gap_error[-1]),
        float(speed_error[-1]),
        float(gap_error.max()),
        float(speed_error.max()),
        max(0.0, float(force_excess.max())),
        max(0.0, float(speed_excess.max())),
        max(0.0, float(gap_excess.max())),
    )
    wrong = (
        (force_excess > tolerance.force_mps2)
        | (speed_excess > tolerance.excess_mps)
        | (gap_excess > max(tolerance.gap_m, 0.1))
    )
    marks = np.array([wrong[a : b + 1].any() for a, b in pairwise(ends)])
    reference = Reference(position, gap, ratio - 1.0, bend / guess.length_m)
    return check, reference, path, marks if marks.any() else np.ones_like(marks)


def _force(leg: Leg, position: Array, gap: Array, ratio: Array, bend: Array) -> Array:
    """The force over mass that drives a given gap, on the exact profiles, m/s²."""
    route, davis = leg.route, leg.vehicle.davis
    mother = route.mother.speed_at(position)
    accel = route.mother.accel_at(position)
    speed, here = ratio * mother, position + gap
    running = davis.c0 + (davis.c1 + davis.c2 * route.tunnel.at(here) * speed) * speed
    force: Array = bend * mother**2 + ratio * accel + running + route.resistance.at(here)
    return force / leg.vehicle.epsilon
