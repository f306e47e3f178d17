"""One anomaly put into one picture of a clear track: distortion, obstruction or trespasser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.anomalies.blend import blend
from railinspect.anomalies.cutouts import Cutout
from railinspect.anomalies.distort import (
    DISTORTION_KINDS,
    Distortion,
    DistortionKind,
    Moved,
    distort,
    seen_px,
)
from railinspect.anomalies.ego import EgoTrack, NoTrackError, check_mask, track_of_mask
from railinspect.anomalies.library import draw_cutout
from railinspect.camera import Camera
from railinspect.errors import BadInputError
from railinspect.labels import GROUND

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
MadeType = Literal["distortion", "obstruction", "trespasser"]
MADE_TYPES: Final[tuple[MadeType, ...]] = ("distortion", "obstruction", "trespasser")

_TRIES: Final = 40
_MOST_ENLARGED_M: Final = 0.45
_OPAQUE: Final = 0.5
_IS_GROUND = np.zeros(256, np.uint8)
_IS_GROUND[list(GROUND)] = 1


@dataclass(frozen=True)
class GeneratorSettings:
    """What a caller may choose; the defaults are the paper's where it states one.

    Attributes:
        near_share: τ₁ of equation 45: where R′ begins, share of the way to the horizon.
        far_share: τ₂ of equation 46: where R′ ends.
        obstruction_alpha: Share of alpha blending for obstructions, 0…1.
        trespasser_alpha: The same for people.
        padding_px: Padding of the Poisson domain, pixels; None takes an eighth of the height.
        person_reach_m: People stand up to this far from the centre line: the extended R′, metres.
        distortions: Kinds of distortion to draw from.
        amplitude_m: Range of a distortion's largest lateral displacement, metres.
        least_amplitude_px: A displacement of a ripple or buckle is at least this large in the
            picture, at right angles to the track, pixels. If need be it is made larger, up to
            0.45 m, or the track is bent elsewhere.
        shadow: Darkness of the contact shadow, 0…1.
        cutouts: Things to blend in; empty takes the built-in ones.
    """

    near_share: float = 0.3
    far_share: float = 0.8
    obstruction_alpha: float = 0.3
    trespasser_alpha: float = 0.5
    padding_px: int | None = None
    person_reach_m: float = 1.5
    distortions: tuple[DistortionKind, ...] = ("ripple", "buckle")
    amplitude_m: tuple[float, float] = (0.12, 0.30)
    least_amplitude_px: float = 2.5
    shadow: float = 0.65
    cutouts: tuple[Cutout, ...] = ()

    def __post_init__(self) -> None:
        if not 0 <= self.near_share < self.far_share < 1:
            raise BadInputError(
                f"the stretch is {self.near_share} to {self.far_share} of the way to the horizon; "
                "both must lie within 0…1, the first below the second"
            )
        for name in ("obstruction_alpha", "trespasser_alpha", "shadow"):
            value = getattr(self, name)
            if not 0 <= value <= 1:
                raise BadInputError(f"{name} is {value}; give a number from 0 to 1")
        if self.padding_px is not None and not 1 <= self.padding_px <= 200:
            raise BadInputError(f"padding_px is {self.padding_px}; give 1 to 200 pixels")
        low, high = self.amplitude_m
        if not 0 < low <= high <= 0.6:
            raise BadInputError(f"amplitude_m is {low}…{high}; give metres within 0…0.6, rising")
        if not 0 <= self.person_reach_m <= 4:
            raise BadInputError(f"person_reach_m is {self.person_reach_m}; give 0 to 4 metres")
        strange = [kind for kind in self.distortions if kind not in DISTORTION_KINDS]
        if strange or not self.distortions:
            raise BadInputError(
                f"distortions are {self.distortions}; choose from {', '.join(DISTORTION_KINDS)}"
            )


@dataclass(frozen=True)
class Generated:
    """A picture with one anomaly and its truth; see :class:`ManifestEntry` for the fields."""

    rgb: Image
    labels: Image
    type: MadeType
    kind: str
    polygon_uv: Array
    box_xyxy: tuple[float, float, float, float]
    range_m: float | None
    lateral_m: float
    height_m: float
    label: int | None
    blend: Mapping[str, Any] = field(default_factory=dict)
    moved: Moved | None = None


@dataclass(frozen=True)
class Placed:
    """Where a cut-out came to stand in a picture.

    Attributes:
        matte: Its opacity over its box, 0…1, shape (h, w).
        at_xy: The box's upper left pixel.
        polygon_uv: Its outline, pixels, shape (K, 2).
        box_xyxy: Its box within the picture, pixels.
        method: How it was blended, see :class:`railinspect.anomalies.blend.Blended`.
        padding_px: Padding of the Poisson domain, pixels.
    """

    matte: npt.NDArray[np.float32]
    at_xy: tuple[int, int]
    polygon_uv: Array
    box_xyxy: tuple[float, float, float, float]
    method: str
    padding_px: int


def generate(
    rgb: Image,
    labels: Image,
    kind: MadeType,
    rng: np.random.Generator,
    track: EgoTrack | None = None,
    settings: GeneratorSettings | None = None,
    camera: Camera | None = None,
) -> Generated:
    """Put one anomaly into a picture of a clear track.

    Args:
        rgb: Picture, uint8 RGB, shape (H, W, 3); left as it is.
        labels: RailSem19 class ids, uint8, shape (H, W); left as they are.
        kind: The type of anomaly.
        rng: Source of every choice: the same state gives the same bytes.
        track: The ego track, if it is known; else it is followed in the mask.
        settings: Choices left to the caller.
        camera: The camera, if it is known and ``track`` is not given.

    Raises:
        NoTrackError: if there is no track or no free place on it.
        BadInputError: if the picture or the mask is none, or their sizes differ.
    """
    settings = settings or GeneratorSettings()
    if rgb.ndim != 3 or rgb.shape[2:] != (3,) or rgb.dtype != np.uint8 or rgb.size == 0:
        raise BadInputError(
            f"the picture must be uint8 RGB (H, W, 3), not {rgb.dtype} of shape {rgb.shape}"
        )
    if rgb.shape[:2] != labels.shape:
        raise BadInputError(
            f"the picture is {rgb.shape[1]}×{rgb.shape[0]} but its mask has shape {labels.shape}; "
            "give both at the same size"
        )
    if track is None:
        track = track_of_mask(labels, camera)
    else:
        check_mask(labels)
    near, far = track.section(settings.near_share, settings.far_share)
    if kind == "distortion":
        return _distorted(rgb.copy(), labels.copy(), track, rng, settings, near, far)
    return _with_object(rgb.copy(), labels.copy(), kind, track, rng, settings, near, far)


def _distorted(
    rgb: Image,
    labels: Image,
    track: EgoTrack,
    rng: np.random.Generator,
    settings: GeneratorSettings,
    near: float,
    far: float,
) -> Generated:
    kind = settings.distortions[int(rng.integers(len(settings.distortions)))]
    low, high = settings.amplitude_m
    for _ in range(_TRIES):
        length = {
            "ripple": float(rng.uniform(8.0, 20.0)),
            "buckle": float(rng.uniform(7.0, 14.0)),
            "break": float(rng.uniform(0.6, 1.8)),
            "gap": float(rng.uniform(1.5, 4.0)),
        }[kind]
        length = min(length, 0.8 * (far - near))
        start = float(rng.uniform(near, far - length))
        size = float(rng.uniform(low, high)) * float(rng.choice([-1.0, 1.0]))
        if kind == "break":
            size = math.copysign(min(abs(size), 0.09), size)
        elif kind == "gap":
            size = 0.0
        rails = (True, True)
        if kind == "break" or (kind == "gap" and rng.random() < 0.6):
            left = bool(rng.random() < 0.5)
            rails = (left, not left)
        plan = Distortion(kind, start, length, size, float(rng.uniform(1.5, 3.0)), rails)
        if not _is_free(labels, track, start, start + length, 0.0, 1.2):
            continue
        if kind in ("break", "gap"):
            break
        gain = settings.least_amplitude_px / max(seen_px(track, plan, labels.shape[0]), 1e-9)
        if gain <= 1.0:
            break
        if abs(size) * gain <= _MOST_ENLARGED_M:
            plan = replace(plan, amplitude_m=size * gain)
            break
    else:
        raise NoTrackError(
            "nowhere on the track are its rails in full view and a bend of them would show; use "
            "another picture"
        )
    polygon, notes, moved = distort(rgb, labels, track, plan)
    missing = {"break": length / 3, "gap": length}.get(kind)
    return Generated(
        rgb,
        labels,
        "distortion",
        kind,
        polygon,
        _box(polygon),
        start if track.calibrated else None,
        0.0,
        abs(plan.amplitude_m) if missing is None else missing,
        None,
        notes,
        moved,
    )


def _with_object(
    rgb: Image,
    labels: Image,
    kind: Literal["obstruction", "trespasser"],
    track: EgoTrack,
    rng: np.random.Generator,
    settings: GeneratorSettings,
    near: float,
    far: float,
) -> Generated:
    own = [cutout for cutout in settings.cutouts if cutout.type == kind]
    if settings.cutouts and not own:
        raise BadInputError(
            f"none of the {len(settings.cutouts)} cut-outs is for type {kind}; add one, or build "
            "without that type"
        )
    cutout = own[int(rng.integers(len(own)))] if own else draw_cutout(rng, kind)
    if rng.random() < 0.5:
        cutout = cutout.mirrored()
    person = kind == "trespasser"
    reach = settings.person_reach_m if person else track.camera.rail_spacing_m / 2
    for _ in range(_TRIES):
        # even in the picture's rows, as R′ is a set of pixels
        rows = np.interp([near, far], track.along_m, track.rows_px)
        row = float(rng.uniform(rows[1], rows[0]))
        along = float(np.interp(-row, -track.rows_px, track.along_m))
        lateral = float(rng.uniform(-reach, reach))
        if _is_free(labels, track, along - 0.3, along + 0.3, lateral, 0.3):
            break
    else:
        raise NoTrackError("no free place is left on the track; use another picture")
    alpha = settings.trespasser_alpha if person else settings.obstruction_alpha
    placed = place(rgb, labels, track, cutout, along, lateral, alpha, settings)
    return Generated(
        rgb,
        labels,
        kind,
        cutout.name,
        placed.polygon_uv,
        placed.box_xyxy,
        along if track.calibrated else None,
        lateral,
        cutout.height_m,
        cutout.label,
        {
            "alpha": alpha,
            "method": placed.method,
            "padding_px": placed.padding_px,
            "shadow": settings.shadow,
        },
    )


def place(
    rgb: Image,
    labels: Image,
    track: EgoTrack,
    cutout: Cutout,
    along_m: float,
    lateral_m: float,
    alpha: float,
    settings: GeneratorSettings | None = None,
) -> Placed:
    """Stand a cut-out on the ground of a track and blend it in, both pictures changed in place.

    Args:
        rgb: Picture, uint8, shape (H, W, 3).
        labels: Class mask, uint8, shape (H, W).
        track: The track.
        cutout: What to place.
        along_m: Distance of its foot along the track, metres.
        lateral_m: Place of its middle across the track, metres, positive left.
        alpha: Share of alpha blending, 0…1.
        settings: Padding and shadow.
    """
    settings = settings or GeneratorSettings()
    foot, head = track.pixels(
        along_m, lateral_m, [track.ground_m, track.ground_m + cutout.height_m]
    )
    if not (np.isfinite(foot).all() and np.isfinite(head).all()):
        raise NoTrackError(f"a place {along_m:.1f} m ahead is not in the picture")
    colour, matte, at_xy = stand(cutout, foot, head)
    _contact_shadow(rgb, matte, at_xy, foot, head, cutout.height_m, track, settings.shadow)
    done = blend(rgb, colour, matte, at_xy, alpha, settings.padding_px)
    rows, cols = labels.shape
    left, top = at_xy
    v0, v1 = max(top, 0), min(top + matte.shape[0], rows)
    u0, u1 = max(left, 0), min(left + matte.shape[1], cols)
    solid = matte[max(0, v0 - top) : max(0, v1 - top), max(0, u0 - left) : max(0, u1 - left)]
    solid_px = solid >= _OPAQUE
    if not solid_px.any():
        raise NoTrackError(
            f"{cutout.name} {along_m:.1f} m ahead is too small or out of the picture"
        )
    labels[v0:v1, u0:u1][solid_px] = cutout.label
    contours, _ = cv2.findContours(
        solid_px.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
    )
    points = np.concatenate(contours).reshape(-1, 2)
    outline = cv2.convexHull(points) if len(contours) > 1 else contours[0]
    if len(outline) > 60:
        outline = cv2.approxPolyDP(outline, 1.0, True)
    polygon = outline.reshape(-1, 2).astype(float) + np.array([u0, v0])
    if len(polygon) < 3:
        u, v = np.nonzero(solid_px.T)
        low, high = (u.min() + u0, v.min() + v0), (u.max() + u0 + 1, v.max() + v0 + 1)
        polygon = np.array([low, (high[0], low[1]), high, (low[0], high[1])], float)
    u, v = np.nonzero(solid_px.T)
    box = (float(u.min() + u0), float(v.min() + v0), float(u.max() + u0), float(v.max() + v0))
    return Placed(matte, at_xy, polygon, box, done.method, done.padding_px)


def stand(
    cutout: Cutout, foot_uv: Array, head_uv: Array
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], tuple[int, int]]:
    """Scale and turn a cut-out so that its lowest row meets ``foot_uv``, its highest ``head_uv``.

    Returns:
        Premultiplied colours (h, w, 3), the matte (h, w), and the upper left pixel of both.
    """
    rows = np.flatnonzero((cutout.rgba[..., 3] >= 128).any(axis=1))
    tall = float(rows[-1] - rows[0] + 1)
    up = head_uv - foot_uv
    size_px = float(np.hypot(*up))
    source = cutout.rgba.astype(np.float32)
    opacity = source[..., 3:] / 255.0
    source[..., :3] *= opacity
    source[..., 3:] = opacity
    # an area average first, so that the last step only shifts and turns
    shrink = min(1.0, 1.25 * size_px / tall)
    grid = (
        max(1, round(cutout.rgba.shape[1] * shrink)),
        max(1, round(cutout.rgba.shape[0] * shrink)),
    )
    small = cv2.resize(source, grid, interpolation=cv2.INTER_AREA)
    share_u, share_v = grid[0] / cutout.rgba.shape[1], grid[1] / cutout.rgba.shape[0]
    # source edges (pixels counted from the picture's edge) to picture
    foot_s = np.array([cutout.rgba.shape[1] / 2 * share_u, (rows[-1] + 1) * share_v])
    gain_v = size_px / (tall * share_v)
    gain_u = size_px / (tall * share_u)
    unit_v = -up / max(size_px, 1e-9)  # downwards in the cut-out
    unit_u = np.array([unit_v[1], -unit_v[0]])
    turn = np.stack([unit_u * gain_u, unit_v * gain_v], axis=1)
    corners = np.array([[0, 0], [grid[0], 0], [0, grid[1]], [grid[0], grid[1]]], float)
    spots = (corners - foot_s) @ turn.T + foot_uv
    low = np.floor(spots.min(axis=0)).astype(int) - 1
    high = np.ceil(spots.max(axis=0)).astype(int) + 1
    # pixel centres lie half a pixel from the edges, in the cut-out as in the picture
    start = turn @ (0.5 - foot_s) + foot_uv - low
    warp = np.column_stack([turn, start])
    box = (int(high[0] - low[0]), int(high[1] - low[1]))
    stood = cast(npt.NDArray[np.float32], cv2.warpAffine(small, warp, box, flags=cv2.INTER_LINEAR))
    # the lens's own softness
    stood = np.asarray(cv2.GaussianBlur(stood, (3, 3), 0.45), np.float32)
    return stood[..., :3], stood[..., 3], (int(low[0]), int(low[1]))


def _contact_shadow(
    rgb: Image,
    matte: npt.NDArray[np.float32],
    at_xy: tuple[int, int],
    foot: Array,
    head: Array,
    height_m: float,
    track: EgoTrack,
    darkness: float,
) -> None:
    """Darken the ground about what touches it."""
    if darkness <= 0:
        return
    size_px = float(np.hypot(*(head - foot)))
    metre = size_px / height_m
    row = min(max(round(foot[1]) - at_xy[1], 1), matte.shape[0])
    touch = matte[max(0, row - max(2, round(0.12 * size_px))) : row].max(axis=0) > 0.4
    columns = np.flatnonzero(touch)
    if not len(columns):
        return
    middle = at_xy[0] + 0.5 * (columns[0] + columns[-1])
    half_u = 0.5 * (columns[-1] - columns[0] + 1) + 0.16 * metre
    # how much the ground rises in the picture over the shadow's depth
    camera = track.camera
    drop = max(foot[1] - camera.horizon_v(float(foot[0])), 1.0)
    depth_m = min(0.9, 0.25 + 0.22 * (half_u / metre))
    half_v = max(1.2, depth_m * drop / (drop / metre * camera.focal_px / metre + depth_m))
    low_u, high_u = math.floor(middle - 2 * half_u), math.ceil(middle + 2 * half_u) + 1
    low_v, high_v = math.floor(foot[1] - 2 * half_v), math.ceil(foot[1] + 2 * half_v) + 1
    low_u, high_u = max(low_u, 0), min(high_u, rgb.shape[1])
    low_v, high_v = max(low_v, 0), min(high_v, rgb.shape[0])
    if low_u >= high_u or low_v >= high_v:
        return
    u = (np.arange(low_u, high_u, dtype=np.float32) - np.float32(middle)) / np.float32(half_u)
    v = (np.arange(low_v, high_v, dtype=np.float32) - np.float32(foot[1])) / np.float32(half_v)
    # full under the object, soft beyond its edges
    u = np.maximum(np.abs(u) - 0.5, 0.0) * 2.0
    gain = 1.0 - np.float32(darkness) * np.exp(-1.2 * (u * u + (v * v)[:, None])).astype(np.float32)
    part = rgb[low_v:high_v, low_u:high_u]
    part[...] = (part * gain[..., None]).astype(np.uint8)


def _is_free(
    labels: Image, track: EgoTrack, near_m: float, far_m: float, lateral_m: float, half_m: float
) -> bool:
    """Whether the ground of a stretch is in view and within the picture."""
    along = np.linspace(near_m, far_m, 7)[:, None]
    left = lateral_m + np.linspace(-half_m, half_m, 5)
    uv = track.pixels(along, left, track.ground_m).reshape(-1, 2)
    height, width = labels.shape
    inside = np.asarray(np.isfinite(uv).all(axis=1))
    inside[inside] &= ((uv[inside] >= 0) & (uv[inside] <= [width - 1, height - 1])).all(axis=1)
    if not inside.all():
        return False
    at = uv.round().astype(int)
    seen = _IS_GROUND[labels[at[:, 1], at[:, 0]]]
    return bool(seen.mean() >= 0.85)


def _box(points: Array) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


__all__: Sequence[str] = [
    "MADE_TYPES",
    "Generated",
    "GeneratorSettings",
    "MadeType",
    "Placed",
    "generate",
    "place",
    "stand",
]
