"""How far training has come, in steps or in minutes, and the learning rate that follows from it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class ScheduleConfig:
    """When training ends and how the learning rate gets there.

    Attributes:
        max_epochs: Passes over the training set; -1 is no limit.
        max_steps: Optimiser steps; -1 is no limit.
        max_minutes: Wall-clock limit, minutes, 0 is none. Whichever limit is nearest in
            proportion drives the learning rate, so it always ends near zero.
        warmup: Fraction of the whole run over which the rate rises linearly.
        shape: ``cosine`` or ``poly`` (power 0.9).
        final: Last learning rate as a fraction of the peak.
        patience: Validations in a row without a better rail IoU after which training stops; 0
            never stops early.
    """

    max_epochs: int = -1
    max_steps: int = -1
    max_minutes: float = 0.0
    warmup: float = 0.03
    shape: str = "cosine"
    final: float = 0.005
    patience: int = 0


def rate_factor(progress: float, config: ScheduleConfig) -> float:
    """Learning rate as a fraction of its peak at ``progress`` 0 … 1 of the run."""
    progress = min(max(progress, 0.0), 1.0)
    if progress < config.warmup:
        return max(progress / config.warmup, 1e-3)
    along = (progress - config.warmup) / (1 - config.warmup)
    curve = (1 + math.cos(math.pi * along)) / 2 if config.shape == "cosine" else (1 - along) ** 0.9
    return config.final + (1 - config.final) * curve


class Clock:
    """Progress of a run against its limits; minutes spent before a resume count."""

    def __init__(self, config: ScheduleConfig, spent_s: float = 0.0) -> None:
        self.config = config
        self._began = time.monotonic() - spent_s

    @property
    def spent_s(self) -> float:
        """Seconds trained so far, earlier runs included."""
        return time.monotonic() - self._began

    def progress(self, steps: int, steps_per_epoch: int) -> float:
        """Largest used-up fraction among the limits that are set."""
        config = self.config
        fractions = [0.0]
        if config.max_steps > 0:
            fractions.append(steps / config.max_steps)
        if config.max_epochs > 0:
            fractions.append(steps / (config.max_epochs * steps_per_epoch))
        if config.max_minutes > 0:
            fractions.append(self.spent_s / (config.max_minutes * 60))
        return max(fractions)
