"""From radiance to a camera's picture: fog, headlight, glare, rain, lens, sensor, compression."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Weather:
    """How the air, the light and the camera change the scene; constant over a ride.

    Attributes:
        visibility_m: Distance at which contrast has fallen to 1/e, metres.
        fog_rgb: Colour of the air, 0…255.
        ambient: Share of daylight, 0…1.
        headlight: Strength of the train's headlight, 0…1.
        exposure: Gain before the tone curve.
        gamma: Exponent of the tone curve.
        contrast: Contrast about mid grey.
        cast_rgb: Channel gains.
        saturation: 0 grey … 1 unchanged.
        vignette: Darkening of the corners, 0…1.
        noise: Standard deviation of the sensor noise, grey levels.
        rain: Strength of rain streaks, 0…1.
        snow: Strength of falling snow, 0…1.
        drops: Number of drops on the windscreen.
        wiper: Angle of a wiper across the screen, radians; NaN for none.
        wiper_pair: Whether two arms are seen.
        dashboard: Share of the picture hidden at the bottom by the cab, 0…0.2.
        glare: Strength of veiling glare, 0…1.
        motion_blur: Length of the blur at the bottom edge, pixels at 640 wide.
        defocus: Standard deviation of the blur, pixels.
        quality: JPEG quality, or 0 for none.
        caption: Text in a corner, as recorders and websites add it; empty for none.
    """

    visibility_m: float = 6000.0
    fog_rgb: tuple[float, float, float] = (200.0, 205.0, 210.0)
    ambient: float = 1.0
    headlight: float = 0.0
    exposure: float = 1.0
    gamma: float = 1.0
    contrast: float = 1.0
    cast_rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    saturation: float = 1.0
    vignette: float = 0.1
    noise: float = 2.0
    rain: float = 0.0
    snow: float = 0.0
    drops: int = 0
    wiper: float = float("nan")
    wiper_pair: bool = False
    dashboard: float = 0.0
    glare: float = 0.0
    motion_blur: float = 0.0
    defocus: float = 0.0
    quality: int = 0
    caption: str = ""


@lru_cache(maxsize=1)
def _noise_tile() -> Floats:
    tile = np.random.default_rng(77).standard_normal((1024, 1024)).astype(np.float32)
    tile.setflags(write=False)
    return tile


@njit(cache=True, error_model="numpy")
def _develop(  # type: ignore[no-untyped-def]  # compiled
    rgb,
    depth,
    out,
    visibility,
    fog,
    ambient,
    headlight,
    gains,
    saturation,
    vignette,
    noise,
    tile,
    shift_v,
    shift_u,
    table,
):
    rows, cols = depth.shape
    for v in range(rows):
        y = (v - rows * 0.5) / (cols * 0.5)
        for u in range(cols):
            x = (u - cols * 0.5) / (cols * 0.5)
            far = depth[v, u]
            r, g, b = rgb[v, u, 0], rgb[v, u, 1], rgb[v, u, 2]
            if far < 1e8:
                light = ambient
                if headlight > 0:
                    beam = 22.0 / (far + 10.0)
                    light += (
                        headlight * min(1.2, beam * beam * 1.6 + 0.25 * beam) * np.exp(-x * x * 3.0)
                    )
                r, g, b = r * light, g * light, b * light
                haze = 1.0 - np.exp(-far / visibility)
            else:
                r, g, b = r * ambient, g * ambient, b * ambient
                haze = 1.0 - np.exp(-900.0 / visibility)
            r += haze * (fog[0] - r)
            g += haze * (fog[1] - g)
            b += haze * (fog[2] - b)
            shade = 1.0 - vignette * (x * x + y * y)
            r, g, b = r * gains[0] * shade, g * gains[1] * shade, b * gains[2] * shade
            grey = 0.3 * r + 0.59 * g + 0.11 * b
            r = grey + saturation * (r - grey)
            g = grey + saturation * (g - grey)
            b = grey + saturation * (b - grey)
            tv = (v + shift_v) & 1023
            tu = (u + shift_u) & 1023
            common = tile[tv, tu] * noise
            chroma = tile[tu, tv] * noise * 0.5
            out[v, u, 0] = table[min(max(int(r + common + chroma), 0), 1023)]
            out[v, u, 1] = table[min(max(int(g + common), 0), 1023)]
            out[v, u, 2] = table[min(max(int(b + common - chroma), 0), 1023)]


def develop(rgb: Floats, depth_m: Floats, weather: Weather, rng: np.random.Generator) -> Image:
    """Turn scene colours into the picture a camera in this weather delivers.

    Args:
        rgb: Scene colours in full daylight, 0…255 and above, shape (H, W, 3).
        depth_m: Distance ahead, metres, +inf for sky, shape (H, W).
        weather: Air, light and camera.
        rng: Source of noise, rain and drops.

    Returns:
        RGB picture, uint8, shape (H, W, 3).
    """
    rows, cols = depth_m.shape
    level = np.arange(1024) / 255.0
    tone = np.clip(level, 0, 1.6)
    tone = np.where(tone > 0.85, 0.85 + (1 - np.exp(-(tone - 0.85) * 3)) * 0.15, tone)
    tone = np.clip(tone, 0, 1) ** weather.gamma
    table = np.clip(((tone - 0.5) * weather.contrast + 0.5) * 255, 0, 255).astype(np.uint8)
    gains = np.array(weather.cast_rgb) * weather.exposure
    out = np.empty((rows, cols, 3), np.uint8)
    shift_v, shift_u = (int(s) for s in rng.integers(0, 1024, 2))
    _develop(
        rgb,
        depth_m,
        out,
        weather.visibility_m,
        np.array(weather.fog_rgb),
        weather.ambient,
        weather.headlight,
        gains,
        weather.saturation,
        weather.vignette,
        weather.noise,
        _noise_tile(),
        shift_v,
        shift_u,
        table,
    )
    scale = cols / 640.0
    if weather.motion_blur * scale > 1:
        out = _motion_blur(out, weather.motion_blur * scale)
    if weather.snow > 0:
        _snow(out, weather.snow, rng)
    if weather.rain > 0:
        _rain(out, weather.rain, rng)
    if weather.drops:
        out = _drops(out, weather.drops, rng)
    if weather.glare > 0:
        _glare(out, weather.glare, rng)
    if not np.isnan(weather.wiper):
        _wiper(out, weather.wiper, weather.wiper_pair)
    if weather.dashboard > 0:
        _dashboard(out, weather.dashboard)
    if weather.defocus > 0.3:
        out = cast(Image, cv2.GaussianBlur(out, (0, 0), weather.defocus * max(scale, 0.5)))
    if weather.caption:
        place = (round(20 * scale), rows - round(14 * scale))
        cv2.putText(
            out,
            weather.caption,
            place,
            cv2.FONT_HERSHEY_SIMPLEX,
            0.35 * scale,
            (235, 235, 235),
            1,
            cv2.LINE_AA,
        )
    if weather.quality:
        packed = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, weather.quality])[1]
        out = cast(Image, cv2.imdecode(packed, cv2.IMREAD_COLOR))
    return out


def _motion_blur(image: Image, length_px: float) -> Image:
    """Blur downwards in strength from the middle row, as the ground streams by."""
    rows = image.shape[0]
    for start, share in ((0.62, 0.4), (0.8, 1.0)):
        first = int(rows * start)
        taps = max(2, round(length_px * share))
        kernel = np.zeros((taps, taps), np.float32)
        kernel[:, taps // 2] = 1.0 / taps
        image[first:] = cv2.filter2D(image[first:], -1, kernel)
    return image


def _glare(image: Image, strength: float, rng: np.random.Generator) -> None:
    rows, cols = image.shape[:2]
    small = (max(cols // 8, 1), max(rows // 8, 1))
    u, v = np.meshgrid(np.linspace(0, 1, small[0]), np.linspace(0, 1, small[1]))
    centre = rng.uniform((0.0, -0.1), (1.0, 0.6))
    veil = 190 * strength * np.exp(-((u - centre[0]) ** 2 + (v - centre[1]) ** 2) * 4)
    grown = cv2.resize(veil.astype(np.uint8), (cols, rows), interpolation=cv2.INTER_LINEAR)
    cv2.add(image, cv2.merge([grown, grown, grown]), dst=image)


def _rain(image: Image, strength: float, rng: np.random.Generator) -> None:
    rows, cols = image.shape[:2]
    layer = np.zeros((rows, cols), np.uint8)
    lean = rng.uniform(-0.25, 0.25)
    for u, v, length in rng.uniform((0, 0, 0.02), (cols, rows, 0.09), (int(400 * strength), 3)):
        end = (int(u + lean * length * rows), int(v + length * rows))
        cv2.line(layer, (int(u), int(v)), end, int(rng.integers(25, 80)), 1, cv2.LINE_AA)
    cv2.add(image, cv2.merge([layer, layer, layer]), dst=image)


def _snow(image: Image, strength: float, rng: np.random.Generator) -> None:
    rows, cols = image.shape[:2]
    flakes = rng.uniform((0, 0, 0.6), (cols, rows, 3.2), (int(350 * strength), 3))
    for u, v, radius in flakes:
        grey = int(rng.integers(190, 250))
        cv2.circle(image, (int(u), int(v)), int(radius), (grey, grey, grey), -1, cv2.LINE_AA)


def _drops(image: Image, count: int, rng: np.random.Generator) -> Image:
    rows, cols = image.shape[:2]
    blurred = cv2.flip(cv2.resize(cv2.resize(image, (cols // 8, rows // 8)), (cols, rows)), 0)
    mask = np.zeros((rows, cols), np.float32)
    for u, v, radius in rng.uniform((0, 0, 0.003), (cols, rows, 0.016), (count, 3)):
        size = (max(1, int(radius * cols)), max(1, int(radius * cols * rng.uniform(0.8, 1.6))))
        cv2.ellipse(mask, (int(u), int(v)), size, 0, 0, 360, 0.6, -1, cv2.LINE_AA)
    return cast(Image, cv2.blendLinear(blurred, image, mask, 1 - mask))


def _wiper(image: Image, angle: float, pair: bool) -> None:
    rows, cols = image.shape[:2]
    for pivot in (0.3, 0.72) if pair else (0.55,):
        base = np.array([pivot * cols, rows * 1.08])
        tip = base + 1.15 * rows * np.array([np.sin(angle), -np.cos(angle)])
        elbow = base + 0.55 * (tip - base)
        thick = max(1, cols // 110)
        points = [tuple(int(c) for c in p) for p in (base, elbow, tip)]
        cv2.line(image, points[0], points[1], (22, 22, 24), thick * 2, cv2.LINE_AA)
        along = (tip - base) * 0.32
        blade = [tuple(int(c) for c in p) for p in (elbow - 0.4 * along, tip)]
        cv2.line(image, blade[0], blade[1], (14, 14, 15), thick, cv2.LINE_AA)
        shift = (thick, 0)
        cv2.line(
            image,
            (blade[0][0] + shift[0], blade[0][1]),
            (blade[1][0] + shift[0], blade[1][1]),
            (95, 97, 100),
            1,
            cv2.LINE_AA,
        )


def _dashboard(image: Image, share: float) -> None:
    rows, cols = image.shape[:2]
    top = int(rows * (1 - share))
    edge = np.array(
        [[0, rows], [0, top + rows // 40], [cols // 2, top], [cols, top + rows // 30], [cols, rows]]
    )
    cv2.fillPoly(image, [edge], (26, 27, 30), cv2.LINE_AA)
    cv2.polylines(image, [edge[1:4]], False, (60, 62, 66), max(1, cols // 320), cv2.LINE_AA)
