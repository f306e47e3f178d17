"""``railops pilot …``: plan the reference gap, follow it, and simulate missions."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from railops.braking.train import Brake, Train
from railops.cli import Commands, Result
from railops.errors import DomainError, FileError
from railops.files import read_mapping
from railops.pilot.controllers import Mpc, Pid
from railops.pilot.leg import Objective
from railops.pilot.mission import SYSTEMS, Camera, Mission, Radio, simulate
from railops.pilot.page import write_page
from railops.pilot.route import Route, SpeedProfile
from railops.pilot.tracking import Reality, track
from railops.pilot.trip import Trip, TripPlan, plan_trip
from railops.traction import Line

HELP = "a pilot vehicle ahead of the train: its gap, its control, its worth"


def add_commands(commands: Commands) -> None:
    """Add the pilot vehicle's commands."""
    parser = commands.add("plan", "plan the gap over a trip (the paper's Table II, Fig. 9)", _plan)
    _add_trip(parser)
    parser.add_argument("--figure", type=Path, help="write the figure here (.png, .svg, .pdf)")
    parser.add_argument("--points", type=int, default=0, help="points of x_ref in the document")

    parser = commands.add("track", "follow the planned gap in closed loop (Fig. 12)", _track)
    _add_trip(parser)
    add = parser.add_argument
    add("--controller", choices=("pid", "mpc"), default="pid", help="which controller")
    add("--rough", action="store_true", help="noise, lag, wind, radio loss, wrong coefficients")
    add("--seed", type=int, default=0, help="seed of the noise")
    add("--figure", type=Path, help="write the figure here (.png, .svg, .pdf)")
    add("--most-m", type=float, help="largest error allowed, m; beyond it the exit status is 1")

    parser = commands.add("mission", "an obstacle appears: who stops before it?", _mission)
    add = parser.add_argument
    add("--train", type=Path, metavar="YAML", help="train file (default: a suburban train)")
    add("--speed-kmh", type=float, default=120.0, help="mother train's speed, km/h")
    add("--gap-m", type=float, default=1500.0, help="gap to the pilot vehicle, m")
    add("--camera-m", type=float, default=100.0, help="distance at which it recognises, m")
    add("--recognition-s", type=float, default=0.1, help="recognition time, s")
    add("--pilot-decel-mps2", type=float, default=1.5, help="pilot vehicle's braking, m/s²")
    add("--radio-loss", type=float, default=0.05, help="probability that one message is lost")
    add("--sudden", type=float, default=0.1, help="share of obstacles that appear suddenly")
    add("--missions", type=int, default=100_000, help="simulated missions")
    add("--seed", type=int, default=0, help="seed")
    add("--page", type=Path, help="write an animated HTML page here")


def _add_trip(parser: argparse.ArgumentParser) -> None:
    """Arguments of a trip; without any, the paper's Table I."""
    add = parser.add_argument
    add("--route", type=Path, metavar="YAML", help="route file (default: the paper's trip)")
    add("--near-gap-m", type=float, default=100.0, help="gap near stations x₀, m")
    add("--far-gap-m", type=float, default=1500.0, help="gap under way x_max, m")
    add("--open-from-m", type=float, help="where the gap starts to open (default: 5 %% of trip)")
    add("--close-until-m", type=float, help="where it is closed again (default: 95 %% of trip)")
    add("--longest-m", type=float, default=6000.0, help="length of a leg at most, m")
    add("--relative-speed-mps", type=float, default=10.0, help="speed above the train's, m/s")
    add("--speed-limit-mps", type=float, default=math.inf, help="pilot vehicle's top speed, m/s")
    add(
        "--energy",
        choices=("signed", "absolute", "squared", "traction"),
        default="signed",
        help="energy term; signed power reproduces Table II",
    )
    add("--jerk", choices=("total", "worst", "bounded"), default="total", help="jerk term")
    add("--energy-weight", type=float, default=1.0, help="λ₁")
    add("--jerk-weight", type=float, default=1e4, help="λ₂")
    add("--jerk-limit-mps3", type=float, default=0.5, help="θ for --jerk bounded, m/s³")
    add("--discontinuous", action="store_true", help="drop constraints 27, 28, 36 and 37")


def read_route(path: Path) -> Route:
    """Read a route file: ``speed`` as [position_m, speed_mps] pairs; ``gradients``, ``curves``.

    Raises:
        FileError: if it cannot be read, has unknown keys, lacks the speed, or a value lies outside
            its range.
    """
    data = read_mapping(path, "route file")
    known = {"speed", "gradients", "curves", "tunnels", "transition_m"}
    if unknown := sorted(set(map(str, data)) - known):
        raise FileError(f"route file {path} has unknown keys {unknown}; known: {sorted(known)}")
    try:
        speed = [(float(at), float(value)) for at, value in data["speed"]]
        tunnels = tuple((float(a), float(b), float(c)) for a, b, c in data.get("tunnels", ()))
        transition = float(data.get("transition_m", 100.0))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FileError(
            f"route file {path} needs speed as [position_m, speed_mps] pairs and tunnels as "
            f"[from_m, to_m, factor]: {error}"
        ) from error
    try:
        mother = SpeedProfile.through([at for at, _ in speed], [v for _, v in speed], transition)
        line = Line(data.get("gradients", ((0.0, 0.0),)), data.get("curves", ((0.0, math.inf),)))
        return Route(mother, line, tunnels, transition)
    except DomainError as error:
        raise FileError(f"route file {path}: {error}") from error


