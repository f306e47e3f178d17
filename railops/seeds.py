"""Random numbers from seeds that are checked, so that a bad one is refused in one sentence."""

from __future__ import annotations

import numpy as np

from railops.errors import DomainError


def generator(seed: int, *branch: int) -> np.random.Generator:
    """A generator of random numbers; each ``branch`` of one seed is a stream of its own.

    Branch 0 is the stream of the seed without a branch, as NumPy counts them.

    Raises:
        DomainError: if the seed is not a whole number in [0, 2⁶³].

    Example:
        >>> bool(generator(1).random() == generator(1).random() != generator(1, 1).random())
        True
    """
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed <= 2**63:
        raise DomainError("seed", seed, "a whole number in [0, 2^63]")
    return np.random.default_rng([int(seed), *branch] if branch else int(seed))
