"""The pilot vehicle against its bars: ``python -m benchmarks.pilot [--json] [--profiles N]``."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

from benchmarks.common import Measure, median_seconds, parser, publish
from railops.errors import UnreachableError
from railops.pilot import (
    DEFAULT_MESH,
    Leg,
    LegPlan,
    Mission,
    Mpc,
    Objective,
    Pid,
    Reality,
    Tolerance,
    Trip,
    plan_leg,
    plan_trip,
    simulate,
    track,
)
from railops.pilot.profiles import random_route

# Table II: cost, length and CPU time; and the authors' length of the worst-case-jerk leg.
PAPER = {
    "opening": (Leg.paper_acceleration(), 1.069572e6, 5718.025, 5.289023, 5378.39),
    "closing": (Leg.paper_deceleration(), 2.438284e5, 3798.177, 5.440077, 3472.75),
}


def first_of_all(name: str) -> float:
    """CPU time of a process's first plan, CasADi, IPOPT and compiled functions loaded on the way.

    The cold solve beside it builds and solves the programme anew and checks it by re-integration,
    with no earlier solution; only the libraries are there.
    """
    program = (
        "import time; from benchmarks.pilot import PAPER, plan_leg; start = time.process_time();"
        f"plan_leg(PAPER['{name}'][0], refine=False); print(time.process_time() - start)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    return float(done.stdout)


def legs(repeats: int) -> list[Measure]:
    """Table II, solve times and re-integration."""
    measures = []
    for name, (leg, cost, length, seconds, worst_length) in PAPER.items():
        plan = plan_leg(leg, DEFAULT_MESH)
        worst = plan_leg(replace(leg, objective=Objective(jerk="worst")))

        def cold(leg: Leg = leg) -> LegPlan:
            return plan_leg(leg, DEFAULT_MESH, refine=False)

        spent = median_seconds(cold, repeats)
        start = time.process_time()
        for _ in range(repeats):
            cold()
        cpu = (time.process_time() - start) / repeats
        measures += [
            Measure(f"{name}: cost off Table II", abs(plan.cost / cost - 1) * 100, "%", 0.5),
            Measure(
                f"{name}: length off Table II", abs(plan.length_m / length - 1) * 100, "%", 0.5
            ),
            Measure(f"{name}: cold solve, wall clock", spent, "s", 0.15),
            Measure(f"{name}: cold solve, CPU time", cpu, "s"),
            Measure(f"{name}: first solve of a fresh process, CPU time", first_of_all(name), "s"),
            Measure(f"{name}: times faster than published", seconds / spent, "x", 35, "higher"),
            Measure(f"{name}: re-integrated end, gap", plan.check.end_gap_m, "m", 0.1),
            Measure(f"{name}: re-integrated end, speed", plan.check.end_speed_mps, "m/s", 0.01),
            Measure(
                f"{name}: worst-case jerk, length off the authors'",
                abs(worst.length_m / worst_length - 1) * 100,
                "%",
                0.5,
            ),
        ]
    return measures


def profiles(count: int) -> list[Measure]:
    """Random mountainous trips: solved, refused with a reason, or neither."""
    solved = refused = 0
    gap = speed = force = 0.0
    tolerance, spent = Tolerance(), []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        route, opens = random_route(rng), bool(rng.integers(2))
        leg = Leg(
            route,
            from_gap_m=100.0 if opens else 1500.0,
            to_gap_m=1500.0 if opens else 100.0,
            anchor_m=float(rng.uniform(12e3, 25e3)),
            anchored="start" if opens else "end",
            longest_m=12e3,
        )
        start = time.perf_counter()
        try:
            check = plan_leg(leg, tolerance=tolerance).check
        except UnreachableError as refusal:
            refused += refusal.constraint not in ("all", "accuracy")
            continue
        spent.append(time.perf_counter() - start)
        solved += 1
        gap, speed = max(gap, check.end_gap_m), max(speed, check.end_speed_mps)
        force = max(force, check.force_excess_mps2)
    share = (solved + refused) / count
    return [
        Measure(
            "random profiles solved or refused with the limit", 100 * share, "%", 100, "higher"
        ),
        Measure("random profiles solved", 100 * solved / count, "%", None, "higher"),
        Measure("random profiles, worst re-integrated gap", gap, "m", 0.1),
        Measure("random profiles, worst re-integrated speed", speed, "m/s", 0.01),
        Measure("random profiles, worst excess of the force", force, "m/s²", 0.01),
        Measure("random profiles, median time", float(np.median(spent)), "s"),
    ]


def loops() -> list[Measure]:
    """Tracking over the 300 km trip of Table I."""
    plan = plan_trip(Trip())
    unlimited = track(plan, Pid(anti_windup=False), Reality(limited=False))
    return [
        Measure("PID, 300 km: largest error", unlimited.largest_error_m, "m", 15.0),
        Measure("PID, 300 km, limited: largest error", track(plan).largest_error_m, "m", 15.0),
        Measure("MPC, 300 km: largest error", track(plan, Mpc()).largest_error_m, "m", 3.0),
        Measure(
            "PID, 300 km, rough: largest error",
            track(plan, Pid(), Reality.rough()).largest_error_m,
            "m",
        ),
        Measure(
            "MPC, 300 km, rough: largest error",
            track(plan, Mpc(), Reality.rough()).largest_error_m,
            "m",
        ),
    ]


def missions(count: int) -> list[Measure]:
    """Mission Monte-Carlo: how fast, and what it says at the defaults."""
    spent = median_seconds(lambda: simulate(Mission(), count, 1), 5)
    found = simulate(Mission(), count, 1)
    return [
        Measure("missions per second", count / spent, "1/s", 20_000, "higher"),
        *(
            Measure(f"train stops in time, {name}", 100 * found.stops(name).value, "%")
            for name in found.margin_m
        ),
        Measure("pilot vehicle itself stops in time", 100 * found.pilot_stops.value, "%"),
    ]


def main() -> None:
    arguments = parser(__doc__ or "")
    arguments.add_argument("--profiles", type=int, default=100, help="random trips (default 100)")
    arguments.add_argument("--missions", type=int, default=50_000, help="missions (default 50000)")
    arguments.add_argument("--repeats", type=int, default=9, help="timed solves (default 9)")
    options = arguments.parse_args()
    plan_leg(Leg.paper_acceleration(), refine=False)  # imports and compiles before any clock
    measures = legs(options.repeats)
    measures += loops() + missions(options.missions) + profiles(options.profiles)
    publish("pilot", measures, options.json)


if __name__ == "__main__":
    main()
