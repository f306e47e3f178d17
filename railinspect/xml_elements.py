"""Reading the elements that matter from a large XML file nobody vouches for.

The file is read in pieces and only the elements asked for are kept, one at a time. A document type
is refused before anything it declares is looked at, so no entity is ever expanded and nothing is
ever fetched.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NoReturn
from xml.etree import ElementTree

from railinspect.errors import BadInputError

MAX_BYTES: Final = 1 << 30
"""Larger files are refused."""

MAX_ELEMENT_CHARS: Final = 32_000_000
"""Text and attributes that one element may hold."""

MAX_DEPTH: Final = 64
"""Deeper nesting is refused."""

_PIECE: Final = 1 << 16


class _RefusedError(Exception):
    """Raised inside the parser's callbacks; carries what is wrong."""


class _Wanted:
    """A parser's target that keeps whole elements of some names and forgets the rest."""

    def __init__(self, names: frozenset[str]) -> None:
        self.root: str | None = None
        self.ready: list[ElementTree.Element] = []
        self._names = names
        self._depth = 0
        self._opened_at = 0
        self._chars = 0
        self._builder: ElementTree.TreeBuilder | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        name = _local(tag)
        self.root = self.root or name
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise _RefusedError(f"nests elements more than {MAX_DEPTH} deep")
        if self._builder is None:
            if name not in self._names:
                return
            self._builder, self._opened_at, self._chars = ElementTree.TreeBuilder(), self._depth, 0
        self._count(len(name) + sum(len(k) + len(v) for k, v in attributes.items()))
        self._builder.start(name, attributes)

    def data(self, text: str) -> None:
        if self._builder is not None:
            self._count(len(text))
            self._builder.data(text)

    def end(self, tag: str) -> None:
        if self._builder is not None:
            self._builder.end(_local(tag))
            if self._depth == self._opened_at:
                self.ready.append(self._builder.close())
                self._builder = None
        self._depth -= 1

    def doctype(self, *_: object) -> NoReturn:
        raise _RefusedError("declares a document type, which these files have no use for")

    def close(self) -> None:
        """Nothing is left to give."""

    def _count(self, chars: int) -> None:
        self._chars += chars
        if self._chars > MAX_ELEMENT_CHARS:
            raise _RefusedError("has an element of more than 32 million characters")


def _local(tag: str) -> str:
    """An element's name without its namespace, which differs between versions of a format."""
    return tag.rpartition("}")[2]


def read_elements(
    path: Path, root: str, names: tuple[str, ...], what: str, kind: str
) -> Iterator[ElementTree.Element]:
    """The elements of some names, in the order they end, wherever they lie in the file.

    Args:
        path: The file.
        root: Name its outermost element must have.
        names: Names of the elements wanted, without namespace; one inside another comes with it.
        what: What the file is to the user, for messages, such as ``positions ride.gpx``.
        kind: What it should be, such as ``a GPX file``.

    Raises:
        BadInputError: if the file cannot be read, is larger than 1 GiB, is no well-formed XML,
            declares a document type, nests deeper than 64 elements, or has another root.
    """
    target = _Wanted(frozenset(names))
    parser = ElementTree.XMLParser(target=target)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInputError(f"{what} is larger than 1 GiB; give {kind} cut into parts")
        with path.open("rb") as file:
            while piece := file.read(_PIECE):
                parser.feed(piece)
                if target.root not in (None, root):
                    raise BadInputError(f"{what} is not {kind}: its root is <{target.root}>")
                yield from target.ready
                target.ready.clear()
            parser.close()
    except OSError as error:
        raise BadInputError(f"cannot read {what}: {error.strerror or error}") from error
    except _RefusedError as error:
        raise BadInputError(f"{what} {error}; {kind} needs none of that") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        if isinstance(error, BadInputError):
            raise
        raise BadInputError(f"{what} is not {kind}: {error}") from error
    yield from target.ready
