"""Where records and events go: JSON Lines, Parquet and the overlay video."""

from railinspect.sinks.json_lines import JsonLines
from railinspect.sinks.overlay import draw_overlay
from railinspect.sinks.overlay_video import OverlayVideo
from railinspect.sinks.parquet import write_events_parquet

__all__ = ["JsonLines", "OverlayVideo", "draw_overlay", "write_events_parquet"]
