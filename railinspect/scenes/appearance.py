"""Colours, light and weather of one rendered world, drawn from its seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from railinspect import labels
from railinspect.scenes import tables
from railinspect.scenes.backdrop import skyline
from railinspect.scenes.settings import SceneSettings
from railinspect.scenes.weather import Weather

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Appearance:
    """Everything about a world's looks that is not geometry.

    Attributes:
        weather: Air, light and camera.
        look: Look vector of the ground shader, shape (16,).
        zenith: Sky colour overhead, 0…255.
        horizon: Sky colour at the horizon, 0…255.
        cloud: Cloud cover, 0…1.
        sun_side: Side the sun is on, -1 right … 1 left.
        sun_azimuth_rad: Direction of the sun, radians.
        sun_height: Tangent of its elevation.
        sun_gain: Brightness of its glow.
        skylines: Distant skylines, shape (L, AZIMUTH_STEPS).
        layers: Their colours, shape (L, 6).
        grass: Colour of the open ground.
        foliage: Colours of leaves, shape (3, 3).
        night: Whether artificial light is on.
    """

    weather: Weather
    look: Array
    zenith: Array
    horizon: Array
    cloud: float
    sun_side: float
    sun_azimuth_rad: float
    sun_height: float
    sun_gain: float
    skylines: npt.NDArray[np.float32]
    layers: Array
    grass: Array
    foliage: Array
    night: bool


_GRASS = (
    (98, 112, 58),
    (120, 124, 70),
    (86, 96, 52),
    (140, 128, 86),
    (104, 92, 66),
    (152, 146, 120),
)
_LEAVES = ((52, 74, 36), (70, 92, 44), (40, 58, 36), (134, 104, 46), (120, 72, 40), (92, 84, 70))
_BEDS = (
    (122, 114, 106),
    (96, 88, 82),
    (150, 142, 134),
    (112, 96, 82),
    (84, 80, 80),
    (172, 164, 150),
    (62, 58, 56),
    (128, 108, 92),
)
_RUST = ((92, 62, 46), (72, 54, 44), (56, 46, 42), (106, 78, 60), (48, 44, 44))


def jitter(rng: np.random.Generator, colour: npt.ArrayLike, share: float = 0.15) -> Array:
    """A colour with its brightness and hue varied by about ``share``."""
    gain = np.exp(rng.normal(0, share)) * np.exp(rng.normal(0, share / 7, 3))
    varied: Array = np.clip(np.broadcast_to(np.asarray(colour, float), (3,)) * gain, 4, 250)
    return varied


def draw_appearance(rng: np.random.Generator, settings: SceneSettings) -> Appearance:
    """Draw the looks of a world."""
    season_snow = settings.weather and rng.random() < 0.04
    grass = jitter(rng, _GRASS[rng.integers(len(_GRASS))], 0.2)
    leaves = np.array([jitter(rng, _LEAVES[rng.integers(len(_LEAVES))], 0.2) for _ in range(3)])
    bed = jitter(rng, _BEDS[rng.integers(len(_BEDS))], 0.2)
    if season_snow:
        grass = np.array([216.0, 220.0, 226.0])
        bed = bed * 0.4 + 0.6 * grass
    time = rng.choice(["sun", "overcast", "dusk", "night"], p=[0.44, 0.38, 0.11, 0.07])
    if not settings.weather:
        time = "overcast"
    sunny = time == "sun"
    sun_side = float(rng.uniform(-1, 1))
    weather = _draw_weather(rng, settings, str(time))
    blue = jitter(rng, (88, 136, 200), 0.12)
    white = jitter(rng, (218, 224, 230), 0.06)
    if sunny:
        zenith, horizon, cloud = blue, jitter(rng, (196, 212, 226), 0.06), rng.uniform(0.0, 0.7)
    elif time == "overcast":
        zenith, horizon, cloud = white * rng.uniform(0.72, 1.08), white, rng.uniform(0.3, 1.0)
    elif time == "dusk":
        zenith = jitter(rng, (96, 112, 150), 0.15)
        horizon, cloud = jitter(rng, (232, 176, 128), 0.12), rng.uniform(0.0, 0.8)
    else:
        zenith, horizon, cloud = np.array([26.0, 30, 42]), np.array([58.0, 56, 60]), 0.3
    look = np.zeros(16)
    look[tables.LOOK_BED_R : tables.LOOK_BED_B + 1] = bed
    look[tables.LOOK_BED_GRAIN] = rng.uniform(0.08, 0.34)
    look[tables.LOOK_RUST_R : tables.LOOK_RUST_B + 1] = jitter(
        rng, _RUST[rng.integers(len(_RUST))], 0.2
    )
    look[tables.LOOK_SUN_SIDE] = sun_side
    look[tables.LOOK_SHADOW] = rng.uniform(0.6, 1.0) if sunny else rng.uniform(0.0, 0.3)
    look[tables.LOOK_DAPPLE] = rng.uniform(0.2, 0.8) if sunny and rng.random() < 0.35 else 0.0
    look[tables.LOOK_WEEDS] = rng.uniform(0.3, 0.9) if rng.random() < 0.25 else 0.0
    look[tables.LOOK_OIL] = rng.uniform(0.0, 0.5)
    if weather.rain > 0 or (settings.weather and rng.random() < 0.05):
        look[tables.LOOK_WET] = rng.uniform(0.2, 0.8)
    look[tables.LOOK_SKY] = float(np.mean(horizon))
    if sunny and settings.distractors and rng.random() < 0.3:
        start = rng.uniform(-8, 6)
        look[tables.LOOK_SHADE_FROM] = start
        look[tables.LOOK_SHADE_TO] = start + rng.choice([0.15, 0.4, 3.0, 12.0])
    layers, lines = [], []
    for level in range(int(rng.integers(1, 4))):
        far = 800.0 * 2.2**level
        tall = rng.choice([0.012, 0.03, 0.08, 0.2], p=[0.3, 0.35, 0.25, 0.1]) * (0.7 + 0.4 * level)
        lines.append(skyline(rng, float(tall), float(rng.uniform(0.4, 0.75)), 12 + 8 * level))
        tint = jitter(rng, leaves[level % 3] * 0.9 if level < 2 else (104, 116, 128), 0.15)
        layers.append((*tint, rng.uniform(0.08, 0.3), labels.VEGETATION, far))
    return Appearance(
        weather=weather,
        look=look,
        zenith=zenith,
        horizon=horizon,
        cloud=float(cloud),
        sun_side=sun_side,
        sun_azimuth_rad=float(rng.uniform(-0.9, 0.9)),
        sun_height=float(rng.uniform(0.05, 0.4)),
        sun_gain=float(rng.uniform(30, 200)) if sunny or time == "dusk" else 0.0,
        skylines=np.array(lines, np.float32),
        layers=np.array(layers, float),
        grass=grass,
        foliage=leaves,
        night=bool(time == "night"),
    )


def _draw_weather(rng: np.random.Generator, settings: SceneSettings, time: str) -> Weather:
    if not settings.weather:
        return Weather()
    foggy = rng.random() < 0.10
    rain = float(rng.uniform(0.2, 1.0)) if rng.random() < 0.08 else 0.0
    snow = float(rng.uniform(0.2, 1.0)) if rng.random() < 0.05 else 0.0
    wet = rain > 0 or rng.random() < 0.05
    grey = float(rng.uniform(150, 225))
    night, dusk = time == "night", time == "dusk"
    if night:
        grey = 30.0
    ambient = (
        float(rng.uniform(0.12, 0.3)) if night else float(rng.uniform(0.35, 0.7)) if dusk else 1.0
    )
    cast_gain = np.exp(rng.normal(0, 0.035, 3))
    wiper = settings.distractors and rng.random() < (0.5 if wet else 0.06)
    return Weather(
        visibility_m=float(
            rng.uniform(40, 260) if foggy else 600 if rain or snow else rng.uniform(1200, 9000)
        ),
        fog_rgb=(grey, grey * 1.01, grey * 1.03),
        ambient=ambient,
        headlight=float(rng.uniform(0.9, 2.0)) if night else 0.4 if dusk else 0.0,
        exposure=float(np.exp(rng.normal(0.0, 0.2))),
        gamma=float(np.exp(rng.normal(0.0, 0.22))),
        contrast=float(np.exp(rng.normal(0.08, 0.16))),
        cast_rgb=(float(cast_gain[0]), float(cast_gain[1]), float(cast_gain[2])),
        saturation=float(np.clip(rng.normal(0.95, 0.3), 0, 1.6)) if rng.random() > 0.05 else 0.0,
        vignette=float(rng.uniform(0, 0.35)),
        noise=float(rng.gamma(1.5, 2.0)) * (2.0 if night else 1.0),
        rain=rain,
        snow=snow,
        drops=int(rng.integers(10, 90)) if rain and rng.random() < 0.6 else 0,
        wiper=float(rng.uniform(-1.2, 1.2)) if wiper else float("nan"),
        wiper_pair=bool(rng.random() < 0.4),
        dashboard=float(rng.uniform(0.03, 0.16)) if rng.random() < 0.12 else 0.0,
        glare=float(rng.uniform(0.2, 0.9)) if rng.random() < 0.07 else 0.0,
        motion_blur=float(rng.uniform(2, 12)) if rng.random() < 0.35 else 0.0,
        defocus=float(rng.uniform(0.4, 1.3)) * settings.closer if rng.random() < 0.4 else 0.0,
        quality=int(rng.integers(28, 92)) if rng.random() < 0.45 else 0,
        caption=str(rng.choice(["Vmax 70", "120 km/h", "Cab view  1:24:07", "km 34.2"]))
        if settings.distractors and rng.random() < 0.06
        else "",
    )
