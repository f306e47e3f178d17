"""YAML files of settings: one mapping per dataclass, unknown keys refused."""

from __future__ import annotations

import contextlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_type_hints

import yaml

from railops.errors import DomainError, FileError

Kind = TypeVar("Kind")


class _Loader(yaml.SafeLoader):
    """The safe loader without aliases: ten lines of them can stand for a billion values."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]  # its stub has no types
            words = f"the alias *{event.anchor} is not followed here: write the value out"
            raise yaml.MarkedYAMLError(problem=words, problem_mark=event.start_mark)
        return super().compose_node(parent, index)


def parse_yaml(text: str) -> tuple[Any, yaml.Node | None]:
    """What a YAML text holds, as plain values and as nodes that know their lines.

    Raises:
        yaml.YAMLError: whatever is wrong with the text: aliases, a nesting too deep to follow,
            and tags on values they do not fit included.
    """
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        return (None if root is None else loader.construct_document(root)), root
    except RecursionError:
        raise yaml.YAMLError("it is nested too deeply") from None
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        # What the constructors raise for 2001-99-99, !!bool x, !!timestamp x and their like.
        raise yaml.YAMLError(f"a value is not of its kind ({error})") from error


def read_mapping(path: str | Path, what: str) -> dict[str, Any]:
    """Read a YAML file that holds a mapping; ``what`` names it in messages ("train file").

    Raises:
        FileError: if it cannot be read or holds something else.
    """
    try:
        data, _ = parse_yaml(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FileError(f"cannot read {what} {path}: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict):
        raise FileError(f"{what} {path} must hold a mapping")
    return data


def build(kind: type[Kind], data: Any, where: str) -> Kind:
    """Build a dataclass from a mapping, nested dataclasses from nested mappings.

    Args:
        kind: The dataclass.
        data: What the file holds.
        where: Names the place in messages ("train file train.yaml").

    Raises:
        FileError: if ``data`` is not a mapping, has unknown keys, misses one, or a value lies
            outside its range.
    """
    if not isinstance(data, dict):
        raise FileError(f"{where}: {kind.__name__} must be a mapping, not {data!r}")
    hints = get_type_hints(kind)
    known = [item.name for item in fields(cast(Any, kind)) if item.init]
    if unknown := sorted(set(map(str, data)) - set(known)):
        raise FileError(f"{where} has unknown keys {unknown}; known: {known}")
    values = {
        key: build(hints[key], value, f"{where}: {key}")
        if is_dataclass(hints[key])
        else _number(hints[key], value)
        for key, value in data.items()
    }
    try:
        return kind(**values)
    except DomainError as error:
        raise FileError(f"{where}: {error}") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise FileError(f"{where} is incomplete or mistyped: {error}") from error


def _number(kind: Any, value: Any) -> Any:
    """The value; as a number where YAML 1.1 takes one for text, as it does 1e-3 (not 1.0e-3)."""
    if kind is float and isinstance(value, str):
        with contextlib.suppress(ValueError):
            return float(value)
    return value


def plain(value: Any) -> Any:
    """Dataclasses as mappings and tuples as lists, the way YAML writes them."""
    if is_dataclass(value):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value) if item.init}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    return value


def write_mapping(path: str | Path, value: Any) -> None:
    """Write a dataclass as YAML that :func:`read_mapping` and :func:`build` read back."""
    Path(path).write_text(yaml.safe_dump(plain(value), sort_keys=False), encoding="utf-8")
