"""A few SVG shapes and a pair of axes: all that the pictures of this room need."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.sax.saxutils import escape

INK, GRID = "#222831", "#d9dde3"
# Five points of the perceptually even viridis scale.
_SCALE = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))


def colour(part: float) -> str:
    """A colour of the scale for 0 … 1."""
    place = min(max(part, 0.0), 1.0) * (len(_SCALE) - 1)
    low = min(int(place), len(_SCALE) - 2)
    mixed = (
        round(a + (place - low) * (b - a))
        for a, b in zip(_SCALE[low], _SCALE[low + 1], strict=True)
    )
    return "#" + "".join(f"{value:02x}" for value in mixed)


def ticks(low: float, high: float, about: int = 6) -> list[float]:
    """Round values from low to high."""
    raw = (high - low) / max(about, 1)
    if raw <= 0.0:
        return [low]
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * unit for unit in (1.0, 2.0, 5.0, 10.0) if power * unit >= raw)
    first = math.ceil(low / step - 1e-9)
    return [index * step for index in range(first, math.floor(high / step + 1e-9) + 1)]


class Picture:
    """An SVG document that is drawn from back to front."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self.width, self.height = width, height
        self._parts: list[str] = []
        self.text(width / 2, 24, title, size=15, anchor="middle")

    def line(
        self,
        points: Iterable[tuple[float, float]],
        stroke: str = INK,
        width: float = 1.0,
        dash: str = "",
    ) -> None:
        """A polyline."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{path}" fill="none" stroke="{stroke}" '
            f'stroke-width="{width}"{dashes}/>'
        )

    def area(
        self,
        points: Iterable[tuple[float, float]],
        fill: str,
        stroke: str = "none",
        alpha: float = 1,
    ) -> None:
        """A filled polygon."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._parts.append(
            f'<polygon points="{path}" fill="{fill}" fill-opacity="{alpha}" stroke="{stroke}" '
            'stroke-width="0.6"/>'
        )

    def box(self, x: float, y: float, w: float, h: float, fill: str, alpha: float = 1.0) -> None:
        """A filled rectangle."""
        self.area([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], fill, alpha=alpha)

    def text(
        self,
        x: float,
        y: float,
        words: str,
        size: float = 11,
        anchor: str = "start",
        fill: str = INK,
        turn: float = 0.0,
    ) -> None:
        """Words at a place; ``anchor`` is start, middle or end."""
        rotate = f' transform="rotate({turn:g} {x:.1f} {y:.1f})"' if turn else ""
        self._parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" '
            f'fill="{fill}"{rotate}>{escape(words)}</text>'
        )

    def svg(self) -> str:
        """The document."""
        body = "\n".join(self._parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" '
            f'width="{self.width}" height="{self.height}" font-family="Helvetica, Arial, '
            f'sans-serif">\n<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
        )


class Axes:
    """Two linear axes in a picture, with grid and labels."""

    def __init__(
        self,
        picture: Picture,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        labels: tuple[str, str],
        box: tuple[float, float, float, float] = (66, 44, 24, 52),
    ) -> None:
        left, top, right, bottom = box
        self.picture, self.x_range, self.y_range = picture, x_range, y_range
        self.left, self.top = left, top
        self.right, self.bottom = picture.width - right, picture.height - bottom
        for value in ticks(*x_range):
            x = self.x(value)
            picture.line([(x, self.top), (x, self.bottom)], GRID)
            picture.text(x, self.bottom + 16, f"{value:g}", anchor="middle")
        for value in ticks(*y_range):
            y = self.y(value)
            picture.line([(self.left, y), (self.right, y)], GRID)
            picture.text(self.left - 6, y + 4, f"{value:g}", anchor="end")
        picture.text((self.left + self.right) / 2, self.bottom + 38, labels[0], 12, "middle")
        middle = (self.top + self.bottom) / 2
        picture.text(18, middle, labels[1], 12, "middle", turn=-90)

    def x(self, value: float) -> float:
        """Picture coordinate of a value on the horizontal axis."""
        low, high = self.x_range
        return self.left + (value - low) / (high - low) * (self.right - self.left)

    def y(self, value: float) -> float:
        """Picture coordinate of a value on the vertical axis, which points up."""
        low, high = self.y_range
        return self.bottom - (value - low) / (high - low) * (self.bottom - self.top)

    def curve(
        self,
        xs: Sequence[float],
        ys: Sequence[float],
        stroke: str,
        width: float = 2,
        dash: str = "",
    ) -> None:
        """A curve through values."""
        points = [(self.x(x), self.y(y)) for x, y in zip(xs, ys, strict=True)]
        self.picture.line(points, stroke, width, dash)
