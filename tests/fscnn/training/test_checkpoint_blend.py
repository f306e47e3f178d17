"""The mean of two checkpoints' weights."""

from pathlib import Path

import pytest
import torch

from export.bundle import _public
from fscnn.models import build
from fscnn.training import checkpoint
from fscnn.training.blend import main
from fscnn.training.checkpoint import KEY

SMALL = {"widths": [8, 8, 8, 8], "blocks": [1, 1, 1], "message_channels": 8, "context": 8}


def write(path: Path, seed: int, **settings: object) -> Path:
    torch.manual_seed(seed)
    chosen = {**SMALL, **settings}
    network = build("fscnn_s", chosen)
    entry = {
        "network": "fscnn_s",
        "settings": chosen,
        "norms_folded": False,
        "average": network.state_dict(),
        "recipe": {"seed": seed},
        "fingerprint": str(seed),
        "steps": seed,
    }
    torch.save({KEY: entry}, path)
    return path


def test_every_weight_is_the_mean_and_the_rest_is_the_seconds(tmp_path: Path) -> None:
    first, second = (write(tmp_path / f"{seed}.ckpt", seed) for seed in (1, 2))
    out = tmp_path / "mean.ckpt"
    assert main([str(first), str(second), "--out", str(out), "--share", "0.25"]) == 0
    a, b, mean = (checkpoint.load(path).network.state_dict() for path in (first, second, out))
    assert any(not torch.equal(a[name], b[name]) for name in a)
    for name, weight in mean.items():
        if weight.is_floating_point():
            torch.testing.assert_close(weight, 0.75 * a[name] + 0.25 * b[name])
        else:
            assert torch.equal(weight, b[name])
    trained = checkpoint.load(out)
    assert (trained.fingerprint, trained.steps) == ("2", 2)
    assert trained.recipe["blended_with"] == {"recipe": {"seed": 1}, "share": 0.75}
    assert [path.name for path in tmp_path.glob("*.part")] == []


@pytest.mark.parametrize(
    ("settings", "share", "message"),
    [
        ({"context": 16}, "0.5", "networks of different shapes; blend stages of one training"),
        ({}, "1.5", "share is 1.5; give 0 to 1"),
    ],
)
def test_what_cannot_be_blended_is_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    settings: dict[str, int],
    share: str,
    message: str,
) -> None:
    first, second = write(tmp_path / "1.ckpt", 1), write(tmp_path / "2.ckpt", 2, **settings)
    out = tmp_path / "mean.ckpt"
    assert main([str(first), str(second), "--out", str(out), "--share", share]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_bundle_names_no_folder_of_either_training() -> None:
    own = {"data": {"train_folders": ["/here"], "zoom": [1.0, 1.0]}, "run": {"out": "/there"}}
    public = _public({**own, "blended_with": {"recipe": {**own, "start_from": "/x"}, "share": 0.5}})
    plain = {"data": {"zoom": [1.0, 1.0]}, "run": {}}
    assert public == {**plain, "blended_with": {"recipe": plain, "share": 0.5}}
