"""Section files: YAML in and out, with the place in the file in every complaint.

A section file is a mapping with the keys of :class:`~railops.headway.section.Section`, with
``gradients`` and ``curves`` of the line beside them and the kind of protection named:

    name: Example
    length_m: 1700
    gradients: [[0, 0.0], [300, -0.02], [600, 0.0]]     # position m, rise over run
    limits_kmh: [[0, 80]]
    run_times_s: {from: 115, to: 130, step: 5}           # or a list
    dwell: {mean_s: 20, std_s: 3}
    stock: {length_m: 120, effort: {accel_mps2: 1.0, power_w_per_kg: 12}, brake_mps2: 0.9}
    protection:
      kind: track_circuits                               # fixed_block, moving_block
      circuits: [[-150, 30], [30, 180], [180, 330]]
      steps_kmh: [0, 40, 60, 70, 80]
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from railops.errors import DomainError, FileError
from railops.files import parse_yaml
from railops.headway.protection import FixedBlock, MovingBlock, Protection, TrackCircuits
from railops.headway.section import Dwell, Section
from railops.headway.stock import Stock
from railops.traction import Davis, Effort, Line

KINDS: Mapping[str, type[Protection]] = {
    "track_circuits": TrackCircuits,
    "fixed_block": FixedBlock,
    "moving_block": MovingBlock,
}
Marks = dict[str, int]


def load_yaml(path: str | Path) -> tuple[dict[str, Any], Marks]:
    """Read a YAML mapping and the line each of its places is on (``"a.b[2]"`` → line)."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        data, root = parse_yaml(text)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FileError(f"cannot read {path}: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise FileError(f"{path} must hold a mapping, such as length_m: 1700")
    marks: Marks = {}
    _mark(root, "", marks)
    return data, marks


def _mark(node: Any, place: str, marks: Marks) -> None:
    marks[place] = node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            _mark(value, f"{place}.{key.value}" if place else str(key.value), marks)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            _mark(value, f"{place}[{index}]", marks)


class Reader:
    """Builds dataclasses from a mapping and knows where in the file it is."""

    def __init__(self, path: str | Path, marks: Marks) -> None:
        self.path, self.marks = path, marks

    def error(self, place: str, message: str) -> FileError:
        """An error that names the file, the line and the place."""
        known = place
        while known and known not in self.marks:  # the nearest place that is in the file
            cut = max(known.rfind("."), known.rfind("["))
            known = known[:cut] if cut > 0 else ""
        line = f", line {self.marks[known]}" if known in self.marks else ""
        return FileError(f"{self.path}{line}: {message}")

    def build(self, kind: Callable[..., Any], data: Any, place: str) -> Any:
        """Call ``kind`` with the mapping's values; unknown and missing keys are errors."""
        where = f"{place}: " if place else ""
        if not isinstance(data, dict):
            raise self.error(place, f"{where}expected a mapping, not {data!r}")
        taken = fields(kind)  # type: ignore[arg-type]  # always a dataclass
        known: dict[str, Field[Any]] = {item.name: item for item in taken if item.init}
        for key in data:
            if key not in known:
                inside = f"{place}.{key}" if place else str(key)
                raise self.error(inside, f"{where}unknown key {key!r}; known: {sorted(known)}")
        for name, item in known.items():
            needed = item.default is MISSING and item.default_factory is MISSING
            if needed and name not in data:
                raise self.error(place, f"{where}{name} is missing")
        return self.call(place, lambda: kind(**{key: _frozen(v) for key, v in data.items()}))

    def call(self, place: str, make: Callable[[], Any]) -> Any:
        """Run ``make`` and put the place in front of what it complains about."""
        try:
            return make()
        except DomainError as error:
            inside = error.name.split(" ")[0]
            whole = f"{place}.{inside}" if place else inside
            prefix = f"{place}." if place and not str(error).startswith(place) else ""
            raise self.error(whole, f"{prefix}{error}") from error
        except (TypeError, ValueError, OverflowError) as error:
            raise self.error(place, f"{place}: {error}" if place else str(error)) from error


