"""What a world is made of: its things, the tables a renderer needs, and their draft."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from railinspect.camera import Camera
from railinspect.scenes.alignment import Alignment
from railinspect.scenes.appearance import Appearance
from railinspect.scenes.raster import Kit
from railinspect.scenes.settings import SceneSettings

Array = npt.NDArray[np.float64]

START_M = -20
"""Chainage at which a world begins; the observer starts at 0."""

AHEAD_M = 700.0
"""How far a world reaches beyond the last place it is seen from, metres."""


@dataclass(frozen=True)
class Thing:
    """An object of interest standing in the world, or a distortion of the rails.

    Attributes:
        id: Identity, > 0.
        type: ``obstruction``, ``trespasser`` or ``distortion`` when it is an anomaly of the ego
            track, else the name of its class.
        label: Class id it is drawn with.
        chainage_m: Position of its near end along the track.
        lateral_m: Lateral position of its middle against the ego track, positive left.
        length_m: Extent along the track.
        height_m: Height; for a distortion the lateral amplitude.
        on_track: Whether it stands within the clearance of the ego track.
    """

    id: int
    type: str
    label: int
    chainage_m: float
    lateral_m: float
    length_m: float
    height_m: float
    on_track: bool


@dataclass(frozen=True)
class World:
    """Everything a renderer needs; see the modules of the tables for their columns."""

    seed: int
    kind: str
    alignment: Alignment
    camera: Camera
    looks: Appearance
    offsets: Array
    tracks: Array
    waves: Array
    zones: Array
    crossings: Array
    light: Array
    geometry: Array
    attributes: npt.NDArray[np.float32]
    things: tuple[Thing, ...]

    @property
    def spacing_m(self) -> float:
        """Distance between the centre lines of the two heads, metres."""
        return self.camera.rail_spacing_m


@dataclass
class Draft:
    """A world under construction, handed from builder to builder."""

    rng: np.random.Generator
    settings: SceneSettings
    looks: Appearance
    kind: str
    length_m: float
    spacing_m: float
    kit: Kit = field(default_factory=Kit)
    offsets: list[Array] = field(default_factory=list)
    tracks: list[tuple[float, ...]] = field(default_factory=list)
    waves: list[tuple[float, ...]] = field(default_factory=list)
    zones: list[tuple[float, ...]] = field(default_factory=list)
    crossings: list[tuple[float, ...]] = field(default_factory=list)
    turns: list[Array] = field(default_factory=list)
    things: list[Thing] = field(default_factory=list)
    light: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self.light = np.ones(self.along.size)

    @property
    def end_m(self) -> float:
        """Where the world ends, metres."""
        return self.length_m + AHEAD_M

    @property
    def along(self) -> Array:
        """Positions of the tables along the track, metres, step 1."""
        return np.arange(START_M, int(self.length_m + AHEAD_M) + 1, dtype=float)

    def in_the_open(self, at: float) -> bool:
        """Whether a place along the track lies off the junctions, where turns need the ground."""
        return all(np.isnan(turn[np.abs(self.along - at) < 6.0]).all() for turn in self.turns)

    def next_id(self) -> int:
        """A fresh object id."""
        return len(self.things) + 1

    def edges(self) -> tuple[float, float]:
        """Right and left limits of the tracks, metres."""
        middles = [o[np.isfinite(o)] for o in self.offsets]
        every = np.concatenate([*middles, np.zeros(1)])
        return float(every.min()) - 1.6, float(every.max()) + 1.6
