import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from railinspect.anomalies.blend import NEUTRAL_RGB, blend, solve_laplace


def a_disc(size=40, radius=14.0, colour=(200.0, 60.0, 40.0)):
    grid = np.arange(size) - (size - 1) / 2
    matte = (np.hypot(*np.meshgrid(grid, grid)) < radius).astype(np.float32)
    return np.float32(colour) * matte[..., None], matte


def test_the_membrane_solves_laplace_s_equation():
    rng = np.random.default_rng(0)
    values = rng.uniform(-80, 80, (30, 36, 3)).astype(np.float32)
    free = np.zeros((30, 36), bool)
    free[4:25, 5:20] = True
    free[10:18, 20:33] = True
    got = solve_laplace(values, free)
    index = -np.ones(free.shape, int)
    index[free] = np.arange(free.sum())
    matrix = scipy.sparse.lil_matrix((free.sum(), free.sum()))
    right = np.zeros((free.sum(), 3))
    for v, u in zip(*np.nonzero(free), strict=True):
        n = index[v, u]
        matrix[n, n] = 4
        for a, b in ((v - 1, u), (v + 1, u), (v, u - 1), (v, u + 1)):
            if free[a, b]:
                matrix[n, index[a, b]] = -1
            else:
                right[n] += values[a, b]
    exact = scipy.sparse.linalg.spsolve(matrix.tocsc(), right)
    np.testing.assert_allclose(got[free], exact, atol=0.05)
    np.testing.assert_array_equal(got[~free], values[~free])
    with pytest.raises(ValueError, match="edge"):
        solve_laplace(values, np.ones((30, 36), bool))


def test_alpha_one_is_porter_duff_over():
    rgb = np.full((100, 120, 3), 90, np.uint8)
    colour, matte = a_disc()
    done = blend(rgb, colour, matte, (30, 20), 1.0)
    assert done.method == "alpha"
    whole = np.full((100, 120, 3), 90.0)
    whole[20:60, 30:70] = whole[20:60, 30:70] * (1 - matte[..., None]) + colour
    np.testing.assert_array_equal(rgb, np.rint(whole).astype(np.uint8))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5])
def test_on_a_plain_ground_the_mix_is_known(alpha):
    # the membrane of a constant border is that constant: ground − neutral
    ground = np.array([60, 80, 140], np.uint8)
    rgb = np.tile(ground, (120, 140, 1))
    colour, matte = a_disc()
    done = blend(rgb, colour, matte, (40, 40), alpha)
    assert done.method == "mixed"
    lift = ground - np.array(NEUTRAL_RGB)
    expected = np.clip(np.array([200, 60, 40]) + (1 - alpha) * lift, 0, 255)
    np.testing.assert_allclose(rgb[60, 60], expected, atol=1)
    untouched = np.ones(rgb.shape[:2], bool)
    untouched[40:80, 40:80] = matte < 0.5
    assert (rgb[untouched] == ground).all()


def test_an_object_is_not_shifted():
    rng = np.random.default_rng(1)
    rgb = rng.integers(90, 130, (150, 150, 3), np.uint8)
    colour, matte = a_disc(colour=(250.0, 250.0, 250.0))
    # an outline that is not centred in its box is what a re-centring would move
    matte[:22], colour[:22] = 0.0, 0.0
    blend(rgb, colour, matte, (50, 60), 0.3)
    lit = np.argwhere(rgb.min(axis=2) > 190)
    true = np.argwhere(matte > 0.5) + np.array([60, 50])
    np.testing.assert_allclose(lit.mean(axis=0), true.mean(axis=0), atol=0.05)
    assert len(lit) == len(true)


@pytest.mark.parametrize("at", [(-15, 40), (40, -20), (118, 40), (40, 95), (-100, -100)])
def test_at_the_border_it_falls_back_to_alpha(at):
    rgb = np.full((110, 140, 3), 90, np.uint8)
    colour, matte = a_disc()
    before = rgb.copy()
    done = blend(rgb, colour, matte, at, 0.3)
    assert done.method == "alpha"
    if at != (-100, -100):
        assert (rgb == (200, 60, 40)).all(axis=2).any()
    else:
        np.testing.assert_array_equal(rgb, before)
