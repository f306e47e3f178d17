"""Lightning without what it says about choices made here on purpose."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator

_NOISE = (
    r"Checkpoint directory .* exists and is not empty",  # it holds the resolved configuration
    r".*does not have many workers",  # data.workers says how many
    r"The number of training batches .* is smaller than the logging interval",
    r"It is recommended to use `self\.log\(.*sync_dist",  # the totals are summed before
    r".*LeafSpec.* is deprecated",  # Lightning's own call of torch
)


@contextlib.contextmanager
def only_what_matters() -> Iterator[None]:
    """Keep from the user what Lightning says about choices made here on purpose."""
    log = logging.getLogger("lightning.pytorch")
    level = log.level
    log.setLevel(logging.WARNING)
    with warnings.catch_warnings():
        for message in _NOISE:
            warnings.filterwarnings("ignore", message)
        yield
    log.setLevel(level)
