"""Training transforms (Albumentations). Each works on ``image`` uint8 RGB and ``mask`` uint8.

A real cab camera differs from the renderer first of all in colour, contrast and sharpness, so the
photometric part is wide; the geometric part keeps the camera upright, as a cab's is.
"""

from __future__ import annotations

import os
from typing import Any

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # else importing it asks the network

import albumentations
import cv2
import numpy as np

from fscnn.data.anomalies import Anomaly
from railinspect.labels import (
    RAIL_TRACK,
    RAILS,
    ROAD,
    SIDEWALK,
    TERRAIN,
    TRACKBED,
    TRAM_TRACK,
    VOID,
)
from railinspect.railsem import Image

_STREAMING = (ROAD, SIDEWALK, TRAM_TRACK, TERRAIN, RAIL_TRACK, TRACKBED)
"""Ground without vegetation, which stands up, and without rails, along which nothing smears."""


class RailCrop(albumentations.DualTransform):
    """Cut a window at a random zoom and aspect, most often around a rail, and resize it.

    Args:
        size_wh: Size of the result, pixels.
        zoom: Range of the magnification; 1 keeps the source's pixels.
        aspect: Horizontal against vertical stretch lies in ``1 / aspect … aspect``.
        rail_share: Fraction of windows that must contain a rail pixel, where the mask has one.
    """

    _targets = (
        albumentations.core.type_definitions.Targets.IMAGE,
        albumentations.core.type_definitions.Targets.MASK,
    )

    def __init__(
        self,
        size_wh: tuple[int, int],
        zoom: tuple[float, float] = (0.75, 1.6),
        aspect: float = 1.15,
        rail_share: float = 0.8,
    ) -> None:
        super().__init__(p=1.0)
        self.size_wh = size_wh
        self.zoom = zoom
        self.aspect = aspect
        self.rail_share = rail_share

    def get_params_dependent_on_data(
        self, params: dict[str, Any], data: dict[str, Any]
    ) -> dict[str, Any]:
        """Choose the window: source pixels of its corner and its extent."""
        rng = self.random_generator
        height, width = data["image"].shape[:2]
        # Never smaller than the source allows: a window that fits is better than padding.
        least = max(self.size_wh[0] / width, self.size_wh[1] / height)
        low, high = max(self.zoom[0], least), max(self.zoom[1], least)
        zoom = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        stretch = float(np.exp(rng.uniform(-1, 1) * np.log(self.aspect) / 2))
        w = min(width, max(8, round(self.size_wh[0] / (zoom * stretch))))
        h = min(height, max(8, round(self.size_wh[1] / (zoom / stretch))))
        left = int(rng.integers(0, width - w + 1))
        top = int(rng.integers(0, height - h + 1))
        if rng.random() < self.rail_share:
            rows, columns = np.nonzero((data["mask"] == RAILS[0]) | (data["mask"] == RAILS[1]))
            if rows.size:
                pick = int(rng.integers(rows.size))
                left = int(np.clip(columns[pick] - rng.integers(0, w), 0, width - w))
                top = int(np.clip(rows[pick] - rng.integers(0, h), 0, height - h))
        return {"window": (left, top, w, h)}

    def apply(self, img: Image, window: tuple[int, int, int, int], **params: Any) -> Image:
        """Cut and resize the image."""
        left, top, w, h = window
        shrinks = w * h > self.size_wh[0] * self.size_wh[1]
        part = img[top : top + h, left : left + w]
        return cv2.resize(
            part, self.size_wh, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        )

    def apply_to_mask(self, mask: Image, window: tuple[int, int, int, int], **params: Any) -> Image:
        """Cut and resize the mask without mixing ids."""
        left, top, w, h = window
        part = mask[top : top + h, left : left + w]
        return cv2.resize(part, self.size_wh, interpolation=cv2.INTER_NEAREST_EXACT)


