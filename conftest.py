"""Runs the Python examples of the docs pages and the README along with the tests."""

collect_ignore_glob = ["runs/*", "build/*", "train.py", "evaluate.py"]
