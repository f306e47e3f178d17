"""``railops headway …``: characteristics, the upper loop, calibration, conversion, animation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from railops.cli import Commands, Result
from railops.errors import DomainError, FileError, check_range
from railops.headway import draw
from railops.headway.animate import animation
from railops.headway.calibrate import BOUNDS, METRO_CODES_KMH, Unknowns, calibrate
from railops.headway.characteristic import Characteristic, characteristic
from railops.headway.control import Order, choose_run_time
from railops.headway.files import content_hash, find_section, save_section
from railops.headway.interchange import osrd_section, railtoolkit_path, railtoolkit_train
from railops.headway.interval import Succession
from railops.headway.lines import load_line, regulate
from railops.headway.published import PUBLISHED
from railops.headway.stairway import stairway
from railops.headway.store import Store
from railops.headway.tables import as_text, read_csv, write_csv, write_parquet

_SECTION = "section file, or the name of a built-in section: moscow, zhengzhou"
_TABLE = (
    "section as above, a CSV table (interval_s, run_s, front_run_s, dwell_s), or "
    "published-moscow, published-zhengzhou"
)


def add_commands(commands: Commands) -> None:
    """Add the headway commands."""
    add = commands.add(
        "characteristic", "the shortest interval for all pairs of run times", _characteristic
    ).add_argument
    add("section", help=_SECTION)
    add("--run-times", type=_times, metavar="S,S,…", help="run times, s; default: the section's")
    add("--dwell", type=float, help="dwell of the train in front, s; default: the section's mean")
    add("--probability", type=float, help="take the dwell not exceeded with this probability")
    add("--csv", type=Path, metavar="FILE", help="write the pairs as CSV")
    add("--parquet", type=Path, metavar="FILE", help="write the pairs as Parquet")
    add("--store", type=Path, metavar="FILE", help="SQLite database to keep and reuse results in")
    add("--plots", type=Path, metavar="FOLDER", help="write heat map, surface and plots (SVG)")

    parser = commands.add("check", "one step of the upper loop: which run time to order", _check)
    add = parser.add_argument
    add("table", help=_TABLE)
    add("--front-run", type=float, required=True, help="run time of the train in front, s")
    add("--planned-run", type=float, required=True, help="our run time by the timetable, s")
    add("--front-departure", type=_clock, required=True, help="H:MM:SS or s")
    add("--planned-departure", type=_clock, required=True, help="ours, H:MM:SS or s")
    add("--departure", type=_clock, help="our actual departure; default: as planned")
    add("--front-dwell", type=float, help="planned dwell of the train in front, s")
    add("--front-delay", type=float, default=0.0, help="its predicted delay there, s")

    add = commands.add("line", "the upper loop over a whole line", _line).add_argument
    add("line", type=Path, help="line file: sections and trains (see docs/headway.md)")

    add = commands.add("calibrate", "fit a section to a characteristic", _calibrate).add_argument
    add("table", help="CSV table, or published-moscow, published-zhengzhou")
    add("--out", type=Path, metavar="FILE", help="write the fitted section")
    add(
        "--fix",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=f"a known quantity, repeatable; of {', '.join(BOUNDS)}",
    )
    add("--codes", type=_times, metavar="KM/H,…", help="speed codes; default: 0,40,60,70,80")
    add("--generations", type=int, default=120, help="of the search")
    add("--seed", type=int, default=0, help="of the search")

    add = commands.add("convert", "a section file from another format", _convert).add_argument
    add("source", type=Path, help="railtoolkit running path (YAML), or OSRD RailJSON with --tracks")
    add("--path", metavar="ID", help="which path of the file; default: the first")
    add("--train", type=Path, metavar="FILE", help="railtoolkit train; default: a metro train")
    add("--train-id", metavar="ID", help="which train of that file; default: the first")
    add("--tracks", type=lambda words: words.split(","), metavar="ID,…", help="RailJSON: tracks in "
        "running order; --tracks=-ID runs one backwards")  # fmt: skip
    add("--from-m", type=float, default=0.0, help="RailJSON: first stop along the tracks, m")
    add("--to-m", type=float, help="RailJSON: next stop along the tracks, m")
    add("--codes", type=_times, metavar="KM/H,…", help="RailJSON: codes; default: fixed blocks")
    add("--out", type=Path, required=True, metavar="FILE", help="section file to write")

    add = commands.add("animate", "both trains with their codes, as HTML", _animate).add_argument
    add("section", help=_SECTION)
    add("--second-run", type=float, required=True, help="run time of the second train, s")
    add("--front-run", type=float, required=True, help="run time of the train in front, s")
    add("--dwell", type=float, help="dwell of the train in front, s; default: the section's mean")
    add("--interval", type=float, help="departure interval, s; default: the shortest")
    add("--out", type=Path, required=True, metavar="FILE", help="HTML file to write")


def _times(words: str) -> list[float]:
    return sorted(float(word) for word in words.split(","))


def _clock(words: str) -> float:
    """Seconds from ``H:MM:SS``, ``H:MM`` or plain seconds."""
    parts = [float(part) for part in words.split(":")]
    if len(parts) > 3 or any(part < 0 for part in parts):
        raise argparse.ArgumentTypeError(f"{words} is no time; expected H:MM:SS or seconds")
    if len(parts) == 1:
        return parts[0]
    return sum(part * unit for part, unit in zip(parts, (3600.0, 60.0, 1.0), strict=False))


def _find_table(name: str) -> Characteristic:
    if name in PUBLISHED:
        return PUBLISHED[name]
    return read_csv(name) if name.endswith(".csv") else characteristic(find_section(name))


def _characteristic(arguments: argparse.Namespace) -> Result:
    section = find_section(arguments.section)
    dwell = section.dwell.mean_s if arguments.dwell is None else arguments.dwell
    if arguments.probability is not None:
        if arguments.dwell is not None:
            raise DomainError("--probability", arguments.probability, "no --dwell beside it")
        dwell = section.dwell.quantile_s(arguments.probability)
    check_range("dwell_s", dwell, 0.0, 86_400.0, "s")
    times, fresh = arguments.run_times, True
    if arguments.store:
        with Store(arguments.store) as store:
            table, fresh = store.characteristic(section, times)
    else:
        table = characteristic(section, times)
    pair = Succession(section)
    second, first = float(table.second_s[0]), float(table.first_s[-1])
    blocks, critical = stairway(pair, second, first, dwell)
    written = _write(arguments, table, pair, dwell)
    linear_from = float(np.nanmax(table.linear_from_s))
    work = {f"{time:g}": pair.run(time).work_jpkg for time in table.second_s.tolist()}
    document = {
        "section": section.name,
        "hash": content_hash(section),
        "dwell_s": dwell,
        "linear_from_dwell_s": linear_from,
        "shortest_run_s": pair.regulator.shortest_s,
        "computed": fresh,
        "intervals": table.rows(dwell),
        "traction_work_j_per_kg": work,
        "stairway": {"run_s": second, "front_run_s": first, "critical": critical, "blocks": blocks},
        "files": written,
    }
    text = "\n".join(
        [
            as_text(table, dwell),
            f"exactly linear for dwells from {linear_from:.1f} s",
            f"critical for T(n) = {second:g} s behind T(n-1) = {first:g} s: {critical.name}",
            *(f"wrote {file}" for file in written),
        ]
    )
    return Result(document, text)


def _write(
    arguments: argparse.Namespace, table: Characteristic, pair: Succession, dwell: float
) -> list[str]:
    written: list[str] = []
    if arguments.csv:
        write_csv(table, arguments.csv, dwell)
        written.append(str(arguments.csv))
    if arguments.parquet:
        write_parquet(table, arguments.parquet, dwell)
        written.append(str(arguments.parquet))
    if arguments.plots:
        arguments.plots.mkdir(parents=True, exist_ok=True)
        second, first = float(table.second_s[0]), float(table.first_s[-1])
        interval = pair.interval(second, first).at(dwell)
        pictures = {
            "heat-map": draw.heat_map(table, dwell),
            "surface": draw.surface(table, dwell),
            "time-distance": draw.time_distance(pair, second, first, dwell, interval),
            "speed-distance": draw.speed_distance(pair, second, first, dwell, interval),
        }
        for name, svg in pictures.items():
            file = arguments.plots / f"{name}.svg"
            file.write_text(svg, encoding="utf-8")
            written.append(str(file))
    return written


def _order_text(order: Order) -> list[str]:
    lines = []
    for trial in order.trials:
        sign, word = (">=", "feasible") if trial.feasible else ("<", "not feasible")
        lines.append(
            f"run time {trial.run_s:g} s needs {trial.required_s:.1f} s: "
            f"{order.interval_s:.1f} s {sign} {trial.required_s:.1f} s, {word}"
        )
    return lines


def _check(arguments: argparse.Namespace) -> Result:
    actual = arguments.planned_departure if arguments.departure is None else arguments.departure
    order = choose_run_time(
        _find_table(arguments.table),
        arguments.front_run,
        arguments.planned_run,
        actual - arguments.front_departure,
        max(0.0, actual - arguments.planned_departure),
        arguments.front_dwell,
        arguments.front_delay,
    )
    lines = _order_text(order)
    if order.feasible:
        lines.append(f"order {order.run_s:g} s; {order.delay_left_s:.1f} s late on arrival")
    else:
        lines.append(
            f"no allowed run time is feasible: hold the train {order.hold_s:.1f} s, then order "
            f"{order.run_s:g} s; {order.delay_left_s:.1f} s late on arrival"
        )
    return Result({"order": order}, "\n".join(lines), order.feasible)


def _line(arguments: argparse.Namespace) -> Result:
    line = load_line(arguments.line)
    passages = regulate(line)
    held = [item for item in passages if item.order is not None and not item.order.feasible]
    rows: list[dict[str, Any]] = [
        {
            "train": line.trains[item.train].name or str(item.train + 1),
            "section": line.tables[item.section].name,
            "depart_s": item.depart_s,
            "arrive_s": item.arrive_s,
            "run_s": item.arrive_s - item.depart_s,
            "late_s": item.late_s,
            "hold_s": item.order.hold_s if item.order else 0.0,
            "required_s": item.order.required_s if item.order else None,
            "tried_s": [trial.run_s for trial in item.order.trials] if item.order else [],
        }
        for item in passages
    ]
    text = [
        f"{'train':<12}{'section':<24}{'leaves':>9}{'runs':>8}{'arrives':>9}{'late':>7}{'hold':>7}"
    ]
    text += [
        f"{row['train']:<12}{row['section'][:22]:<24}{row['depart_s']:>9.1f}{row['run_s']:>8.1f}"
        f"{row['arrive_s']:>9.1f}{row['late_s']:>7.1f}{row['hold_s']:>7.1f}"
        for row in rows
    ]
    text.append(f"{len(held)} of {len(passages)} departures had to be held")
    return Result({"passages": rows, "held": len(held)}, "\n".join(text), not held)


def _calibrate(arguments: argparse.Namespace) -> Result:
    if arguments.table in PUBLISHED:
        table = PUBLISHED[arguments.table]
    else:
        table = read_csv(arguments.table)
    fixed: dict[str, Any] = {}
    for item in arguments.fix:
        name, _, value = item.partition("=")
        try:
            fixed[name] = float(value)
        except ValueError:
            raise FileError(f"--fix {item}: expected NAME=VALUE with a number") from None
        if name not in BOUNDS:
            raise FileError(f"--fix {item}: {name} is none of {', '.join(BOUNDS)}")
    bounds = {name: pair for name, pair in BOUNDS.items() if name not in fixed}
    found = calibrate(
        table,
        bounds,
        Unknowns(**fixed),
        tuple(arguments.codes or METRO_CODES_KMH),
        seed=arguments.seed,
        generations=arguments.generations,
        name=arguments.out.stem if arguments.out else "calibrated",
    )
    if arguments.out:
        save_section(found.section, arguments.out, f"Fitted to {table.name}: {found.rms_s:.2f} s")
    lines = [
        f"RMS residual {found.rms_s:.2f} s over {int(np.sum(~np.isnan(found.residual_s)))} "
        f"intervals of {table.name} ({found.evaluations} characteristics, seed {found.seed})"
    ]
    lines += [
        f"  {item.name:<20}{item.value:>10.3f}   in {item.low:g} … {item.high:g}; equally good "
        f"{item.equally_good[0]:.3g} … {item.equally_good[1]:.3g}: {item.verdict}"
        for item in found.estimates
    ]
    estimates = [
        {
            "name": item.name,
            "value": item.value,
            "bounds": (item.low, item.high),
            "spread": item.spread,
            "equally_good": item.equally_good,
            "verdict": item.verdict,
        }
        for item in found.estimates
    ]
    document = {
        "rms_s": found.rms_s,
        "residual_s": found.residual_s,
        "estimates": estimates,
        "evaluations": found.evaluations,
        "seed": found.seed,
        "file": str(arguments.out) if arguments.out else None,
    }
    return Result(document, "\n".join(lines))


def _convert(arguments: argparse.Namespace) -> Result:
    stock = None
    if arguments.train is not None:
        stock = railtoolkit_train(arguments.train, arguments.train_id)
    if arguments.tracks is None:
        section = railtoolkit_path(arguments.source, arguments.path, stock)
    elif arguments.to_m is None:
        raise DomainError("--to-m", "missing", "the next stop along the tracks, m")
    else:
        ends = arguments.from_m, arguments.to_m
        codes = tuple(arguments.codes or ())
        section = osrd_section(arguments.source, arguments.tracks, *ends, stock, steps_kmh=codes)
    save_section(section, arguments.out, f"Converted from {arguments.source.name}")
    shortest = Succession(section).regulator.shortest_s
    document = {
        "file": str(arguments.out),
        "section": section.name,
        "length_m": section.length_m,
        "shortest_run_s": shortest,
    }
    words = f"{section.length_m:.0f} m, shortest run time {shortest:.1f} s"
    return Result(document, f"wrote {arguments.out}: {section.name}, {words}")


def _animate(arguments: argparse.Namespace) -> Result:
    section = find_section(arguments.section)
    dwell = section.dwell.mean_s if arguments.dwell is None else arguments.dwell
    pair = Succession(section)
    shortest = pair.interval(arguments.second_run, arguments.front_run).at(dwell)
    interval = shortest if arguments.interval is None else arguments.interval
    page = animation(pair, arguments.second_run, arguments.front_run, dwell, interval)
    arguments.out.write_text(page, encoding="utf-8")
    document = {"file": str(arguments.out), "interval_s": interval, "shortest_s": shortest}
    words = "meets a restrictive code" if interval < shortest - 1e-6 else "meets none"
    return Result(
        document,
        f"wrote {arguments.out}: at {interval:.1f} s (shortest {shortest:.1f} s) the second train "
        f"{words}",
    )
