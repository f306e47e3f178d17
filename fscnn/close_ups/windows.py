"""Windows of rendered pictures with the truth at their place, to train the close-ups on.

Two sources, as the inspector meets two kinds of anomalies: those drawn into pictures
(:mod:`railinspect.anomalies`, sharp and wide pictures), and those that stand in the rendered world
(small pictures, often several things at once). A window is of an answer if that is at its place:
within 11 % of its range; what is between 11 % and 35 % away belongs to neither and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from railinspect.anomalies import NoTrackError, generate
from railinspect.anomalies.ego import EgoTrack, track_of_world
from railinspect.anomalies.generate import MADE_TYPES, Generated
from railinspect.anomalies.sources import WorldSource
from railinspect.close_ups import ANSWERS, FARTHEST_M, LEAST_METRE_PX, WINDOW_WH, close_up
from railinspect.labels import HUMAN
from railinspect.scenes import SceneSettings, planting
from railinspect.scenes.render import SceneObject, view
from railinspect.scenes.world import begin, finish

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Span = tuple[float, float]

WIDE: Final = SceneSettings(size_wh=(1920, 1080))
"""Pictures that anomalies are drawn into."""

AT_PLACE: Final = 0.11
"""What is so near to a window's place, in the logarithm of the range, is what the window shows."""

APART: Final = 0.3
"""What is farther away from it than this is not."""

STEP: Final = 1.2
"""Ratio of the ranges of a clear picture's windows: neighbours share half of what they show."""

MARGIN_PX: Final = 6
"""Border kept around a window, from which the trainer shifts and scales it."""

SIZE_WH: Final = (WINDOW_WH[0] + 2 * MARGIN_PX, WINDOW_WH[1] + 2 * MARGIN_PX)
"""Width and height of a window with its margin, pixels."""

_DRAWN_EACH: Final = 2
_PATH_STD: Final = (0.10, 0.05, 0.03)
"""How far off a followed track is: aside and along the picture's columns (m), and its scale."""

_LEAST_HEIGHT_PX: Final = 4.0
_LEAST_VISIBLE_PX: Final = 25
_LEAST_BEND_PX: Final = 2.0
_BESIDE_M: Final = 2.3
"""A person nearer to the centre line than this, but not on the track, is neither."""


@dataclass
class Windows:
    """Windows of one or more pictures.

    Attributes:
        images: uint8, shape (92, 140, 3) each: with ``MARGIN_PX`` around.
        answers: Position in ``ANSWERS`` of each.
    """

    images: list[Image] = field(default_factory=list)
    answers: list[int] = field(default_factory=list)

    def take(
        self, rgb: Image, track: EgoTrack, range_m: float, answer: int, rng: np.random.Generator
    ) -> None:
        """Cut one window as the inspector would, its track not quite where the true one is."""
        place = track.pixels(range_m, 0.0, 0.0)
        metre = float(np.interp(range_m, track.along_m, track.metre_px))
        aside, along, scale = rng.normal(0.0, _PATH_STD)
        place = place + metre * np.array([aside, along])
        metre *= math.exp(scale)
        if not np.isfinite([*place, metre]).all():
            return
        window = with_margin(rgb, place, metre)
        if window is not None:
            self.images.append(window)
            self.answers.append(answer)


def with_margin(rgb: Image, place_uv: Array, metre_px: float) -> Image | None:
    """A close-up with ``MARGIN_PX`` more on each side, uint8, shape (92, 140, 3)."""
    return close_up(rgb, (float(place_uv[0]), float(place_uv[1])), metre_px, MARGIN_PX)


def drawn(seed: int) -> Windows | None:
    """A clear wide picture all along its track, and two anomalies of each type drawn into it.

    Args:
        seed: Seed of the world and of every choice.

    Returns:
        The windows; None if the world has no track to draw on.
    """
    rng = np.random.default_rng([seed, 77])
    try:
        base = WorldSource(seed, WIDE).base(0)
        base.track.section(0.3, 0.8)
    except NoTrackError:
        return None
    track = base.track
    near, far = _seen(track, 4.0)
    windows = Windows()
    for range_m in _ladder(near, far, rng):
        windows.take(base.rgb, track, range_m, 0, rng)
    for kind in MADE_TYPES:
        for _ in range(_DRAWN_EACH):
            try:
                made = generate(base.rgb, base.labels, kind, rng, track)
            except NoTrackError:
                continue
            whole, core = _extent(made, track)
            for _ in range(2):
                at = float(rng.choice(core)) * math.exp(rng.uniform(-AT_PLACE, AT_PLACE))
                windows.take(made.rgb, track, at, ANSWERS.index(kind), rng)
            elsewhere = math.exp(rng.uniform(math.log(near), math.log(far)))
            if _apart(elsewhere, whole):
                windows.take(made.rgb, track, elsewhere, 0, rng)
    return windows


