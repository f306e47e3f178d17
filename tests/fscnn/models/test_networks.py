import pytest
import torch
import torchvision

from fscnn.models import NAMES, build, decide, rail_probability, settings_of, split
from fscnn.models.backbones import BACKBONES, IMAGENET_MEAN, IMAGENET_STD, Backbone
from railinspect.errors import BadInputError
from railinspect.labels import HUMAN, RAIL_EMBEDDED, RAIL_RAISED, SKY


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("height_width", [(48, 80), (50, 66)])
def test_every_network_builds_and_scores_all_classes(
    name: str, height_width: tuple[int, int]
) -> None:
    with torch.device("meta"), torch.no_grad():  # shapes without arithmetic
        network = build(name).eval()
        scores = network(torch.empty(2, 3, *height_width))
    stride = network.stride
    assert scores.shape[1] in (19, 19 + stride**2)
    assert scores.shape[2:] == (height_width[0] // stride, height_width[1] // stride)


@pytest.mark.parametrize("backbone", BACKBONES)
@pytest.mark.parametrize("name", ["fscnn", "scnn", "deeplabv3", "lraspp"])
def test_every_backbone_carries_every_head(name: str, backbone: str) -> None:
    settings = {"backbone": backbone}
    if name in ("scnn", "deeplabv3"):
        settings["stride"] = 16
    with torch.device("meta"), torch.no_grad():
        network = build(name, settings).eval()
        assert network(torch.empty(1, 3, 64, 96)).shape[2:] == (32, 48)


@pytest.mark.parametrize("name", NAMES)
def test_settings_rebuild_the_network(name: str) -> None:
    with torch.device("meta"):
        network = build(name)
        again = build(name, settings_of(network))
    shapes = [{k: v.shape for k, v in n.state_dict().items()} for n in (network, again)]
    assert shapes[0] == shapes[1]
    assert settings_of(again) == settings_of(network)


@pytest.mark.parametrize("name", BACKBONES)
def test_cut_backbones_lack_only_what_has_stride_32(name: str) -> None:
    with torch.device("meta"):
        whole, part = Backbone(name), Backbone(name, cut=True)
        maps = part.eval()(torch.empty(1, 3, 64, 96))
    assert [m.shape[2] for m in maps] == [32, 16, 8, 4]
    assert tuple(m.shape[1] for m in maps) == part.channels
    kept = part.state_dict().keys()
    assert kept < whole.state_dict().keys()
    dropped = sum(w.numel() for k, w in whole.state_dict().items() if k not in kept)
    assert dropped > 0.3 * sum(w.numel() for w in whole.state_dict().values())


def test_rivals_have_their_published_number_of_weights() -> None:
    # FRRN-B: 24.8 M with Cityscapes' 19 classes. DeepLabV3-ResNet50: torchvision's count of
    # 39.64 M, at 21 classes and with a norm of 512 weights in the pooled branch.
    with torch.device("meta"):
        counts = {n: sum(w.numel() for w in build(n).parameters()) for n in ("frrn_b", "deeplabv3")}
        theirs = torchvision.models.segmentation.deeplabv3_resnet50(
            weights=None, weights_backbone=None, num_classes=19
        )
    assert counts["frrn_b"] == pytest.approx(24.8e6, rel=0.01)
    assert counts["deeplabv3"] == pytest.approx(
        sum(w.numel() for w in theirs.parameters()), rel=1e-3
    )


def test_backbone_and_stride_that_do_not_exist() -> None:
    with pytest.raises(BadInputError, match="unknown backbone 'vgg'; known: resnet50"):
        build("fscnn", {"backbone": "vgg"})
    with pytest.raises(BadInputError, match="mobilenet_v3_small cannot have stride 8"):
        build("scnn", {"backbone": "mobilenet_v3_small"})


def test_imagenet_weights_that_cannot_be_had(monkeypatch: pytest.MonkeyPatch) -> None:
    backbone = Backbone("mobilenet_v3_small")

    def offline(*_: object, **__: object) -> None:
        raise OSError("no route to host")

    monkeypatch.setattr(torchvision.models, "get_model", offline)
    with pytest.raises(
        BadInputError,
        match=r"weights of mobilenet_v3_small \(no route to host\); download https.*checkpoints",
    ):
        backbone.load_imagenet()


def test_imagenet_weights_take_plain_rgb(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    published = torchvision.models.mobilenet_v3_small(weights=None, dilated=True).eval()
    norm = published.features[0][1]
    norm.running_mean.uniform_(-1, 1)
    backbone = Backbone("mobilenet_v3_small").eval()
    monkeypatch.setattr(torchvision.models, "get_model", lambda *_, **__: published)
    image = torch.rand(1, 3, 32, 48)
    mean, std = (torch.tensor(v).view(1, 3, 1, 1) for v in (IMAGENET_MEAN, IMAGENET_STD))
    with torch.no_grad():
        expected = published.features[0]((image - mean) / std)
        backbone.load_imagenet()
        found = backbone.stages[0](image)
    inside = (..., slice(1, -1), slice(1, -1))  # the padding's zeros mean another colour
    torch.testing.assert_close(found[inside], expected[inside], rtol=1e-4, atol=1e-5)
    assert not torch.allclose(found[..., 0, :], expected[..., 0, :])


def test_batching_changes_nothing() -> None:
    torch.manual_seed(0)
    network = build("fscnn_s").eval()
    images = torch.rand(3, 3, 48, 64)
    with torch.no_grad():
        alone = torch.cat([network(image[None]) for image in images])
        torch.testing.assert_close(network(images), alone, rtol=1e-4, atol=1e-4)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(BadInputError, match="unknown network 'fscnn_x'; known: fscnn_s"):
        build("fscnn_x")
    with pytest.raises(BadInputError, match="no setting 'width'"):
        build("fscnn_s", {"width": 3})


def scores_of(cells: list[list[dict[int, float]]]) -> torch.Tensor:
    scores = torch.zeros(1, 19, len(cells), len(cells[0]))
    for v, row in enumerate(cells):
        for u, cell in enumerate(row):
            for label, value in cell.items():
                scores[0, label, v, u] = value
    return scores


def test_decide_takes_the_likeliest_class_and_says_how_sure() -> None:
    labels, confidence, rail_score = decide(scores_of([[{SKY: 50.0}, {HUMAN: 50.0}]]))
    assert labels.tolist() == [[[SKY, SKY, HUMAN, HUMAN]] * 2]
    assert confidence.unique().tolist() == [255]
    assert rail_score.unique().tolist() == [0]
    assert {part.dtype for part in (labels, confidence, rail_score)} == {torch.uint8}


def test_decide_equals_softmax_where_nothing_varies() -> None:
    torch.manual_seed(1)
    one = torch.randn(5, 19) * 3
    labels, confidence, rail_score = decide(one[:, :, None, None].expand(5, 19, 3, 4))
    chances = one.softmax(1)
    rails = chances[:, RAIL_RAISED:].sum(1)
    is_rail = (rails * 255).round() >= 128
    expected = torch.where(
        is_rail, RAIL_RAISED + chances[:, RAIL_RAISED:].argmax(1), chances[:, :17].argmax(1)
    )
    for i in range(5):
        assert labels[i].unique().tolist() == [int(expected[i])]
        assert abs(int(confidence[i, 0, 0]) - float(chances[i].max() * 255)) <= 0.51
        assert abs(int(rail_score[i, 0, 0]) - float(rails[i] * 255)) <= 0.51


def test_rails_are_decided_between_cells_and_keep_their_kind() -> None:
    # Three cells, the middle one embedded rail with P = 1: at full size P is 1/4, 3/4, 3/4, 1/4.
    cells = [[{SKY: 60.0}, {RAIL_EMBEDDED: 60.0}, {SKY: 60.0}]]
    labels, _, rail_score = decide(scores_of(cells))
    assert labels[0, 0].tolist() == [SKY, SKY, RAIL_EMBEDDED, RAIL_EMBEDDED, SKY, SKY]
    assert rail_score[0, 0].tolist() == [0, 64, 191, 191, 64, 0]


def test_rail_probability_is_the_sum_of_both_kinds() -> None:
    scores = torch.zeros(1, 19, 1, 1)
    assert rail_probability(scores, None).flatten().tolist() == pytest.approx([2 / 19] * 4)


def test_rail_scores_of_a_cells_pixels_decide_where_there_are_any() -> None:
    # The classes say sky; of the cell's four pixels, row by row, the second and third are rail.
    scores = torch.zeros(1, 23, 1, 1)
    scores[0, SKY], scores[0, RAIL_EMBEDDED] = 60.0, 1.0
    scores[0, 19:, 0, 0] = torch.tensor([-60.0, 60.0, 60.0, -60.0])
    labels, confidence, rail_score = decide(scores)
    assert labels[0].tolist() == [[SKY, RAIL_EMBEDDED], [RAIL_EMBEDDED, SKY]]
    assert rail_score[0].tolist() == [[0, 255], [255, 0]]
    assert confidence.unique().tolist() == [255]
    assert rail_probability(*split(scores)).flatten().tolist() == pytest.approx([0, 1, 1, 0])


def test_huge_scores_stay_finite() -> None:
    labels, confidence, _ = decide(scores_of([[{SKY: 1e4, HUMAN: -1e4}]]))
    assert labels[0, 0, 0] == SKY
    assert confidence[0, 0, 0] == 255
