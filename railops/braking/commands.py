"""``railops braking …``: bounds, protective section, simulation, curves and the decision."""

from __future__ import annotations

import argparse
import csv
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from railops.braking import bounds, channels, etcs, protection, rare, tails, target, worst
from railops.braking.decision import Policy, RangeMeasurement, decide
from railops.braking.montecarlo import DIMENSIONS, Campaign, StopLaw
from railops.braking.train import Train
from railops.cli import Commands, Result
from railops.errors import (
    CannotStopError,
    DomainError,
    EvidenceError,
    FileError,
    RailOpsError,
    check_range,
)
from railops.traction import Line

Array = npt.NDArray[np.float64]

_QUANTILES = (0.5, 0.9, 0.99, 0.999, 0.9999, 0.99999)


def add_commands(commands: Commands) -> None:
    """Add the braking commands."""
    add = commands.add(
        "trials", "how many trials a probability needs (Table 1)", _trials
    ).add_argument
    add("--p", type=float, help="exceedance probability; without it: the whole table")
    add("--confidence", type=float, default=0.9, help="confidence of the statement")
    add("--exceedances", type=int, default=0, help="exceedances allowed among the trials")

    add = commands.add("bound", "what trials or measured errors support", _bound).add_argument
    add("--trials", type=int, help="number of trials")
    add("--errors", type=Path, metavar="FILE", help="measured errors, m: text or CSV")
    add("--exceedances", type=int, help="exceedances among the trials, fixed beforehand")
    add("--confidence", type=float, default=0.9, help="confidence of the statement")
    add("--p", type=float, help="probability to support; refused if the trials do not")

    add = commands.add(
        "protect", "the protective section and its probability", _protect
    ).add_argument
    add("--stop-error-m", type=float, required=True, help="largest overrun ΔS_max, m")
    add("--stop-exceedance", type=float, required=True, help="probability of exceeding it")
    add("--range-error-m", type=float, required=True, help="largest range error ΔL_max, m")
    add("--range-exceedance", type=float, required=True, help="of one measurement")
    add("--measurements", type=int, default=4, help="measurements, the smallest decides")
    add("--second", type=int, default=0, help="measurements through a second channel")
    add("--common-cause", type=float, default=0.0, help="share that strikes all at once")
    add("--period-s", type=float, default=0.1, help="time one measurement takes, s")
    add("--missing", type=float, default=0.0, help="share of attempts that yield nothing")
    add("--target", type=float, default=1e-8, help="collision probability to reach")
    _add_speed(add, required=True)

    parser = commands.add("simulate", "Monte-Carlo of the stopping distance", _simulate)
    _add_train(parser)
    add = parser.add_argument
    add("--brake", choices=("service", "emergency"), default="emergency", help="which brake")
    add("--stops", type=int, default=1_000_000, help="simulated stops")
    add("--seed", type=int, default=1, help="seed")
    add("--threads", type=int, help="threads (default: all usable cores)")
    add("--tail", type=float, metavar="P", help="also the distance exceeded with probability P")
    add("--samples", type=int, default=50_000, help="samples per level for --tail and --beyond-m")
    add("--beyond-m", type=float, help="also the probability of a longer stop than this, m")

    parser = commands.add("curves", "braking curves in ETCS vocabulary", _curves)
    _add_train(parser)
    add = parser.add_argument
    add("--target-m", type=float, required=True, help="supervised location, m along the line")
    add("--points", type=int, default=11, help="number of speeds")
    add("--kdry", type=float, default=1.0, help="Kdry_rst")
    add("--kwet", type=float, default=1.0, help="Kwet_rst")

    parser = commands.add("decide", "what to do about a measured obstacle", _decide)
    _add_train(parser)
    add = parser.add_argument
    add("--range-m", type=float, action="append", default=[], help="measured range, m; repeatable")
    add("--std-m", type=float, default=1.0, help="standard deviation of --range-m, m")
    add("--ranges", type=Path, metavar="CSV", help="time_s,range_m,std_m[,low_m,high_m,channel]")
    add("--policy", type=Path, metavar="YAML", help="policy file")
    add("--unknown", action="store_true", help="perception is unknown")
    add("--time-s", type=float, help="now, s (default: the newest measurement)")

    parser = commands.add(
        "target", "stopping errors of the two target-braking controllers", _target
    )
    _add_train(parser)
    parser.add_argument("--runs", type=int, default=200, help="simulated stops")
    parser.add_argument("--seed", type=int, default=1, help="seed")

    parser = commands.add("worst", "the worst gradient profile within a tolerance", _worst)
    _add_train(parser)
    add = parser.add_argument
    add("--tolerance-permille", type=float, required=True, help="of one stretch, ‰")
    add("--mean-permille", type=float, required=True, help="of the mean over the stop, ‰")
    add("--stretch-m", type=float, default=100.0, help="length of a stretch, m")


