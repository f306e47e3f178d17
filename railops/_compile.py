"""One typed door to numba, so that compiled functions keep their signatures for the checker."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile to machine code on first use; the GIL is released and the result is cached on disk.

    Division follows NumPy (no exception), so callers check their inputs before they come here.
    The cache notices changes of the function's own file only: after editing a compiled function
    that others call, delete the ``*.nbi`` and ``*.nbc`` files under ``__pycache__``.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
