"""Export against the network it came from: parity, graph, metadata, refusals, command line."""

import collections
import json
import warnings
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from export.__main__ import main
from export.bundle import FORBIDDEN, Exported, ParityError, compare, count_nodes, export
from export.deployed import Deployed
from export.quantise import Comparison, RefusedError, compare_speed_and_rails
from fscnn.models import build, settings_of
from fscnn.models.blocks import fold_norms
from fscnn.training.checkpoint import KEY, Trained, load
from fscnn.training.evaluation import evaluate, load_model
from railinspect.bundle import golden_image
from railinspect.errors import BadInputError
from railinspect.labels import RAIL_RAISED
from railinspect.segmenter import Segmenter, verify
from tests.fscnn.drawing import draw

SIZE_WH = (96, 64)
SETTINGS = {
    "widths": [8, 12, 16, 24],
    "blocks": [1, 1, 1],
    "message_channels": 8,
    "message_taps": 3,
    "context": 16,
}


def lively_network(seed: int = 0) -> nn.Module:
    """Random weights and norms whose statistics have seen pictures, so that all classes occur."""
    torch.manual_seed(seed)
    network = build("fscnn_s", SETTINGS).train()
    pictures = np.stack([draw(i)[0] for i in range(4)])
    for norm in network.modules():
        if isinstance(norm, nn.BatchNorm2d):
            norm.momentum = 1.0  # one batch is then all the statistics there are
    with torch.no_grad():
        network(torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255)
        nn.init.normal_(network.classify.weight, std=2.0)
    return network.eval()


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    network = lively_network()
    path = tmp_path_factory.mktemp("export") / "net.ckpt"
    held = {
        "network": "fscnn_s",
        "settings": settings_of(network),
        "norms_folded": False,
        "average": network.state_dict(),
        "recipe": {"seed": 4, "data": {"train_folders": ["/somewhere"]}, "run": {"out": "/else"}},
        "fingerprint": "ab" * 32,
        "steps": 7,
    }
    torch.save({KEY: held}, path)
    return path


@pytest.fixture(scope="module")
def exported(checkpoint: Path) -> tuple[Path, dict[str, object]]:
    """The command's own output, and the JSON it printed."""
    import contextlib
    import io

    out = checkpoint.with_name("net.onnx")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        status = main(
            [str(checkpoint), "--out", str(out), "--size", "96x64", "--scenes", "1", "--json"]
        )
    assert status == 0
    return out, json.loads(printed.getvalue())


def test_command_prints_one_document(exported: tuple[Path, dict[str, object]]) -> None:
    path, document = exported
    assert set(document) == set(Exported.__dataclass_fields__)
    assert document["size_bytes"] == path.stat().st_size
    assert document["input_size_wh"] == [96, 64]
    assert document["agreement"] >= 0.999
    assert document["score_difference"] <= 1


def test_checkpoint_equals_bundle_equals_runtime(
    checkpoint: Path, exported: tuple[Path, dict[str, object]]
) -> None:
    images = [golden_image(SIZE_WH), *(draw(seed)[0] for seed in range(4))]
    eager, runtime = load_model(checkpoint, SIZE_WH), Segmenter.load(exported[0], threads=1)
    seen = set()
    for image in images:
        a, b = eager(image), runtime(image)
        assert np.mean(a.labels == b.labels) >= 0.999
        # one rounding step: the same sums in another order
        assert np.abs(a.confidence.astype(int) - b.confidence).max() <= 1
        assert np.abs(a.rail_score.astype(int) - b.rail_score).max() <= 1
        seen |= set(np.unique(b.labels))
    assert len(seen) >= 5  # else agreement would say little


def test_metrics_are_the_same_from_both(
    checkpoint: Path, exported: tuple[Path, dict[str, object]]
) -> None:
    pairs = [draw(seed) for seed in range(3)]
    summaries = [
        evaluate(model, pairs).summary()
        for model in (load_model(checkpoint, SIZE_WH), load_model(exported[0]))
    ]
    for name in ("rail_iou", "mean_iou", "accuracy", "ece"):
        assert summaries[0][name] == pytest.approx(summaries[1][name], abs=2e-3, nan_ok=True)


def test_any_batch(exported: tuple[Path, dict[str, object]]) -> None:
    import onnxruntime

    session = onnxruntime.InferenceSession(str(exported[0]), providers=["CPUExecutionProvider"])
    images = np.stack([draw(seed)[0] for seed in range(3)])
    together = session.run(None, {"image": images})
    for i, image in enumerate(images):
        alone = session.run(None, {"image": image[None]})
        for a, b in zip(alone, together, strict=True):
            assert np.mean(a[0] == b[i]) >= 0.999