def _add_speed(add: Any, required: bool = False) -> None:
    add("--speed-mps", type=float, required=required, help="speed, m/s")


def _add_train(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--train", type=Path, metavar="YAML", help="train file (default: a suburban train)")
    _add_speed(add)
    add("--gradient-permille", type=float, help="uniform gradient, ‰, positive uphill")


def _train(arguments: argparse.Namespace) -> Train:
    """The train the arguments describe."""
    if arguments.train is not None:
        train = Train.load(arguments.train, arguments.speed_mps)
    elif arguments.speed_mps is None:
        raise DomainError("--speed-mps", "missing", "a speed in m/s where no train file gives one")
    else:
        train = Train(arguments.speed_mps)
    if arguments.gradient_permille is not None:
        train = replace(train, line=Line.uniform(arguments.gradient_permille / 1000.0))
    return train


def _trials(arguments: argparse.Namespace) -> Result:
    levels = (0.9, 0.99, 0.999)
    if arguments.p is None:
        rows = [
            {"p": p, "confidence": b, "trials": bounds.trials_needed(p, b, arguments.exceedances)}
            for p in (1e-2, 1e-4, 1e-6, 1e-8)
            for b in levels
        ]
        lines = [f"{'p':>8}" + "".join(f"{f'β = {b:g}':>14}" for b in levels)]
        for start in range(0, len(rows), 3):
            group = rows[start : start + 3]
            lines.append(f"{group[0]['p']:>8g}" + "".join(f"{r['trials']:>14}" for r in group))
    else:
        count = bounds.trials_needed(arguments.p, arguments.confidence, arguments.exceedances)
        rows = [{"p": arguments.p, "confidence": arguments.confidence, "trials": count}]
        lines = [
            f"{count} trials with {arguments.exceedances} exceedances support p = {arguments.p:g} "
            f"at confidence {arguments.confidence:g}"
        ]
    lines += ["provided:", *(f"- {c}" for c in bounds.CONDITIONS)]
    document: dict[str, Any] = {
        "exceedances": arguments.exceedances,
        "table": rows,
        "conditions": bounds.CONDITIONS,
    }
    if arguments.p is not None:
        document |= rows[0]
    return Result(document, "\n".join(lines))


def _bound(arguments: argparse.Namespace) -> Result:
    if (arguments.trials is None) == (arguments.errors is None):
        raise DomainError("--trials, --errors", "both or neither", "exactly one of them")
    if arguments.errors is not None:
        errors = bounds.read_errors(arguments.errors)
        found = bounds.error_bound(errors, arguments.confidence, arguments.p, arguments.exceedances)
    else:
        found = bounds.bound(
            arguments.trials, arguments.confidence, arguments.exceedances or 0, arguments.p
        )
    return Result(asdict(found) | {"statement": found.statement}, found.statement)


def _protect(arguments: argparse.Namespace) -> Result:
    check_range("target", arguments.target, 0.0, 1.0, above=True)
    first = channels.Channel(
        "onboard",
        arguments.range_exceedance,
        arguments.measurements,
        arguments.period_s,
        arguments.missing,
        arguments.common_cause,
    )
    pair = [first]
    if arguments.second:
        pair.append(replace(first, name="wayside", measurements=arguments.second))
    plan = channels.plan(
        pair, arguments.speed_mps, common_cause=arguments.common_cause, target=arguments.target
    )
    section = protection.Section(
        arguments.stop_error_m,
        arguments.range_error_m + plan.growth_m,
        arguments.stop_exceedance,
        plan.exceedance,
    )
    met = section.collision_bound <= arguments.target * (1 + 1e-12)

    def smallest(exceedance: Array) -> Array:
        joint = first.joint_of(exceedance)
        if len(pair) == 1:
            return joint
        return channels.together(joint, pair[1].joint_of(exceedance), arguments.common_cause)

    normal = None
    if max(arguments.stop_exceedance, arguments.range_exceedance) < 0.5:
        normal = protection.normal_collision_probability(
            arguments.stop_error_m,
            arguments.stop_exceedance,
            arguments.range_error_m,
            arguments.range_exceedance,
            smallest,
        )
    document = asdict(section) | {
        "length_m": section.length_m,
        "growth_m": plan.growth_m,
        "duration_s": plan.duration_s,
        "collision_bound": section.collision_bound,
        "product_as_printed": protection.product_as_printed(
            arguments.stop_exceedance, plan.exceedance
        ),
        "collision_if_normal": normal,
        "measurements_needed": _needed(arguments),
        "target": arguments.target,
        "met": met,
        "conditions": bounds.CONDITIONS,
    }
    text = (
        f"protective section {section.length_m:.1f} m (stopping {section.stop_error_m:.1f} m, "
        f"range {section.range_error_m:.1f} m of which {plan.growth_m:.1f} m are run in "
        f"{plan.duration_s:.2f} s of measuring)\n"
        f"collision probability at most {section.collision_bound:.3g} (stopping "
        f"{section.stop_exceedance:.3g}, range {section.range_exceedance:.3g}): "
        f"{'meets' if met else 'does not meet'} {arguments.target:g}"
    )
    if normal is not None:
        text += f"\nif both errors were normal: {normal:.3g} (convolution, an example law)"
    return Result(document, text, met)


def _needed(arguments: argparse.Namespace) -> int | None:
    """Measurements of one channel for the target; None where no number suffices."""
    try:
        return channels.measurements_needed(
            arguments.target, arguments.range_exceedance, arguments.common_cause
        )
    except EvidenceError:
        return None


def _simulate(arguments: argparse.Namespace) -> Result:
    train = _train(arguments)
    law = StopLaw(train, arguments.brake)
    campaign = law.simulate(arguments.stops, arguments.seed, arguments.threads)
    found = list(campaign.quantiles(_QUANTILES))
    document: dict[str, Any] = {
        "nominal_m": campaign.nominal_m,
        "stops": arguments.stops,
        "seed": arguments.seed,
        "not_stopping": campaign.not_stopping,
        "quantiles": found,
        "fits": _fits(campaign),
        "disturbances": law.disturbances,
    }
    lines = [f"nominal {campaign.nominal_m:.2f} m; {campaign.not_stopping} stops run away"]
    for q in found:
        lines.append(f"{q.q:>8g} quantile {q.value:8.2f} m  (95 %: {q.low:.2f} … {q.high:.2f})")
    lines += [f"{name}: {fit}" for name, fit in document["fits"].items()]
    rng = np.random.default_rng([arguments.seed, 1])
    if arguments.tail is not None:
        distance = rare.quantile(law.distances, arguments.tail, DIMENSIONS, rng, arguments.samples)
        document["tail"] = {"probability": arguments.tail, "distance_m": distance}
        lines.append(f"exceeded with probability {arguments.tail:g}: {distance:.2f} m")
    if arguments.beyond_m is not None:
        tail = rare.tail(law.distances, arguments.beyond_m, DIMENSIONS, rng, arguments.samples)
        document["beyond"] = tail
        lines.append(
            f"longer than {arguments.beyond_m:g} m with probability {tail.probability:.3g} "
            f"(± {100 * tail.cov:.1f} %, {tail.method}; the methods "
            f"{'agree' if tail.agrees else 'DISAGREE: do not use'})"
        )
    return Result(document, "\n".join(lines), document.get("beyond") is None or bool(tail.agrees))


def _fits(campaign: Campaign) -> dict[str, Any]:
    """Pearson type I and generalised Pareto fits of the error, or why there is none."""
    sample = campaign.errors_m[:20_000]
    fits: dict[str, Any] = {}
    for name, fit in (
        ("pearson_moments", tails.pearson_moments),
        ("pearson_likelihood", tails.pearson_likelihood),
        ("peaks_over_threshold", lambda errors: tails.peaks_over_threshold(-errors)),
    ):
        try:
            fits[name] = asdict(fit(sample))
        except RailOpsError as error:
            fits[name] = {"refused": str(error)}
    return fits


def _curves(arguments: argparse.Namespace) -> Result:
    train = _train(arguments)
    data = etcs.BrakingData.of(train, Kdry_rst=arguments.kdry, Kwet_rst=arguments.kwet)
    found = etcs.curves(
        data,
        arguments.target_m,
        train.speed_mps,
        train.line,
        train.length_m,
        arguments.points,
    )
    names = ("indication_m", "permitted_m", "warning_m", "sbi_m", "ebi_m", "ebd_m", "sbd_m")
    columns = {"speed_mps": found.speed_mps} | {name: getattr(found, name) for name in names}
    lines = ["".join(f"{name:>14}" for name in columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append("".join(f"{value:>14.2f}" for value in row))
    return Result(columns | {"data": data}, "\n".join(lines))


def _decide(arguments: argparse.Namespace) -> Result:
    train = _train(arguments)
    policy = Policy.load(arguments.policy) if arguments.policy is not None else Policy()
    ranges = _read_ranges(arguments.ranges) if arguments.ranges is not None else []
    for number in arguments.range_m:
        half = 1.96 * arguments.std_m
        ranges.append(
            RangeMeasurement(0.0, number, arguments.std_m, (number - half, number + half))
        )
    try:
        advice, stops = (
            decide(ranges, train, policy, arguments.unknown, arguments.time_s),
            True,
        )
    except CannotStopError as error:
        if error.advice is None:
            raise
        advice, stops = error.advice, False
    text = f"{advice.action}: {advice.reason}\n{advice.would_change}"
    for contradiction in advice.contradictions:
        text += f"\ncontradiction: {contradiction}"
    return Result(advice.as_dict() | {"would_change": advice.would_change}, text, stops)


def _read_ranges(path: Path) -> list[RangeMeasurement]:
    """Range measurements from CSV."""
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"cannot read range file {path}: {error}") from error
    found = []
    for number, row in enumerate(rows, start=2):
        try:
            range_m, std_m = float(row["range_m"]), float(row["std_m"])
            low = float(row.get("low_m") or range_m - 1.96 * std_m)
            high = float(row.get("high_m") or range_m + 1.96 * std_m)
            channel = row.get("channel") or "onboard"
            valid = (row.get("valid") or "1").strip().lower() not in ("0", "false", "no")
            time_s = float(row["time_s"])
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(
                f"range file {path}, line {number}: needs numbers in time_s, range_m, std_m "
                f"({error})"
            ) from error
        found.append(RangeMeasurement(time_s, range_m, std_m, (low, high), channel, valid))
    return found


def _target(arguments: argparse.Namespace) -> Result:
    train = _train(arguments)
    document: dict[str, Any] = {"runs": arguments.runs, "seed": arguments.seed}
    lines = []
    for kind in ("acceleration", "speed"):
        errors = target.stopping_errors(
            target.suburban(kind), train, arguments.runs, arguments.seed
        )
        low, high = float(errors.min()), float(errors.max())
        document[kind] = {"lowest_m": low, "highest_m": high, "std_m": float(errors.std())}
        lines.append(f"{kind}-based: {low:.2f} … {high:.2f} m over {arguments.runs} runs")
    return Result(document, "\n".join(lines))


def _worst(arguments: argparse.Namespace) -> Result:
    found = worst.worst_profile(
        _train(arguments),
        arguments.tolerance_permille / 1000.0,
        arguments.mean_permille / 1000.0,
        stretch_m=arguments.stretch_m,
    )
    document = {
        "nominal_m": found.nominal_m,
        "distance_m": found.distance_m,
        "overrun_m": found.overrun_m,
        "gradients": found.line.gradients,
    }
    text = (
        f"nominal {found.nominal_m:.2f} m, worst profile {found.distance_m:.2f} m "
        f"(+{found.overrun_m:.2f} m)"
    )
    return Result(document, text)
