"""The errors a caller may want to tell apart; each is also the built-in error it refines."""

from __future__ import annotations


class RailInspectError(Exception):
    """Root of the package's own errors. Its message is one sentence a user can act on."""


class BadInputError(RailInspectError, ValueError):
    """A file, a setting or a value that cannot be used as given."""


class BundleError(BadInputError):
    """A model bundle that is not ours, is damaged, or disagrees with its own metadata."""


class OutputError(RailInspectError, OSError):
    """A place results cannot be written to."""
