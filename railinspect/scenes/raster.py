"""Everything that stands up: textured parallelograms and thick lines with a depth test.

A primitive is one row of a geometry table (nine numbers: a corner and two edge vectors, or for a
line a point and the vector to its end) and one row of an attribute table.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numba import njit

from railinspect.scenes.noise import sample

# Materials.
(
    PLAIN,
    BOARDS,
    WINDOWS,
    FOLIAGE,
    ELLIPSE,
    MESH,
    SHADOW,
    HEDGE,
    GLOW,
    BRICK,
    BAND,
    STONE,
    LINE,
) = range(13)

# Columns of the attribute table.
(
    ATTR_R,
    ATTR_G,
    ATTR_B,
    ATTR_R2,
    ATTR_G2,
    ATTR_B2,
    ATTR_MATERIAL,
    ATTR_P0,
    ATTR_P1,
    ATTR_GRAIN,
    ATTR_LABEL,
    ATTR_OBJECT,
    ATTR_SEED,
) = range(13)

NO_LABEL = -1.0
NEAR_M = 0.25
TOLERANCE = 1.004  # a foot on the ground must not sink into it by rounding
_TEXEL_M = 0.04

Colour = tuple[float, float, float]
Point = tuple[float, float, float]


def tint(colour: npt.ArrayLike, gain: float = 1.0) -> Colour:
    """A colour scaled by ``gain``, as a triple."""
    red, green, blue = (min(255.0, float(c) * gain) for c in np.asarray(colour, float))
    return (red, green, blue)


@dataclass
class Kit:
    """A growing list of primitives in track coordinates (along, left, up), metres."""

    geometry: list[tuple[float, ...]] = field(default_factory=list)
    attributes: list[tuple[float, ...]] = field(default_factory=list)

    def face(
        self,
        corner: Point,
        edge_u: Point,
        edge_v: Point,
        colour: Colour,
        label: float,
        material: int = PLAIN,
        colour2: Colour = (0.0, 0.0, 0.0),
        p0: float = 0.0,
        p1: float = 0.0,
        grain: float = 0.12,
        thing: int = 0,
    ) -> None:
        """Add a parallelogram; ``thing`` is the id of the object it belongs to (0: none)."""
        self.geometry.append((*corner, *edge_u, *edge_v))
        self.attributes.append((*colour, *colour2, material, p0, p1, grain, label, thing))

    def line(
        self,
        start: Point,
        end: Point,
        radius: float,
        colour: Colour,
        label: float,
        thing: int = 0,
        grain: float = 0.3,
    ) -> None:
        """Add a round bar of the given radius, metres."""
        edge = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
        self.geometry.append((*start, *edge, 0.0, 0.0, 0.0))
        self.attributes.append((*colour, 0, 0, 0, LINE, radius, 0.0, grain, label, thing))

    def box(
        self,
        along: float,
        left: float,
        up: float,
        size: Point,
        colour: Colour,
        label: float,
        sun: float = 0.0,
        material: int = PLAIN,
        colour2: Colour = (0.0, 0.0, 0.0),
        p0: float = 0.0,
        p1: float = 0.0,
        grain: float = 0.1,
        thing: int = 0,
    ) -> None:
        """Add the faces of an upright box that an observer before it can see.

        Args:
            along: Near face, metres.
            left: Middle, metres.
            up: Bottom, metres.
            size: Length along the track, width, height, metres.
            colour: Colour in full light, 0…255.
            label: Class id.
            sun: Side the sun is on, -1…1, positive left.
            material: Material of the front and the sides.
            colour2: The material's second colour.
            p0: First material parameter.
            p1: Second material parameter.
            grain: Texture contrast.
            thing: Object id.
        """
        length, width, height = size
        for side in (-1.0, 1.0):
            edge = left + side * width / 2
            light = 0.78 + 0.25 * side * sun
            tone = (colour[0] * light, colour[1] * light, colour[2] * light)
            self.face(
                (along, edge, up),
                (length, 0, 0),
                (0, 0, height),
                tone,
                label,
                material,
                colour2,
                p0,
                p1,
                grain,
                thing,
            )
        self.face(
            (along, left + width / 2, up),
            (0, -width, 0),
            (0, 0, height),
            (colour[0] * 0.86, colour[1] * 0.86, colour[2] * 0.86),
            label,
            material,
            colour2,
            p0,
            p1,
            grain,
            thing,
        )
        self.face(
            (along, left + width / 2, up + height),
            (0, -width, 0),
            (length, 0, 0),
            colour,
            label,
            PLAIN,
            grain=grain,
            thing=thing,
        )

    def tables(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32]]:
        """Geometry, shape (N, 9), and attributes, shape (N, 13).

        The seed column is the row's own, so a primitive keeps its texture from frame to frame.
        """
        attributes = np.array(self.attributes, np.float32).reshape(-1, 12)
        seeds = (np.arange(len(attributes)) * 37.7 % 512).astype(np.float32)
        return (
            np.array(self.geometry, np.float64).reshape(-1, 9),
            np.column_stack([attributes, seeds]),
        )


@njit(cache=True, error_model="numpy")
def _draw_line(  # type: ignore[no-untyped-def]  # compiled
    rgb, labels, depth, things, geometry, attribute, focal, centre_u, centre_v, sun
):
    rows, cols = labels.shape
    x0, y0, z0 = geometry[0], geometry[1], geometry[2]
    x1, y1, z1 = x0 + geometry[3], y0 + geometry[4], z0 + geometry[5]
    if z0 < NEAR_M and z1 < NEAR_M:
        return
    if z0 < NEAR_M or z1 < NEAR_M:
        part = (NEAR_M - z0) / (z1 - z0)
        xm, ym = x0 + part * (x1 - x0), y0 + part * (y1 - y0)
        if z0 < NEAR_M:
            x0, y0, z0 = xm, ym, NEAR_M
        else:
            x1, y1, z1 = xm, ym, NEAR_M
    u0, v0 = centre_u + focal * x0 / z0, centre_v + focal * y0 / z0
    u1, v1 = centre_u + focal * x1 / z1, centre_v + focal * y1 / z1
    radius = attribute[ATTR_P0]
    half0, half1 = radius * focal / z0, radius * focal / z1
    du, dv = u1 - u0, v1 - v0
    length = np.sqrt(du * du + dv * dv)
    if length < 1e-6:
        return
    upright = abs(dv) >= abs(du)
    if upright:
        main0, main1, limit, other_limit = v0, v1, rows, cols
        cross0, cross1 = u0, u1
    else:
        main0, main1, limit, other_limit = u0, u1, cols, rows
        cross0, cross1 = v0, v1
    stretch = length / abs(main1 - main0)
    first = max(0, int(np.ceil(min(main0, main1) - 0.5)))
    last = min(limit - 1, int(np.floor(max(main0, main1) + 0.5)))
    label = int(attribute[ATTR_LABEL])
    thing = int(attribute[ATTR_OBJECT])
    for m in range(first, last + 1):
        part = min(max((m - main0) / (main1 - main0), 0.0), 1.0)
        inverse = (1 - part) / z0 + part / z1
        z = 1.0 / inverse
        half = (half0 + part * (half1 - half0)) * stretch
        cross = cross0 + part * (cross1 - cross0)
        low = max(0, int(np.floor(cross - half + 0.5)))
        high = min(other_limit - 1, int(np.floor(cross + half + 0.5)))
        for c in range(low, high + 1):
            cover = min(cross + half, c + 0.5) - max(cross - half, c - 0.5)
            if cover <= 0:
                continue
            cover = min(cover, 1.0)
            v, u = (m, c) if upright else (c, m)
            if z > depth[v, u] * TOLERANCE:
                continue
            across = min(max((c - cross) / max(half, 0.5), -1.0), 1.0)
            light = 0.9 - attribute[ATTR_GRAIN] * across * sun - 0.15 * across * across
            for i in range(3):
                rgb[v, u, i] += cover * (attribute[ATTR_R + i] * light - rgb[v, u, i])
            if cover > 0.45:
                depth[v, u] = z
                if label >= 0:
                    labels[v, u] = label
                things[v, u] = thing


@njit(cache=True, error_model="numpy")
def draw(  # type: ignore[no-untyped-def]  # compiled; types are those of the tables
    rgb, labels, depth, things, geometry, attributes, focal, centre_u, centre_v, sun, stack
):
    """Draw primitives given far to near.

    Args:
        rgb: Colours 0…255, float32, shape (H, W, 3); changed.
        labels: Class ids, shape (H, W); changed.
        depth: Distance ahead, metres, shape (H, W); changed.
        things: Object ids, int16, shape (H, W); changed.
        geometry: Camera coordinates (right, down, ahead), shape (N, 9).
        attributes: Attribute table, shape (N, 13).
        focal: Focal length, px.
        centre_u: Principal point, px.
        centre_v: Principal point, px.
        sun: Side the sun is on in the image, -1…1, positive left.
        stack: Noise pyramids.
    """
    rows, cols = labels.shape
    xs = np.empty(5)
    ys = np.empty(5)
    zs = np.empty(5)
    for n in range(geometry.shape[0]):
        material = int(attributes[n, ATTR_MATERIAL])
        if material == LINE:
            _draw_line(
                rgb,
                labels,
                depth,
                things,
                geometry[n],
                attributes[n],
                focal,
                centre_u,
                centre_v,
                sun,
            )
            continue
        px, py, pz = geometry[n, 0], geometry[n, 1], geometry[n, 2]
        ax, ay, az = geometry[n, 3], geometry[n, 4], geometry[n, 5]
        bx, by, bz = geometry[n, 6], geometry[n, 7], geometry[n, 8]
        # the visible outline, clipped at the near plane, bounds the pixels to visit
        xs[0], ys[0], zs[0] = px, py, pz
        xs[1], ys[1], zs[1] = px + ax, py + ay, pz + az
        xs[2], ys[2], zs[2] = px + ax + bx, py + ay + by, pz + az + bz
        xs[3], ys[3], zs[3] = px + bx, py + by, pz + bz
        xs[4], ys[4], zs[4] = px, py, pz
        u_low, u_high, v_low, v_high = 1e9, -1e9, 1e9, -1e9
        for i in range(4):
            if zs[i] >= NEAR_M:
                u = centre_u + focal * xs[i] / zs[i]
                v = centre_v + focal * ys[i] / zs[i]
                u_low, u_high = min(u_low, u), max(u_high, u)
                v_low, v_high = min(v_low, v), max(v_high, v)
            if (zs[i] < NEAR_M) != (zs[i + 1] < NEAR_M):
                part = (NEAR_M - zs[i]) / (zs[i + 1] - zs[i])
                u = centre_u + focal * (xs[i] + part * (xs[i + 1] - xs[i])) / NEAR_M
                v = centre_v + focal * (ys[i] + part * (ys[i + 1] - ys[i])) / NEAR_M
                u_low, u_high = min(u_low, u), max(u_high, u)
                v_low, v_high = min(v_low, v), max(v_high, v)
        if u_high < -0.5 or u_low > cols or v_high < -0.5 or v_low > rows:
            continue
        first_u = max(0, int(np.floor(u_low)))
        last_u = min(cols - 1, int(np.ceil(u_high)))
        first_v = max(0, int(np.floor(v_low)))
        last_v = min(rows - 1, int(np.ceil(v_high)))
        # inverse of [A B P]: its rows are cross products over the determinant
        cx, cy, cz = by * pz - bz * py, bz * px - bx * pz, bx * py - by * px
        det = ax * cx + ay * cy + az * cz
        if abs(det) < 1e-12:
            continue
        dx, dy, dz = py * az - pz * ay, pz * ax - px * az, px * ay - py * ax
        ex, ey, ez = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length_a = np.sqrt(ax * ax + ay * ay + az * az)
        length_b = np.sqrt(bx * bx + by * by + bz * bz)
        cr, cg, cb = attributes[n, ATTR_R], attributes[n, ATTR_G], attributes[n, ATTR_B]
        cr2, cg2, cb2 = attributes[n, ATTR_R2], attributes[n, ATTR_G2], attributes[n, ATTR_B2]
        p0, p1 = attributes[n, ATTR_P0], attributes[n, ATTR_P1]
        grain = attributes[n, ATTR_GRAIN]
        label = int(attributes[n, ATTR_LABEL])
        thing = int(attributes[n, ATTR_OBJECT])
        seed_u = attributes[n, ATTR_SEED]
        for v in range(first_v, last_v + 1):
            y = (v - centre_v) / focal
            for u in range(first_u, last_u + 1):
                x = (u - centre_u) / focal
                q2 = (ex * x + ey * y + ez) / det
                if q2 <= 0:
                    continue
                z = 1.0 / q2
                if z < NEAR_M or (z > depth[v, u] * TOLERANCE and material != SHADOW):
                    continue
                a = (cx * x + cy * y + cz) / det * z
                if a < 0 or a > 1:
                    continue
                b = (dx * x + dy * y + dz) / det * z
                if b < 0 or b > 1:
                    continue
                ma, mb = a * length_a, b * length_b
                foot = z / focal / _TEXEL_M
                alpha = 1.0
                r, g, bl = cr, cg, cb
                texture = sample(
                    stack, 1, ma / _TEXEL_M + seed_u, mb / _TEXEL_M + seed_u * 1.7, foot
                )
                if material == FOLIAGE:
                    ru, rv = 2 * a - 1, 2 * b - 1
                    rough = sample(
                        stack,
                        1,
                        a * 130 + seed_u,
                        b * 130 + seed_u,
                        130 * z / focal / max(length_a, 0.1),
                    )
                    body = ru * ru + rv * rv + 0.28 * rough
                    if body > 0.92:
                        continue
                    shade = 0.78 + 0.32 * rough + 0.25 * rv + 0.2 * ru * -sun
                    r, g, bl = r * shade, g * shade, bl * shade
                elif material == HEDGE:
                    top = 0.8 + 0.2 * sample(stack, 1, ma * 5 + seed_u, seed_u, 5 * z / focal) * 0.6
                    if b > top:
                        continue
                    rough = sample(stack, 1, ma * 14 + seed_u, mb * 14, 14 * z / focal)
                    shade = 0.7 + 0.3 * b + 0.3 * rough
                    r, g, bl = r * shade, g * shade, bl * shade
                elif material in (ELLIPSE, STONE):
                    ru, rv = 2 * a - 1, 2 * b - 1
                    body = ru * ru + rv * rv
                    if material == STONE:
                        body += 0.18 * sample(stack, 2, a * 60 + seed_u, b * 60 + seed_u, 1.0)
                    if body > 1:
                        continue
                    shade = 1.0 + 0.3 * rv - 0.25 * ru * sun + grain * texture
                    r, g, bl = r * shade, g * shade, bl * shade
                elif material == SHADOW:
                    if z > depth[v, u] + 1.5 + 0.1 * z or z < depth[v, u] - 1.5 - 0.1 * z:
                        continue
                    alpha = grain
                    if p0 > 0:
                        ru, rv = 2 * a - 1, 2 * b - 1
                        alpha *= max(0.0, 1.0 - (ru * ru + rv * rv))
                elif material == GLOW:
                    ru, rv = 2 * a - 1, 2 * b - 1
                    body = ru * ru + rv * rv
                    if body > 1:
                        continue
                    gain = (1 - body) * (1 - body) * grain
                    rgb[v, u, 0] = min(255.0, rgb[v, u, 0] + gain * cr)
                    rgb[v, u, 1] = min(255.0, rgb[v, u, 1] + gain * cg)
                    rgb[v, u, 2] = min(255.0, rgb[v, u, 2] + gain * cb)
                    continue
                else:
                    shade = 1.0 + grain * texture
                    if material == BOARDS:
                        cell = ma / p0
                        tone = 1.0 + 0.18 * np.sin(np.floor(cell) * 12.9898)
                        if z / focal < p0 * 0.5 and cell - np.floor(cell) < 0.1:
                            tone *= 0.55
                        shade *= tone
                    elif material == MESH:
                        cell = ma / p0
                        pixel = z / focal / p0
                        if pixel > 0.6:
                            alpha = p1
                        elif (
                            cell - np.floor(cell) > p1
                            and (mb < length_b - 0.08)
                            and (mb > 0.12 or mb < 0.05)
                        ):
                            continue
                    elif material == WINDOWS:
                        cell_a, cell_b = ma / p0, mb / p1
                        fa, fb = cell_a - np.floor(cell_a), cell_b - np.floor(cell_b)
                        if 0.22 < fa < 0.78 and 0.35 < fb < 0.82:
                            r, g, bl = cr2, cg2, cb2
                    elif material == BRICK:
                        row = np.floor(mb / 0.5)
                        cell = ma / 1.1 + 0.5 * (row % 2)
                        if z / focal < 0.1 and (
                            mb / 0.5 - row < 0.08 or cell - np.floor(cell) < 0.04
                        ):
                            shade *= 0.7
                        shade *= 1.0 + 0.1 * np.sin(np.floor(cell) * 7.3 + row * 3.1)
                    elif material == BAND and p0 < b < p1:
                        r, g, bl = cr2, cg2, cb2
                    r, g, bl = r * shade, g * shade, bl * shade
                if material == SHADOW:
                    rgb[v, u, 0] *= 1 - alpha
                    rgb[v, u, 1] *= 1 - alpha
                    rgb[v, u, 2] *= 1 - alpha
                    continue
                rgb[v, u, 0] += alpha * (r - rgb[v, u, 0])
                rgb[v, u, 1] += alpha * (g - rgb[v, u, 1])
                rgb[v, u, 2] += alpha * (bl - rgb[v, u, 2])
                if alpha > 0.35:
                    depth[v, u] = z
                    if label >= 0:
                        labels[v, u] = label
                    things[v, u] = thing
