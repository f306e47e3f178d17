"""A widened network gives the narrow one's numbers, and what cannot be widened is refused."""

from __future__ import annotations

import pytest
import torch

from fscnn.models import build
from fscnn.models.blocks import fold_norms
from fscnn.models.widen import widen
from railinspect.errors import BadInputError

SMALL = {"widths": [8, 8, 8, 16], "blocks": [1, 1, 2], "message_channels": 8, "context": 16}


@pytest.mark.parametrize("folded", [False, True])
def test_wider_maps_change_nothing_at_first_and_learn_then(folded: bool) -> None:
    narrow = build("fscnn_s", {**SMALL, "decoder": [8, 8, 8], "detail": 8})
    wide = build(
        "fscnn_s",
        {**SMALL, "widths": [16, 8, 16, 16], "decoder": [8, 16, 8], "detail": 16, "refine": 1},
    )
    if folded:
        narrow, wide = fold_norms(narrow), fold_norms(wide)
    widen(narrow, wide)
    image = torch.rand(2, 3, 32, 64)
    torch.testing.assert_close(wide.eval()(image), narrow.eval()(image))
    wide.train()(image).square().mean().backward()
    assert wide.up2.filter[0].weight.grad[:, 8:].abs().max() > 0
    refining = wide.refine[0].branch[1]
    learns = refining[0].weight if folded else refining[1].weight
    assert learns.grad.abs().max() > 0


def test_what_cannot_be_widened_is_refused() -> None:
    narrow = build("fscnn_s", SMALL)
    for weights in narrow.parameters():
        torch.nn.init.normal_(weights, std=0.2)  # as if trained: messages are nothing at first
    for settings in (
        {**SMALL, "widths": [8, 8, 8, 8]},  # narrower
        {**SMALL, "blocks": [2, 1, 2]},  # other layers
        {**SMALL, "widths": [8, 8, 8, 32]},  # stacked before the context
    ):
        with pytest.raises(BadInputError, match="cannot start one with"):
            widen(narrow, build("fscnn_s", settings))
