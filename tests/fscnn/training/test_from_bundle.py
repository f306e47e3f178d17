"""Weights out of a bundle are the ones it runs with."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import onnx
import pytest
import torch

from fscnn.models import decide
from fscnn.training.config import load
from fscnn.training.fit import fit
from fscnn.training.from_bundle import load_bundle
from railinspect import Segmenter
from railinspect.bundle import golden_image
from railinspect.errors import BadInputError
from tests.fscnn.drawing import write_set

SHIPPED = Path(str(files("railinspect") / "bundles" / "fscnn_s.onnx"))


def test_the_network_labels_as_its_bundle_does() -> None:
    trained = load_bundle(SHIPPED)
    assert (trained.name, trained.norms_folded) == ("fscnn_s", True)
    rgb = golden_image(Segmenter.default().metadata.input_size_wh)
    with torch.no_grad():
        scores = trained.network(torch.from_numpy(rgb.copy()).permute(2, 0, 1)[None] / 255)
    labels, confidence, _ = decide(scores, trained.network.stride)
    expected = Segmenter.default()(rgb)
    assert (labels[0].numpy() == expected.labels).mean() >= 0.999
    off = confidence[0].int() - torch.from_numpy(expected.confidence.copy()).int()
    assert off.abs().max() <= 2


def test_training_starts_from_it_and_half_precision_scores_the_same(tmp_path: Path) -> None:
    write_set(tmp_path / "set", 4)
    scores = []
    for precision in ("32-true", "bf16-mixed"):
        config = load(
            None,
            [
                f"start_from={SHIPPED}",
                f"data.train_folders=[{tmp_path / 'set'}]",
                "data.val_scenes=[900100, 2]",
                "data.crop_wh=[96, 64]",
                "data.batch_size=2",
                "data.workers=0",
                "schedule.max_steps=1",
                "optimiser.rate=0",
                "run.examples=0",
                "run.progress=false",
                f"run.precision={precision}",
                f"run.out={tmp_path / precision}",
            ],
        )
        scores.append(fit(config))
    held = torch.load(tmp_path / "32-true" / "last.ckpt", weights_only=True)["fscnn"]
    assert held["norms_folded"]
    assert held["recipe"]["settings"] == held["settings"] == load_bundle(SHIPPED).settings
    before = load_bundle(SHIPPED).network.state_dict()
    assert torch.equal(held["average"]["classify.weight"], before["classify.weight"])
    whole, half = (score["val/rail_iou"] for score in scores)
    assert whole > 0.3
    assert half == pytest.approx(whole, abs=0.02)


def test_what_is_no_such_bundle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="cannot read bundle"):
        load_bundle(tmp_path / "none.onnx")
    (text := tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(BadInputError, match="is not an ONNX file"):
        load_bundle(text)
    model = onnx.load(SHIPPED)
    model.graph.initializer[0].name = "network.stem.0.weight_quantized"
    onnx.save(model, other := tmp_path / "other.onnx")
    with pytest.raises(BadInputError, match=r"does not hold stem\.0\.weight of network fscnn_s"):
        load_bundle(other)
    del model.metadata_props[:]
    onnx.save(model, other)
    with pytest.raises(ValueError, match=str(other)):
        load_bundle(other)
