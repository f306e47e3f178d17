"""Close-ups of the track ahead, each to one scale, and what a small network says of them.

A segmentation labels pixels wherever they are and at whatever size a thing has there. The track is
known once it is followed, and with it the scale: a close-up is a window of the picture around a
place on the centre line, 6.4 m wide, resampled to ``PX_PER_M`` pixels per metre. Whatever the
range, the rails meet the place in the same two columns, the ground runs to the same vanishing row
for a camera of the same height, and a person is as tall: the network has only to tell a clear track
from one that is distorted, obstructed or walked on *at that place*. It answers from the picture
itself and so errs in other pictures than the segmentation does.

Close-ups need the track and say nothing where it is not followed, nor where it is too dark to see
it. They say where along the track something is, not which pixels it covers.
"""

from __future__ import annotations

import functools
import importlib.resources
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from railinspect.bundle import GOLDEN_INPUT, Image, golden_image, read_bytes
from railinspect.errors import BundleError
from railinspect.onnx_session import open_session
from railinspect.track.geometry import TrackGeometry

Array = npt.NDArray[np.float64]

PX_PER_M: Final = 20.0
"""Scale of a close-up across the track at its place, pixels per metre."""

WINDOW_WH: Final = (128, 80)
"""Width and height of a close-up, pixels."""

PLACE_UV: Final = (64, 56)
"""Where in a close-up its place on the centre line lies, pixels."""

ANSWERS: Final = ("clear", "distortion", "obstruction", "trespasser")
"""What the network tells apart, in the order of its output."""

METADATA_KEY: Final = "railinspect_close_up"
FORMAT: Final = 1

STEP: Final = 1.09
"""Ratio of the ranges of neighbouring close-ups: each thing is near the place of two."""

LEAST_METRE_PX: Final = 5.0
"""Nothing is told where a metre across the track takes up fewer pixels of the picture."""

MOST_METRE_SHARE: Final = 0.4
"""So near that a metre takes up this share of the picture's width, a close-up would be mostly
outside of it."""

LEAST_CONTRAST: Final = 1.0
"""Standard deviation of the ground's grey levels around a place, 0 … 255, below which nothing shows
what the track is like there: night, or glare."""

_GROUND: Final = np.s_[40:72, 30:98]

FARTHEST_M: Final = 130.0
BEYOND_REACH: Final = 1.15
"""Close-ups are taken up to this multiple of the rails' reach and 3 m: a thing hides the rails."""

_BATCH = 64


@dataclass(frozen=True)
class CloseUps:
    """What the network says of places along the track; N places, by rising range.

    Attributes:
        chainage_m: Distance of each place along the track, metres, shape (N,).
        chances: Probability of each of :data:`ANSWERS`, 0…1, shape (N, 4).
    """

    chainage_m: Array
    chances: Array


def close_up(
    rgb: Image, place_uv: Sequence[float], metre_px: float, margin_px: int = 0
) -> Image | None:
    """One window of a picture, resampled to ``PX_PER_M``; the picture's border is repeated outside.

    Args:
        rgb: Picture, uint8, shape (H, W, 3).
        place_uv: The place on the centre line, pixels.
        metre_px: Pixels per metre across the track there, > 0.
        margin_px: So many more pixels on each side, for training.

    Returns:
        uint8, shape (80, 128, 3) without a margin; None where the window lies outside the picture.

    Example:
        >>> picture = np.zeros((360, 640, 3), np.uint8)
        >>> close_up(picture, (320.0, 250.0), 40.0).shape
        (80, 128, 3)
    """
    scale = metre_px / PX_PER_M
    wide, high = (side + 2 * margin_px for side in WINDOW_WH)
    left, top = (round(place_uv[i] - (PLACE_UV[i] + margin_px) * scale) for i in range(2))
    right, bottom = left + max(2, round(wide * scale)), top + max(2, round(high * scale))
    height, width = rgb.shape[:2]
    u0, v0, u1, v1 = max(0, left), max(0, top), min(width, right), min(height, bottom)
    if u1 - u0 < 2 or v1 - v0 < 2:
        return None
    part = rgb[v0:v1, u0:u1]
    margin = (v0 - top, bottom - v1, u0 - left, right - u1)
    if any(margin):
        part = cast(Image, cv2.copyMakeBorder(part, *margin, cv2.BORDER_REPLICATE))
    way = cv2.INTER_AREA if scale > 1.0 else cv2.INTER_LINEAR
    return cast(Image, cv2.resize(part, (wide, high), interpolation=way))


def places(
    track: TrackGeometry, from_m: float = 0.0, to_m: float = FARTHEST_M, every: int = 1
) -> Array:
    """Where along a followed track close-ups are taken, metres, rising, shape (N,).

    Args:
        track: The track; empty without a path.
        from_m: Nearest range wanted, metres.
        to_m: Farthest, metres.
        every: Only each so-many-th place, at least 1.
    """
    path = track.path
    if path is None or len(path.uv) < 2:
        return np.zeros(0)
    first = float(path.chainage_m[0])
    last = min(float(path.chainage_m[-1]), BEYOND_REACH * (track.reach_m or 0.0) + 3.0, FARTHEST_M)
    if last <= first or first <= 0.0:
        return np.zeros(0)
    count = int(np.log(last / first) / np.log(STEP)) + 1
    at = first * STEP ** np.arange(0, count, every)
    metre = np.interp(at, path.chainage_m, path.metre_px)
    most = MOST_METRE_SHARE * track.camera.size_wh[0]
    chosen = (metre >= LEAST_METRE_PX) & (metre <= most) & (at >= from_m) & (at <= to_m)
    return cast(Array, at[chosen])


