"""``railops ROOM COMMAND …``: one door for the decision rooms.

A room joins by one line in :data:`ROOMS`; its module is imported only when the room is asked for.
The module has a function ``add_commands(commands)``, which calls ``commands.add(name, help, run)``
for each command and adds arguments to the parser it returns; ``run(arguments)`` returns a
:class:`Result`. Everything else (``--json``, errors, exit status) is here: 0 done, 1 done but a
check failed, 2 bad input.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, NoReturn, Protocol, cast

from railops.errors import RailOpsError

# name: (module with add_commands, what `railops --help` says)
ROOMS: Mapping[str, tuple[str, str]] = {
    "braking": (
        "railops.braking.commands",
        "bounds on errors, stopping distances, and when to brake",
    ),
    "crossing": (
        "railops.crossing.commands",
        "collision avoidance at level crossings",
    ),
    "headway": (
        "railops.headway.commands",
        "shortest departure intervals of metro sections, and which run time to order",
    ),
    "pilot": (
        "railops.pilot.commands",
        "the pilot vehicle: its trip, its tracking, and what it is worth",
    ),
}


@dataclass(frozen=True)
class Result:
    """What a command found.

    Attributes:
        document: For ``--json``: mappings, sequences, dataclasses, numbers, strings.
        text: For people.
        passed: False if the command checked something and it failed (exit status 1).
    """

    document: Mapping[str, Any]
    text: str
    passed: bool = True


Run = Callable[[argparse.Namespace], Result]


class Room(Protocol):
    """What a room's command module offers."""

    def add_commands(self, commands: Commands) -> None:
        """Add the room's commands."""


class _Parser(argparse.ArgumentParser):
    """A parser whose complaint is one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, _one_line(f"{self.prog}: {message} (see --help)") + "\n")


class Commands:
    """The commands of one room."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._choices = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    def add(self, name: str, help: str, run: Run) -> argparse.ArgumentParser:
        """Add a command and return its parser for the arguments."""
        parser = self._choices.add_parser(
            name,
            help=help,
            description=help,
            formatter_class=argparse.ArgumentDefaultsHelpFormatter,
        )
        parser.add_argument("--json", action="store_true", help="print one JSON document")
        parser.set_defaults(run=run)
        return parser


def _one_line(words: str, most: int = 400) -> str:
    """A complaint on one line; what a file held in place of a number may be a megabyte long."""
    line = " ".join(words.split())
    return line if len(line) <= most else f"{line[: most - 100]} … {line[-97:]}"


def json_ready(value: Any) -> Any:
    """Plain JSON values; what JSON lacks (infinity, NaN) becomes null."""
    if is_dataclass(value) and not isinstance(value, type):
        return json_ready(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return json_ready(value.tolist())
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = _Parser(
        prog="railops", description="Railway decisions: braking and what builds on it."
    )
    rooms = parser.add_subparsers(dest="room", metavar="ROOM", required=True)
    given = list(sys.argv[1:] if arguments is None else arguments)
    for name, (module, about) in ROOMS.items():
        room_parser = rooms.add_parser(name, help=about, description=about)
        if given[:1] == [name]:
            room = cast(Room, importlib.import_module(module))
            room.add_commands(Commands(room_parser))
    try:
        parsed = parser.parse_args(given)
    except SystemExit as leave:  # --help and usage errors
        return int(leave.code or 0)
    try:
        result: Result = parsed.run(parsed)
    except (RailOpsError, OSError) as error:
        sentence = _one_line(f"railops {parsed.room} {parsed.command}: {error}")
        print(sentence, file=sys.stderr)
        return 2
    if parsed.json:
        print(json.dumps(json_ready(result.document), ensure_ascii=False, allow_nan=False))
    else:
        print(result.text)
    return 0 if result.passed else 1


if __name__ == "__main__":
    sys.exit(main())