def _frozen(value: Any) -> Any:
    """Lists as tuples, so that everything built is hashable and comparable."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def load_section(path: str | Path) -> Section:
    """Read a section file.

    Raises:
        FileError: if it cannot be read, or a value is wrong; the message names the line.
    """
    data, marks = load_yaml(path)
    return section_from(data, Reader(path, marks))


def section_from(data: Mapping[str, Any], reader: Reader, place: str = "") -> Section:
    """Build a section from the mapping of a section file."""

    def at(key: str) -> str:
        return f"{place}.{key}" if place else key

    values = dict(data)
    pieces = {key: values.pop(key) for key in ("gradients", "curves") if key in values}
    if pieces:
        values["line"] = reader.call(
            place, lambda: Line(**{key: _frozen(value) for key, value in pieces.items()})
        )
    if isinstance(values.get("run_times_s"), dict):
        values["run_times_s"] = _run_times(values["run_times_s"], reader, at("run_times_s"))
    if "dwell" in values:
        values["dwell"] = reader.build(Dwell, values["dwell"], at("dwell"))
    if "stock" in values:
        values["stock"] = _stock(values["stock"], reader, at("stock"))
    if "protection" in values:
        values["protection"] = _protection(values["protection"], reader, at("protection"))
    if "name" not in values:
        values["name"] = Path(reader.path).stem
    section: Section = reader.build(Section, values, place)
    return section


def _run_times(data: dict[str, Any], reader: Reader, place: str) -> list[float]:
    if set(data) != {"from", "to", "step"}:
        raise reader.error(place, f"{place}: expected a list of s, or from, to and step")
    first, last, step = (data[key] for key in ("from", "to", "step"))
    if not all(isinstance(value, (int, float)) for value in (first, last, step)) or not step > 0:
        raise reader.error(place, f"{place}: from, to and step must be numbers, the step positive")
    steps = reader.call(place, lambda: (last - first) / step + 1e-9)
    if not 0.0 <= steps < 1000.0:
        raise reader.error(place, f"{place}: from, to and step give {steps + 1.0:.0f} run times")
    count = math.floor(steps) + 1
    return [float(first + step * index) for index in range(count)]


def _stock(data: Any, reader: Reader, place: str) -> Stock:
    if isinstance(data, dict):
        parts: dict[str, type] = {"effort": Effort, "davis": Davis}
        data = {
            key: reader.build(parts[key], value, f"{place}.{key}") if key in parts else value
            for key, value in data.items()
        }
    stock: Stock = reader.build(Stock, data, place)
    return stock


def _protection(data: Any, reader: Reader, place: str) -> Protection:
    kind = data.get("kind") if isinstance(data, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise reader.error(place, f"{place}.kind is {kind!r}; expected one of {sorted(KINDS)}")
    rest = {key: value for key, value in data.items() if key != "kind"}
    protection: Protection = reader.build(KINDS[kind], rest, place)
    return protection


def plain(section: Section) -> dict[str, Any]:
    """The section as the mapping of a section file, complete and in a fixed order."""
    values: dict[str, Any] = _plain(section)
    line = values.pop("line")
    kind = next(name for name, kind in KINDS.items() if isinstance(section.protection, kind))
    protection = {"kind": kind}
    for key, value in values["protection"].items():
        if value != []:  # of codes and steps_kmh one is empty
            protection[key] = value
    return {
        "name": section.name,
        **{key: value for key, value in values.items() if key != "name"},
        "gradients": line["gradients"],
        "curves": line["curves"],
        "protection": protection,
    }


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value) if item.init}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def save_section(section: Section, path: str | Path, note: str = "") -> None:
    """Write a section file that :func:`load_section` reads back to an equal section."""
    head = "".join(f"# {line}\n" for line in note.splitlines())
    body = yaml.safe_dump(plain(section), sort_keys=False, default_flow_style=None, width=96)
    Path(path).write_text(head + body, encoding="utf-8")


def content_hash(section: Section) -> str:
    """SHA-256 of everything that decides the characteristic; the name does not.

    Example:
        >>> content_hash(Section(1500.0, name="a")) == content_hash(Section(1500.0, name="b"))
        True
        >>> content_hash(Section(1500.0)) == content_hash(Section(1500.5))
        False
    """
    values = {
        key: value
        for key, value in plain(section).items()
        if key not in ("name", "run_times_s", "dwell")
    }
    text = json.dumps(values, sort_keys=True, default=float)
    return hashlib.sha256(text.encode()).hexdigest()


def builtin_sections() -> dict[str, Path]:
    """Names and files of the sections that come with the package."""
    folder = Path(__file__).parent / "sections"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def find_section(name: str) -> Section:
    """A section by the name of a built-in one or by file."""
    known = builtin_sections()
    if name not in known and not Path(name).exists():
        raise FileError(f"there is no section file {name}; built in are {sorted(known)}")
    return load_section(known.get(name, Path(name)))
