"""Read other formats where they map: railtoolkit paths and trains, OSRD RailJSON infrastructure.

What they do not hold (train protection for the one, dwell and run times for both) keeps the
defaults of :class:`~railops.headway.section.Section`; the caller replaces it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from railops.errors import DomainError, FileError
from railops.headway.files import load_yaml
from railops.headway.protection import FixedBlock, TrackCircuits
from railops.headway.section import Section
from railops.headway.stock import Stock
from railops.traction import GRAVITY_MPS2, Davis, Effort, Line

KMH = 1.0 / 3.6


@contextmanager
def _reading(path: str | Path, what: str) -> Iterator[None]:
    """Whatever goes wrong inside is said of ``what`` in this file, in one sentence."""
    try:
        yield
    except FileError:
        raise
    except KeyError as error:
        raise FileError(f"{path}: {what} lacks {error}") from error
    except DomainError as error:
        raise FileError(f"{path}: {what}: {error}") from error
    except (TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise FileError(f"{path}: {what} is mistyped: {error}") from error


def _the_one(items: Any, key: str | None, what: str, path: str | Path) -> dict[str, Any]:
    """The item with an id, or the only one."""
    if not isinstance(items, list) or not items:
        raise FileError(f"{path} holds no {what}")
    if not all(isinstance(item, dict) for item in items):
        raise FileError(f"{path}: every {what} must be a mapping")
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
    with _reading(path, f"path {chosen.get('id')}"):
        gradients = tuple(
            (at - start, math.tan(math.asin(1e-3 * permille))) for at, _, permille in rows[:-1]
        )
        return Section(
            end - start,
            stock=stock or Stock(),
            line=Line(gradients),
            limits_kmh=tuple((at - start, speed) for at, speed, _ in rows[:-1]),
            name=str(chosen.get("name") or chosen["id"]),
        )


def _characteristic_sections(value: Any, path: str | Path) -> list[tuple[float, float, float]]:
    with _reading(path, "characteristic_sections"):
        if isinstance(value, dict):
            value = [{"position": at, **(rest or {})} for at, rest in value.items()]
        items = list(value or [])
    rows: list[tuple[float, float, float]] = []
    speed, resistance = math.nan, 0.0
    for index, item in enumerate(items):
        try:
            if isinstance(item, dict):
                at = float(item["position"])
                speed = float(item.get("speed", speed))
                resistance = float(item.get("resistance", resistance))
            else:
                at, speed, resistance = (float(number) for number in item)
        except (KeyError, TypeError, ValueError, OverflowError):
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
    with _reading(path, f"train {train.get('id')}"):
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
    if not (np.isfinite(speeds).all() and np.isfinite(force).all()):
        raise ValueError("tractive_effort holds no pairs of speed in km/h and force in N")
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
    runs one backwards). Slopes (‰), curves (m), detectors, and the speed sections (m/s) that apply
    in the running direction are taken; 80 km/h holds where there is none. Detectors become the
    boundaries of fixed blocks, or of track circuits with derived codes.

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
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileError(f"cannot read {path} as RailJSON infrastructure: {error}") from error
    laid, total = [], 0.0
    for name in tracks:
        key = name.removeprefix("-")
        if key not in by_id:
            raise FileError(f"{path} has no track {key}; it has {sorted(by_id)[:20]}")
        with _reading(path, f"track {key}"):
            length = float(by_id[key]["length"])
            laid.append(_Laid(by_id[key], total - start_m, length, key != name))
        total += length
    slopes, curves, limits, detectors = [], [], [], []
    for track in laid:
        with _reading(path, f"track {track.item['id']}"):
            for item in track.item.get("slopes", ()):
                slopes.append((*track.span(item), track.sign * 1e-3 * float(item["gradient"])))
            for item in track.item.get("curves", ()):
                curves.append((*track.span(item), abs(float(item["radius"])) or math.inf))
        with _reading(path, "speed_sections"):
            for zone in data.get("speed_sections", ()):
                for item in zone.get("track_ranges", ()):
                    if zone.get("speed_limit") is not None and track.concerned(item):
                        limits.append((*track.span(item), float(zone["speed_limit"]) / KMH))
        with _reading(path, "detectors"):
            for item in data.get("detectors", ()):
                if item["track"] == track.item["id"]:
                    detectors.append(track.place(float(item["position"])))
    with _reading(path, f"the section from {start_m:g} m to {end_m:g} m along {list(tracks)}"):
        cuts = tuple(pairwise(sorted({-start_m, total - start_m, *detectors})))
        return Section(
            end_m - start_m,
            TrackCircuits(cuts, steps_kmh=steps_kmh) if steps_kmh else FixedBlock(cuts),
            stock or Stock(),
            Line(_profile(slopes, 0.0), _profile(curves, math.inf)),
            _profile(limits, 80.0, least=True),
            name=Path(path).stem,
        )


class _Laid(NamedTuple):
    """A track laid into the section: where it begins, and whether it is run backwards."""

    item: dict[str, Any]
    from_m: float
    length_m: float
    backwards: bool

    @property
    def sign(self) -> float:
        """Of its gradients."""
        return -1.0 if self.backwards else 1.0

    def place(self, position_m: float) -> float:
        """A position on the track as one in the section, m."""
        return self.from_m + (self.length_m - position_m if self.backwards else position_m)

    def span(self, item: dict[str, Any]) -> tuple[float, float]:
        """An item's begin and end in the section, in running order, m."""
        ends = self.place(float(item["begin"])), self.place(float(item["end"]))
        return min(ends), max(ends)

    def concerned(self, item: dict[str, Any]) -> bool:
        """Whether a track range is on this track and applies in the running direction."""
        against = "START_TO_STOP" if self.backwards else "STOP_TO_START"
        return item["track"] == self.item["id"] and item.get("applicable_directions") != against


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
