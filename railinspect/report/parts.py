"""Parts of every page: the document that loads nothing, cards, pictures, counts and ranges."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

from railinspect.report.style import style_sheet


def document(title: str, body: str) -> str:
    """A whole page around its body; the title is escaped, the body is HTML already."""
    # The policy forbids every load but inline style and what the page embeds: no network, provably.
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; media-src data:; style-src 'unsafe-inline'\">"
        f"<title>{escape(title)}</title><style>{style_sheet()}</style></head>"
        f"<body><main>{body}</main></body></html>\n"
    )


def cards_of(cards: Iterable[tuple[str, str]]) -> str:
    """A row of cards, each a value (escaped) over what it is."""
    inner = "".join(
        f'<div class="card"><b>{escape(value)}</b><span>{label}</span></div>'
        for value, label in cards
    )
    return f'<div class="cards">{inner}</div>'


def count_of(number: int, noun: str) -> str:
    r"""A number with its noun.

    Example:
        >>> count_of(1, "frame"), count_of(12000, "frame").replace("\u202f", " ")
        ('1 frame', '12 000 frames')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}".replace(",", "\u202f")


def picture(jpeg: bytes, label: str) -> str:
    """A JPEG embedded in the page."""
    return f'<img alt="{escape(label, quote=True)}" src="{_data("image/jpeg", jpeg)}">'


def clip(mp4: bytes, poster_jpeg: bytes | None, label: str) -> str:
    """A film embedded in the page, with the picture shown before it is played."""
    poster = f' poster="{_data("image/jpeg", poster_jpeg)}"' if poster_jpeg else ""
    return (
        f'<video controls muted loop preload="metadata" aria-label="{escape(label, quote=True)}"'
        f'{poster} src="{_data("video/mp4", mp4)}"></video>'
    )


def _data(media_type: str, data: bytes) -> str:
    return f"data:{media_type};base64,{base64.b64encode(data).decode('ascii')}"


def range_cell(range_m: float | None, bounds: Sequence[float | None] | None) -> str:
    """A range with its interval, both in metres."""
    if range_m is None:
        return "–<small>no reliable range</small>"
    if bounds is None or bounds[0] is None or bounds[1] is None:
        return f"{range_m:.1f} m"
    return f"{range_m:.1f} m<small>{bounds[0]:.1f} to {bounds[1]:.1f} m</small>"


def table(table_id: str, heads: Sequence[str], rows: Iterable[Sequence[str]], empty: str) -> str:
    """A table; the cells are HTML already. Without rows it says ``empty``."""
    head = "".join(f"<th>{name}</th>" for name in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    body = body or f'<tr><td colspan="{len(heads)}">{empty}</td></tr>'
    return (
        f'<div class="scroll"><table id="{table_id}"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )
