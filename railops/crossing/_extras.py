"""The one door to the optional dependencies of the ``crossing`` extra."""

from __future__ import annotations

import importlib
from typing import Any

from railops.errors import MissingExtraError


def extra(module: str, purpose: str) -> Any:
    """Import a module of the ``crossing`` extra when it is first needed.

    Raises:
        MissingExtraError: if it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise MissingExtraError(
            f"{purpose} needs {package}, which is not installed: "
            f"pip install 'railinspect[crossing]' brings it"
        ) from error
