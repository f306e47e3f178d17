"""Settings of every test of the export."""

from tests.fscnn.conftest import one_thread

__all__ = ["one_thread"]
