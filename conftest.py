"""Settings of the whole test suite."""

import os

from hypothesis import HealthCheck, settings

# Shared machines stall; a slow example is no failing one.
# The same examples every time, so that a change is judged by what it changed. The long form,
# `HYPOTHESIS_PROFILE=fuzz pytest`, draws new ones and twenty times as many.
unhurried = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("suite", derandomize=True, **unhurried)
settings.register_profile("fuzz", max_examples=2000, **unhurried)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))

collect_ignore_glob = ["tests/*/conftest.py", "runs/*", "build/*", "train.py", "evaluate.py"]
