import pytest
import torch

from fscnn.training.loss import LossConfig, RailLoss
from railinspect.errors import BadInputError
from railinspect.labels import CLASSES, CONSTRUCTION, HUMAN, RAIL_RAISED, RAIL_TRACK, SKY, VOID


def perfect(masks: torch.Tensor, certainty: float = 30.0) -> torch.Tensor:
    one_hot = torch.nn.functional.one_hot(masks[:, ::2, ::2].long(), len(CLASSES))
    return one_hot.permute(0, 3, 1, 2).float() * certainty


def test_perfect_scores_cost_nothing_and_wrong_ones_much() -> None:
    masks = torch.full((2, 8, 8), SKY, dtype=torch.uint8)
    masks[:, 2:6] = RAIL_RAISED
    loss = RailLoss(LossConfig())
    good = loss(perfect(masks), masks)["total"]
    bad = loss(perfect(torch.full_like(masks, SKY)), masks)["total"]
    assert good < 0.5 < 5 < bad  # at a rail's edge cells straddle two classes: never exactly 0


def test_void_counts_nowhere() -> None:
    masks = torch.full((1, 8, 8), VOID, dtype=torch.uint8)
    scores = torch.randn(1, 19, 4, 4, requires_grad=True)
    total = RailLoss(LossConfig())(scores, masks)["total"]
    total.backward()
    assert total.item() == pytest.approx(0.0, abs=1e-6)
    assert float(scores.grad.abs().sum()) == 0


def test_gradient_is_finite_where_the_network_is_surely_wrong() -> None:
    masks = torch.full((1, 8, 8), RAIL_RAISED, dtype=torch.uint8)
    scores = torch.zeros(1, 19, 4, 4)
    scores[:, SKY] = 200
    scores.requires_grad_()
    RailLoss(LossConfig())(scores, masks)["total"].backward()
    assert torch.isfinite(scores.grad).all()


def test_an_obstacle_weighs_more_near_the_track_than_away_from_it() -> None:
    masks = torch.full((1, 160, 96), SKY, dtype=torch.uint8)
    masks[:, :40] = RAIL_TRACK
    masks[:, 20:24] = CONSTRUCTION  # on the track
    masks[:, 30:34] = HUMAN
    masks[:, 150:154] = CONSTRUCTION  # a house, far from it
    masks[:, 158:] = VOID
    weights = RailLoss(LossConfig(small_weight=3.0))._weights(masks[:, ::2, ::2].long())
    assert [float(weights[0, v // 2, 5]) for v in (10, 22, 32, 100, 152, 159)] == [1, 3, 3, 1, 1, 0]


def certain(masks: torch.Tensor, wrong: int) -> torch.Tensor:
    """Scores that are sure of ``masks`` but for the first ``wrong`` cells of the first image."""
    scores = perfect(masks, 4.0)
    flat = scores.flatten(2)
    flat[0, :, :wrong] = flat[0, :, :wrong].roll(1, 0)
    return scores


@pytest.mark.parametrize("wrong", [2, 4])
def test_only_the_hardest_cells_count(wrong: int) -> None:
    masks = torch.full((1, 8, 8), SKY, dtype=torch.uint8)
    scores = certain(masks, wrong).requires_grad_()
    masks[:, 6:] = VOID  # twelve cells are left; a quarter of them is three
    easy = torch.nn.functional.cross_entropy(scores[:, :, 2, 3], torch.tensor([SKY])).item()
    hard = torch.nn.functional.cross_entropy(scores[:, :, 0, 0], torch.tensor([SKY])).item()
    assert hard > easy + 3
    classes = RailLoss(LossConfig(hardest=0.25))(scores, masks)["classes"]
    assert classes.item() == pytest.approx((2 * hard + easy) / 3 if wrong == 2 else hard)
    classes.backward()
    assert int((scores.grad.abs().sum(1) > 0).sum()) == 3
    assert float(scores.grad[..., 3, :].abs().sum()) == 0  # void


def test_the_hardest_cells_stand_in_for_the_weights() -> None:
    masks = torch.full((1, 8, 8), HUMAN, dtype=torch.uint8)
    masks[:, :, 4:] = SKY
    scores = perfect(masks, 2.0)
    plain, heavy = (
        RailLoss(LossConfig(hardest=0.5, small_weight=w))(scores, masks)["classes"] for w in (1, 9)
    )
    assert plain == heavy


def test_hardest_cells_of_nothing_and_of_nan() -> None:
    masks = torch.full((1, 8, 8), VOID, dtype=torch.uint8)
    scores = torch.randn(1, 19, 4, 4, requires_grad=True)
    mining = RailLoss(LossConfig(hardest=0.25))
    mining(scores, masks)["total"].backward()
    assert float(scores.grad.abs().sum()) == 0
    masks[:] = SKY
    scores = torch.zeros(1, 19, 4, 4)
    scores[0, 0, 1, 1] = torch.nan  # must reach the guard, however few cells count
    assert torch.isnan(mining(scores, masks)["classes"])


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, float("nan")])
def test_shares_that_are_none(share: float) -> None:
    with pytest.raises(BadInputError, match=r"loss\.hardest is .*above 0 and at most 1"):
        RailLoss(LossConfig(hardest=share))
