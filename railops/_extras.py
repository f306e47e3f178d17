"""The one door to optional dependencies."""

from __future__ import annotations

import importlib
from typing import Any

from railops.errors import MissingExtraError


def extra(name: str, module: str, purpose: str) -> Any:
    """Import a module of the extra ``name`` when it is first needed.

    Args:
        name: The extra that brings it, as in ``pip install 'railinspect[name]'``.
        module: The module to import.
        purpose: What needs it; the message begins with it.

    Raises:
        MissingExtraError: if it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise MissingExtraError(
            f"{purpose} needs {package}, which is not installed: "
            f"pip install 'railinspect[{name}]' brings it"
        ) from error