class GroundSmear(albumentations.ImageOnlyTransform):
    """Smear the ground as it streams by under the camera, and stain it.

    On recorded video the ballast ahead is a smooth brown blur, dark beside the rails, and a network
    that only knows sharp ballast takes such patches for people. Rails and whatever stands on the
    ground stay as they are: blur lies along the rails, and what stands ahead hardly moves.

    Args:
        length: Range of the blur at the picture's bottom, as a share of its height.
        darkest: Range of the factor by which the darkest stain dims.
        p: Probability.
    """

    def __init__(
        self,
        length: tuple[float, float] = (0.01, 0.08),
        darkest: tuple[float, float] = (0.35, 1.0),
        p: float = 0.3,
    ) -> None:
        super().__init__(p=p)
        self.length = length
        self.darkest = darkest

    @property
    def targets_as_params(self) -> list[str]:
        """Where the ground is comes from the mask."""
        return ["mask"]

    def get_params_dependent_on_data(
        self, params: dict[str, Any], data: dict[str, Any]
    ) -> dict[str, Any]:
        """Draw the blur and the stains: a field of random blots, longer than wide."""
        rng = self.random_generator
        ground = np.isin(data["mask"], _STREAMING).astype(np.float32)
        height, width = ground.shape
        length_px = max(3, round(float(rng.uniform(*self.length)) * height))
        cells = rng.standard_normal((int(rng.integers(3, 7)), int(rng.integers(8, 24))))
        blots = cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
        stain = float(rng.uniform(*self.darkest)) ** (1 / (1 + np.exp(-3.0 * blots)))
        return {"ground": ground, "length_px": length_px, "stain": stain.astype(np.float32)}

    def apply(self, img: Image, ground: Any, length_px: int, stain: Any, **params: Any) -> Image:
        """Mix the ground with its own blur, the more the nearer, and dim it where it is stained."""
        rows = np.flatnonzero(ground.any(axis=1))
        if not len(rows):
            return img
        top = int(rows[0])
        sharp, share = img[top:].astype(np.float32), ground[top:]
        size = (1 + length_px // 3, length_px)
        weight = np.maximum(cv2.blur(share, size), 1e-3)[..., None]
        blurred = cv2.blur(sharp * share[..., None], size) / weight
        near = np.sqrt(np.linspace(0, 1, len(sharp), dtype=np.float32))[:, None]
        mixed = sharp + near[..., None] * (blurred - sharp)
        # Rust and oil leave red the longest.
        mixed *= stain[top:, :, None] ** np.array([0.85, 1.0, 1.15], np.float32)
        result = img.copy()
        result[top:] = np.where(share[..., None] > 0, np.clip(mixed, 0, 255), sharp).astype(
            np.uint8
        )
        return result


def training_transform(
    size_wh: tuple[int, int],
    zoom: tuple[float, float] = (0.75, 1.6),
    rail_share: float = 0.8,
    strength: float = 1.0,
    aspect: float = 1.15,
    anomalies: float = 0.0,
) -> albumentations.Compose:
    """Crop, mirror, recolour, blur and compress.

    Args:
        size_wh: Size of the result, pixels.
        zoom: See :class:`RailCrop`.
        rail_share: See :class:`RailCrop`.
        strength: 0 leaves colours and sharpness alone, 1 is the recipe of the shipped bundle.
        aspect: See :class:`RailCrop`.
        anomalies: Share of the pictures that get an :class:`~fscnn.data.anomalies.Anomaly`.
    """
    a = albumentations
    s = strength
    return a.Compose(
        [
            *([Anomaly(p=anomalies)] if anomalies > 0 else []),  # on the whole picture, in metres
            RailCrop(size_wh, zoom, aspect, rail_share),
            GroundSmear(p=0.3 * s),
            a.HorizontalFlip(p=0.5),
            a.Affine(rotate=(-3, 3), p=0.15 * s, fill=0, fill_mask=VOID),
            a.OneOf(
                [
                    a.ColorJitter(
                        brightness=(0.6, 1.4),
                        contrast=(0.6, 1.4),
                        saturation=(0.4, 1.6),
                        hue=(-0.04, 0.04),
                    ),
                    a.RandomBrightnessContrast(0.3, 0.3),
                    a.RandomGamma((55, 180)),
                    a.RGBShift(25, 25, 25),
                    a.RandomToneCurve(0.25, per_channel=True),
                ],
                p=0.8 * s,
            ),
            a.OneOf([a.ToGray(p=1.0), a.ChannelShuffle(p=0.4)], p=0.08 * s),
            a.OneOf(
                [
                    a.GaussianBlur((3, 5), sigma_limit=(0.3, 1.4)),
                    a.MotionBlur((3, 7)),
                    a.Downscale((0.5, 0.85)),
                    a.Sharpen((0.1, 0.4)),
                ],
                p=0.3 * s,
            ),
            a.GaussNoise((0.01, 0.06), noise_scale_factor=0.5, p=0.15 * s),
            a.ImageCompression(quality_range=(35, 90), p=0.3 * s),
        ]
    )
