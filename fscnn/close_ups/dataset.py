"""Cached training windows in memory, and how each is varied before it is trained on."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.data import Dataset

from fscnn.close_ups.windows import MARGIN_PX, SIZE_WH
from railinspect.close_ups import ANSWERS, WINDOW_WH
from railinspect.errors import BadInputError

Image = npt.NDArray[np.uint8]

HELD_OUT = 25
"""Every so many files one is kept for validation."""

_SHIFT_PX = (5.0, 4.0)
_SCALE = 0.08


@dataclass(frozen=True)
class Cached:
    """Windows with margin, uint8 (N, 92, 140, 3), and their answers, (N,)."""

    images: Image
    answers: npt.NDArray[np.uint8]


def read(folder: Path) -> tuple[Cached, Cached]:
    """Training and validation windows of a folder written by ``fscnn.close_ups.cache``.

    Raises:
        BadInputError: if there are too few files, or one is damaged.
    """
    files = sorted(folder.glob("*.npz"))
    if len(files) < 2:
        raise BadInputError(
            f"{folder} holds {len(files)} files of windows, at least 2 are needed; make them with "
            "python -m fscnn.close_ups.cache"
        )
    parts: tuple[list[Cached], list[Cached]] = ([], [])
    for number, path in enumerate(files):
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                one = Cached(file["images"], file["answers"])
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise BadInputError(f"{path} is no file of windows ({error}); make it again") from error
        if one.images.shape[1:] != (SIZE_WH[1], SIZE_WH[0], 3) or one.answers.max(initial=0) >= len(
            ANSWERS
        ):
            raise BadInputError(f"{path} holds windows of another kind; make it again")
        parts[number % HELD_OUT == 0].append(one)
    return _joined(parts[0]), _joined(parts[1])


def _joined(parts: list[Cached]) -> Cached:
    return Cached(
        np.concatenate([p.images for p in parts]), np.concatenate([p.answers for p in parts])
    )


class WindowSet(Dataset[tuple[Tensor, int]]):
    """Windows as the network takes them, uint8 (80, 128, 3), with their answers.

    Args:
        cached: The windows.
        seed: Seed of the variations; None leaves the windows as they are.
    """

    def __init__(self, cached: Cached, seed: int | None = None) -> None:
        self.cached = cached
        self._rng = None if seed is None else np.random.default_rng(seed)

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.cached.answers)

    def __getitem__(self, index: int) -> tuple[Tensor, int]:
        """One window and its answer."""
        image = self.cached.images[index]
        if self._rng is None:
            inner = image[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX]
            window = np.ascontiguousarray(inner)
        else:
            window = varied(image, self._rng)
        return torch.from_numpy(window), int(self.cached.answers[index])


def varied(image: Image, rng: np.random.Generator) -> Image:
    """A window of an image with margin: moved, scaled, mirrored, in other light, less sharp.

    Args:
        image: uint8, shape (92, 140, 3).
        rng: Source of every choice.
    """
    width, height = WINDOW_WH
    scale = float(np.exp(rng.uniform(-_SCALE, _SCALE)))
    corner = [
        (side - scale * inner) / 2 + float(rng.uniform(-shift, shift))
        for side, inner, shift in zip(SIZE_WH, WINDOW_WH, _SHIFT_PX, strict=True)
    ]
    moved: Any = cv2.warpAffine(
        image,
        np.array([[scale, 0.0, corner[0]], [0.0, scale, corner[1]]]),
        WINDOW_WH,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if rng.random() < 0.5:
        moved = moved[:, ::-1]
    light = np.ascontiguousarray(moved, np.float32) / 255.0
    if rng.random() < 0.7:
        light **= np.float32(np.exp(rng.normal(0.0, 0.3)))
        light *= np.float32(rng.uniform(0.75, 1.25))
        light += np.float32(rng.uniform(-0.08, 0.08))
        light *= np.exp(rng.normal(0.0, 0.06, 3)).astype(np.float32)
    if rng.random() < 0.25:  # a narrower picture, or the far end of any
        factor = float(rng.uniform(1.2, 3.2))
        coarse_wh = (int(width / factor), int(height / factor))
        coarse = cv2.resize(light, coarse_wh, interpolation=cv2.INTER_AREA)
        light = np.asarray(cv2.resize(coarse, WINDOW_WH), np.float32)
    elif rng.random() < 0.15:
        blurred = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.4, 1.2)))
        light = np.asarray(blurred, np.float32)
    if rng.random() < 0.2:
        noise = rng.normal(0.0, float(rng.uniform(0.005, 0.05)), light.shape)
        light = light + noise.astype(np.float32)
    if rng.random() < 0.05:
        light = np.repeat(light.mean(axis=2, keepdims=True), 3, axis=2)
    window: Image = np.clip(np.rint(light * 255.0), 0, 255).astype(np.uint8)
    return window
