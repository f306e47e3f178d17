"""The train file: what it accepts, and one clear sentence for what it does not."""

import re
from pathlib import Path

import pytest
import yaml

import railops
from railops.braking import Brake, Train
from railops.errors import FileError, RailOpsError

DOCS = Path(railops.__file__).parents[1] / "docs" / "braking.md"


def write(tmp_path, text):
    path = tmp_path / "train.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_documented_file_is_a_train(tmp_path):
    block = re.search(r"```yaml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)[1]
    train = Train.load(write(tmp_path, block))
    assert train.emergency == Brake(((0.0, 1.1), (30.0, 0.9)), 0.4, 1.2)
    assert train.line.radius_m(600.0) == 400.0
    train.save(tmp_path / "again.yaml")
    assert Train.load(tmp_path / "again.yaml") == train
    assert set(yaml.safe_load(block)) <= set(Train.__dataclass_fields__)


def test_numbers_that_yaml_takes_for_text_are_numbers(tmp_path):
    path = write(tmp_path, "speed_mps: 2e1\ndavis: {c0: 1e-2}\nmass_kg: '4.8e5'\n")
    train = Train.load(path)
    assert (train.speed_mps, train.davis.c0, train.mass_kg) == (20.0, 0.01, 480_000.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed_mps: 20\nlenght_m: 5\n", r"has unknown keys \['lenght_m'\]; known: \['speed_mps'"),
        ("speed_mps: 20\nservice: {decel_mps2: 0.7}\n", "service is incomplete or mistyped: .*del"),
        ("speed_mps: 20\nservice: 0.7\n", "service: Brake must be a mapping, not 0.7"),
        ("- 1\n- 2\n", "must hold a mapping"),
        ("speed_mps: [", "cannot read train file"),
        ("length_m: 100\n", "has no speed_mps, and no speed was given"),
        ("speed_mps: fast\n", r"speed_mps is fast m/s; expected a number in \[0, 150\] m/s"),
        ("speed_mps: true\n", "speed_mps is True m/s; expected a number"),
        ("speed_mps: 160\n", r"speed_mps is 160 m/s; .* \(speeds are in metres per second"),
        ("speed_mps: .nan\n", "speed_mps is nan m/s"),
        ("speed_mps: -3\n", "speed_mps is -3 m/s"),
        (
            "speed_mps: 20\nemergency: {decel_mps2: 0, delay_s: 1, build_up_s: 1}\n",
            r"train.yaml: emergency: decel_mps2 is 0.0 m/s²; expected a number in \(0, 5\] m/s²",
        ),
        (
            "speed_mps: 20\nline: {gradients: [[0, 0.9]]}\n",
            r"line: gradient is 0.9 m/m; .* \(25 ‰ is 0.025\)",
        ),
        ("speed_mps: 20\nline: {gradients: steep}\n", r"gradients is steep; expected a list of"),
    ],
)
def test_a_bad_file_is_one_sentence_naming_file_key_value_and_range(tmp_path, text, message):
    with pytest.raises(FileError, match=message) as refused:
        Train.load(write(tmp_path, text))
    assert "train.yaml" in str(refused.value)
    assert isinstance(refused.value, RailOpsError)
    assert isinstance(refused.value, ValueError)
