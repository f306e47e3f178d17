"""The anomaly generator as an Albumentations transform, so that training can draw from it."""

from __future__ import annotations

import os
from typing import Any

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # else importing it asks the network

import albumentations
import numpy as np
from albumentations.core.type_definitions import Targets

from railinspect.anomalies import Generated, GeneratorSettings, NoTrackError, generate
from railinspect.anomalies.generate import MADE_TYPES, MadeType
from railinspect.railsem import Image


class Anomaly(albumentations.DualTransform):
    """Put one anomaly into a picture of a clear track, and into its mask.

    The track is followed in the mask; a picture without one is left as it is. Boxes and key points
    of other things stay where they are, except that points on distorted rails move with them: use
    :func:`railinspect.anomalies.generate` itself where the anomaly's own box is wanted.

    Args:
        types: Types to draw from.
        settings: Settings of the generator.
        p: Probability.
    """

    _targets = (Targets.IMAGE, Targets.MASK, Targets.BBOXES, Targets.KEYPOINTS)

    def __init__(
        self,
        types: tuple[MadeType, ...] = MADE_TYPES,
        settings: GeneratorSettings | None = None,
        p: float = 0.3,
    ) -> None:
        super().__init__(p=p)
        self.types = types
        self.settings = settings or GeneratorSettings()

    @property
    def targets_as_params(self) -> list[str]:
        """What the drawing of the anomaly needs."""
        return ["image", "mask"]

    def get_params_dependent_on_data(
        self, params: dict[str, Any], data: dict[str, Any]
    ) -> dict[str, Any]:
        """Make the picture and its mask once, for all targets."""
        rng = self.random_generator
        kind = self.types[int(rng.integers(len(self.types)))]
        try:
            made = generate(
                np.ascontiguousarray(data["image"]),
                np.ascontiguousarray(data["mask"]),
                kind,
                rng,
                settings=self.settings,
            )
        except NoTrackError:
            return {"made": None}
        return {"made": made}

    def apply(self, img: Image, made: Generated | None = None, **params: Any) -> Image:
        """The picture with the anomaly."""
        return img if made is None else made.rgb

    def apply_to_mask(self, mask: Image, made: Generated | None = None, **params: Any) -> Image:
        """The mask with the anomaly's class, and with rails where they now are."""
        return mask if made is None else made.labels

    def apply_to_bboxes(
        self, bboxes: np.ndarray, made: Generated | None = None, **params: Any
    ) -> np.ndarray:
        """Boxes of other things stay."""
        return bboxes

    def apply_to_keypoints(
        self, keypoints: np.ndarray, made: Generated | None = None, **params: Any
    ) -> np.ndarray:
        """Points (a rail's polyline among them) move with a distortion."""
        if made is None or made.moved is None:
            return keypoints
        out = np.array(keypoints, copy=True)
        out[:, :2] = made.moved(out[:, :2].astype(float))
        return out

    def get_transform_init_args_names(self) -> tuple[str, ...]:
        """Arguments that describe the transform."""
        return ("types", "settings")
