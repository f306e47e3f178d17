"""Settings of the whole test suite."""

from hypothesis import settings

# Shared machines stall; a slow example is no failing one.
settings.register_profile("shared", deadline=None)
settings.load_profile("shared")

collect_ignore_glob = ["tests/*/conftest.py", "runs/*", "build/*", "train.py", "evaluate.py"]
