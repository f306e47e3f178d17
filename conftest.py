"""Settings of the whole test suite."""

import os

from hypothesis import settings

# Shared machines stall; a slow example is no failing one.
# The same examples every time, so that a change is judged by what it changed. The long form,
# `HYPOTHESIS_PROFILE=fuzz pytest`, draws new ones and twenty times as many.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.register_profile("fuzz", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))

collect_ignore_glob = ["tests/*/conftest.py", "runs/*", "build/*", "train.py", "evaluate.py"]
