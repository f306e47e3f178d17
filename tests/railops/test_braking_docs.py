"""Every example in the documentation and in the docstrings of railops runs."""

import doctest
import importlib
import pkgutil
from pathlib import Path

import pytest

import railops

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(railops.__path__, "railops.")
    if module.name.startswith(("railops.braking", "railops.traction", "railops.errors"))
)
DOCS = Path(railops.__file__).parents[1] / "docs"


@pytest.mark.parametrize("name", MODULES)
def test_docstring_examples(name):
    assert doctest.testmod(importlib.import_module(name), optionflags=FLAGS).failed == 0


def test_documentation_examples():
    found = doctest.testfile(str(DOCS / "braking.md"), module_relative=False, optionflags=FLAGS)
    assert found.attempted > 30
    assert found.failed == 0


def test_some_docstrings_have_examples():
    """The loop above must not pass for want of examples."""
    finder = doctest.DocTestFinder()
    tests = [t for name in MODULES for t in finder.find(importlib.import_module(name))]
    assert sum(bool(test.examples) for test in tests) >= 12
