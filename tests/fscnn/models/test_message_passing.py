"""The three forms of the passes against each other, and the equation against hand-worked values."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from fscnn.models.message_passing import FoldedMessagePassing, SequentialMessagePassing, bounded
from fscnn.models.passing import Axis, pass_export, pass_fast, pass_reference

AXES: tuple[Axis, ...] = ("vertical", "horizontal")
FORMS = (pass_fast, pass_export)


def random_pair(shape: tuple[int, ...], taps: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    channels = shape[1]
    features = torch.randn(shape, generator=generator)
    kernels = torch.randn(2, channels, channels, taps, generator=generator)
    return features, kernels / (channels * taps) ** 0.5


def test_hand_worked_column() -> None:
    # One channel, one tap of weight 2, column 1, 2, 3:
    # down 1, 2 + 2·1, 3 + 2·4; up (from the bottom) 3, 2 + 2·3, 1 + 2·8.
    column = torch.tensor([1.0, 2.0, 3.0]).view(1, 1, 3, 1)
    kernels = torch.full((2, 1, 1, 1), 2.0)
    for form in (pass_reference, *FORMS):
        down, up = form(column, kernels, "vertical")
        assert down.flatten().tolist() == [1, 4, 11]
        assert up.flatten().tolist() == [17, 8, 3]


def test_hand_worked_row_with_three_taps_and_rectification() -> None:
    # Travel right over two columns of height 2; taps (1, -1, 2) run down the column.
    # Column (1, 3): row 0 sees (pad 0, 1, 3) → −1 + 6 = 5; row 1 (1, 3, pad 0) → 1 − 3 = −2 → 0.
    features = torch.tensor([[1.0, 10.0], [3.0, 20.0]]).view(1, 1, 2, 2)
    kernels = torch.tensor([1.0, -1.0, 2.0]).view(1, 1, 1, 3).repeat(2, 1, 1, 1)
    for form in (pass_reference, *FORMS):
        right, _ = form(features, kernels, "horizontal")
        assert right.flatten().tolist() == [1, 15, 3, 20]


@settings(max_examples=25, deadline=None)
@given(
    batch=st.integers(1, 3),
    channels=st.integers(1, 5),
    height=st.integers(1, 9),
    width=st.integers(1, 9),
    taps=st.sampled_from([1, 3, 5, 9]),
    axis=st.sampled_from(AXES),
)
def test_forms_agree(
    batch: int, channels: int, height: int, width: int, taps: int, axis: Axis
) -> None:
    features, kernels = random_pair((batch, channels, height, width), taps)
    expected = pass_reference(features, kernels, axis)
    for form in FORMS:
        torch.testing.assert_close(form(features, kernels, axis), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("axis", AXES)
def test_forms_agree_in_bfloat16(axis: Axis) -> None:
    features, kernels = (t.bfloat16() for t in random_pair((2, 8, 7, 5), 3))
    expected = pass_reference(features.float(), kernels.float(), axis)
    for form in FORMS:
        for part, whole in zip(form(features, kernels, axis), expected, strict=True):
            assert part.dtype == torch.bfloat16
            # eight bits of mantissa, rounded once per step over at most seven steps
            torch.testing.assert_close(part.float(), whole, rtol=0.05, atol=0.05)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("shape", [(1, 2, 4, 3), (2, 3, 3, 5), (2, 1, 1, 4)])
def test_gradients(axis: Axis, shape: tuple[int, ...]) -> None:
    features, kernels = (t.double().requires_grad_() for t in random_pair(shape, 3, seed=3))
    assert torch.autograd.gradcheck(lambda f, k: pass_fast(f, k, axis), (features, kernels))


@pytest.mark.parametrize("axis", AXES)
def test_gradients_equal_those_of_the_plain_form(axis: Axis) -> None:
    gradients = []
    for form in (pass_reference, pass_fast):
        features, kernels = (t.double().requires_grad_() for t in random_pair((2, 6, 11, 7), 5))
        forwards, backwards = form(features, kernels, axis)
        (forwards.square().sum() + (3 * backwards).sin().sum()).backward()
        gradients.append((features.grad, kernels.grad))
    torch.testing.assert_close(gradients[1], gradients[0])


@pytest.mark.parametrize("axis", AXES)
def test_mirroring_the_map_exchanges_the_directions(axis: Axis) -> None:
    features, kernels = random_pair((1, 3, 6, 5), 3)
    dim = 2 if axis == "vertical" else 3
    forwards, backwards = pass_fast(features, kernels, axis)
    mirrored = pass_fast(features.flip(dim), kernels.flip(0), axis)
    torch.testing.assert_close(mirrored[0].flip(dim), backwards)
    torch.testing.assert_close(mirrored[1].flip(dim), forwards)


def test_every_slice_but_the_first_in_travel_is_updated() -> None:
    features = torch.ones(1, 1, 5, 4)
    kernels = torch.full((2, 1, 1, 1), 0.5)
    down, up = pass_fast(features, kernels, "vertical")
    assert (down[0, 0, :, 0] != 1).tolist() == [False, True, True, True, True]
    assert (up[0, 0, :, 0] != 1).tolist() == [True, True, True, True, False]


def test_a_message_crosses_the_whole_map() -> None:
    features = torch.zeros(1, 1, 3, 50)
    features[0, 0, 1, 0] = 1
    right, left = pass_fast(features, torch.ones(2, 1, 1, 1), "horizontal")
    assert right[0, 0, 1].tolist() == [1] * 50
    assert left[0, 0, 1].tolist() == [1] + [0] * 49


def test_folded_reads_one_input_and_orders_up_down_right_left() -> None:
    module = FoldedMessagePassing(3, 5)
    features = torch.randn(2, 3, 6, 7)
    down, up = pass_reference(features, bounded(module.vertical), "vertical")
    right, left = pass_reference(features, bounded(module.horizontal), "horizontal")
    for form in ("reference", "fast", "export"):
        module.form = form
        result = module(features)
        assert result.shape == (2, 12, 6, 7)
        torch.testing.assert_close(result, torch.cat([up, down, right, left], 1))


def test_sequential_reads_the_last_output() -> None:
    module = SequentialMessagePassing(2, 3)
    features = torch.randn(1, 2, 4, 5)
    expected = features
    for kernels, axis in ((module.vertical, "vertical"), (module.horizontal, "horizontal")):
        for direction in (0, 1):
            expected = pass_reference(expected, bounded(kernels), axis)[direction]
    torch.testing.assert_close(module(features), expected)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 999), scale=st.sampled_from([0.01, 1.0, 1e4]))
def test_no_kernels_diverge(seed: int, scale: float) -> None:
    # Free kernels grow as gain^L: at scale 1e4 they would overflow within ten slices.
    torch.manual_seed(seed)
    module = FoldedMessagePassing(4, 5)
    with torch.no_grad():
        for kernel in module.parameters():
            kernel.mul_(scale)
        features = torch.randn(1, 4, 200, 3)
        result = module(features)
    assert result.abs().max() <= features.abs().max() * 200


def test_bounding_leaves_small_rows_alone_and_scales_the_others_to_one() -> None:
    kernels = torch.zeros(2, 2, 2, 3)
    kernels[0, 0, 1] = torch.tensor([0.2, -0.3, 0.4])
    kernels[1, 1] = -2.0
    result = bounded(kernels)
    assert torch.equal(result[0], kernels[0])
    assert torch.allclose(result[1, 1], torch.full((2, 3), -1 / 6))


def test_kernels_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match=r"expected \(2, 3, 3, k\) with an odd k"):
        pass_fast(torch.zeros(1, 3, 4, 4), torch.zeros(2, 3, 3, 4), "vertical")
    with pytest.raises(ValueError, match="odd taps, got 8, 2"):
        FoldedMessagePassing(8, 2)
