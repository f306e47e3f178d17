from itertools import pairwise

import numpy as np
import pytest

from railinspect.scenes.noise import LEVELS, TILE_PX, pyramids, sample
from railinspect.scenes.rails import displacement


def test_ripple_is_the_stated_function() -> None:
    waves = np.array([[10.0, 12.0, 0.2, 6.0, 1.0, 0.5]])
    at = 14.0
    window = np.sin(np.pi * 4 / 12)
    expected = 0.2 * window * np.sin(2 * np.pi * 4 / 6)
    assert displacement(waves, at, 1.0) == pytest.approx(expected)
    assert displacement(waves, at, -1.0) == pytest.approx(expected / 2)


def test_bulge_peaks_at_its_amplitude_in_the_middle() -> None:
    waves = np.array([[0.0, 10.0, 0.25, 0.0, 1.0, 1.0]])
    assert displacement(waves, 5.0, 1.0) == pytest.approx(0.25)
    assert displacement(waves, 0.0, 1.0) == 0.0
    assert displacement(waves, 10.0, 1.0) == 0.0


def test_noise_is_centred_and_loses_contrast_with_distance() -> None:
    stack = pyramids()
    for field in stack:
        assert abs(field[0].mean()) < 1e-3
        assert field[0].std() == pytest.approx(1.0, abs=1e-3)
        spread = [field[k, : TILE_PX >> k, : TILE_PX >> k].std() for k in range(LEVELS)]
        assert all(a >= b for a, b in pairwise(spread))


def test_noise_tiles_without_a_seam() -> None:
    stack = pyramids()
    here = sample(stack, 1, 3.25, 7.75, 1.0)
    assert sample(stack, 1, 3.25 + TILE_PX, 7.75 - TILE_PX, 1.0) == pytest.approx(here, abs=1e-5)
