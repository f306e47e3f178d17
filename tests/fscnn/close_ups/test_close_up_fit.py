"""The close-ups' network learns, comes back from its checkpoint, and is the same as ONNX."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from export.close_up import export, main
from fscnn.close_ups.fit import fit, load, told_at
from fscnn.close_ups.windows import SIZE_WH
from fscnn.models.close_up import CloseUpNet
from fscnn.training.checkpoint import KEY
from railinspect.close_ups import WINDOW_WH, CloseUpNetwork
from railinspect.errors import BadInputError


def write(folder: Path, name: str, seed: int) -> None:
    """Windows whose answer is the place of a bright block: an easy lesson."""
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 60, (48, SIZE_WH[1], SIZE_WH[0], 3), dtype=np.uint8)
    answers = np.arange(48, dtype=np.uint8) % 4
    for image, answer in zip(images, answers, strict=True):
        if answer:
            row = 12 + 24 * int(answer - 1)
            image[row : row + 14, 50:90] = 230
    np.savez(folder / name, images=images, answers=answers)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, float]]:
    folder = tmp_path_factory.mktemp("windows")
    for seed in range(6):
        write(folder, f"w{seed}.npz", seed)
    out = folder / "net.ckpt"
    return out, fit(folder, out, minutes=0, steps=120, batch=16)


def test_an_easy_lesson_is_learnt(trained: tuple[Path, dict[str, float]]) -> None:
    _, told = trained
    assert told["obstruction at 1 %"] > 0.9
    assert told["trespasser at 1 %"] > 0.9


def test_checkpoint_and_onnx_say_the_same(
    trained: tuple[Path, dict[str, float]], tmp_path: Path
) -> None:
    path, _ = trained
    out = tmp_path / "close_up.onnx"
    assert export(path, out) <= 1e-4
    network, said = load(path)
    runtime = CloseUpNetwork.load(out)
    assert runtime.metadata["training"] == said
    width, height = WINDOW_WH
    windows = np.random.default_rng(1).integers(0, 256, (5, height, width, 3), dtype=np.uint8)
    with torch.no_grad():
        exact = network(torch.from_numpy(windows)).softmax(1).numpy()
    assert np.abs(runtime.chances(windows) - exact).max() < 1e-4
    assert np.abs(exact - exact[:1]).max() > 1e-4  # the windows are told apart at all


def test_the_command_exports_and_refuses(
    trained: tuple[Path, dict[str, float]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = trained
    assert main([str(path), "--out", str(tmp_path / "a.onnx")]) == 0
    assert "within" in capsys.readouterr().out
    strange = tmp_path / "strange.ckpt"
    torch.save({KEY: {"network": "fscnn_s"}}, strange)
    assert main([str(strange), "--out", str(tmp_path / "b.onnx")]) == 2
    assert "fscnn.close_ups.fit" in capsys.readouterr().err
    assert not (tmp_path / "b.onnx").exists()


def test_weights_of_another_shape_are_refused(tmp_path: Path) -> None:
    held = {
        "network": "close_up",
        "settings": {"channels": [8, 8, 8, 8]},
        "average": CloseUpNet().state_dict(),
    }
    torch.save({KEY: held}, tmp_path / "a.ckpt")
    with pytest.raises(BadInputError, match="do not fit"):
        load(tmp_path / "a.ckpt")


@pytest.mark.parametrize("wrong", [{"minutes": 0.0}, {"rate": 0.0}, {"batch": 1}])
def test_settings_that_train_nothing_are_refused(tmp_path: Path, wrong: dict[str, float]) -> None:
    with pytest.raises(BadInputError, match="must be"):
        fit(tmp_path, tmp_path / "a.ckpt", **{"minutes": 1.0, **wrong})


def test_shares_are_told_from_the_clear_windows() -> None:
    clear = np.column_stack(
        [np.linspace(0, 1, 1001), 1 - np.linspace(0, 1, 1001)] + [np.zeros(1001)] * 2
    )
    found = np.array([[0.0005, 0.0, 0.9995, 0.0], [0.5, 0.0, 0.5, 0.0]])
    chances = np.concatenate([clear, found])
    answers = np.array([0] * 1001 + [2, 2])
    told = told_at(chances, answers)
    assert told == {
        "obstruction at 1 %": 0.5,
        "obstruction at 0.3 %": 0.5,
        "obstruction at 0.1 %": 0.5,
    }
