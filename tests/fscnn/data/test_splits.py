import json
from pathlib import Path

import pytest

from fscnn.data.datasets import FolderSource, JoinedSource, SceneSource
from fscnn.data.module import DataConfig, RailData
from fscnn.data.splits import PROTOCOLS, Split, draw, load, main, of_folder, pairs_of
from railinspect.errors import BadInputError
from tests.fscnn.drawing import write_set

NAMES = [f"rs{i:05d}" for i in range(8500)]


def test_the_papers_protocol_and_the_full_one() -> None:
    for name, counts in (("paper", (3000, 500, 500)), ("full", (6800, 850, 850))):
        split = draw(NAMES, PROTOCOLS[name], name, seed=3)
        parts = (split.train, split.val, split.test)
        assert tuple(len(part) for part in parts) == counts
        assert len({n for part in parts for n in part}) == sum(counts)
        assert split.seed == 3
    assert draw(NAMES[::-1], PROTOCOLS["paper"], "paper", 3) == draw(
        NAMES, PROTOCOLS["paper"], "paper", 3
    )
    assert draw(NAMES, PROTOCOLS["paper"], "paper", 4) != draw(
        NAMES, PROTOCOLS["paper"], "paper", 3
    )


def test_command_saves_the_list_that_a_run_uses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_set(tmp_path / "set", 6, inner="rs19_val")
    out = tmp_path / "mine.json"
    arguments = [str(tmp_path / "set"), "--counts", "3", "2", "1", "--seed", "5", "--out", str(out)]
    assert main(arguments) == 0
    assert "3 train, 2 val, 1 test of 6 images, seed 5" in capsys.readouterr().out
    split = load(out)
    assert (split.name, split.seed) == ("mine", 5)
    data = RailData(
        DataConfig(railsem=str(tmp_path / "set"), split=str(out), crop_wh=[48, 32]), seed=0
    )
    assert data.split == split
    assert tuple(pair.image.stem for pair in data.train_files) == split.train
    assert [pair.image.stem for pair in pairs_of(tmp_path / "set", split, "test")] == [*split.test]


def test_protocols_refuse_what_they_cannot_be_drawn_from(tmp_path: Path) -> None:
    write_set(tmp_path, 2)
    with pytest.raises(BadInputError, match="split paper needs 4000 images but there are 2"):
        of_folder(tmp_path, "paper", 0)
    with pytest.raises(BadInputError, match="leaves a part empty"):
        draw(NAMES, (1, 0, 1), "x", 0)
    assert main([str(tmp_path), "--protocol", "full", "--out", str(tmp_path / "s.json")]) == 2


def test_splits_that_cannot_be_used(tmp_path: Path) -> None:
    write_set(tmp_path / "set", 2)
    path = tmp_path / "s.json"
    with pytest.raises(BadInputError, match="cannot read split"):
        load(path)
    path.write_text("[1]")
    with pytest.raises(BadInputError, match="is no split"):
        load(path)
    path.write_text(json.dumps({"train": ["a"], "val": ["b"], "test": ["a"]}))
    with pytest.raises(BadInputError, match="names image a twice"):
        load(path)
    split = Split("s", -1, ("rs00000", "rs00009"), ("rs00001",), ())
    with pytest.raises(BadInputError, match=r"1 images of split s are not in .*, rs00009 first"):
        pairs_of(tmp_path / "set", split, "train")
    with pytest.raises(BadInputError, match="part test of split s is empty"):
        pairs_of(tmp_path / "set", split, "test")
    with pytest.raises(BadInputError, match="unknown part 'tests'"):
        pairs_of(tmp_path / "set", split, "tests")


def test_folders_and_rendered_scenes_mix(tmp_path: Path) -> None:
    write_set(tmp_path, 2)
    joined = JoinedSource([FolderSource(tmp_path), SceneSource(5, 1)])
    assert len(joined) == 3
    assert joined(1)[0].shape == (64, 96, 3)
    image, mask = joined(2)
    assert image.shape[:2] == mask.shape != (64, 96)
