"""``railops crossing …``: train detectors, assess and react to situations, simulate, experiment."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from railops.cli import Commands, Result
from railops.crossing import coverage, negative, projections, tables, vdetector
from railops.crossing.audit import audit
from railops.crossing.bus import Link
from railops.crossing.drive import Plan, run, save
from railops.crossing.experiment import run as run_plan
from railops.crossing.fallback import react
from railops.crossing.memory import Memory
from railops.crossing.probability import Approach, collision_probability
from railops.crossing.problem import BOTH_WAYS, SLOW_DOWN
from railops.crossing.published import ANTIGENS, SELF
from railops.crossing.rules import can_stop, clearance
from railops.crossing.situation import DIMENSIONS, SPACE, Array, Situation, as_points
from railops.crossing.units import Policy
from railops.errors import DomainError, FileError

HELP = "level crossings: recognise a dangerous situation, react, and exchange messages"

_SITUATION = "eight numbers: " + ", ".join(f"{axis.label} ({axis.unit})" for axis in SPACE)


def add_commands(commands: Commands) -> None:
    """Add the crossing commands."""
    add = commands.add("train", "mature detectors on safe situations", _train).add_argument
    add("memory", type=Path, help="SQLite file to keep the detectors in")
    add("--safe", type=Path, help="JSON list of safe situations; without it the published nine")
    add(
        "--method",
        choices=("v-detectors", "published", "scaled"),
        default="v-detectors",
        help="variable radii; moving detectors as printed (raw units); the same in the unit cube",
    )
    add("--drawing", type=Path, help="image file for the space in projections (Fig. 4.4)")
    add("--seed", type=int, default=0, help="seed of the random numbers")

    add = commands.add("assess", "judge one situation", _assess).add_argument
    _add_situation(add)
    add("--memory", type=Path, help="detectors made by train; the situation is kept if caught")

    add = commands.add("react", "what to do about one situation", _react).add_argument
    _add_situation(add)
    add("--both-ways", action="store_true", help="changes of -15 … +5 km/h, not -10 … 0")
    add("--train-age-s", type=float, default=0.0, help="age of the train's report, s")
    add("--car-age-s", type=float, default=0.0, help="age of the car's report, s")
    add("--seed", type=int, default=0, help="seed of the clonal selection")

    add = commands.add("simulate", "drives with late and lost messages", _simulate).add_argument
    add("--drives", type=int, default=20, help="number of drives")
    add("--delay-low-s", type=float, default=1.0, help="least delay of a message, s")
    add("--delay-high-s", type=float, default=15.0, help="largest delay, s")
    add("--loss", type=float, default=0.05, help="share of messages lost")
    add("--as-published", action="store_true", help="wait for busy; do not brake in doubt")
    add("--current-s", type=float, default=5.0, help="an older state is not current, s")
    add("--record", type=Path, help="SQLite file for the first drive's data")
    add("--seed", type=int, default=0, help="seed of the first drive")

    add = commands.add("experiment", "the published plan, Tables 4.1-4.7", _experiment).add_argument
    add("--attempts", type=int, default=6, help="attempts per scenario")
    add("--seed", type=int, default=0, help="seed of the plan")


def _add_situation(add: object) -> None:
    assert callable(add)
    add("situation", type=float, nargs=DIMENSIONS, metavar="NUMBER", help=_SITUATION)


def _read_situations(path: Path) -> Array:
    """Safe situations from a JSON list of lists of eight numbers, shape (N, 8)."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FileError(f"cannot read safe situations {path}: {error}") from error
    if not isinstance(rows, list):
        raise FileError(f"{path} must hold a JSON list of situations")
    try:
        return as_points(rows)
    except DomainError as error:
        raise FileError(f"safe situations {path}: {error}") from error


