"""Networks in plain torch; nothing here knows how they are trained."""

from fscnn.models.decision import decide, rail_probability, split
from fscnn.models.fscnn_s import FscnnS, FscnnSConfig
from fscnn.models.message_passing import FoldedMessagePassing, SequentialMessagePassing
from fscnn.models.registry import NAMES, build, settings_of

__all__ = [
    "NAMES",
    "FoldedMessagePassing",
    "FscnnS",
    "FscnnSConfig",
    "SequentialMessagePassing",
    "build",
    "decide",
    "rail_probability",
    "settings_of",
    "split",
]