LookAtTrack = Callable[..., CloseUps]
"""A :class:`CloseUpNetwork` bound to its picture; takes the track and what :func:`places` does."""


class CloseUpNetwork:
    """The network of the close-ups, loaded and checked.

    Attributes:
        metadata: What the file says about itself.
    """

    def __init__(self, data: bytes, name: str = "close-up network") -> None:
        """Load it from its bytes; :meth:`load` and :meth:`default` read them from a file.

        Args:
            data: The ONNX file.
            name: How error messages call it.

        Raises:
            BundleError: if the bytes are no such network, or one for other windows than ours.
        """
        session = open_session(data, name, 1)
        text = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
        self.metadata = _checked(text, name)
        width, height = WINDOW_WH
        ports = [(p.name, p.type, p.shape[1:]) for p in session.get_inputs()]
        ports += [(p.name, p.type, p.shape[1:]) for p in session.get_outputs()]
        expected = [
            ("windows", "tensor(uint8)", [height, width, 3]),
            ("chances", "tensor(float)", [len(ANSWERS)]),
        ]
        if ports != expected:
            raise BundleError(f"{name} takes and gives {ports}, expected {expected}")
        self._session = session

    @staticmethod
    def load(path: Path | str) -> CloseUpNetwork:
        """Load a file made by ``python -m export.close_up``.

        Raises:
            BundleError: if it is missing, damaged, too large or something else.
        """
        return CloseUpNetwork(read_bytes(Path(path)), f"close-up network {path}")

    @staticmethod
    @functools.cache
    def default() -> CloseUpNetwork:
        """The one that ships with the package, loaded once."""
        shipped = importlib.resources.files("railinspect") / "bundles" / "close_up.onnx"
        with importlib.resources.as_file(shipped) as path:
            return CloseUpNetwork.load(path)

    def chances(self, windows: Image) -> Array:
        """Probability of each of :data:`ANSWERS`, shape (N, 4).

        Args:
            windows: Close-ups, uint8, shape (N, 80, 128, 3).
        """
        parts = [
            self._session.run(["chances"], {"windows": windows[i : i + _BATCH]})[0]
            for i in range(0, len(windows), _BATCH)
        ]
        return np.concatenate(parts).astype(float) if parts else np.zeros((0, len(ANSWERS)))

    def __call__(
        self,
        rgb: Image,
        track: TrackGeometry,
        from_m: float = 0.0,
        to_m: float = FARTHEST_M,
        every: int = 1,
    ) -> CloseUps:
        """Look at the track of a picture, all along or from … to.

        Args:
            rgb: Picture, uint8 RGB, shape (H, W, 3).
            track: The track followed in it.
            from_m: Nearest range wanted, metres.
            to_m: Farthest, metres.
            every: Only at each so-many-th place, at least 1.
        """
        path = track.path
        at, windows = [], []
        for chainage in places(track, from_m, to_m, every):
            assert path is not None
            u, v = (float(np.interp(chainage, path.chainage_m, path.uv[:, i])) for i in range(2))
            metre = float(np.interp(chainage, path.chainage_m, path.metre_px))
            if not (0 <= u < rgb.shape[1] and 0 <= v < rgb.shape[0] and np.isfinite(metre)):
                continue  # the track has left the picture there, or turned back behind a crest
            window = close_up(rgb, (u, v), metre)
            if window is not None and cv2.meanStdDev(window[_GROUND])[1].max() >= LEAST_CONTRAST:
                at.append(chainage)
                windows.append(window)
        if not windows:
            return CloseUps(np.zeros(0), np.zeros((0, len(ANSWERS))))
        return CloseUps(np.array(at), self.chances(np.stack(windows)))


def golden_windows() -> Image:
    """Two windows by formula on which a network must give the same chances everywhere."""
    width, height = WINDOW_WH
    picture = golden_image((2 * width, height))
    return np.stack([picture[:, :width], picture[:, width:]])


def _checked(text: str | None, name: str) -> dict[str, Any]:
    """The metadata, if it is that of a close-up network for this package's windows."""
    if text is None:
        raise BundleError(
            f"{name} is an ONNX file but no close-up network of ours: it has no {METADATA_KEY!r} "
            "metadata; make one with python -m export.close_up"
        )
    try:
        found = json.loads(text)
        said = {key: found[key] for key in expected_metadata()}
    except (ValueError, KeyError, TypeError) as error:
        raise BundleError(
            f"the metadata of {name} is damaged ({type(error).__name__}: {error}); export it again"
        ) from error
    for key, expected in expected_metadata().items():
        if said[key] != expected:
            raise BundleError(
                f"{name} has {key} {said[key]!r}, this package expects {expected!r}; export it "
                "again with this version"
            )
    return cast(dict[str, Any], found)


def expected_metadata() -> dict[str, Any]:
    """What every file must say that this package can run."""
    return {
        "format": FORMAT,
        "answers": list(ANSWERS),
        "window_wh": list(WINDOW_WH),
        "place_uv": list(PLACE_UV),
        "px_per_m": PX_PER_M,
        "golden_input": GOLDEN_INPUT,
    }
