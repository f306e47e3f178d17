"""Reading a network back from a checkpoint, without running anything the file may hold."""

from __future__ import annotations

import pickle
import warnings
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from fscnn.models import build
from fscnn.models.blocks import fold_norms
from railinspect.errors import BadInputError

KEY = "fscnn"
"""Entry of a Lightning checkpoint that holds what rebuilding the network takes."""


@dataclass(frozen=True)
class Trained:
    """A network out of a checkpoint.

    Attributes:
        network: The averaged weights, in evaluation mode.
        name: Its name in the registry.
        settings: The settings it was built with.
        norms_folded: Whether its batch norms were folded into its kernels before training.
        recipe: The resolved training configuration.
        fingerprint: Digest of the training data's file list.
        steps: Optimiser steps taken.
    """

    network: nn.Module
    name: str
    settings: dict[str, Any]
    norms_folded: bool
    recipe: dict[str, Any]
    fingerprint: str
    steps: int


def read(path: Path) -> dict[str, Any]:
    """Read a checkpoint file with ``weights_only=True``.

    Raises:
        BadInputError: if it is missing, holds code, is damaged, or is not one of ours.
    """
    try:
        with (
            warnings.catch_warnings()
        ):  # about a foreign pickle's protocol; the error below says more
            warnings.simplefilter("ignore")
            data = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise BadInputError(f"cannot read checkpoint {path}: {error.strerror or error}") from error
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError) as error:
        reason = (
            "it is damaged"
            if zipfile.is_zipfile(path)
            else "it is a pickle or another kind of file, and loading it could run code"
        )
        raise BadInputError(
            f"{path} is not a checkpoint of this project ({reason}); pass a .ckpt file written by "
            "train.py"
        ) from error
    if not isinstance(data, dict) or not isinstance(data.get(KEY), dict):
        raise BadInputError(
            f"{path} holds no {KEY!r} entry, so it was not written by train.py; pass a .ckpt file "
            "from a run's folder"
        )
    return data


def load(path: Path) -> Trained:
    """Rebuild the averaged network of a checkpoint.

    Raises:
        BadInputError: as :func:`read`, or if the weights do not fit the network it names.
    """
    held = read(path)[KEY]
    try:
        network = build(held["network"], held["settings"])
        if held["norms_folded"]:
            fold_norms(network)
        network.load_state_dict(held["average"])
        return Trained(
            network.eval(),
            held["network"],
            held["settings"],
            held["norms_folded"],
            held["recipe"],
            held["fingerprint"],
            held["steps"],
        )
    except (KeyError, RuntimeError, TypeError) as error:
        raise BadInputError(
            f"the weights in {path} do not fit the network it names; it comes from another version "
            f"of the network ({str(error).splitlines()[0]})"
        ) from error