def test_graph_holds_nothing_it_must_not(exported: tuple[Path, dict[str, object]]) -> None:
    model = onnx.load(exported[0])
    onnx.checker.check_model(model, full_check=True)
    operators = {node.op_type for node in model.graph.node}
    assert not operators & set(FORBIDDEN)
    # all but the one behind the message passing are folded into the convolution before them
    assert count_nodes(model)["BatchNormalization"] == 1
    # the bound on the kernels is computed once, here
    assert not operators & {"Abs", "Clip", "Div"}
    assert len(model.functions) == 0


def test_metadata_says_where_it_comes_from_but_not_on_which_machine(
    exported: tuple[Path, dict[str, object]],
) -> None:
    metadata = Segmenter.load(exported[0]).metadata
    assert metadata.training["steps"] == 7
    assert metadata.training["recipe"] == {"seed": 4, "data": {}, "run": {}}
    assert metadata.training_fingerprint == "ab" * 32
    assert dict(metadata.nodes) == count_nodes(onnx.load(exported[0]))
    data = exported[0].read_bytes()
    for trace in (b"/somewhere", b"/else", str(Path(__file__).parents[2]).encode()):
        assert trace not in data


def test_verifies(exported: tuple[Path, dict[str, object]]) -> None:
    result = verify(Segmenter.load(exported[0]), repeats=1)
    assert result.identical
    assert result.passed


def test_folding_norms_changes_nothing() -> None:
    network = lively_network(1)
    image = torch.rand(1, 3, 32, 48)
    with torch.no_grad():
        before = network(image)
        after = fold_norms(network)(image)
    torch.testing.assert_close(after, before, rtol=1e-4, atol=1e-4)
    assert all(weights.requires_grad for weights in network.parameters())  # it is trained on
    assert Deployed(network)(torch.zeros(1, 32, 48, 3, dtype=torch.uint8))[0].shape == (1, 32, 48)


class Stubborn(nn.Module):
    """A stand-in for a network whose graph computes something else."""

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
        labels = torch.full(image.shape[:3], RAIL_RAISED, dtype=torch.uint8)
        return labels, labels, labels


def test_disagreement_is_found(exported: tuple[Path, dict[str, object]]) -> None:
    agreement, difference = compare(Stubborn(), Segmenter.load(exported[0]), (draw(0)[0],))
    assert agreement < 0.9
    assert difference > 1


def test_disagreeing_bundle_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exported: tuple[Path, dict[str, object]]
) -> None:
    graph = onnx.load(exported[0])
    monkeypatch.setattr("export.bundle.to_onnx", lambda *_: graph)
    other = Trained(lively_network(5), "fscnn_s", {}, False, {}, "", 0)
    with pytest.raises(ParityError, match=r"of the bundle's labels equal the checkpoint's"):
        export(other, tmp_path / "b.onnx", SIZE_WH)
    graph.graph.node[0].op_type = "ScatterND"
    with pytest.raises(ParityError, match="holds ScatterND, which no bundle may"):
        export(other, tmp_path / "b.onnx", SIZE_WH)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size_wh", [(100, 64), (96, 60), (48, 48)])
def test_sizes_that_do_not_fit(tmp_path: Path, size_wh: tuple[int, int]) -> None:
    trained = Trained(nn.Identity(), "fscnn_s", {}, False, {}, "", 0)
    with pytest.raises(BadInputError, match="divisible by 16 and at least 64"):
        export(trained, tmp_path / "b.onnx", size_wh)


def test_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "none.ckpt"), "--out", str(tmp_path / "b.onnx")]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "cannot read checkpoint" in printed.err
    with pytest.raises(SystemExit), warnings.catch_warnings():
        main(["x.ckpt", "--out", "b.onnx", "--size", "640"])
    assert "is not WIDTHxHEIGHT" in capsys.readouterr().err


@pytest.fixture(scope="module")
def trained(checkpoint: Path) -> Trained:
    return load(checkpoint)


