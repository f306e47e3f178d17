"""Pictures of solid things built from a few rounded bodies, lit by a sun and the sky.

A thing is a list of bodies: cones with round ends, ellipsoids, boxes with round edges, cylinders.
Their signed distances are joined smoothly, so that a leg grows out of a hip; rays along the
viewing direction are marched to the surface (sphere tracing), which is then shaded with sunlight,
its shadow, the sky, and the darkness of creases and of the ground. Object axes: x right, y up,
z towards the viewer, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Triple = tuple[float, float, float]

CONE, ELLIPSOID, BOX, CYLINDER = range(4)

# Columns of the table of bodies.
_KIND, _A, _B, _R0, _R1, _TURN, _MELT = 0, 1, 4, 7, 8, 9, 18
_COLOUR, _GRAIN, _BUMP, _BUMP_PER_M = 19, 22, 23, 24
_COLOUR2, _BAND_LOW, _BAND_HIGH, _BOARD_M, _STRETCH = 25, 28, 29, 30, 31
_WIDTH = 32

_STEPS = 40
_DEPTH_M = 4.0


@dataclass(frozen=True)
class Surface:
    """How a body looks.

    Attributes:
        colour: Colour in full light, 0…255.
        grain: Contrast of its mottling, 0…1.
        bump_m: Height of its unevenness, metres.
        bump_per_m: Bumps per metre.
        colour2: Colour of its band.
        band: Where the band lies: share of the way from the first end to the second, or for
            boxes and ellipsoids of the height from the middle, -1…1.
        board_m: Width of the boards it is made of, metres; 0 for none.
        stretch: How much longer than wide its mottling is, along the body.
    """

    colour: Triple
    grain: float = 0.10
    bump_m: float = 0.0
    bump_per_m: float = 6.0
    colour2: Triple = (0.0, 0.0, 0.0)
    band: tuple[float, float] = (9.0, 9.0)
    board_m: float = 0.0
    stretch: float = 1.0


@dataclass
class Sculpture:
    """A growing list of bodies."""

    rows: list[list[float]] = field(default_factory=list)

    def _add(
        self,
        kind: int,
        a: Triple,
        b: Triple,
        radii: tuple[float, float],
        turn: Array,
        melt: float,
        look: Surface,
    ) -> None:
        self.rows.append(
            [
                kind,
                *a,
                *b,
                *radii,
                *turn.ravel(),
                melt,
                *look.colour,
                look.grain,
                look.bump_m,
                look.bump_per_m,
                *look.colour2,
                *look.band,
                look.board_m,
                look.stretch,
            ]
        )

    def cone(
        self, a: Triple, b: Triple, ra: float, rb: float, look: Surface, melt: float = 0.02
    ) -> None:
        """A bar from ``a`` to ``b`` with round ends of radii ``ra`` and ``rb``."""
        self._add(CONE, a, b, (ra, rb), np.eye(3), melt, look)

    def ellipsoid(
        self,
        middle: Triple,
        half: Triple,
        look: Surface,
        melt: float = 0.02,
        yaw: float = 0.0,
        lean: float = 0.0,
    ) -> None:
        """An ellipsoid with half-axes ``half``, turned about y by ``yaw``, about z by ``lean``."""
        self._add(ELLIPSOID, middle, half, (0.0, 0.0), _turn(yaw, lean), melt, look)

    def box(
        self,
        middle: Triple,
        half: Triple,
        edge: float,
        look: Surface,
        melt: float = 0.0,
        yaw: float = 0.0,
        lean: float = 0.0,
    ) -> None:
        """A box with half sizes ``half`` whose edges are rounded by ``edge``."""
        self._add(BOX, middle, half, (edge, 0.0), _turn(yaw, lean), melt, look)

    def cylinder(
        self, a: Triple, b: Triple, radius: float, look: Surface, melt: float = 0.0
    ) -> None:
        """A cylinder from ``a`` to ``b`` with flat ends."""
        self._add(CYLINDER, a, b, (radius, 0.0), np.eye(3), melt, look)

    def table(self) -> Array:
        """The bodies, shape (N, 32)."""
        return np.array(self.rows, float).reshape(-1, _WIDTH)

    def extent(self) -> tuple[float, float, float, float]:
        """Least x, greatest x, least y, greatest y that could be reached, metres."""
        table = self.table()
        a, b = table[:, _A : _A + 3], table[:, _B : _B + 3]
        solid = (table[:, _KIND] == ELLIPSOID) | (table[:, _KIND] == BOX)
        reach = np.where(solid, np.linalg.norm(b, axis=1), np.maximum(table[:, _R0], table[:, _R1]))
        reach += 2 * table[:, _BUMP] + 0.02
        end = np.where(solid[:, None], a, b)
        low = np.minimum(a, end) - reach[:, None]
        high = np.maximum(a, end) + reach[:, None]
        return (
            float(low[:, 0].min()),
            float(high[:, 0].max()),
            max(0.0, float(low[:, 1].min())),
            float(high[:, 1].max()),
        )


def _turn(yaw: float, lean: float) -> Array:
    cy, sy, cl, sl = math.cos(yaw), math.sin(yaw), math.cos(lean), math.sin(lean)
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cl, -sl, 0], [sl, cl, 0], [0, 0, 1]])
    turned: Array = (about_y @ about_z).T
    return turned


def picture(
    thing: Sculpture, longest_px: int, sun: Triple = (-0.5, 0.75, 0.5)
) -> tuple[Image, float]:
    """Render a thing standing on y = 0.

    Args:
        thing: The bodies; what lies below y = 0 is in the ground and not seen.
        longest_px: Size of the longer side of what can be reached, pixels.
        sun: Direction to the sun.

    Returns:
        RGBA, uint8, shape (H, W, 4), and its scale, pixels per metre.
    """
    left, right, low, high = thing.extent()
    scale = longest_px / max(right - left, high - low)
    cols, rows = math.ceil((right - left) * scale) + 2, math.ceil((high - low) * scale) + 2
    light = np.array(sun) / np.linalg.norm(sun)
    rgba = np.zeros((rows, cols, 4))
    _trace(rgba, thing.table(), left, high, 1.0 / scale, light)
    return np.clip(rgba + 0.5, 0, 255).astype(np.uint8), scale


@njit(cache=True, error_model="numpy", inline="always")
def _hash(i, j, k):  # type: ignore[no-untyped-def]  # compiled
    n = np.uint32(i) * np.uint32(374761393) + np.uint32(j) * np.uint32(668265263)
    n = np.uint32(n + np.uint32(k) * np.uint32(2147483647))
    n = np.uint32((n ^ (n >> np.uint32(13))) * np.uint32(1274126177))
    return ((n ^ (n >> np.uint32(16))) & np.uint32(65535)) / 32767.5 - 1.0


@njit(cache=True, error_model="numpy")
def _noise(x, y, z):  # type: ignore[no-untyped-def]  # compiled
    """Value noise, about -1…1."""
    x0, y0, z0 = np.floor(x), np.floor(y), np.floor(z)
    fx, fy, fz = x - x0, y - y0, z - z0
    fx, fy, fz = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy), fz * fz * (3 - 2 * fz)
    i, j, k = int(x0) + 4096, int(y0) + 4096, int(z0) + 4096
    total = 0.0
    for dk in range(2):
        for dj in range(2):
            row = _hash(i, j + dj, k + dk) * (1 - fx) + _hash(i + 1, j + dj, k + dk) * fx
            total += row * (fy if dj else 1 - fy) * (fz if dk else 1 - fz)
    return total


@njit(cache=True, error_model="numpy")
def _body(row, x, y, z):  # type: ignore[no-untyped-def]  # compiled
    """Distance to one body, and where along it the nearest place lies."""
    kind = int(row[_KIND])
    px, py, pz = x - row[_A], y - row[_A + 1], z - row[_A + 2]
    if kind in (CONE, CYLINDER):
        bx, by, bz = row[_B] - row[_A], row[_B + 1] - row[_A + 1], row[_B + 2] - row[_A + 2]
        square = bx * bx + by * by + bz * bz + 1e-12
        part = (px * bx + py * by + pz * bz) / square
        if kind == CONE:
            held = min(max(part, 0.0), 1.0)
            qx, qy, qz = px - held * bx, py - held * by, pz - held * bz
            radius = row[_R0] + held * (row[_R1] - row[_R0])
            return np.sqrt(qx * qx + qy * qy + qz * qz) - radius, held
        length = np.sqrt(square)
        qx, qy, qz = px - part * bx, py - part * by, pz - part * bz
        around = np.sqrt(qx * qx + qy * qy + qz * qz) - row[_R0]
        beyond = abs(part - 0.5) * length - 0.5 * length
        outside = np.sqrt(max(around, 0.0) ** 2 + max(beyond, 0.0) ** 2)
        return min(max(around, beyond), 0.0) + outside, part
    lx = row[_TURN] * px + row[_TURN + 1] * py + row[_TURN + 2] * pz
    ly = row[_TURN + 3] * px + row[_TURN + 4] * py + row[_TURN + 5] * pz
    lz = row[_TURN + 6] * px + row[_TURN + 7] * py + row[_TURN + 8] * pz
    hx, hy, hz = row[_B], row[_B + 1], row[_B + 2]
    if kind == ELLIPSOID:
        k0 = np.sqrt((lx / hx) ** 2 + (ly / hy) ** 2 + (lz / hz) ** 2)
        k1 = np.sqrt((lx / hx**2) ** 2 + (ly / hy**2) ** 2 + (lz / hz**2) ** 2)
        return k0 * (k0 - 1.0) / max(k1, 1e-9), ly / hy
    edge = row[_R0]
    ex, ey, ez = abs(lx) - hx + edge, abs(ly) - hy + edge, abs(lz) - hz + edge
    outside = np.sqrt(max(ex, 0.0) ** 2 + max(ey, 0.0) ** 2 + max(ez, 0.0) ** 2)
    return outside + min(max(ex, max(ey, ez)), 0.0) - edge, ly / hy


@njit(cache=True, error_model="numpy")
def _distance(table, x, y, z, fine):  # type: ignore[no-untyped-def]  # compiled
    """Distance to the smooth union of all bodies."""
    total = 1e9
    for n in range(table.shape[0]):
        d = _body(table[n], x, y, z)[0]
        bump = table[n, _BUMP]
        if fine and bump > 0 and d < 6 * bump:
            f = table[n, _BUMP_PER_M]
            d += bump * (
                _noise(x * f + 7 * n, y * f, z * f)
                + 0.45 * _noise(x * 2.7 * f, y * 2.7 * f + 5 * n, z * 2.7 * f)
            )
        melt = table[n, _MELT]
        if melt > 0 and abs(total - d) < melt:
            share = 0.5 + 0.5 * (total - d) / melt
            total = total + share * (d - total) - melt * share * (1 - share)
        else:
            total = min(total, d)
    return total


@njit(cache=True, error_model="numpy")
def _albedo(table, x, y, z, out):  # type: ignore[no-untyped-def]  # compiled
    best, place, chosen = 1e9, 0.0, 0
    for n in range(table.shape[0]):
        d, part = _body(table[n], x, y, z)
        if d < best:
            best, place, chosen = d, part, n
    row = table[chosen]
    base = _COLOUR2 if row[_BAND_LOW] <= place <= row[_BAND_HIGH] else _COLOUR
    f = row[_STRETCH]
    mottle = 0.6 * _noise(x * 9 / f + 3 * chosen, y * 9, z * 9) + 0.4 * _noise(
        x * 37 / f + chosen, y * 37, z * 37
    )
    tone = 1 + row[_GRAIN] * mottle
    if row[_BOARD_M] > 0:
        cell = (y - row[_A + 1]) / row[_BOARD_M] + 64.0
        inside = cell - np.floor(cell)
        tone *= 1 + 0.2 * _hash(int(np.floor(cell)), chosen, 3)
        if inside < 0.07:
            tone *= 0.45
    for i in range(3):
        out[i] = row[base + i] * tone


@njit(cache=True, error_model="numpy")
def _trace(rgba, table, left, top, step, light):  # type: ignore[no-untyped-def]  # compiled
    rows, cols, _ = rgba.shape
    colour = np.zeros(3)
    eps = 0.5 * step
    for v in range(rows):
        y = top - (v + 0.5) * step
        if y < 0:
            continue
        for u in range(cols):
            x = left + (u + 0.5) * step
            z = _DEPTH_M
            nearest, nearest_z = 1e9, z
            for _ in range(_STEPS):
                d = _distance(table, x, y, z, True)
                if d < nearest:
                    nearest, nearest_z = d, z
                if d < 0.05 * step or z < -_DEPTH_M:
                    break
                z -= 0.75 * d
            cover = 1.0 if nearest < 0.08 * step else max(0.55 - nearest / step, 0.0)
            if cover <= 0.02:
                continue
            z = nearest_z
            nx = _distance(table, x + eps, y, z, True) - _distance(table, x - eps, y, z, True)
            ny = _distance(table, x, y + eps, z, True) - _distance(table, x, y - eps, z, True)
            nz = _distance(table, x, y, z + eps, True) - _distance(table, x, y, z - eps, True)
            size = np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-12
            nx, ny, nz = nx / size, ny / size, nz / size
            crease = 1.0
            for tap in (0.04, 0.10, 0.22):
                free = _distance(table, x + nx * tap, y + ny * tap, z + nz * tap, True)
                crease -= 0.3 * max(0.0, 1.0 - free / tap)
            crease = max(crease, 0.25)
            near_ground = min(y / 0.3, 1.0)
            crease *= 0.62 + 0.38 * near_ground * (2 - near_ground)
            facing = max(0.0, nx * light[0] + ny * light[1] + nz * light[2])
            sunlit = 1.0
            if facing > 0:
                far = 0.03
                for _ in range(14):
                    d = _distance(
                        table,
                        x + nx * 0.01 + light[0] * far,
                        y + ny * 0.01 + light[1] * far,
                        z + nz * 0.01 + light[2] * far,
                        True,
                    )
                    sunlit = min(sunlit, 6 * d / far)
                    far += max(d, 0.015)
                    if sunlit < 0.02 or far > 1.2:
                        break
                sunlit = max(sunlit, 0.0)
            sky = 0.66 + 0.34 * ny
            tone = 0.72 * sky * crease + 0.72 * facing * sunlit
            _albedo(table, x, y, z, colour)
            for i in range(3):
                rgba[v, u, i] = colour[i] * tone
            rgba[v, u, 3] = 255 * cover
