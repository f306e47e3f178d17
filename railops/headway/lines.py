"""Line files: the sections of a line and the trains that run over it.

sections: [moscow, station-b.yaml]      # built-in, files beside this one, or CSV tables
trains:
  - {name: "101", depart_s: 0, run_s: [150, 120], dwell_s: [20, 20]}
  - {name: "102", depart_s: 95, run_s: [150, 120], dwell_s: [20, 20], late_s: 5,
     dwell_delay_s: [3, 0]}
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from railops.headway.characteristic import Characteristic, characteristic
from railops.headway.control import Passage, Plan, regulate_line
from railops.headway.files import Reader, builtin_sections, load_section, load_yaml
from railops.headway.published import PUBLISHED
from railops.headway.tables import read_csv


@dataclass(frozen=True)
class LineFile:
    """A line: one characteristic per section, and the trains in the order they run."""

    tables: tuple[Characteristic, ...]
    trains: tuple[Plan, ...]


def load_line(path: str | Path) -> LineFile:
    """Read a line file.

    Raises:
        FileError: if it cannot be read, or a value is wrong; the message names the line.
    """
    data, marks = load_yaml(path)
    reader = Reader(path, marks)
    for key in ("sections", "trains"):
        if not isinstance(data.get(key), list) or not data[key]:
            raise reader.error(key, f"{key} is missing or no list")
    if unknown := sorted(set(data) - {"sections", "trains"}):
        raise reader.error(str(unknown[0]), f"unknown key {unknown[0]!r}; known: sections, trains")
    known = builtin_sections()
    tables = []
    for index, name in enumerate(data["sections"]):
        name, place = str(name), f"sections[{index}]"
        file = Path(path).parent / name
        if name in PUBLISHED:
            tables.append(PUBLISHED[name])
        elif name in known or file.is_file():
            found = known.get(name, file)
            table = read_csv if found.suffix == ".csv" else _computed
            tables.append(table(found))
        else:
            raise reader.error(place, f"{place}: no section {name!r}; built in: {sorted(known)}")
    trains = tuple(
        reader.build(Plan, train, f"trains[{index}]") for index, train in enumerate(data["trains"])
    )
    line = LineFile(tuple(tables), trains)
    reader.call("", lambda: regulate(line))  # wrong counts and run times are errors of the file
    return line


def _computed(path: Path) -> Characteristic:
    return characteristic(load_section(path))


def regulate(line: LineFile) -> list[Passage]:
    """Run the upper loop over the line."""
    return regulate_line(line.tables, line.trains)