def _trip(arguments: argparse.Namespace) -> Trip:
    """The trip the arguments describe."""
    route = Route.paper() if arguments.route is None else read_route(arguments.route)
    first, length = route.mother.position_m[0], route.mother.length_m
    start, end = arguments.open_from_m, arguments.close_until_m
    return Trip(
        route=route,
        near_gap_m=arguments.near_gap_m,
        far_gap_m=arguments.far_gap_m,
        open_from_m=first + 0.05 * length if start is None else start,
        close_until_m=first + 0.95 * length if end is None else end,
        longest_m=arguments.longest_m,
        relative_speed_mps=arguments.relative_speed_mps,
        speed_limit_mps=arguments.speed_limit_mps,
        safe_gap_m=0.0,
        objective=Objective(
            arguments.energy,
            arguments.energy_weight,
            arguments.jerk,
            arguments.jerk_weight,
            arguments.jerk_limit_mps3,
            not arguments.discontinuous,
        ),
    )


def _legs(plan: TripPlan) -> dict[str, dict[str, Any]]:
    """Both legs for the document."""
    return {
        name: {
            "from_m": leg.span_m[0],
            "to_m": leg.span_m[1],
            "length_m": leg.length_m,
            "cost": leg.cost,
            "energy": leg.energy,
            "jerk": leg.jerk,
            "nodes": leg.position_m.size,
            "iterations": leg.iterations,
            "refinements": leg.rounds,
            "solve_s": leg.solve_s,
            "reintegration": asdict(leg.check),
        }
        for name, leg in (("opening", plan.opening), ("closing", plan.closing))
    }


def _plan(arguments: argparse.Namespace) -> Result:
    plan = plan_trip(_trip(arguments))
    document: dict[str, Any] = {"legs": _legs(plan)}
    if arguments.points > 0:
        first, *_, last = plan.trip.route.mother.position_m
        at = np.linspace(first, last, arguments.points)
        gap, slope, _ = plan.reference.at(at)
        document["reference"] = {
            "position_m": at,
            "gap_m": gap,
            "speed_mps": plan.trip.route.mother.speed_at(at) * (1.0 + slope),
            "force_mps2": plan.force_mps2(at),
        }
    if arguments.figure is not None:
        from railops.pilot.plots import plot_trip

        document["figure"] = str(plot_trip(plan, arguments.figure))
    lines = [
        f"{name:<8} {leg['from_m']:>9.0f} … {leg['to_m']:.0f} m, {leg['length_m']:.1f} m long, "
        f"cost {leg['cost']:.5g}, {leg['nodes']} nodes, solved in {leg['solve_s']:.2f} s"
        for name, leg in document["legs"].items()
    ]
    return Result(document, "\n".join(lines))


def _track(arguments: argparse.Namespace) -> Result:
    plan = plan_trip(_trip(arguments))
    reality = Reality.rough() if arguments.rough else Reality()
    controller = Mpc() if arguments.controller == "mpc" else Pid()
    found = track(plan, controller, reality, seed=arguments.seed)
    document: dict[str, Any] = {
        "controller": arguments.controller,
        "seed": arguments.seed,
        "reality": asdict(reality),
        "largest_error_m": found.largest_error_m,
        "rms_error_m": found.rms_error_m,
        "saturated_share": found.saturated_share,
        "beyond_plan_mps2": found.beyond_plan_mps2,
        "unseen_share": found.unseen_share,
        "smallest_gap_m": found.smallest_gap_m,
    }
    if arguments.figure is not None:
        from railops.pilot.plots import plot_track

        tracks = {arguments.controller: found}
        document["figure"] = str(plot_track(plan, tracks, arguments.figure))
    text = (
        f"{arguments.controller}: error at most {found.largest_error_m:.2f} m, rms "
        f"{found.rms_error_m:.3f} m; force at its limits {100 * found.saturated_share:.1f} % of "
        f"the time; gap never below {found.smallest_gap_m:.1f} m"
    )
    most = math.inf if arguments.most_m is None else arguments.most_m
    return Result(document, text, found.largest_error_m <= most)


def _mission(arguments: argparse.Namespace) -> Result:
    speed = arguments.speed_kmh / 3.6
    train = Train(speed) if arguments.train is None else Train.load(arguments.train, speed)
    plain = Mission(train=train)
    mission = replace(
        plain,
        gap_m=arguments.gap_m,
        camera=Camera(arguments.camera_m, recognition_s=arguments.recognition_s),
        radio=Radio(loss=arguments.radio_loss),
        sudden=arguments.sudden,
        pilot_brake=Brake(arguments.pilot_decel_mps2, 0.1, 0.3),
    )
    campaign = simulate(mission, arguments.missions, arguments.seed)
    systems = {}
    for system in SYSTEMS:
        worst, median, best = campaign.quantiles(system)
        systems[system] = {
            "train_stops": asdict(campaign.stops(system)),
            "margin_m": {"0.01": worst, "0.5": median, "0.99": best},
        }
    document: dict[str, Any] = {
        "missions": campaign.missions,
        "seed": arguments.seed,
        "systems": systems,
        "pilot_stops": asdict(campaign.pilot_stops),
        "train_reaches_pilot": float(campaign.reaches_pilot.mean()),
    }
    if arguments.page is not None:
        document["page"] = str(write_page(campaign, arguments.page))
    lines = [
        f"{name:<7} train stops in {100 * found['train_stops']['value']:6.2f} % "
        f"(95 %: {100 * found['train_stops']['low']:.2f} … "
        f"{100 * found['train_stops']['high']:.2f}), margin {found['margin_m']['0.5']:.0f} m"
        for name, found in systems.items()
    ]
    lines.append(f"the pilot vehicle itself stops in {100 * campaign.pilot_stops.value:.2f} %")
    return Result(document, "\n".join(lines))
