"""Networks by name, each with its dataclass of settings; the only place that lists them all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any

from torch import nn

from fscnn.models.deeplab import DeepLab, DeepLabConfig
from fscnn.models.frrn import Frrn, FrrnConfig
from fscnn.models.fscnn import Fscnn, FscnnConfig
from fscnn.models.fscnn_s import FscnnS, FscnnSConfig
from fscnn.models.lraspp import Lraspp, LrasppConfig
from fscnn.models.scnn import Scnn, ScnnConfig
from railinspect.errors import BadInputError

_NETWORKS: dict[str, tuple[type[nn.Module], type[Any]]] = {
    "fscnn_s": (FscnnS, FscnnSConfig),
    "fscnn": (Fscnn, FscnnConfig),
    "scnn": (Scnn, ScnnConfig),
    "frrn_b": (Frrn, FrrnConfig),
    "deeplabv3": (DeepLab, DeepLabConfig),
    "lraspp": (Lraspp, LrasppConfig),
}

NAMES = tuple(_NETWORKS)


def build(name: str, settings: Mapping[str, Any] | None = None) -> nn.Module:
    """Build a network from its name and settings, with random weights.

    Raises:
        BadInputError: if the name or a setting is unknown.
    """
    if name not in _NETWORKS:
        raise BadInputError(f"unknown network {name!r}; known: {', '.join(NAMES)}")
    network, config = _NETWORKS[name]
    settings = dict(settings or {})
    known = {field.name for field in fields(config)}
    if unknown := sorted(set(settings) - known):
        raise BadInputError(f"network {name} has no setting {unknown[0]!r}; known: {sorted(known)}")
    shaped = {key: tuple(v) if isinstance(v, list) else v for key, v in settings.items()}
    return network(config(**shaped))


def settings_of(network: nn.Module) -> dict[str, Any]:
    """The settings ``network`` was built with, as plain values a file can hold."""
    config = network.config
    assert is_dataclass(config)
    assert not isinstance(config, type)
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(config).items()}
