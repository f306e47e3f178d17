"""Read other formats where they map: railtoolkit paths and trains, OSRD RailJSON infrastructure.

What they do not hold (train protection for the one, dwell and run times for both) keeps the
defaults of :class:`~railops.headway.section.Section`; the caller replaces it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from railops.errors import FileError
from railops.headway.files import load_yaml
from railops.headway.protection import FixedBlock, TrackCircuits
from railops.headway.section import Section
from railops.headway.stock import Stock
from railops.traction import GRAVITY_MPS2, Davis, Effort, Line

KMH = 1.0 / 3.6


def _the_one(items: Any, key: str | None, what: str, path: str | Path) -> dict[str, Any]:
    """The item with an id, or the only one."""
    if not isinstance(items, list) or not items:
        raise FileError(f"{path} holds no {what}")
    if key is None:
        return dict(items[0])
    for item in items:
        if str(item.get("id")) == key:
            return dict(item)
    raise FileError(f"{path} has no {what} {key}; it has {[str(i.get('id')) for i in items]}")


def railtoolkit_path(
    path: str | Path, key: str | None = None, stock: Stock | None = None
) -> Section:
    """Read a railtoolkit running path (schema 2022.05 to 2024.07).

    The path's characteristic sections give limits (km/h) and resistance (‰, taken as a gradient);
    the section runs from the first position to the last. Characteristic sections may be lists
    [position, speed, resistance], mappings with ``position``, or a mapping by position; what one
    of them leaves out holds on.

    Args:
        path: The YAML file.
        key: Id of the path; default: the first.
        stock: Rolling stock; default: the default metro train.

    Raises:
        FileError: if the file cannot be read as such a path.
    """
    data, _ = load_yaml(path)
    chosen = _the_one(data.get("paths"), key, "path", path)
    rows = _characteristic_sections(chosen.get("characteristic_sections"), path)
    start, end = rows[0][0], rows[-1][0]
    limits = tuple((at - start, speed) for at, speed, _ in rows[:-1] if speed > 0.0)
    gradients = tuple(
        (at - start, math.tan(math.asin(1e-3 * permille))) for at, _, permille in rows[:-1]
    )
    return Section(
        end - start,
        stock=stock or Stock(),
        line=Line(gradients),
        limits_kmh=limits,
        name=str(chosen.get("name") or chosen["id"]),
    )


def _characteristic_sections(value: Any, path: str | Path) -> list[tuple[float, float, float]]:
    if isinstance(value, dict):
        value = [{"position": at, **(rest or {})} for at, rest in value.items()]
    rows: list[tuple[float, float, float]] = []
    speed, resistance = math.nan, 0.0
    for index, item in enumerate(value or []):
        try:
            if isinstance(item, dict):
                at = float(item["position"])
                speed = float(item.get("speed", speed))
                resistance = float(item.get("resistance", resistance))
            else:
                at, speed, resistance = (float(number) for number in item)
        except (KeyError, TypeError, ValueError):
            raise FileError(
                f"{path}: characteristic_sections[{index}] is {item!r}; expected position (m), "
                "speed (km/h) and resistance (‰)"
            ) from None
        rows.append((at, speed, resistance))
    if len(rows) < 2 or math.isnan(rows[0][1]):
        raise FileError(f"{path}: a path needs two characteristic sections, the first with a speed")
    return sorted(rows)


def railtoolkit_train(path: str | Path, key: str | None = None) -> Stock:
    """Read a railtoolkit train made of vehicles with tractive efforts, or simplified.

    Masses in t, speeds in km/h, forces in N as in the 2022.05 examples, resistances in ‰ of the
    weight with the speed scale of 100 km/h. Traction is fitted as constant effort up to constant
    power, through the effort at standstill and the median power above half the highest speed.

    Raises:
        FileError: if the file cannot be read as such a train.
    """
    data, _ = load_yaml(path)
    train = _the_one(data.get("trains"), key, "train", path)
    try:
        if "simplified_characteristics" in train:
            simple = train["simplified_characteristics"]
            accel = float(simple["acceleration"])
            power = accel * 0.6 * float(simple["speed_limit"]) * KMH
            coasting = -float(simple.get("coasting", 0.0))
            return Stock(
                float(simple["length"]),
                Effort(accel + coasting, power),
                Davis(coasting, 0.0, 0.0),
                rotating=0.0,
                brake_mps2=-float(simple["deceleration"]),
            )
        vehicles = {str(item["id"]): item for item in data["vehicles"]}
        return _formation([vehicles[str(name)] for name in train["formation"]])
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(
            f"{path}: train {train.get('id')} lacks or mistypes {error}; needed are length, mass, "
            "tractive_effort and the resistances of its vehicles"
        ) from error


def _formation(vehicles: Sequence[dict[str, Any]]) -> Stock:
    mass_kg = 1e3 * sum(float(item["mass"]) for item in vehicles)
    share = [1e3 * float(item["mass"]) / mass_kg for item in vehicles]
    rotating = sum(
        part * (float(item.get("rotation_mass", 1.06)) - 1.0)
        for part, item in zip(share, vehicles, strict=True)
    )
    base, rolling, air = (
        sum(part * float(item.get(name, 0.0)) for part, item in zip(share, vehicles, strict=True))
        for name in ("base_resistance", "rolling_resistance", "air_resistance")
    )
    reference = 100.0 * KMH
    efforts = [np.array(v["tractive_effort"], float) for v in vehicles if "tractive_effort" in v]
    speeds = np.unique(np.concatenate([table[:, 0] for table in efforts])) * KMH
    force = sum(np.interp(speeds / KMH, table[:, 0], table[:, 1]) for table in efforts)
    inertia_kg = mass_kg * (1.0 + rotating)
    fast = speeds >= 0.5 * speeds[-1]
    power = float(np.median((speeds * force)[fast]))
    brakes = [-float(item["a_braking"]) for item in vehicles if "a_braking" in item]
    return Stock(
        sum(float(item["length"]) for item in vehicles),
        Effort(float(np.asarray(force)[0]) / inertia_kg, power / inertia_kg),
        Davis(
            1e-3 * GRAVITY_MPS2 * base,
            1e-3 * GRAVITY_MPS2 * rolling / reference,
            1e-3 * GRAVITY_MPS2 * air / reference**2,
        ),
        rotating,
        min(brakes, default=0.5),
    )


def osrd_section(
    path: str | Path,
    tracks: Sequence[str],
    start_m: float,
    end_m: float,
    stock: Stock | None = None,
    *,
    steps_kmh: tuple[float, ...] = (),
) -> Section:
    """Read a section from OSRD RailJSON infrastructure.

    The tracks are laid one after the other, each run from its begin to its end (a leading ``-``
    runs one backwards). Slopes (‰), curves (m), speed sections (m/s) and detectors along them are
    taken; detectors become the boundaries of fixed blocks, or of track circuits with derived codes.

    Args:
        path: The infrastructure file.
        tracks: Ids of the tracks in running order.
        start_m: Stopping point of the first station along them, m.
        end_m: Stopping point of the next, m.
        stock: Rolling stock; default: the default metro train.
        steps_kmh: Speed codes; with them the protection is track circuits.

    Raises:
        FileError: if the file cannot be read so, or names no such track.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        by_id = {str(item["id"]): item for item in data["track_sections"]}
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"cannot read {path} as RailJSON infrastructure: {error}") from error
    offset, slopes, curves, limits, detectors = -start_m, [], [], [], []
    total = 0.0
    for name in tracks:
        back, key = name.startswith("-"), name.removeprefix("-")
        if key not in by_id:
            raise FileError(f"{path} has no track {key}; it has {sorted(by_id)[:20]}")
        length = float(by_id[key]["length"])

        def along(begin: float, end: float) -> tuple[float, float]:
            if back:  # noqa: B023 — called within the same turn of the loop
                begin, end = length - end, length - begin  # noqa: B023
            return offset + begin, offset + end  # noqa: B023

        sign = -1.0 if back else 1.0
        for item in by_id[key].get("slopes", []):
            slopes.append((*along(item["begin"], item["end"]), sign * 1e-3 * item["gradient"]))
        for item in by_id[key].get("curves", []):
            curves.append((*along(item["begin"], item["end"]), abs(item["radius"]) or math.inf))
        for zone in data.get("speed_sections", []):
            speed = zone.get("speed_limit")
            for span in zone.get("track_ranges", []):
                if span["track"] == key and speed is not None:
                    limits.append((*along(span["begin"], span["end"]), speed / KMH))
        for item in data.get("detectors", []):
            if item["track"] == key:
                detectors.append(along(item["position"], item["position"])[0])
        offset += length
        total += length
    edges = sorted({-start_m, total - start_m, *detectors})
    cuts = tuple(pairwise(edges))
    section = Section(
        end_m - start_m,
        stock=stock or Stock(),
        line=Line(_profile(slopes, 0.0), _profile(curves, math.inf)),
        limits_kmh=_profile(limits, 80.0, least=True),
        name=Path(path).stem,
    )
    if steps_kmh:
        return replace(section, protection=TrackCircuits(cuts, steps_kmh=steps_kmh))
    return replace(section, protection=FixedBlock(cuts))


def _profile(
    spans: Sequence[tuple[float, float, float]], rest: float, *, least: bool = False
) -> tuple[tuple[float, float], ...]:
    """(begin, end, value) spans as a step function with ``rest`` in between."""
    edges = sorted({0.0, *(a for a, _, _ in spans), *(b for _, b, _ in spans)})
    steps: list[tuple[float, float]] = []
    for edge in edges:
        over = [value for a, b, value in spans if a <= edge < b]
        value = (min(over) if least else over[-1]) if over else rest
        if not steps or steps[-1][1] != value:
            steps.append((edge, value))
    return tuple(steps)
