"""Sky and distant land: what a ray meets when it meets no ground within reach."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from railinspect.labels import SKY
from railinspect.scenes.noise import sample

AZIMUTH_STEPS = 1440
"""Entries of a skyline over the full circle."""

# Columns of the layer table.
LAYER_R, LAYER_G, LAYER_B, LAYER_GRAIN, LAYER_LABEL, LAYER_DISTANCE = range(6)


def skyline(
    rng: np.random.Generator, height_rad: float, roughness: float, cells: int
) -> npt.NDArray[np.float32]:
    """A closed random skyline: elevation tangent by azimuth, shape (AZIMUTH_STEPS,)."""
    angle = np.linspace(0, 2 * np.pi, AZIMUTH_STEPS, endpoint=False)
    line = np.zeros(AZIMUTH_STEPS)
    weight = 1.0
    while cells < AZIMUTH_STEPS // 2 and weight > 0.02:
        knots = rng.standard_normal(cells)
        line += weight * np.interp(
            angle, np.arange(cells + 1) * 2 * np.pi / cells, np.append(knots, knots[0])
        )
        weight *= roughness
        cells *= 2
    line = (line - line.min()) / (np.ptp(line) + 1e-9)
    scaled: npt.NDArray[np.float32] = (height_rad * line).astype(np.float32)
    return scaled


@njit(cache=True, error_model="numpy")
def shade_backdrop(  # type: ignore[no-untyped-def]  # compiled; types are those of the tables
    rgb,
    labels,
    depth,
    rotation,
    focal,
    centre_u,
    centre_v,
    heading,
    skylines,
    layers,
    zenith,
    horizon,
    cloud,
    sun_azimuth,
    sun_height,
    sun_gain,
    stack,
):
    """Paint every pixel that no ground was found for.

    Args:
        rgb: Colours 0…255, float32, shape (H, W, 3); changed.
        labels: Class ids, shape (H, W); changed.
        depth: Distance ahead, metres, +inf where nothing was drawn; changed for land.
        rotation: Rotation from world to camera axes.
        focal: Focal length, px.
        centre_u: Principal point, px.
        centre_v: Principal point, px.
        heading: Heading of the observer, radians; turns the backdrop.
        skylines: Elevation tangents, near layer first, shape (L, AZIMUTH_STEPS).
        layers: Layer table, shape (L, 6).
        zenith: Sky colour overhead.
        horizon: Sky colour at the horizon.
        cloud: Cloud cover 0…1.
        sun_azimuth: Direction of the sun, radians, positive left.
        sun_height: Tangent of the sun's elevation.
        sun_gain: Brightness of its glow, 0…255.
        stack: Noise pyramids.
    """
    rows, cols = labels.shape
    for v in range(rows):
        down = (v - centre_v) / focal
        for u in range(cols):
            if depth[v, u] < 1e8:
                continue
            right = (u - centre_u) / focal
            dx = rotation[0, 0] * right + rotation[1, 0] * down + rotation[2, 0]
            dy = rotation[0, 1] * right + rotation[1, 1] * down + rotation[2, 1]
            dz = rotation[0, 2] * right + rotation[1, 2] * down + rotation[2, 2]
            flat = np.sqrt(dx * dx + dy * dy)
            rise = dz / flat
            # the small-angle arctangent is cheap and its error is the same in every frame
            ratio = dy / max(dx, 0.05)
            azimuth = ratio / (1.0 + 0.28 * ratio * ratio) + heading
            place = azimuth / (2 * np.pi) * AZIMUTH_STEPS
            index = int(np.floor(place))
            part = place - index
            i0 = index % AZIMUTH_STEPS
            i1 = (index + 1) % AZIMUTH_STEPS
            hit = -1
            for n in range(layers.shape[0]):
                if rise < skylines[n, i0] * (1 - part) + skylines[n, i1] * part:
                    hit = n
                    break
            if hit < 0 and rise < 0.0:
                hit = layers.shape[0] - 1
            if hit >= 0:
                texture = sample(
                    stack, 1, azimuth * 900 + 57 * hit, rise * 900 + 91 * hit, 900 / focal
                )
                gain = 1.0 + layers[hit, LAYER_GRAIN] * texture
                rgb[v, u, 0] = layers[hit, LAYER_R] * gain
                rgb[v, u, 1] = layers[hit, LAYER_G] * gain
                rgb[v, u, 2] = layers[hit, LAYER_B] * gain
                labels[v, u] = int(layers[hit, LAYER_LABEL])
                depth[v, u] = layers[hit, LAYER_DISTANCE]
                continue
            blend = min(max(rise * 2.2, 0.0), 1.0)
            blend = blend * (2 - blend)
            puff = sample(stack, 2, azimuth * 160, 90 / (rise + 0.35), 1.0)
            puff = min(max((puff + 2.4 * cloud - 1.2) * 0.9, 0.0), 1.0)
            off = azimuth - heading - sun_azimuth
            lift = rise - sun_height
            glow = sun_gain * np.exp(-(off * off + lift * lift) * 14.0)
            for i in range(3):
                base = horizon[i] + blend * (zenith[i] - horizon[i])
                base += puff * 0.8 * (horizon[i] * 0.98 + 8 - base)
                rgb[v, u, i] = base + glow
            labels[v, u] = SKY
