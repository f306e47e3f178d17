import pytest
import torch

from fscnn.training.loss import LossConfig, RailLoss
from railinspect.labels import CLASSES, RAIL_RAISED, SKY, VOID


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
    assert float(scores.grad.abs().sum()) == 0  # type: ignore[union-attr]


def test_gradient_is_finite_where_the_network_is_surely_wrong() -> None:
    masks = torch.full((1, 8, 8), RAIL_RAISED, dtype=torch.uint8)
    scores = torch.zeros(1, 19, 4, 4)
    scores[:, SKY] = 200
    scores.requires_grad_()
    RailLoss(LossConfig())(scores, masks)["total"].backward()
    assert torch.isfinite(scores.grad).all()  # type: ignore[arg-type]
