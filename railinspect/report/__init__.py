"""The report of a run: one HTML file that needs nothing beside it and no network."""

from railinspect.report.page import write_report

__all__ = ["write_report"]