def test_half_precision_halves_the_file(
    tmp_path: Path, trained: Trained, exported: tuple[Path, dict[str, object]]
) -> None:
    images = tuple(draw(seed)[0] for seed in range(2))
    done = export(trained, tmp_path / "half.onnx", SIZE_WH, images, "fp16")
    assert done.agreement >= 0.99
    model = onnx.load(done.path)
    kinds = collections.Counter()
    for tensor in model.graph.initializer:
        kinds[tensor.data_type] += int(np.prod(tensor.dims))
    assert kinds[onnx.TensorProto.FLOAT16] > 20 * kinds[onnx.TensorProto.FLOAT]
    assert Segmenter.load(done.path).metadata.training["precision"] == "fp16"


def int8_export(
    monkeypatch: pytest.MonkeyPatch,
    trained: Trained,
    exported: tuple[Path, dict[str, object]],
    out: Path,
    measured: Comparison | None,
) -> Exported:
    monkeypatch.setattr("export.bundle.to_onnx", lambda *_: onnx.load(exported[0]))
    if measured is not None:
        monkeypatch.setattr("export.bundle.compare_speed_and_rails", lambda *_: measured)
    labelled = [draw(seed) for seed in range(6)]
    return export(trained, out, SIZE_WH, (), "int8", labelled)


def test_eight_bits_are_kept_where_they_are_faster_and_keep_the_rails(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    trained: Trained,
    exported: tuple[Path, dict[str, object]],
) -> None:
    better = Comparison(0.001, 0.002, 0.50, 0.505)
    done = int8_export(monkeypatch, trained, exported, tmp_path / "b.onnx", better)
    assert done.comparison == better
    assert done.nodes["QuantizeLinear"] > 10
    assert done.nodes["DequantizeLinear"] > 20
    assert done.agreement > 0.5  # it still says much the same
    assert verify(Segmenter.load(done.path), repeats=1).passed


@pytest.mark.parametrize(
    ("measured", "reason"),
    [
        (Comparison(0.003, 0.002, 0.5, 0.5), r"takes 3\.0 ms a frame where the float.* 2\.0 ms"),
        (Comparison(0.001, 0.002, 0.48, 0.5), r"rail IoU is 0\.480 where the float.* is 0\.500"),
        (Comparison(0.003, 0.002, np.nan, 0.5), r"3\.0 ms .* and its rail IoU is nan"),
    ],
)
def test_eight_bits_are_refused_otherwise_and_the_message_says_why(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    trained: Trained,
    exported: tuple[Path, dict[str, object]],
    measured: Comparison,
    reason: str,
) -> None:
    with pytest.raises(RefusedError, match=f"int8 refused on this machine: it.*{reason}"):
        int8_export(monkeypatch, trained, exported, tmp_path / "b.onnx", measured)
    assert not list(tmp_path.iterdir())


def test_eight_bits_are_measured_not_assumed(exported: tuple[Path, dict[str, object]]) -> None:
    segmenter = Segmenter.load(exported[0], threads=1)
    labelled = [draw(seed) for seed in range(2)]
    found = compare_speed_and_rails(segmenter, segmenter, labelled, repeats=3)
    assert found.frame_s > 0
    assert found.float_frame_s > 0
    assert (
        found.rail_iou
        == found.float_rail_iou
        == evaluate(segmenter, labelled).summary()["rail_iou"]
    )


def test_precisions_that_cannot_be_had(tmp_path: Path, trained: Trained) -> None:
    with pytest.raises(BadInputError, match="unknown precision 'fp8'; known: fp32, fp16, int8"):
        export(trained, tmp_path / "b.onnx", SIZE_WH, (), "fp8")
    with pytest.raises(BadInputError, match=r"int8 needs labelled images .* got 1"):
        export(trained, tmp_path / "b.onnx", SIZE_WH, (), "int8", [draw(0)])


def test_published_backbone_exports_at_another_size(tmp_path: Path) -> None:
    torch.manual_seed(0)
    settings = {
        "backbone": "mobilenet_v3_small",
        "message_channels": 8,
        "message_taps": 3,
        "context": 8,
        "rates": [2],
        "light": True,
        "decoder": [8, 8, 8],
    }
    network = build("fscnn", settings).eval()
    other = Trained(network, "fscnn", settings, False, {}, "", 0)
    images = tuple(draw(seed, 160, 96)[0] for seed in range(2))
    done = export(other, tmp_path / "mobile.onnx", (160, 96), images)
    assert done.agreement >= 0.999
    assert done.input_size_wh == (160, 96)
    assert not set(done.nodes) & set(FORBIDDEN)
    assert Segmenter.load(done.path).metadata.network == "fscnn"