def _extent(made: Generated, track: EgoTrack) -> tuple[Span, Array]:
    """From where to where an anomaly reaches along the track, and ranges that surely show it."""
    if made.moved is None:
        assert made.range_m is not None
        return (made.range_m, made.range_m), np.array([made.range_m])
    along = np.interp(-made.moved.v, -track.rows_px, track.along_m)
    aside = np.abs(made.moved.shift_px) / made.moved.metre_px
    there = along[aside >= 0.15 * aside.max()]
    return (float(there.min()), float(there.max())), along[aside >= 0.6 * aside.max()]


def rendered(seed: int) -> Windows | None:
    """A small picture of a world with things in it, half of them crowded, all along its track.

    Args:
        seed: Seed of the world and of every choice.

    Returns:
        The windows; None if the world has no track.
    """
    rng = np.random.default_rng([seed, 78])
    settings = SceneSettings(crowded=bool(rng.random() < 0.5), closer=int(rng.choice([1, 1, 2])))
    draft, alignment, camera = begin(seed, settings)
    if draft.kind == "none":
        return None
    planting.sprinkle(draft, np.random.default_rng([seed, 0xA402]), camera.focal_px)
    world = finish(draft, seed, alignment, camera)
    picture = view(world, np.random.default_rng([seed, 0xF17E]))
    try:
        track = track_of_world(world, picture)
    except NoTrackError:
        return None
    near, far = _seen(track, LEAST_METRE_PX)
    lengths = {thing.id: thing.length_m for thing in world.things}
    shown = [
        one
        for thing in picture.objects
        if (one := _shown(thing, lengths.get(thing.id, 0.0), track)) is not None
    ]
    first = min((span[0] for span, _ in shown), default=math.inf)
    windows = Windows()
    for range_m in _ladder(near, far, rng):
        # behind a thing the track may be hidden, and then the window shows nothing of it
        told = range_m < STEP * first or rng.random() < 0.3
        if told and all(_apart(range_m, span) for span, _ in shown):
            windows.take(picture.rgb, track, range_m, 0, rng)
    for (start, end), answer in shown:
        for _ in range(2 if answer else 0):
            inner = (0.7 * start + 0.3 * end, 0.3 * start + 0.7 * end)
            at = rng.uniform(*inner) * math.exp(rng.uniform(-AT_PLACE, AT_PLACE))
            if 0.8 * near < at < 1.1 * far:
                windows.take(picture.rgb, track, at, answer, rng)
    return windows


def _shown(thing: SceneObject, length_m: float, track: EgoTrack) -> tuple[Span, int] | None:
    """Where a thing reaches along the track, and its answer: 0 where it can hardly be told."""
    if not thing.on_track or thing.type not in ANSWERS:
        beside = thing.label == HUMAN and abs(thing.lateral_m) < _BESIDE_M
        return ((thing.range_m, thing.range_m), 0) if beside else None
    metre = float(np.interp(thing.range_m, track.along_m, track.metre_px))
    answer = ANSWERS.index(thing.type)
    if thing.type == "distortion":
        span = thing.range_m, thing.range_m + length_m
        return span, answer if thing.height_m * metre >= _LEAST_BEND_PX else 0
    tall = thing.height_m * metre >= _LEAST_HEIGHT_PX
    told = tall and thing.visible_px >= _LEAST_VISIBLE_PX
    return (thing.range_m, thing.range_m), answer if told else 0


def _seen(track: EgoTrack, least_metre_px: float) -> Span:
    wide = track.along_m[track.metre_px > least_metre_px]
    far = float(wide[-1]) if len(wide) else 0.0
    return float(track.along_m[0]), min(far, FARTHEST_M)


def _ladder(near: float, far: float, rng: np.random.Generator) -> Iterator[float]:
    range_m = near * math.exp(rng.uniform(0.0, math.log(STEP)))
    while range_m < far:
        yield range_m
        range_m *= STEP


def _apart(range_m: float, span: Span) -> bool:
    return range_m < span[0] * math.exp(-APART) or range_m > span[1] * math.exp(APART)
