from pathlib import Path

import pytest
import torch

from fscnn.models import build, settings_of
from fscnn.training.config import TrainConfig, load, save
from fscnn.training.schedule import Clock, ScheduleConfig, rate_factor
from railinspect.errors import BadInputError

CONFIGS = sorted((Path(__file__).parents[3] / "configs").glob("*.yaml"))


def test_defaults_then_file_then_command_line(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("seed: 3\noptimiser:\n  rate: 1e-3\n  clip: 2\n")
    config = load(file, ["optimiser.clip=9", "data.crop_wh=[64, 32]"])
    assert config.seed == 3
    assert config.optimiser.rate == 1e-3  # YAML 1.1 would read this as text
    assert config.optimiser.clip == 9.0
    assert config.data.crop_wh == [64, 32]
    assert config.optimiser.average == TrainConfig().optimiser.average


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_every_shipped_configuration_loads(path: Path) -> None:
    config = load(path)
    with torch.device("meta"):
        assert settings_of(build(config.network, config.settings))
    assert Path(config.run.out).name == path.stem


def test_saved_configuration_reads_back_equal(tmp_path: Path) -> None:
    config = load(None, ["seed=5", "data.train_scenes=[0, 4]", "settings={message_taps: 5}"])
    save(config, tmp_path / "config.yaml")
    assert load(tmp_path / "config.yaml") == config


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("optimiser.rat=1", r"unknown setting 'optimiser\.rat'; did you mean optimiser\.rate\?"),
        ("qqq=1", "unknown setting 'qqq'; known: seed"),
        ("seed=abc", r"seed must be of type int, got 'abc'"),
        ("seed=true", "seed must be of type int, got True"),
        ("data.crop_wh=[a, b]", r"data\.crop_wh\[0\] must be of type int"),
        ("data=3", "data must be a group of settings, got 3"),
        ("seed", "'seed' is not of the form key=value"),
    ],
)
def test_wrong_settings_are_refused(override: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        load(None, [override])


def test_file_that_is_no_mapping(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("[1, 2]")
    with pytest.raises(BadInputError, match="must be a mapping"):
        load(file)
    with pytest.raises(BadInputError, match="cannot read configuration"):
        load(tmp_path / "none.yaml")


@pytest.mark.parametrize("shape", ["cosine", "poly"])
def test_rate_rises_then_falls_to_nearly_nothing(shape: str) -> None:
    config = ScheduleConfig(warmup=0.1, shape=shape, final=0.01)
    rates = [rate_factor(i / 100, config) for i in range(101)]
    assert rates[0] < 0.01
    assert rates[10] == pytest.approx(1, abs=0.02)
    assert rates[:11] == sorted(rates[:11])
    assert rates[10:] == sorted(rates[10:], reverse=True)
    assert rates[-1] == pytest.approx(0.01)
    assert rate_factor(2.0, config) == rates[-1]


def test_nearest_limit_drives_progress() -> None:
    clock = Clock(ScheduleConfig(max_epochs=10, max_minutes=1), spent_s=30)
    assert clock.progress(steps=1, steps_per_epoch=10) == pytest.approx(0.5, abs=0.01)
    assert clock.progress(steps=90, steps_per_epoch=10) == pytest.approx(0.9, abs=0.01)
