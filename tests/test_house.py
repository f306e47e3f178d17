"""The house rules that tools can hold: style, types, import contracts, and a torch-free runtime."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    "command",
    [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        ["mypy"],
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_tool_is_content(command: list[str]) -> None:
    run = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_import_contracts_hold() -> None:
    script = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run([script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def loaded_after(statement: str) -> set[str]:
    code = (
        f"{statement}\nimport sys\nprint(*sorted({{name.split('.')[0] for name in sys.modules}}))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(run.stdout.split())


TRAINING_STACK = {"torch", "torchvision", "lightning", "albumentations", "onnx", "onnxscript"}


def test_runtime_never_loads_the_training_stack() -> None:
    modules = (
        "railinspect, railinspect.cli, railinspect.scenes, railops, railops.braking, railops.cli"
    )
    assert not TRAINING_STACK & loaded_after(f"import {modules}")


def test_the_check_above_can_fail() -> None:
    assert "onnx" in loaded_after("import railinspect, onnx")


def test_the_readme_leads_to_every_page_and_every_link_leads_somewhere() -> None:
    texts = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    linked: dict[Path, set[Path]] = {}
    for text in texts:
        targets = re.findall(r"\]\(([^)#\s]+)", text.read_text(encoding="utf-8"))
        inside = [target for target in targets if "://" not in target]
        linked[text] = {(text.parent / target).resolve() for target in inside}
    broken = {text.name: {x for x in found if not x.exists()} for text, found in linked.items()}
    assert not any(broken.values()), broken
    unread = {page for page in texts if page.parent.name == "docs"} - linked[ROOT / "README.md"]
    assert not unread, f"README.md leads to none of {sorted(page.name for page in unread)}"


def test_the_fuzz_profile_is_documented_and_there() -> None:
    name = re.findall(r"HYPOTHESIS_PROFILE=(\w+)", (ROOT / "CONTRIBUTING.md").read_text("utf-8"))
    assert name == ["fuzz"]
    usual, long = (settings.get_profile(name).max_examples for name in ("suite", "fuzz"))
    assert long >= 20 * usual
