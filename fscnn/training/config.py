"""The typed configuration of a training run: defaults < YAML file < command line."""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from fscnn.data.module import DataConfig
from fscnn.training.loss import LossConfig
from fscnn.training.schedule import ScheduleConfig
from railinspect.errors import BadInputError


@dataclass(frozen=True)
class OptimiserConfig:
    """AdamW and what surrounds it.

    Attributes:
        rate: Peak learning rate.
        weight_decay: Decoupled weight decay of convolution kernels.
        clip: Largest norm of the gradient.
        average: Decay of the weight average per step.
    """

    rate: float = 2e-3
    weight_decay: float = 1e-2
    clip: float = 5.0
    average: float = 0.999


@dataclass(frozen=True)
class RunConfig:
    """How the run is carried out.

    Attributes:
        out: Folder for checkpoints, logs and the resolved configuration.
        precision: Lightning's precision, e.g. ``32-true`` or ``bf16-mixed``.
        accelerator: ``auto``, ``cpu`` or ``gpu``.
        devices: Devices to train on, a process each; a step then takes ``devices`` batches.
        accumulate: Batches per optimiser step.
        channels_last: Keep maps channels-last in memory.
        threads: Torch threads on a CPU; 0 leaves the default.
        validate_every: Steps between validations; 0 validates after every epoch.
        tensorboard: Write TensorBoard logs.
        progress: Show a progress bar.
        examples: Validation pictures shown in ``examples.png`` and in TensorBoard.
        recalibrate: Training batches on which the batch norms of the averaged weights are measured
            again after training; the result is kept where it is better. 0 does not try.
    """

    out: str = "runs/fscnn_s"
    precision: str = "32-true"
    accelerator: str = "auto"
    devices: int = 1
    accumulate: int = 1
    channels_last: bool = True
    threads: int = 0
    validate_every: int = 0
    tensorboard: bool = False
    progress: bool = True
    examples: int = 4
    recalibrate: int = 0


@dataclass(frozen=True)
class TrainConfig:
    """Everything a training run depends on.

    Attributes:
        seed: Seed of weights, order and transforms.
        network: Name in the registry.
        settings: Settings of the network that differ from its defaults; none takes those of
            ``start_from``.
        start_from: Checkpoint or bundle (``.onnx``) whose weights training starts from, or
            ``imagenet`` for the published weights of the network's backbone; empty starts from
            random ones. A wider network of the same kind starts from a narrower one's.
        fold_norms: Fold the batch norms of ``start_from`` into its kernels and train on without:
            more samples per second on a CPU, at a lower rate.
    """

    seed: int = 0
    network: str = "fscnn_s"
    settings: dict[str, Any] = field(default_factory=dict)
    start_from: str = ""
    fold_norms: bool = False
    data: DataConfig = field(default_factory=DataConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)
    run: RunConfig = field(default_factory=RunConfig)


def load(path: Path | None = None, overrides: Sequence[str] = ()) -> TrainConfig:
    """Build a configuration.

    Args:
        path: YAML file; None uses the defaults.
        overrides: ``dotted.key=value`` strings; values are read as YAML.

    Raises:
        BadInputError: if the file cannot be read, a key is unknown or a value has another type.
    """
    data: dict[str, Any] = {}
    if path is not None:
        try:
            data = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise BadInputError(f"cannot read configuration {path}: {error}") from error
        if not isinstance(data, dict):
            raise BadInputError(f"configuration {path} must be a mapping of settings")
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals:
            raise BadInputError(f"{override!r} is not of the form key=value")
        place = data
        *parents, last = key.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise BadInputError(f"{key!r}: {parent!r} is a value, not a group of settings")
        place[last] = yaml.safe_load(text)
    return _build(TrainConfig, data, "")


def save(config: TrainConfig, path: Path) -> None:
    """Write every setting, defaults included, as YAML that :func:`load` reads back."""
    path.write_text(yaml.safe_dump(asdict(config), sort_keys=False), encoding="utf-8")


def _build(kind: type[Any], data: Mapping[str, Any], prefix: str) -> Any:
    hints = typing.get_type_hints(kind)
    names = [f.name for f in fields(kind)]
    values = {}
    for key, value in data.items():
        name = f"{prefix}{key}"
        if key not in names:
            near = difflib.get_close_matches(str(key), names, 1)
            hint = f"; did you mean {prefix}{near[0]}?" if near else f"; known: {', '.join(names)}"
            raise BadInputError(f"unknown setting {name!r}{hint}")
        wanted = hints[key]
        if is_dataclass(wanted):
            if not isinstance(value, dict):
                raise BadInputError(f"{name} must be a group of settings, got {value!r}")
            values[key] = _build(typing.cast(type[Any], wanted), value, f"{name}.")
        else:
            values[key] = _checked(wanted, value, name)
    assert all(f.default is not MISSING or f.default_factory is not MISSING for f in fields(kind))
    return kind(**values)


def _checked(wanted: Any, value: Any, name: str) -> Any:
    origin = typing.get_origin(wanted) or wanted
    assert not isinstance(origin, types.UnionType)
    if origin is float and isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            return float(value)  # YAML 1.1 reads 1e-3 as text
        except ValueError:
            pass
    elif isinstance(value, origin) and not (origin is int and isinstance(value, bool)):
        if origin is list:
            (item,) = typing.get_args(wanted)
            return [_checked(item, part, f"{name}[{i}]") for i, part in enumerate(value)]
        return value
    raise BadInputError(
        f"{name} must be of type {getattr(wanted, '__name__', wanted)}, got {value!r}"
    )
