"""Minimal filtering gives the sums of the plain products, alone and inside the passes."""

import pytest
import torch

from fscnn.models import filtering
from fscnn.models.filtering import Direct, Minimal, in_shares, steps_of
from fscnn.models.passing import Axis, pass_fast, pass_reference


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_hand_worked_pair() -> None:
    # Inputs 1, 2, 4, 8, taps 3, −1, 5: 3 − 2 + 20 = 21 and 6 − 4 + 40 = 42; backwards twice that.
    padded = torch.tensor([1.0, 2.0, 4.0, 8.0]).view(1, 1, 4, 1).repeat(2, 1, 1, 1)
    kernels = torch.tensor([3.0, -1.0, 5.0]).view(1, 3, 1, 1).repeat(2, 1, 1, 1)
    kernels[1] *= 2
    for kind in (Direct, Minimal):
        out = torch.empty(2, kind.shares, 1, 2 // kind.shares, 1)
        filtered = kind(kernels, 1, 2)
        filtered(filtered.reads(padded), out)
        assert out.flatten().tolist() == [21, 42, 42, 84]


@pytest.mark.parametrize("taps", [3, 9, 15])
@pytest.mark.parametrize(("batch", "extent"), [(1, 2), (2, 6), (3, 10)])
def test_both_ways_give_the_same_sums(taps: int, batch: int, extent: int) -> None:
    # Directions lie apart in memory, as the two slices of a step do.
    padded = random(5, batch, extent + taps - 1, 4)[::4]
    kernels = random(2, taps, 4, 3, seed=1)
    found = []
    for kind in (Direct, Minimal):
        slices = torch.full((2, batch, extent, 3), torch.nan, dtype=torch.float64)
        results = in_shares(slices, kind.shares).contiguous()
        filtered = kind(kernels, batch, extent)
        filtered(filtered.reads(padded), results)
        in_shares(slices, kind.shares).copy_(results)
        found.append(slices)
    torch.testing.assert_close(found[1], found[0])


def test_minimal_filtering_is_taken_only_where_it_fits() -> None:
    wide = filtering.LEAST_CHANNELS
    assert isinstance(steps_of(torch.empty(2, 9, wide, wide), 1, 8), Minimal)
    for kernels, extent in (
        (torch.empty(2, 7, wide, wide), 8),  # taps not in triples
        (torch.empty(2, 9, wide, wide), 7),  # places not in pairs
        (torch.empty(2, 9, wide - 1, wide), 8),
        (torch.empty(2, 9, wide, wide, dtype=torch.bfloat16), 8),
    ):
        assert isinstance(steps_of(kernels, 1, extent), Direct)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_passes_and_their_gradients_with_minimal_filtering(
    axis: Axis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filtering, "LEAST_CHANNELS", 1)
    features = random(2, 2, 4, 6).requires_grad_()
    kernels = (random(2, 2, 2, 3, seed=1) / 3).requires_grad_()
    for fast, plain in zip(
        pass_fast(features, kernels, axis), pass_reference(features, kernels, axis), strict=True
    ):
        torch.testing.assert_close(fast, plain)
    assert torch.autograd.gradcheck(lambda f, k: pass_fast(f, k, axis), (features, kernels))


def test_single_precision_loses_next_to_nothing() -> None:
    wide = filtering.LEAST_CHANNELS
    features, kernels = random(1, wide, 16, 12), random(2, wide, wide, 9, seed=1) / 34
    exact = torch.cat(pass_reference(features, kernels, "vertical"))
    found = torch.cat(pass_fast(features.float(), kernels.float(), "vertical"))
    assert (found - exact).abs().max() < 1e-5 * exact.abs().max()
