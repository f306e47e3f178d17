from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from railinspect.errors import OutputError
from railinspect.runfolder import RUN_FILES, RunFolder, unique_names


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    RunFolder.claim(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_other_files_in_the_folder_are_left_alone(tmp_path):
    (tmp_path / "ride.mp4").write_text("mine")
    RunFolder.claim(tmp_path)
    assert (tmp_path / "ride.mp4").read_text() == "mine"


@pytest.mark.parametrize("name", [*RUN_FILES, *(f"{name}.part" for name in RUN_FILES)])
def test_a_folder_with_a_run_finished_or_not_is_refused(tmp_path, name):
    (tmp_path / name).touch()
    with pytest.raises(OutputError, match=rf"already holds a run \({name}\); name another folder"):
        RunFolder.claim(tmp_path)


def test_a_folder_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"cannot write to the output folder .*; choose a folder"):
        RunFolder.claim(tmp_path / "file" / "run")


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write to any folder"
)
def test_a_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="Permission denied"):
            RunFolder.claim(tmp_path)
    finally:
        tmp_path.chmod(0o700)


def test_names_appear_only_when_published_and_run_json_last(tmp_path, monkeypatch):
    folder = RunFolder.claim(tmp_path)
    for name in ("run.json", "frames.jsonl", "overlay/a.mp4"):
        folder.part(name).write_text(name)
    assert not (tmp_path / "run.json").exists()
    assert folder.current("run.json").name == "run.json.part"
    order = []
    replace = Path.replace
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (order.append(to.name), replace(self, to))[1]
    )
    folder.publish()
    assert order[-1] == "run.json"
    assert (tmp_path / "overlay" / "a.mp4").read_text() == "overlay/a.mp4"
    assert folder.current("run.json").name == "run.json"


@settings(max_examples=50)
@given(st.lists(st.text(st.characters(exclude_characters="/\0", codec="utf-8"), max_size=30)))
def test_names_of_inputs_are_all_different_and_plain(stems):
    names = unique_names([Path("x") / f"{stem or 'a'}.mp4" for stem in stems])
    assert len({name.casefold() for name in names}) == len(stems)
    for name in names:
        assert name
        assert not set(name) & set('/\\<>:"|?*\n\r')