def _train(arguments: argparse.Namespace) -> Result:
    safe = SELF if arguments.safe is None else _read_situations(arguments.safe)
    if arguments.method == "v-detectors":
        detectors = vdetector.train(safe, arguments.seed)
    else:
        settings = negative.PUBLISHED if arguments.method == "published" else negative.SCALED
        detectors = negative.train(safe, arguments.seed, settings)
    Memory(arguments.memory).save(detectors)
    if arguments.drawing is not None:
        projections.draw(arguments.drawing, detectors, safe, ANTIGENS)
    found = coverage.estimate(detectors, safe, arguments.seed)
    document = {
        "memory": str(arguments.memory),
        "detectors": len(detectors),
        "method": detectors.method,
        "units": detectors.units,
        "seed": detectors.seed,
        "coverage": asdict(found),
    }
    text = (
        f"{len(detectors)} detectors ({detectors.method}, {detectors.units}) cover "
        f"{100 * found.share:.2f} % of the space outside the safe situations "
        f"({100 * found.low:.2f} … {100 * found.high:.2f} % at {100 * found.confidence:g} %)"
    )
    return Result(document, text)


def _assess(arguments: argparse.Namespace) -> Result:
    situation = Situation.of(arguments.situation)
    rule, stop = clearance(situation), can_stop(situation)
    probability = collision_probability(
        Approach(situation.train_distance_m, situation.train_speed_mps),
        Approach(situation.car_distance_m, situation.car_speed_mps),
    )
    detector = None
    if arguments.memory is not None:
        memory = Memory(arguments.memory)
        detector = int(memory.load().judge([situation])[0])
        if detector >= 0:
            memory.remember(situation.array()[None, :], [detector], ["assessed"])
    alarm = detector is not None and detector >= 0
    document = {
        "situation": asdict(situation),
        "rule": asdict(rule),
        "stop": asdict(stop),
        "collision_probability": probability,
        "detector": detector,
        "alarm": alarm if detector is not None else None,
    }
    lines = [
        f"rule: {'kept' if rule.kept else 'BROKEN'}: {rule.reason}",
        f"collision probability: {probability:.3g}",
        f"stop through the valve: {stop.stopping_m:.0f} m of {stop.distance_m:.0f} m",
    ]
    if detector is not None:
        lines.append(f"detectors: {f'ALARM (detector {detector})' if alarm else 'no alarm'}")
    return Result(document, "\n".join(lines), rule.kept and not alarm)


def _react(arguments: argparse.Namespace) -> Result:
    decision = react(
        Situation.of(arguments.situation),
        arguments.seed,
        actions=BOTH_WAYS if arguments.both_ways else SLOW_DOWN,
        train_age_s=arguments.train_age_s,
        car_age_s=arguments.car_age_s,
    )
    text = f"{decision.order.value}: {decision.reason}"
    if decision.order == "change speeds":
        found = decision.reaction
        text += (
            f"\ntrain {found.train_changes_kmh[0]:+.1f} km/h, "
            f"car {found.car_changes_kmh[0]:+.1f} km/h"
        )
    return Result({**asdict(decision), "seed": arguments.seed}, text, not decision.too_late)


def _simulate(arguments: argparse.Namespace) -> Result:
    link = Link(arguments.delay_low_s, arguments.delay_high_s, arguments.loss)
    policy = Policy(arguments.current_s, not arguments.as_published)
    found = audit(arguments.drives, arguments.seed, link, policy)
    if arguments.record is not None:
        save(arguments.record, *run(Plan.random(arguments.seed), link, policy))
    lines = [
        f"{found.drives} drives: {found.collisions} collisions, {found.avoidable} of them "
        f"avoided by a perfect radio, {found.unreported} without a cause; "
        f"{found.needless_stops} needless stops ({found.needless_stops_perfect} with it)"
    ]
    lines += [f"  drive {entry.seed}: {entry.cause}" for entry in found.unsafe]
    document = {**asdict(found), "unreported": found.unreported}
    return Result(document, "\n".join(lines), found.unreported == 0)


def _experiment(arguments: argparse.Namespace) -> Result:
    runs = run_plan(arguments.seed, arguments.attempts)
    methods = list(dict.fromkeys(item.method for item in runs))
    document = {
        "seed": arguments.seed,
        "attempts": arguments.attempts,
        "tables": tables.numbered(runs, arguments.seed),
        "comparisons": [
            asdict(row)
            for name in methods[1:]
            for row in tables.compare(runs, name, arguments.seed)
        ],
    }
    return Result(document, tables.text(runs, arguments.seed))
